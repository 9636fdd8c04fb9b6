"""DXF documents as ezdxf reads them, and one sentence for whatever it trips over in a damaged one."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from recon.errors import ReconError, UnreadableFile

__all__ = ["MOST_ENTITIES", "damaged_dxf_refused", "dxf_document"]

MOST_ENTITIES = 500_000  # blocks within blocks unfold to any number out of a small file


@contextmanager
def damaged_dxf_refused(name: str) -> Iterator[None]:
    """Around all that touches a document: its entities are parsed when they are asked for. Raises UnreadableFile."""
    try:
        yield
    except (ReconError, MemoryError):
        raise
    except Exception as problem:
        raise UnreadableFile(name, "is no DXF file, or damaged beyond repair") from problem


def dxf_document(name: str) -> Any:
    """The document as it stands, repaired only when it cannot be read otherwise: repairing drops line types."""
    import ezdxf
    from ezdxf import recover

    try:
        return ezdxf.filemanagement.readfile(name)
    except Exception:  # noqa: BLE001 - of a damaged file anything may come, and the second reader is to judge it
        return recover.readfile(name)[0]

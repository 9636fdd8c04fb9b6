"""The content of a file that a user named, or one sentence that says why there is none.

Every reader begins here, so that a folder, a pipe, a missing file or an empty one is told of in the same words, and
nothing waits for a pipe that never ends.
"""

import mmap
from collections.abc import Sequence
from pathlib import Path

from recon.errors import UnreadableFile, UnsupportedFormat

__all__ = ["file_bytes", "file_text", "mapped_bytes", "require_plain_file"]


def require_plain_file(path: str | Path, endings: Sequence[str] = ()) -> Path:
    """The path, when it names a plain file with one of the endings; no endings allow any.

    Raises  UnreadableFile, UnsupportedFormat.
    """
    file, name = Path(path), str(path)
    try:
        if file.is_dir():
            raise UnreadableFile(name, "is a folder", "Name a file in it")
        if endings and file.suffix.lower() not in endings:
            raise UnsupportedFormat(name, endings)
        if not file.exists():
            raise UnreadableFile(name, "there is no such file", "Check the name and the folder")
        if not file.is_file():
            raise UnreadableFile(name, "is a device or a pipe", "Name a plain file")
    except (OSError, ValueError) as problem:
        raise UnreadableFile(name, f"cannot be read ({problem})") from problem
    return file


def file_bytes(path: str | Path, endings: Sequence[str] = ()) -> bytes:
    """All of a plain file that is not empty; raises as `require_plain_file`."""
    file, name = require_plain_file(path, endings), str(path)
    try:
        data = file.read_bytes()
    except PermissionError:
        raise UnreadableFile(name, "may not be read", "Ask its owner for the permission to read it") from None
    except OSError as problem:
        raise UnreadableFile(name, f"cannot be read ({problem})") from problem
    if not data.strip():
        raise UnreadableFile(name, "is empty", "Export or copy the file again")
    return data


def mapped_bytes(path: str | Path) -> mmap.mmap:
    """The same bytes as a map of the file, which is read where it is looked at; raises as `file_bytes`."""
    file, name = require_plain_file(path), str(path)
    try:
        with file.open("rb") as stream:
            return mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)
    except PermissionError:
        raise UnreadableFile(name, "may not be read", "Ask its owner for the permission to read it") from None
    except OSError as problem:
        raise UnreadableFile(name, f"cannot be read ({problem})") from problem
    except ValueError:
        raise UnreadableFile(name, "is empty", "Export or copy the file again") from None


def file_text(path: str | Path, endings: Sequence[str] = ()) -> str:
    """The same as text in UTF-8; raises UnreadableFile also where it is none."""
    try:
        return file_bytes(path, endings).decode("utf-8-sig")
    except UnicodeDecodeError as problem:
        raise UnreadableFile(str(path), "is no text") from problem

"""Packed blocks of volumes, unpacked no further than the header asks for: a small file cannot fill the memory."""

import bz2
import zlib
from collections.abc import Callable
from typing import Any

from recon.errors import UnreadableFile

__all__ = ["require_plausible_size", "unbzip2", "unzip"]

LARGE = 1 << 30  # bytes from which on a file must have packed them as a measured volume packs
MOST_PACKED = 250  # times: real masks stay below, and only what is all the same throughout comes above
GZIP_OR_ZLIB = 47  # zlib's word for: look which of the two it is
AGAIN = "Copy or export the file again"


def require_plausible_size(name: str, packed: int, unpacked: int) -> None:
    """Raises UnreadableFile for a gigabyte or more out of a file that cannot hold so much that was measured."""
    if unpacked > LARGE and unpacked > MOST_PACKED * packed:
        raise UnreadableFile(
            name, f"would unpack to {unpacked / 2**30:.3g} GB, which a file of its size does not hold", AGAIN
        )


def unzip(body: bytes, needed: int, name: str) -> bytes:
    """The first `needed` bytes of what gzip or zlib packed; raises UnreadableFile where they are damaged or missing."""
    return _unpacked(body, needed, name, lambda: zlib.decompressobj(GZIP_OR_ZLIB))


def unbzip2(body: bytes, needed: int, name: str) -> bytes:
    """The same for bzip2."""
    return _unpacked(body, needed, name, bz2.BZ2Decompressor)


def _unpacked(body: bytes, needed: int, name: str, begin: Callable[[], Any]) -> bytes:
    """Block after block, one byte further than needed: only at the end of a block its checksum is compared."""
    require_plausible_size(name, len(body), needed)
    parts, left = [], needed + 1
    try:
        while body and left > 0:
            block = begin()
            parts.append(block.decompress(body, left))
            left -= len(parts[-1])
            if not block.eof and left > 0:
                raise UnreadableFile(name, "ends in the middle of its packed data", AGAIN)
            body = block.unused_data
            if sum(map(len, parts)) >= needed:
                break
    except (zlib.error, OSError, ValueError, EOFError) as problem:
        raise UnreadableFile(name, f"its packed data are damaged ({problem})", AGAIN) from problem
    return b"".join(parts)[:needed]

"""STL files, text or binary: triangles with their own three points each.

A binary file may begin with the word solid too, so the two kinds are told apart by the size that the count of
triangles implies, never by the first word.
"""

import mmap
import re

import numpy as np
from numpy.typing import NDArray

from recon.errors import UnreadableFile
from recon.readers.numbers import number_array
from recon.readers.polygons import PolygonSoup

__all__ = ["mapped_corners", "read_stl"]

HEADER = 80
TRIANGLE = np.dtype([("normal", "<f4", (3,)), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
AGAIN = "Export or copy the file again"


def read_stl(data: bytes, name: str) -> PolygonSoup:
    """Triangles of an STL file; raises UnreadableFile when it is neither kind, or not whole."""
    promised = int.from_bytes(data[HEADER : HEADER + 4], "little") if len(data) >= HEADER + 4 else -1
    if promised >= 0 and len(data) == HEADER + 4 + promised * TRIANGLE.itemsize:
        return _soup(np.frombuffer(data, TRIANGLE, promised, HEADER + 4)["corners"])
    if re.match(rb"\s*solid\b", data, re.IGNORECASE) and b"\0" not in data:
        return _read_text(data, name)
    holds = (len(data) - HEADER - 4) // TRIANGLE.itemsize
    if promised < 0 or _is_text(data):
        raise UnreadableFile(name, "is not an STL file: it is neither its text nor its binary kind", AGAIN)
    if holds < promised:
        raise UnreadableFile(
            name, f"its header promises {promised} triangles, but the file holds {max(holds, 0)}", AGAIN
        )
    rest = len(data) - HEADER - 4 - promised * TRIANGLE.itemsize
    corners = np.frombuffer(data, TRIANGLE, promised, HEADER + 4)["corners"]
    return _soup(corners, (f"{rest} bytes after the last triangle were left unread",))


def mapped_corners(data: mmap.mmap) -> NDArray[np.float32] | None:
    """(F, 3, 3) corners of the triangles where they lie in a binary file; None of text, and of what is not whole."""
    count = int.from_bytes(data[HEADER : HEADER + 4], "little")
    if len(data) != HEADER + 4 + count * TRIANGLE.itemsize:
        return None
    return np.frombuffer(data, TRIANGLE, count, HEADER + 4)["corners"]


def _read_text(data: bytes, name: str) -> PolygonSoup:
    lines = [line.split() for line in data.lower().splitlines()]
    first = [words[0] for words in lines if words]
    counts = {word: first.count(word) for word in (b"facet", b"endfacet", b"vertex", b"solid", b"endsolid")}
    if counts[b"solid"] != counts[b"endsolid"] or counts[b"facet"] != counts[b"endfacet"]:
        raise UnreadableFile(name, "ends in the middle of a solid", AGAIN)
    rows = [words[1:] for words in lines if words and words[0] == b"vertex"]
    if len(rows) != 3 * counts[b"facet"] or any(len(row) != 3 for row in rows):
        raise UnreadableFile(name, "has a facet without three vertices of three numbers each", AGAIN)
    return _soup(number_array((word for row in rows for word in row), name).reshape(-1, 3, 3))


def _soup(corners: np.ndarray, notes: tuple[str, ...] = ()) -> PolygonSoup:
    n = len(corners)
    return PolygonSoup(corners.reshape(-1, 3).astype(np.float64), np.arange(3 * n), np.full(n, 3), notes)


def _is_text(data: bytes) -> bool:
    start = data[:256]
    return all(byte in b"\t\r\n" or 32 <= byte < 127 for byte in start)

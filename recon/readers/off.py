"""OFF files: a word, three counts, one point a line, one polygon a line; colours and normals are passed over."""

import re

from recon.errors import UnreadableFile
from recon.readers.numbers import integers, lines_with_words, number_array
from recon.readers.polygons import PolygonSoup

__all__ = ["read_off"]

AGAIN = "Export or copy the file again"


def read_off(data: bytes, name: str) -> PolygonSoup:
    """Polygons of an OFF file; raises UnreadableFile when it is none, or promises more lines than it holds."""
    start = re.match(rb"\s*(?:#[^\n]*\n\s*)*((?:ST)?C?N?OFF)\b", data)
    if start is None:
        raise UnreadableFile(name, "is not an OFF file of points in space: it does not begin with the word OFF", AGAIN)
    lines = lines_with_words(data[start.end() :])
    if lines and lines[0][0].upper() == b"BINARY":
        raise UnreadableFile(name, "is a binary OFF file, which is not read here", "Export it as text, or as PLY")
    counts = lines[0] if lines else []
    if len(counts) < 2 or not all(word.isdigit() for word in counts):
        raise UnreadableFile(name, "does not say how many points and faces it holds", AGAIN)
    n_points, n_faces = int(counts[0]), int(counts[1])
    if len(lines) - 1 < n_points + n_faces:
        raise UnreadableFile(
            name, f"promises {n_points} points and {n_faces} faces, but holds {len(lines) - 1} lines of them", AGAIN
        )
    rows, polygons = lines[1 : 1 + n_points], lines[1 + n_points : 1 + n_points + n_faces]
    if any(len(row) < 3 for row in rows):
        raise UnreadableFile(name, "has a point of fewer than three numbers", AGAIN)
    points = number_array((word for row in rows for word in row[:3]), name).reshape(-1, 3)
    sizes = integers(number_array((row[0] for row in polygons), name), name)
    if any(size < 0 or len(row) <= size for row, size in zip(polygons, sizes.tolist())):
        raise UnreadableFile(name, "has a face with fewer points than it says", AGAIN)
    corners = number_array((w for row, size in zip(polygons, sizes.tolist()) for w in row[1 : 1 + size]), name)
    return PolygonSoup(points, integers(corners, name), sizes)

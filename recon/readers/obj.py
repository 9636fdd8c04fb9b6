"""Wavefront OBJ files: points and polygons; textures, normals, groups, materials, lines and curves are passed over.

v x y z          a point; a weight or a colour may follow
f 1/2/3 -1 7//9  a polygon: point numbers from 1, or from the last point backwards, before the first slash
"""

import re

import numpy as np

from recon.errors import BadGeometry, UnreadableFile
from recon.readers.numbers import integers, lines_with_words, number_array
from recon.readers.polygons import PolygonSoup

__all__ = ["read_obj"]

AGAIN = "Export or copy the file again"


def read_obj(data: bytes, name: str) -> PolygonSoup:
    """Polygons of an OBJ file; raises UnreadableFile when it has no points, BadGeometry for a point number 0."""
    points: list[list[bytes]] = []
    polygons: list[list[bytes]] = []
    known: list[int] = []
    # Everything after the first slash of a corner is texture or normal; a backslash continues a line.
    plain = re.sub(rb"/[^\s]*", b"", re.sub(rb"\\\r?\n", b" ", data))
    for words in lines_with_words(plain):
        if words[0] == b"v":
            points.append(words[1:4])
        elif words[0] == b"f":
            polygons.append(words[1:])
            known.append(len(points))
    if not points:
        raise UnreadableFile(name, "is not an OBJ file with points: no line of it begins with v", AGAIN)
    if any(len(row) < 3 for row in points):
        row = next(i for i, row in enumerate(points) if len(row) < 3)
        raise UnreadableFile(name, f"its point {row + 1} has fewer than three numbers", AGAIN)
    sizes = np.array([len(polygon) for polygon in polygons], dtype=np.int64)
    number = integers(number_array((word for polygon in polygons for word in polygon), name), name)
    if (number == 0).any():
        raise BadGeometry(name, "a face names point 0, but the points of an OBJ file count from 1")
    corners = np.where(number > 0, number - 1, np.repeat(np.array(known, dtype=np.int64), sizes) + number)
    return PolygonSoup(number_array((word for row in points for word in row), name).reshape(-1, 3), corners, sizes)

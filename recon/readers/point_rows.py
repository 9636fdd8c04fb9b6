"""Rows of points from text files: a point a line, its coordinates parted by commas, semicolons or spaces.

x, y, z        a first line of words is a header
0.0, 1.5, 2    two coordinates lie in a plane; lines that begin with # are comments
"""

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recon.errors import BadGeometry, UnreadableFile
from recon.readers.content import file_text
from recon.readers.numbers import number_array

__all__ = ["POINT_ENDINGS", "read_point_row"]

Floats = NDArray[np.float64]

POINT_ENDINGS = (".csv", ".txt", ".xyz", ".dat", ".pts")


def read_point_row(path: str | Path) -> Floats:
    """(n, 2) or (n, 3) points in the order of the file; further columns are refused, since they may be anything.

    Raises  UnreadableFile, UnsupportedFormat; BadGeometry where a coordinate is not finite.
    """
    name = str(path)
    lines = [line.partition("#")[0].strip() for line in file_text(path, POINT_ENDINGS).splitlines()]
    rows = [re.split(r"[,;\s]+", line.strip(",;")) for line in lines if line]
    if rows and _is_header(rows[0]):
        rows = rows[1:]
    if not rows:
        raise UnreadableFile(name, "holds no points")
    width = len(rows[0])
    if width not in (2, 3):
        raise UnreadableFile(name, f"has {width} columns where a point has two or three coordinates")
    odd = next((i for i, row in enumerate(rows, 1) if len(row) != width), None)
    if odd is not None:
        raise UnreadableFile(name, f"point {odd} has {len(rows[odd - 1])} coordinates where the first has {width}")
    points = number_array((word.encode() for row in rows for word in row), name).reshape(-1, width)
    if not np.isfinite(points).all():
        bad = int(np.argmin(np.isfinite(points).all(axis=1))) + 1
        raise BadGeometry(name, f"point {bad} has a coordinate that is not finite")
    return points


def _is_header(row: list[str]) -> bool:
    return all(re.fullmatch(r"[A-Za-z_\"'][^0-9]*\w*", word) and word.lower() not in ("nan", "inf") for word in row)

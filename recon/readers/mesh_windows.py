"""Scans from files of many millions of triangles, without reading them whole: binary PLY files of points and triangles.

Other formats have no numbers for their points (STL), or are text, or packed: they are read whole.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recon.errors import BadGeometry
from recon.geometry.mesh_source import MeshSource, Rows
from recon.readers.content import mapped_bytes, require_plain_file
from recon.readers.meshes import MESH_ENDINGS, MILLIMETRES, Unit
from recon.readers.ply import mapped_triangles

__all__ = ["open_mesh"]

PIECE = 1 << 20  # rows that are looked through at once


def open_mesh(path: str | Path, *, unit: Unit | None = None, least: int) -> MeshSource | None:
    """The mesh of a binary PLY file of `least` points or more, left in the file; None of others, which are read whole.

    unit     of the file's numbers, else millimetres
    Raises   UnreadableFile, UnsupportedFormat; BadGeometry naming the first fault of a number.
    """
    file = require_plain_file(path, MESH_ENDINGS)
    if file.suffix.lower() != ".ply":
        return None
    found = mapped_triangles(mapped_bytes(file), str(path))
    if found is None or len(found[0]) < least or not len(found[1]):
        return None
    rows, faces = found
    if any((faces["count"][part] != 3).any() for part in _pieces(len(faces))):
        return None
    scale = MILLIMETRES[unit or "mm"]

    def points(which: Rows) -> NDArray[np.float64]:
        chosen = rows[which]
        return scale * np.stack([chosen[axis].astype(np.float64) for axis in "xyz"], axis=1)

    def triangles(which: Rows) -> NDArray[np.int64]:
        return np.asarray(faces["corners"][which], dtype=np.int64)

    source = MeshSource(len(rows), len(faces), points, triangles, file.name)
    _require_sound(source, str(path))
    return source


def _pieces(count: int) -> list[slice]:
    return [slice(first, first + PIECE) for first in range(0, count, PIECE)]


def _require_sound(source: MeshSource, name: str) -> None:
    for part in _pieces(source.n_vertices):
        if not np.isfinite(source.points(part)).all():
            raise BadGeometry(name, f"a coordinate among the points from {part.start} on is not a finite number")
    for part in _pieces(source.n_faces):
        faces = source.triangles(part)
        if faces.min() < 0 or faces.max() >= source.n_vertices:
            raise BadGeometry(name, f"a face from {part.start} on names a point outside 0 to {source.n_vertices - 1}")
        if (faces == np.roll(faces, 1, axis=1)).any():
            raise BadGeometry(name, f"a face from {part.start} on names a point twice; let a mesh program clean it")

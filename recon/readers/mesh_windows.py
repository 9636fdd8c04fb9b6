"""Scans from files of many millions of triangles, without reading them whole: binary PLY and STL files.

Triangles of STL files have no numbers for their points; those at exactly the same place are found to be one in parts,
each the corners of the file whose coordinates share a remainder, and a number is kept for every corner.  Other formats
are text, or packed: they are read whole.
"""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.errors import BadGeometry
from recon.geometry.mesh_source import MeshSource, Rows
from recon.numerics.equal_points import first_equal
from recon.readers.content import mapped_bytes, require_plain_file
from recon.readers.meshes import MESH_ENDINGS, MILLIMETRES, Unit
from recon.readers.ply import mapped_triangles
from recon.readers.stl import mapped_corners

__all__ = ["open_mesh"]

PIECE = 1 << 20  # rows that are looked through at once
AT_ONCE = 1 << 21  # corners whose places are compared at once, about


def open_mesh(path: str | Path, *, unit: Unit | None = None, least: int) -> MeshSource | None:
    """The mesh of a binary PLY or STL file of `least` points or more, left in the file; else None, to be read whole.

    unit      of the file's numbers, else millimetres
    Promises  points and triangles of STL files are numbered as `read_mesh` does, and a note counts those left out.
    Raises    UnreadableFile, UnsupportedFormat; BadGeometry naming the first fault of a number.
    """
    file = require_plain_file(path, MESH_ENDINGS)
    scale, ending = MILLIMETRES[unit or "mm"], file.suffix.lower()
    if ending == ".stl":
        return _stl(file, str(path), scale, least)
    return _ply(file, str(path), scale, least) if ending == ".ply" else None


def _ply(file: Path, name: str, scale: float, least: int) -> MeshSource | None:
    found = mapped_triangles(mapped_bytes(file), name)
    if found is None or len(found[0]) < least or not len(found[1]):
        return None
    rows, faces = found
    if any((faces["count"][part] != 3).any() for part in _pieces(len(faces))):
        return None

    def points(which: Rows) -> NDArray[np.float64]:
        chosen = rows[which]
        return scale * np.stack([chosen[axis].astype(np.float64) for axis in "xyz"], axis=1)

    def triangles(which: Rows) -> NDArray[np.int64]:
        return np.asarray(faces["corners"][which], dtype=np.int64)

    source = MeshSource(len(rows), len(faces), points, triangles, file.name)
    _require_sound(source, name)
    return source


def _stl(file: Path, name: str, scale: float, least: int) -> MeshSource | None:
    corners = mapped_corners(mapped_bytes(file))
    if corners is None or 3 * len(corners) < least or not len(corners):
        return None
    for part in _pieces(len(corners)):
        if not np.isfinite(corners[part]).all():
            raise BadGeometry(name, f"a corner among the triangles from {part.start} on is not a finite number")
    faces = _first_places(corners)
    repeats = (faces == np.roll(faces, 1, axis=1)).any(axis=1)
    notes: tuple[str, ...] = ()
    if repeats.all():
        raise BadGeometry(name, "none of its faces has three different points")
    if repeats.any():
        faces = faces[~repeats]
        notes = (f"{np.count_nonzero(repeats)} faces with two corners in the same point were dropped",)
    used = np.zeros(corners.size // 3, dtype=bool)
    used[faces] = True
    places = np.flatnonzero(used).astype(faces.dtype)
    if len(places) < least:
        return None
    for part in _pieces(len(faces)):
        faces[part] = np.searchsorted(places, faces[part])

    def points(which: Rows) -> NDArray[np.float64]:
        chosen = places[which]
        return scale * (corners[chosen // 3, chosen % 3].astype(np.float64) + 0.0)

    def triangles(which: Rows) -> NDArray[np.int64]:
        return np.asarray(faces[which], dtype=np.int64)

    return MeshSource(len(places), len(faces), points, triangles, file.name, notes)


def _first_places(corners: NDArray[np.float32]) -> NDArray[Any]:
    """(F, 3) for every corner the number of the first one of the file at exactly the same place."""
    count = corners.size // 3
    first = np.empty((len(corners), 3), dtype=np.int32 if count < 1 << 31 else np.int64)
    n_shares = 1 + count // AT_ONCE
    for share in range(n_shares):
        rows = np.concatenate(
            [3 * part.start + np.flatnonzero(_shares(corners[part], n_shares) == share) for part in _pieces(len(first))]
        )
        found = first_equal(corners[rows // 3, rows % 3].astype(np.float64))
        first.ravel()[rows] = rows[found]
    return first


def _shares(corners: NDArray[np.float32], n: int) -> NDArray[np.uint32]:
    """(3 f,) a number below n for every corner, the same for equal places."""
    x, y, z = (corners + np.float32(0.0)).view(np.uint32).reshape(-1, 3).T
    mixed = x * np.uint32(0x9E3779B1) ^ y * np.uint32(0x85EBCA77) ^ z * np.uint32(0xC2B2AE3D)
    return (mixed ^ (mixed >> np.uint32(15))) % np.uint32(n)


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

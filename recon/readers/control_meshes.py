"""Control meshes from OBJ files: faces with as many corners as they have, line elements as creases."""

import re
from itertools import pairwise
from pathlib import Path

import numpy as np

from recon.errors import BadGeometry
from recon.geometry.control_mesh import ControlMesh
from recon.readers.content import file_bytes
from recon.readers.numbers import integers, lines_with_words, number_array
from recon.readers.obj import read_obj

__all__ = ["read_control_mesh"]


def read_control_mesh(path: str | Path) -> ControlMesh:
    """The control mesh in an OBJ file; `l` elements, from point to point, are its creases.

    Promises  points that no face uses are left out.
    Raises    UnreadableFile, UnsupportedFormat; BadGeometry when there is no face, or a crease is no edge of a face.
    """
    name = str(path)
    data = file_bytes(path, (".obj",))
    soup = read_obj(data, name)
    if not len(soup.sizes):
        raise BadGeometry(name, "has points but no faces")
    if soup.corners.min() < 0 or soup.corners.max() >= len(soup.points):
        raise BadGeometry(name, f"a face names a point that does not exist; there are {len(soup.points)}")
    used, corners = np.unique(soup.corners, return_inverse=True)
    creases = _creases(data, name, len(soup.points))
    places = np.searchsorted(used, creases)
    if len(creases) and (used[np.minimum(places, len(used) - 1)] != creases).any():
        raise BadGeometry(name, "a crease (line element) ends at a point that no face uses")
    starts = np.concatenate([[0], np.cumsum(soup.sizes)])
    mesh = ControlMesh(soup.points[used], corners.astype(np.int64), starts, places)
    _refuse_loose_creases(mesh, name)
    return mesh


def _creases(data: bytes, name: str, n_points: int) -> np.ndarray:
    plain = re.sub(rb"/[^\s]*", b"", re.sub(rb"\\\r?\n", b" ", data))
    lines = [words[1:] for words in lines_with_words(plain) if words[0] == b"l"]
    pairs = [pair for line in lines for pair in pairwise(line)]
    numbers = integers(number_array((word for pair in pairs for word in pair), name), name).reshape(-1, 2)
    numbers = np.where(numbers > 0, numbers - 1, n_points + numbers)
    if len(numbers) and (numbers.min() < 0 or numbers.max() >= n_points):
        raise BadGeometry(name, f"a line element names a point that does not exist; there are {n_points}")
    return numbers


def _refuse_loose_creases(mesh: ControlMesh, name: str) -> None:
    start, end = mesh.face_corners, mesh.face_corners[mesh.next_corners()]
    sides = np.minimum(start, end) * mesh.n_vertices + np.maximum(start, end)
    creases = np.sort(mesh.crease_edges, axis=1)
    loose = ~np.isin(creases[:, 0] * mesh.n_vertices + creases[:, 1], sides)
    if loose.any():
        raise BadGeometry(name, f"{int(loose.sum())} creases (line elements) are no edge of a face")

"""Control meshes from OBJ files: faces with as many corners as they have, creases and corners.

l 3 4 8                   the edges 3-4 and 4-8 are creases, sharp for ever; points from 1, as in faces
t crease 2/1/0 2 3 1.5    a tag as OpenSubdiv writes it: so many whole numbers, numbers and words, then these. The edge
                          between points 2 and 3, here from 0, is a crease of sharpness 1.5
t crease 3/2/0 2 3 7 1 2  a chain of edges, one sharpness for all or one for each
t corner 1/1/0 5 10       point 5 is a corner; sharpness 10 and above is for ever
"""

import re
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from recon.errors import BadGeometry, UnreadableFile
from recon.geometry.control_mesh import ControlMesh
from recon.readers.content import file_bytes
from recon.readers.numbers import integers, lines_with_words, number_array
from recon.readers.obj import read_obj

__all__ = ["SHARP", "read_control_mesh"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

KINDS = {b"crease": 2, b"corner": 1}  # points that each takes
OF_TEXTURES = b"facevarying"
SHARP = 10.0  # sharpness from which on an edge stays sharp


class _Marks(NamedTuple):
    """Creases or corners: (n, m) points, m = 2 or 1, and (n,) sharpness above 0."""

    points: Ints
    sharpness: Floats


def read_control_mesh(path: str | Path) -> ControlMesh:
    """The control mesh in an OBJ file, with the creases and corners that its line elements and tags name.

    Promises  points that no face uses are left out.
    Raises    UnreadableFile, UnsupportedFormat; BadGeometry when there is no face, a crease is no edge of a face, or a
              tag asks for something that the surface would not have.
    """
    name = str(path)
    data = file_bytes(path, (".obj",))
    soup = read_obj(data, name)
    if not len(soup.sizes):
        raise BadGeometry(name, "has points but no faces")
    if soup.corners.min() < 0 or soup.corners.max() >= len(soup.points):
        raise BadGeometry(name, f"a face names a point that does not exist; there are {len(soup.points)}")
    used, corners = np.unique(soup.corners, return_inverse=True)
    lines, tagged, vertices = _lines(data, name, len(soup.points)), *_tags(data, name, len(soup.points))
    creases = _Marks(*(np.concatenate(both) for both in zip(lines, tagged)))
    starts = np.concatenate([[0], np.cumsum(soup.sizes)])
    mesh = ControlMesh(
        soup.points[used],
        corners.astype(np.int64),
        starts,
        _places(used, creases.points, f"{name}: a crease"),
        _places(used, vertices.points, f"{name}: a corner").ravel(),
        creases.sharpness,
        vertices.sharpness,
    )
    _refuse_loose_creases(mesh, name)
    return mesh


def _places(used: Ints, points: Ints, what: str) -> Ints:
    places = np.searchsorted(used, points)
    if points.size and (used[np.minimum(places, len(used) - 1)] != points).any():
        raise BadGeometry(what, "ends at a point that no face uses")
    return places


def _lines(data: bytes, name: str, n_points: int) -> _Marks:
    plain = re.sub(rb"/[^\s]*", b"", re.sub(rb"\\\r?\n", b" ", data))
    lines = [words[1:] for words in lines_with_words(plain) if words[0] == b"l"]
    pairs = [pair for line in lines for pair in pairwise(line)]
    numbers = integers(number_array((word for pair in pairs for word in pair), name), name).reshape(-1, 2)
    numbers = np.where(numbers > 0, numbers - 1, n_points + numbers)
    if len(numbers) and (numbers.min() < 0 or numbers.max() >= n_points):
        raise BadGeometry(name, f"a line element names a point that does not exist; there are {n_points}")
    return _Marks(numbers, np.full(len(numbers), np.inf))


def _tags(data: bytes, name: str, n_points: int) -> tuple[_Marks, _Marks]:
    """Creases and corners that `t` lines name."""
    found = {size: [(np.empty((0, size), dtype=np.int64), np.empty(0))] for size in KINDS.values()}
    for words in lines_with_words(re.sub(rb"\\\r?\n", b" ", data)):
        if words[0] != b"t" or len(words) < 2 or words[1].startswith(OF_TEXTURES):
            continue
        if words[1] not in KINDS:
            tag = words[1].decode("ascii", "replace")
            raise BadGeometry(name, f"tag {tag!r} has no meaning here, only crease and corner have; take it out")
        size = KINDS[words[1]]
        found[size].append(_marks(words[2:], size, name, n_points))
    creases, corners = (_Marks(*map(np.concatenate, zip(*found[size]))) for size in (2, 1))
    return creases, corners


def _marks(words: list[bytes], size: int, name: str, n_points: int) -> tuple[Ints, Floats]:
    """(n, size) points and (n,) sharpness of a tag; those of no sharpness left out."""
    counts = words[0].split(b"/") if words else []
    sizes = integers(number_array(counts, name), name).tolist()
    if len(sizes) != 3 or min(sizes) < 0 or sizes[0] < size or len(words) < 1 + sizes[0] + sizes[1]:
        raise UnreadableFile(name, "holds a tag with fewer numbers than it announces", "Export the file again")
    points = integers(number_array(words[1 : 1 + sizes[0]], name), name)
    sharpness = number_array(words[1 + sizes[0] : 1 + sizes[0] + sizes[1]], name)
    if points.min() < 0 or points.max() >= n_points:
        raise BadGeometry(name, f"a tag names a point that does not exist; there are {n_points}, from 0")
    n = len(points) - size + 1
    if len(sharpness) not in (1, n) or not (sharpness >= 0.0).all():
        raise BadGeometry(name, f"a tag for {n} creases or corners needs one sharpness, or one for each, of 0 or above")
    sharpness = np.broadcast_to(np.where(sharpness >= SHARP, np.inf, sharpness), n)
    windows = np.lib.stride_tricks.sliding_window_view(points, size)
    return windows[sharpness > 0.0], sharpness[sharpness > 0.0]


def _refuse_loose_creases(mesh: ControlMesh, name: str) -> None:
    start, end = mesh.face_corners, mesh.face_corners[mesh.next_corners()]
    sides = np.minimum(start, end) * mesh.n_vertices + np.maximum(start, end)
    creases = np.sort(mesh.crease_edges, axis=1)
    loose = ~np.isin(creases[:, 0] * mesh.n_vertices + creases[:, 1], sides)
    if loose.any():
        raise BadGeometry(name, f"{int(loose.sum())} creases (line elements or tags) are no edge of a face")

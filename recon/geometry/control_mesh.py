"""Control meshes: polygon meshes read as the control net of a subdivision surface.

2-------3        faces  0-1-2 and 1-3-2, kept as one row of corners and where each face begins:
| \\     |               face_corners  [0 1 2 1 3 2]
|   \\   |               face_starts   [0 3 6]
|     \\ |        a crease edge, as 1-2 may be, is sharp in the limit; free edges always are
0-------1        a corner vertex stays where it is

A crease or corner of finite sharpness s is sharp for s steps of refinement and smooth from then on; a fraction of a
step counts as that share of one.

Paper  [derose1998], sharpness as a number.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from recon.errors import BadGeometry
from recon.geometry.arrays import frozen_floats, frozen_ints
from recon.geometry.mesh import TriangleMesh

__all__ = ["ControlMesh"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class ControlMesh:
    """The control net of a subdivision surface, open or closed.

    vertices         (V, 3) control points in model units
    face_corners     (H,) vertex numbers, face after face, counter-clockwise seen from outside
    face_starts      (F + 1,) where each face begins in face_corners; the last entry is H
    crease_edges     (C, 2) vertex pairs along which the limit surface is sharp
    corner_vertices  (K,) vertices on the border or on creases where the limit curve has a corner
    crease_sharpness (C,) and corner_sharpness (K,), above 0; infinite where they are not given. Of an edge or a vertex
                     that is named more than once the largest counts
    Raises  BadGeometry when a number is out of range, a face has under three corners, or repeats one next to itself.
    """

    vertices: Floats
    face_corners: Ints
    face_starts: Ints
    crease_edges: Ints = field(default_factory=lambda: np.empty((0, 2), dtype=np.int64))
    corner_vertices: Ints = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    crease_sharpness: Floats = field(default_factory=lambda: np.empty(0))
    corner_sharpness: Floats = field(default_factory=lambda: np.empty(0))

    def __post_init__(self) -> None:
        object.__setattr__(self, "vertices", frozen_floats(self.vertices, (None, 3), "control mesh: vertices"))
        shapes: tuple[tuple[str, tuple[int | None, ...]], ...] = (
            ("face_corners", (None,)),
            ("face_starts", (None,)),
            ("crease_edges", (None, 2)),
            ("corner_vertices", (None,)),
        )
        for name, wanted in shapes:
            object.__setattr__(self, name, frozen_ints(getattr(self, name), wanted, f"control mesh: {name}"))
        for name, marks in (("crease_sharpness", self.crease_edges), ("corner_sharpness", self.corner_vertices)):
            object.__setattr__(self, name, _sharpness(getattr(self, name), len(marks), name))
        self._check()

    def _check(self) -> None:
        n = len(self.vertices)
        for name in ("face_corners", "crease_edges", "corner_vertices"):
            numbers = getattr(self, name)
            if numbers.size and (numbers.min() < 0 or numbers.max() >= n):
                raise BadGeometry("control mesh", f"{name} names a vertex outside 0 to {n - 1}")
        starts = self.face_starts
        if len(starts) == 0 or starts[0] != 0 or starts[-1] != len(self.face_corners) or (np.diff(starts) < 3).any():
            raise BadGeometry("control mesh", "face_starts does not divide face_corners into faces of three corners up")
        repeats = self.face_corners == self.face_corners[self.next_corners()]
        if repeats.any():
            face = int(np.searchsorted(starts, np.argmax(repeats), side="right")) - 1
            raise BadGeometry("control mesh", f"face {face} names the same vertex twice in a row")

    @classmethod
    def from_faces(
        cls,
        vertices: ArrayLike,
        faces: NDArray[np.integer] | Sequence[Sequence[int]],
        *,
        crease_edges: ArrayLike = (),
        corner_vertices: ArrayLike = (),
        crease_sharpness: ArrayLike = (),
        corner_sharpness: ArrayLike = (),
    ) -> "ControlMesh":
        """A control mesh from a list of faces: an (F, k) array, or rows of different lengths."""
        rows = [np.atleast_1d(face) for face in faces]
        starts = np.concatenate([[0], np.cumsum([len(row) for row in rows], dtype=np.int64)])
        corners = np.concatenate(rows) if rows else np.empty(0)
        creases = frozen_ints(crease_edges, (None, 2), "control mesh: crease_edges")
        kept = frozen_ints(corner_vertices, (None,), "control mesh: corner_vertices")
        sharpness = (
            _sharpness(s, len(marks), name)
            for s, marks, name in (
                (crease_sharpness, creases, "crease_sharpness"),
                (corner_sharpness, kept, "corner_sharpness"),
            )
        )
        places = frozen_floats(vertices, (None, 3), "control mesh: vertices")
        return cls(places, frozen_ints(corners, (None,), "control mesh: faces"), starts, creases, kept, *sharpness)

    @property
    def n_vertices(self) -> int:
        return len(self.vertices)

    @property
    def n_faces(self) -> int:
        return len(self.face_starts) - 1

    @property
    def is_semi_sharp(self) -> bool:
        """Whether a crease or corner has a finite sharpness."""
        return bool(np.isfinite(self.crease_sharpness).any() or np.isfinite(self.corner_sharpness).any())

    def next_corners(self) -> Ints:
        """(H,) for every entry of face_corners the place of the corner that follows it around its face."""
        following = np.arange(1, len(self.face_corners) + 1)
        following[self.face_starts[1:] - 1] = self.face_starts[:-1]
        return following

    def faces_of(self, n_corners: int) -> Ints:
        """(F, n_corners) all faces as one array; raises BadGeometry when one of them has another number of corners."""
        if (np.diff(self.face_starts) != n_corners).any():
            raise BadGeometry("control mesh", f"has faces with another number of corners than {n_corners}")
        return self.face_corners.reshape(-1, n_corners)

    def triangle_mesh(self) -> TriangleMesh:
        """The control mesh drawn with triangles, each face as a fan from its first corner."""
        counts = np.diff(self.face_starts)
        first = np.repeat(self.face_starts[:-1], counts - 2)
        step = np.arange(len(first)) - np.repeat(np.cumsum(counts - 2) - (counts - 2), counts - 2)
        places = np.stack([first, first + step + 1, first + step + 2], axis=1)
        return TriangleMesh(self.vertices, self.face_corners[places], "control mesh")

    def with_vertices(self, vertices: Floats) -> "ControlMesh":
        """The same net with its control points elsewhere; vertices (V, 3)."""
        return replace(self, vertices=vertices)


def _sharpness(values: ArrayLike, n: int, name: str) -> Floats:
    """(n,) locked, infinite where none are given; raises BadGeometry."""
    array = frozen_floats(values, (None,), f"control mesh: {name}, which is above 0", also=np.inf)
    if len(array) != n:
        if len(array):
            raise BadGeometry("control mesh", f"{name} has shape {array.shape}, not ({n},)")
        array = np.full(n, np.inf)
        array.setflags(write=False)
    if not (array > 0.0).all():
        raise BadGeometry("control mesh", f"{name} holds {array[~(array > 0.0)][0]:g}; a sharpness is above 0")
    return array

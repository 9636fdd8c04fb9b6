"""A triangle mesh that need not be in memory: its points and triangles are fetched where they are asked for."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["MeshSource"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Rows = slice | Ints


@dataclass(frozen=True, eq=False)
class MeshSource:
    """Where the points and triangles of a mesh come from.

    n_vertices, n_faces  how many there are
    points               gives (n, 3) points in model units, by their numbers
    triangles            gives (n, 3) vertex numbers of triangles, by the triangles' numbers
    notes                what was left out of a file, and what its reader decided
    """

    n_vertices: int
    n_faces: int
    points: Callable[[Rows], Floats]
    triangles: Callable[[Rows], Ints]
    name: str = "mesh"
    notes: tuple[str, ...] = ()

    @classmethod
    def of(cls, vertices: Floats, face_vertices: Ints, name: str = "mesh") -> "MeshSource":
        """A mesh that is in memory."""
        return cls(len(vertices), len(face_vertices), vertices.__getitem__, face_vertices.__getitem__, name)

    def pieces(self, count: int, size: int) -> list[slice]:
        """The numbers below `count` in slices of at most `size`."""
        return [slice(first, min(first + size, count)) for first in range(0, count, size)]

"""A closed boundary of faces with a formula and of plane triangles, which share their edges.

  .-------------.        edge     straight between two vertices, or along a row of points on both surfaces
 /  plane      /|        face     on a surface, or plane between three vertices; its loops run with the
'----.--.-----' |                 face to the left, seen from outside
 |  /|  |\\  cylinder
 | / |  | \\  |'
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.errors import BadGeometry
from recon.geometry.analytic import AnalyticSurface, require_sound_surface
from recon.geometry.arrays import frozen_floats, frozen_ints
from recon.geometry.mesh import TriangleMesh

__all__ = ["MixedBoundary", "MixedEdge", "MixedFace"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class MixedEdge:
    """From vertex `start` to vertex `end`, the same for a ring; along `points` (n, 3), both ends included, if given."""

    start: int
    end: int
    points: Floats | None = None

    def __post_init__(self) -> None:
        if self.points is not None:
            object.__setattr__(self, "points", frozen_floats(self.points, (None, 3), "mixed edge: points"))


@dataclass(frozen=True, eq=False)
class MixedFace:
    """A face on surface number `surface`, None where it is a plane triangle, with loops of pairs (edge, forward).

    outside  1 where the surface's normal looks out of the solid, else -1
    area     what it should have, about
    patch    number of the patch of the surface that it covers, alone or with other triangles
    """

    surface: int | None
    outside: float
    loops: tuple[tuple[tuple[int, bool], ...], ...]
    area: float
    patch: int


@dataclass(frozen=True, eq=False)
class MixedBoundary:
    """vertices (V, 3); bodies of shells, each the numbers of its faces, the outer shell first.

    slack  how far edges may lie off their surfaces
    Raises  BadGeometry when a number is out of range, a surface is unsound, or a face is not in exactly one shell.
    """

    vertices: Floats
    surfaces: tuple[AnalyticSurface, ...]
    edges: tuple[MixedEdge, ...]
    faces: tuple[MixedFace, ...]
    bodies: tuple[tuple[tuple[int, ...], ...], ...]
    slack: float

    def __post_init__(self) -> None:
        what = "mixed boundary"
        object.__setattr__(self, "vertices", frozen_floats(self.vertices, (None, 3), f"{what}: vertices"))
        frozen_floats(self.slack, (), f"{what}: slack")
        for k, surface in enumerate(self.surfaces):
            require_sound_surface(surface, f"{what}: surface {k}")
        _require_range([end for edge in self.edges for end in (edge.start, edge.end)], len(self.vertices), "vertex")
        uses = [use[0] for face in self.faces for loop in face.loops for use in loop]
        _require_range(uses, len(self.edges), "edge")
        named = [face.surface for face in self.faces if face.surface is not None]
        _require_range(named, len(self.surfaces), "surface")
        frozen_floats([face.area for face in self.faces], (len(self.faces),), f"{what}: areas")
        if any(face.outside not in (1, -1) for face in self.faces):
            raise BadGeometry(what, "the outside of a face is neither 1 nor -1")
        if sorted(f for body in self.bodies for shell in body for f in shell) != list(range(len(self.faces))):
            raise BadGeometry(what, "each face must belong to exactly one shell")

    def triangles(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """(T, 3) vertices of the faces without a formula, and the patch (T,) of each."""
        free = [face for face in self.faces if face.surface is None]
        start = [[self.edges[e].start if way else self.edges[e].end for e, way in face.loops[0]] for face in free]
        return np.array(start, dtype=np.int64).reshape(-1, 3), np.array([f.patch for f in free], dtype=np.int64)

    def triangle_mesh(self) -> TriangleMesh:
        """The faces without a formula alone: closed where there are no others."""
        return TriangleMesh(self.vertices, self.triangles()[0])

    @property
    def n_triangles(self) -> int:
        """Faces without a formula."""
        return sum(face.surface is None for face in self.faces)


def _require_range(numbers: Sequence[int], count: int, name: str) -> None:
    found = frozen_ints(numbers, (None,), f"mixed boundary: number of a {name}")
    if found.size and (found.min() < 0 or found.max() >= count):
        raise BadGeometry("mixed boundary", f"names a {name} outside 0 to {count - 1}")

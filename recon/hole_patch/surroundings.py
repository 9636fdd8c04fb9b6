"""What is known around a hole before it is patched: the vessel's walls, the hole's edge on each, the wheel's axis.

       axis                     outer wall, seen from outside
        |   inner  outer            _______
        |    |  |                  /  ...  \\      edge: the hole's boundary on that wall,
mouth   |    |  |                 |  <---.  |     a closed polyline that runs counter-clockwise
        |    |  |                 |  | ? |  |     seen from outside the vessel (for the inner
base    |____/  /                 |  '-->'  |     wall too: seen from the same side)
        |______/                   \\_______/
"""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from recon.geometry.arrays import frozen_floats, frozen_ints
from recon.geometry.mesh import TriangleMesh

__all__ = ["Axis", "HoleEdge", "HoleKind", "ShownThickness", "Surroundings", "Wall"]

BRIDGE = -1


class HoleKind(StrEnum):
    """What surrounds a hole: wall on all sides, or wall but for where it runs out into the rim or the foot."""

    WALL = "wall"
    RIM = "rim"
    FOOT = "foot"


@dataclass(frozen=True, eq=False)
class Axis:
    """The axis on which the vessel was thrown.

    point      (3,) on the axis, in millimetres
    direction  (3,) unit vector from base to mouth
    quality    root mean square distance, in millimetres, of the wall without its relief from a wall that is turned
               about the axis; 0 is a perfect wheel
    support    share of the turn in which there is wall, and the wall keeps to the turned one
    """

    point: NDArray[np.float64]
    direction: NDArray[np.float64]
    quality: float
    support: float = 1.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "point", frozen_floats(self.point, (3,), "axis: point"))
        direction = np.asarray(self.direction, dtype=np.float64)
        object.__setattr__(
            self, "direction", frozen_floats(direction / np.linalg.norm(direction), (3,), "axis: direction")
        )

    def cylindrical(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """(m, 3) angle θ in radians (-π, π], radius and height of every point; the frame depends on the axis alone."""
        across, along = self.frame()
        p = points - self.point
        x, y = p @ across, p @ along
        return np.stack([np.arctan2(y, x), np.hypot(x, y), p @ self.direction], axis=1)

    def slopes(self, points: NDArray[np.float64], normals: NDArray[np.float64]) -> NDArray[np.float64]:
        """(m, 2) parts of the normals (m, 3) at the points away from the axis and along it."""
        p = points - self.point
        out = p - (p @ self.direction)[:, None] * self.direction
        away = (normals * out).sum(axis=1) / np.maximum(np.linalg.norm(out, axis=1), 1e-12)
        return np.stack([away, normals @ self.direction], axis=1)

    def cartesian(self, angle_radius_height: NDArray[np.float64]) -> NDArray[np.float64]:
        """(m, 3) points of the given angles, radii and heights: the inverse of `cylindrical`."""
        across, along = self.frame()
        angle, radius, height = np.asarray(angle_radius_height, dtype=np.float64).T
        around = np.cos(angle)[:, None] * across + np.sin(angle)[:, None] * along
        return self.point + radius[:, None] * around + height[:, None] * self.direction

    def frame(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Two unit vectors across the axis, right-handed with its direction."""
        least = np.eye(3)[np.argmin(np.abs(self.direction))]
        across = np.cross(least, self.direction)
        across /= np.linalg.norm(across)
        return across, np.cross(self.direction, across)


@dataclass(frozen=True, eq=False)
class HoleEdge:
    """The edge of a hole on one wall.

    points   (n, 3) closed polyline, the first point not repeated, counter-clockwise seen from outside the vessel
    sherds   (n,) number of the sherd each point was measured on, or -1 where the line bridges a gap between sherds
    normals  (n, 3) unit normals of the wall along it, or None: where the wall turns over a lip they tell which side
             of it a point lies on
    """

    points: NDArray[np.float64]
    sherds: NDArray[np.int64]
    normals: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", frozen_floats(self.points, (None, 3), "hole edge: points"))
        object.__setattr__(self, "sherds", frozen_ints(self.sherds, (len(self.points),), "hole edge: sherds"))
        if self.normals is not None:
            shape = (len(self.points), 3)
            object.__setattr__(self, "normals", frozen_floats(self.normals, shape, "hole edge: normals"))


@dataclass(frozen=True, eq=False)
class Wall:
    """One wall of the vessel, outer or inner: the faces of all sherds that lie on it, and the hole's edge there.

    At a hole that runs out over the lip the wall is one sheet: outer wall, lip and inner wall.
    measured  the wall as scanned, sherds not joined; the normals of both walls point away from the vessel's inside,
              which for the inner wall is into the material; those of a wall over the lip point out of the material
    plain     the same vertices and faces without relief ([taubin1995])
    sherds    (V,) number of the sherd every vertex belongs to
    trust     (V,) 0 to 1: how far `plain` may be believed at a vertex; less within reach of a sherd's border
    edge      the hole's edge, from the mesh as scanned
    over_lip  whether the wall is outer wall, lip and inner wall in one, and the hole's edge runs over the lip
    """

    measured: TriangleMesh
    plain: TriangleMesh
    sherds: NDArray[np.int64]
    trust: NDArray[np.float64]
    edge: HoleEdge
    over_lip: bool = False


@dataclass(frozen=True)
class ShownThickness:
    """Median thickness in millimetres, the range of its middle half, and at how many places it was seen."""

    median: float
    low: float
    high: float
    n_places: int


@dataclass(frozen=True, eq=False)
class Surroundings:
    """All that is known around one hole.

    outer     the outer wall; where the hole runs over the lip, outer wall, lip and inner wall as one sheet
    inner     the inner wall, or None where only the outer one was scanned or both are one sheet
    axis      the wheel's axis, or None where the vessel is not round
    n_holes   how many holes the sherds surround, this one among them
    kind      what surrounds the hole
    shown     how thick the wall is where scans of outer walls happen to show its inner side, or None
    fracture  the faces of the sherds' fracture that look into the hole, or None where none was scanned
    """

    outer: Wall
    inner: Wall | None
    axis: Axis | None
    n_holes: int = 1
    kind: HoleKind = HoleKind.WALL
    shown: ShownThickness | None = None
    fracture: TriangleMesh | None = None

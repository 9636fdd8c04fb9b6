"""Trimmed surfaces, the thick piece between two of them, and the piece of a rim inside one.

v ^   outer loop counter-clockwise in the parameter plane, holes clockwise
  |    .---<---.
  |    |  .>.  |
  |    |  '<'  |      each loop is a closed row of pcurves; the end of one
  |    '--->---'      is the start of the next
  +-------------> u
"""

from dataclasses import dataclass, field

import numpy as np

from recon.errors import BadGeometry
from recon.geometry.bspline import BSplineCurve, BSplineSurface

__all__ = ["LipPiece", "TrimLoop", "TrimmedSurface", "ThickPiece"]


@dataclass(frozen=True, eq=False)
class TrimLoop:
    """A closed row of pcurves; each runs on from the end of the one before.

    pcurves  BSplineCurve in (u, v), at least one
    Raises   BadGeometry when the row has a gap.
    """

    pcurves: tuple[BSplineCurve, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "pcurves", tuple(self.pcurves))
        if not self.pcurves or any(c.control_points.shape[1] != 2 for c in self.pcurves):
            raise BadGeometry("trim loop", "needs at least one curve in (u, v)")
        starts = np.array([c.control_points[0] for c in self.pcurves])
        ends = np.array([c.control_points[-1] for c in self.pcurves])
        size = max(float(np.ptp(np.concatenate([c.control_points for c in self.pcurves]), axis=0).max()), 1e-300)
        gap = np.abs(np.roll(starts, -1, axis=0) - ends).max(axis=1)
        if gap.max() > 1e-9 * size:
            raise BadGeometry(
                "trim loop", f"curve {int(gap.argmax())} ends {gap.max():.3g} away from the start of the next"
            )

    def at(self, places: np.ndarray) -> np.ndarray:
        """(m, 2) parameters at places (m,): the number of a curve plus the share of its range; they may run round."""
        places = np.mod(places, len(self.pcurves))
        number = np.minimum(places.astype(np.int64), len(self.pcurves) - 1)
        uv = np.empty((len(places), 2))
        for k in np.unique(number):
            low, high = self.pcurves[k].domain
            here = number == k
            uv[here] = self.pcurves[k].point(low + (places[here] - k) * (high - low))
        return uv

    def polygon(self, per_curve: int = 64) -> np.ndarray:
        """(m, 2) points of the loop in the parameter plane, the first not repeated."""
        steps = [np.linspace(*c.domain, per_curve, endpoint=False) for c in self.pcurves]
        return np.concatenate([c.point(t) for c, t in zip(self.pcurves, steps)])

    def signed_area(self) -> float:
        """Area in the parameter plane, positive when the loop runs counter-clockwise."""
        x, y = self.polygon().T
        return 0.5 * float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))


@dataclass(frozen=True, eq=False)
class TrimmedSurface:
    """A part of a surface: `loops[0]` bounds it, the others are holes in it.

    Raises  BadGeometry when the outer loop is not counter-clockwise or a hole is not clockwise.
    """

    surface: BSplineSurface
    loops: tuple[TrimLoop, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "loops", tuple(self.loops))
        if not self.loops:
            raise BadGeometry("trimmed surface", "has no loop")
        for i, loop in enumerate(self.loops):
            if (loop.signed_area() > 0) != (i == 0):
                raise BadGeometry("trimmed surface", f"loop {i} runs {'clockwise' if i == 0 else 'counter-clockwise'}")


@dataclass(frozen=True, eq=False)
class ThickPiece:
    """A piece of a wall: an outer and an inner sheet, and the surfaces that close it between them.

    outer, inner  one loop each, with as many pcurves as there are wall surfaces; the normals of both sheets point to
                  the same side, away from the vessel's inside, so the inner one is turned over in the solid
    wall          wall[k](s, 0) runs along pcurve k of the outer loop and wall[k](s, 1) along pcurve k of the inner
                  loop, over the same parameter range; wall[k](1, t) is wall[k + 1](0, t)
    Raises  BadGeometry when the counts differ.
    """

    outer: TrimmedSurface
    inner: TrimmedSurface
    wall: tuple[BSplineSurface, ...] = field(default=())

    def __post_init__(self) -> None:
        object.__setattr__(self, "wall", tuple(self.wall))
        for name, sheet in (("outer", self.outer), ("inner", self.inner)):
            if len(sheet.loops) != 1 or len(sheet.loops[0].pcurves) != len(self.wall):
                raise BadGeometry(
                    "thick piece", f"the {name} sheet needs one loop of {len(self.wall)} curves, one a wall surface"
                )


@dataclass(frozen=True, eq=False)
class LipPiece:
    """A piece of a rim: one face from the outer wall over the lip to the inner one, and the fracture inside its edge.

         L .-->-- pcurves 0 .. n - 1, outer --->-. R      wall[k](s, 0) runs along pcurve k,
            '. wall[0] | wall[1] | ... wall[n-1] .'      wall[k](s, 1) along pcurve 2n - 1 - k, backward;
             '-<-- pcurves 2n - 1 .. n, inner -<-'        both over the same parameter range

    face  one loop of 2n pcurves, the first n from the lip point L to the lip point R, the others back to L; its normal
          points out of the material
    wall  n surfaces in a row; wall[k](1, t) is wall[k + 1](0, t); the row is collapsed to L where it begins and to R
          where it ends
    Raises  BadGeometry when the counts differ, or an end of the row is not collapsed.
    """

    face: TrimmedSurface
    wall: tuple[BSplineSurface, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "wall", tuple(self.wall))
        n = len(self.wall)
        if n == 0 or len(self.face.loops) != 1 or len(self.face.loops[0].pcurves) != 2 * n:
            raise BadGeometry("lip piece", f"the face needs one loop of {2 * n} curves, two a wall surface")
        for name, rung in (("first", self.wall[0].control_net[0]), ("last", self.wall[-1].control_net[-1])):
            if np.ptp(rung, axis=0).max() > 1e-9 * max(float(np.ptp(self.wall[0].control_net, (0, 1)).max()), 1e-300):
                raise BadGeometry("lip piece", f"the {name} wall does not end in a point of the lip")

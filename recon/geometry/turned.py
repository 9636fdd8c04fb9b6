"""A part turned about an axis, as its profile in the half plane beside the axis.

z ^
  |---.        place = origin + z axis + r (any direction at right angles to the axis)
  |   |
  |    \\       loops   closed rows of pieces, each from the end of the one before; the first is the outer one of
  |-----'              its body, pieces on the axis (r = 0) included
  +------> r
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from recon.geometry.bspline import BSplineCurve

__all__ = ["ProfileArc", "ProfileLine", "ProfilePiece", "ProfileSpline", "TurnedPart"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ProfileLine:
    """From start to end, (2,) as (r, z) each."""

    start: Floats
    end: Floats

    def scaled(self, scale: float) -> "ProfileLine":
        return ProfileLine(scale * self.start, scale * self.end)


@dataclass(frozen=True, eq=False)
class ProfileArc:
    """Arc of a circle from start through middle to end, (2,) as (r, z) each."""

    start: Floats
    middle: Floats
    end: Floats

    def scaled(self, scale: float) -> "ProfileArc":
        return ProfileArc(scale * self.start, scale * self.middle, scale * self.end)


@dataclass(frozen=True, eq=False)
class ProfileSpline:
    """A B-spline curve with control points (n, 2) as (r, z)."""

    curve: BSplineCurve

    @property
    def start(self) -> Floats:
        return self.curve.control_points[0]

    @property
    def end(self) -> Floats:
        return self.curve.control_points[-1]

    def scaled(self, scale: float) -> "ProfileSpline":
        return ProfileSpline(replace(self.curve, control_points=scale * self.curve.control_points))


ProfilePiece = ProfileLine | ProfileArc | ProfileSpline


@dataclass(frozen=True, eq=False)
class TurnedPart:
    """Axis and profile; origin (3,) on the axis, axis (3,) of unit length."""

    origin: Floats
    axis: Floats
    loops: tuple[tuple[ProfilePiece, ...], ...]

    def placed(self, turn: Floats, scale: float, shift: Floats) -> "TurnedPart":
        """The part under x -> shift + scale turn x."""
        loops = tuple(tuple(piece.scaled(scale) for piece in loop) for loop in self.loops)
        return TurnedPart(shift + scale * turn @ self.origin, turn @ self.axis, loops)

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

from recon.errors import BadGeometry
from recon.geometry.arrays import frozen_floats
from recon.geometry.bspline import BSplineCurve

__all__ = ["ProfileArc", "ProfileLine", "ProfilePiece", "ProfileSpline", "TurnedPart"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ProfileLine:
    """From start to end, (2,) as (r, z) each; raises BadGeometry."""

    start: Floats
    end: Floats

    def __post_init__(self) -> None:
        for name in ("start", "end"):
            object.__setattr__(self, name, frozen_floats(getattr(self, name), (2,), f"line of a profile: {name}"))

    def points(self, n: int) -> Floats:
        """(n, 2) points from end to end, evenly."""
        t = np.linspace(0.0, 1.0, n)[:, None]
        return np.asarray((1.0 - t) * self.start + t * self.end)

    @property
    def length(self) -> float:
        return float(np.linalg.norm(self.end - self.start))

    def scaled(self, scale: float) -> "ProfileLine":
        return ProfileLine(scale * self.start, scale * self.end)


@dataclass(frozen=True, eq=False)
class ProfileArc:
    """Arc of a circle from start through middle to end, (2,) as (r, z) each; raises BadGeometry."""

    start: Floats
    middle: Floats
    end: Floats

    def __post_init__(self) -> None:
        for name in ("start", "middle", "end"):
            object.__setattr__(self, name, frozen_floats(getattr(self, name), (2,), f"arc of a profile: {name}"))

    @property
    def circle(self) -> tuple[Floats, float]:
        """Centre (2,) and radius."""
        rows = 2.0 * np.stack([self.middle - self.start, self.end - self.start])
        square = [p @ p - self.start @ self.start for p in (self.middle, self.end)]
        centre = np.asarray(np.linalg.solve(rows, np.array(square)), dtype=np.float64)
        return centre, float(np.linalg.norm(self.start - centre))

    @property
    def angles(self) -> tuple[float, float]:
        """Angles of start and end around the centre, in radians; the middle lies between the two."""
        centre, _ = self.circle
        first, between, last = (float(np.arctan2(*(p - centre)[::-1])) for p in (self.start, self.middle, self.end))
        whole = 2.0 * np.pi
        if (between - first) % whole + (last - between) % whole > whole:
            return first, first - (first - last) % whole
        return first, first + (last - first) % whole

    def points(self, n: int) -> Floats:
        """(n, 2) points from end to end, evenly."""
        centre, radius = self.circle
        t = np.linspace(*self.angles, n)
        return np.asarray(centre + radius * np.column_stack([np.cos(t), np.sin(t)]))

    @property
    def length(self) -> float:
        first, last = self.angles
        return self.circle[1] * abs(last - first)

    def scaled(self, scale: float) -> "ProfileArc":
        return ProfileArc(scale * self.start, scale * self.middle, scale * self.end)


@dataclass(frozen=True, eq=False)
class ProfileSpline:
    """A B-spline curve with control points (n, 2) as (r, z); raises BadGeometry for one in space."""

    curve: BSplineCurve

    def __post_init__(self) -> None:
        if self.curve.control_points.shape[1] != 2:
            raise BadGeometry("spline of a profile", "has control points in space where (r, z) are needed")

    @property
    def start(self) -> Floats:
        return self.curve.control_points[0]

    @property
    def end(self) -> Floats:
        return self.curve.control_points[-1]

    def points(self, n: int) -> Floats:
        """(n, 2) points at even parameters."""
        return self.curve.point(np.linspace(*self.curve.domain, n))

    @property
    def length(self) -> float:
        """Of the control polygon, which is a little longer than the curve."""
        return float(np.linalg.norm(np.diff(self.curve.control_points, axis=0), axis=1).sum())

    def scaled(self, scale: float) -> "ProfileSpline":
        return ProfileSpline(replace(self.curve, control_points=scale * self.curve.control_points))


ProfilePiece = ProfileLine | ProfileArc | ProfileSpline


@dataclass(frozen=True, eq=False)
class TurnedPart:
    """Axis and profile; origin (3,) on the axis, axis (3,) of unit length.

    Raises  BadGeometry, also where a loop is not closed.
    """

    origin: Floats
    axis: Floats
    loops: tuple[tuple[ProfilePiece, ...], ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "origin", frozen_floats(self.origin, (3,), "turned part: origin"))
        object.__setattr__(self, "axis", frozen_floats(self.axis, (3,), "turned part: axis"))
        object.__setattr__(self, "loops", tuple(tuple(loop) for loop in self.loops))
        if abs(np.linalg.norm(self.axis) - 1.0) > 1e-6:
            raise BadGeometry("turned part", "its axis is not of unit length")
        if not self.loops or not all(self.loops):
            raise BadGeometry("turned part", "has no profile, or a loop of no pieces")
        for number, loop in enumerate(self.loops):
            starts, ends = np.array([piece.start for piece in loop]), np.array([piece.end for piece in loop])
            gap = np.abs(np.roll(starts, -1, axis=0) - ends).max(axis=1)
            if gap.max() > 1e-9 * max(float(np.abs(starts).max()), 1e-300):
                raise BadGeometry(
                    "turned part", f"piece {int(gap.argmax())} of loop {number} ends away from the start of the next"
                )

    def outlines(self, step: float) -> list[Floats]:
        """Each loop as a closed row of points (n, 2), no farther apart than about a step where it is curved."""
        return [np.concatenate([piece.points(_count(piece, step))[:-1] for piece in loop]) for loop in self.loops]

    def placed(self, turn: Floats, scale: float, shift: Floats) -> "TurnedPart":
        """The part under x -> shift + scale turn x."""
        loops = tuple(tuple(piece.scaled(scale) for piece in loop) for loop in self.loops)
        return TurnedPart(shift + scale * turn @ self.origin, turn @ self.axis, loops)


def _count(piece: ProfilePiece, step: float) -> int:
    return 2 if isinstance(piece, ProfileLine) else max(3, int(np.ceil(piece.length / step)) + 1)

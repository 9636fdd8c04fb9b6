"""The wall around a hole laid flat in millimetres: coordinates (u, v, d) from the wheel's profile.

hole in the side: rolled out            hole over the axis, or near it: spread out from the axis
      v = s ^   .---.                            v ^  .-----.
            |  ( hole)                             | (  hole ) s - s_0 from the axis, at the angle θ
            |   '---'                              |  '--x--'  x the axis
            +---------> u = r̄ θ                    +-----------> u

s        length along the profile, s_0 where it crosses the axis
r̄        mean radius of the hole's edge
d        distance from the turned profile, positive away from the vessel's inside
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from recon.geometry.bspline import BSplineCurve
from recon.hole_patch.profile import Profile, wall_profile
from recon.hole_patch.surroundings import Axis, Wall

__all__ = ["DiskChart", "RolledChart", "WheelChart", "wheel_chart"]

Floats = NDArray[np.float64]


class WheelChart(Protocol):
    """Both charts turn right-handed (u, v) into normals away from the vessel's inside."""

    @property
    def profile(self) -> Profile:
        """What is turned."""

    def flat(self, points: Floats, normals: Floats | None = None) -> Floats:
        """(m, 3) u, v and d of points (m, 3); normals (m, 3) of the wall there tell the sides of a lip apart."""

    def space(self, flat: Floats) -> Floats:
        """(m, 3) points of (u, v, d) rows (m, 3): the inverse of `flat`."""

    def stretch(self, v: Floats) -> Floats:
        """(m,) millimetres on the wall for a millimetre of u."""

    def unfolded(self, uv: Floats) -> Floats:
        """(m, 3) points between which distances are those along the wall, also where it turns back over a lip."""

    def bend(self, v: Floats) -> Floats:
        """(m,) curvature of the profile, not negative."""

    def tip(self) -> float:
        """v where the profile turns back over the lip."""

    def limits(self) -> tuple[Floats, Floats]:
        """Lowest and highest (u, v) that the chart can hold."""


@dataclass(frozen=True, eq=False)
class RolledChart:
    """u around the axis, v along the profile."""

    profile: Profile
    mean_radius: float

    def flat(self, points: Floats, normals: Floats | None = None) -> Floats:
        return self.profile.chart(points, normals) * [self.mean_radius, 1.0, 1.0]

    def space(self, flat: Floats) -> Floats:
        return self.profile.space(flat / [self.mean_radius, 1.0, 1.0])

    def stretch(self, v: Floats) -> Floats:
        return self.profile.radius(v) / self.mean_radius

    def unfolded(self, uv: Floats) -> Floats:
        """On the surface of revolution with the same radii and lengths whose profile never turns back."""
        return _never_turning(self.profile, uv[:, 0] / self.mean_radius, uv[:, 1])

    def bend(self, v: Floats) -> Floats:
        return self.profile.bend(v)

    def tip(self) -> float:
        return self.profile.tip()

    def limits(self) -> tuple[Floats, Floats]:
        half_turn = 0.98 * np.pi * self.mean_radius
        low, high = self.profile.curve.domain
        return np.array([-half_turn, low]), np.array([half_turn, high])


@dataclass(frozen=True, eq=False)
class DiskChart:
    """Lengths along the profile from the axis, in the direction of θ: without a seam and, over the axis, smooth."""

    profile: Profile
    crossing: float

    def flat(self, points: Floats, normals: Floats | None = None) -> Floats:
        angle, s, d = self.profile.chart(points, normals).T
        return np.stack([(s - self.crossing) * np.sin(angle), (s - self.crossing) * np.cos(angle), d], axis=1)

    def space(self, flat: Floats) -> Floats:
        u, v, d = flat.T
        return self.profile.space(np.stack([np.arctan2(u, v), self.crossing + np.hypot(u, v), d], axis=1))

    def stretch(self, v: Floats) -> Floats:
        return np.ones_like(v)

    def unfolded(self, uv: Floats) -> Floats:
        """As of the rolled chart: down a foot ring and up again is as far as it is along the wall."""
        return _never_turning(self.profile, np.arctan2(*uv.T), self.crossing + np.hypot(*uv.T))

    def bend(self, v: Floats) -> Floats:
        return self.profile.bend(self.crossing + v)

    def tip(self) -> float:
        return self.profile.tip() - self.crossing

    def limits(self) -> tuple[Floats, Floats]:
        return np.full(2, -np.inf), np.full(2, np.inf)


def _never_turning(profile: Profile, angle: Floats, s: Floats) -> Floats:
    """(m, 3) points of angles and lengths along the profile whose heights only rise with the length."""
    steps = np.linspace(*profile.curve.domain, 2000)
    slope = profile.curve.derivative(steps)
    risen = np.concatenate([[0.0], np.cumsum(np.abs(slope[:-1, 1]) * np.diff(steps))])
    radius, height = profile.radius(np.clip(s, steps[0], steps[-1])), np.interp(s, steps, risen)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1)


def wheel_chart(wall: Wall, axis: Axis, *, start: BSplineCurve | None = None) -> WheelChart:
    """The chart that suits the hole in a wall; raises NoSurface as `wall_profile` does.

    start  the profile's curve for nearly the same wall
    """
    profile = wall_profile(wall, axis, start=start)
    if profile.crossing is not None:
        return DiskChart(profile, profile.crossing)
    return RolledChart(profile, float(axis.cylindrical(wall.edge.points)[:, 1].mean()))

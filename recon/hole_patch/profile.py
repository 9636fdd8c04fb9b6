"""The profile of a thrown wall and the chart that it spans about the wheel's axis.

A vessel from the wheel is one curve turned about one axis. The curve is read off the wall, robustly and mostly from the
side where the hole is; turned, it carries coordinates in which every wall, steep or flat, is nearly a sheet of paper.

      axis  z ^        s            chart of the hole
         |    |       /  ^ n          s ^   .---.
         |    |      /  /               |  ( hole)
         |    |  ,--'  '----> d         |   '---'
         |    '--+-----> r              +---------> θ

    θ        angle about the axis, 0 in the middle of the hole
    s        length along the profile, from base to mouth
    d        distance from the turned profile, positive away from the vessel's inside
    c(s)     the profile, (radius, height)
    n(s)     its unit normal: the tangent turned clockwise, (c'_z, -c'_r)

Over a lip the profile runs up the outer wall and down the inner one as one curve. There the nearest point of the curve
may lie on the other wall; the wall's own normals tell which side is meant.

      .--.       lip: c(s) turns back
      |  |       the walls may be as thin as the wheel is
    ^ |  | v     out of round
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from recon.errors import NoSurface
from recon.geometry.bspline import BSplineCurve
from recon.hole_patch.foot_curve import fit_foot_curve
from recon.hole_patch.profile_curve import curve_normals, fit_lip_curve, nearest_facing
from recon.hole_patch.section_samples import (
    SectionSamples,
    edge_length,
    lengths_from_lip,
    rough_lengths,
    section_normals,
    section_samples,
    wrapped,
)
from recon.hole_patch.surroundings import Axis, Wall
from recon.hole_patch.unit_length import axis_in, scaled_curve, unit_length, wall_in
from recon.numerics.ribbons import fold_point

__all__ = ["Profile", "wall_profile"]

Floats = NDArray[np.float64]

REACH = 30.0  # units
NEARNESS = np.radians(60.0)  # ovality has period π: a wall a quarter turn away may be out of round the other way
TIPS = 2000  # places among which the tip of a lip is sought
SEEDS = 8  # between two knots, from which the nearest point of the curve is sought
MOST_RIM = 200  # degrees: beyond, what is left of the rim does not tell whether the vessel is round
NEAR_AXIS = (
    0.25  # least over greatest radius of an edge that is rolled out; below, the chart would be stretched fourfold
)


@dataclass(frozen=True, eq=False)
class Profile:
    """A curve in (radius, height) about an axis, with the angle of the hole it was made for.

    axis      the wheel's axis
    curve     c(s), 2D, its parameter close to its length in millimetres, from base to mouth
    middle    angle in radians, in the axis's frame, that the chart counts from
    crossing  s where the profile crosses the axis, when the hole lies over or near it, else None; such a profile
              goes on beyond it as its own mirror image
    """

    axis: Axis
    curve: BSplineCurve
    middle: float
    crossing: float | None = None

    def chart(self, points: Floats, normals: Floats | None = None) -> Floats:
        """(m, 3) θ in [-π, π), s and d of points (m, 3); s stays at an end for points beyond it.

        normals  (m, 3) of the wall at the points, where it turns back over a lip
        """
        turned = self.axis.cylindrical(points)
        s = self.foot(turned[:, 1:], None if normals is None else section_normals(points, normals, self.axis))
        d = np.einsum("ij,ij->i", turned[:, 1:] - self.curve.point(s), self.normal(s))
        return np.stack([wrapped(turned[:, 0] - self.middle), s, d], axis=1)

    def space(self, chart: Floats) -> Floats:
        """(m, 3) points of chart coordinates (m, 3): the inverse of `chart`, straight on beyond the profile's ends."""
        s = np.clip(chart[:, 1], *self.curve.domain)
        normal = self.normal(s)
        tangent = np.stack([-normal[:, 1], normal[:, 0]], axis=1)
        section = self.curve.point(s) + (chart[:, 1] - s)[:, None] * tangent + chart[:, 2:] * normal
        return self.axis.cartesian(np.column_stack([chart[:, 0] + self.middle, section]))

    def normal(self, s: Floats) -> Floats:
        """(m, 2) unit normals n(s) in (radius, height)."""
        return curve_normals(self.curve, s)

    def radius(self, s: Floats) -> Floats:
        """(m,) distance of the profile from the axis."""
        return self.curve.point(s)[:, 0]

    def bend(self, s: Floats) -> Floats:
        """(m,) curvature, not negative."""
        first, second = self.curve.derivative(s), self.curve.derivative(s, 2)
        turn = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
        return np.asarray(np.abs(turn) / np.linalg.norm(first, axis=1) ** 3)

    def tip(self) -> float:
        """s where the profile of a wall turns back over the lip: where the ribbon between both walls is folded."""
        s = np.linspace(*self.curve.domain, TIPS)
        return float(s[fold_point(self.curve.point(s))])

    def foot(self, section: Floats, facing: Floats | None = None) -> Floats:
        """(m,) parameter of the profile's point nearest to each point (m, 2) in (radius, height).

        facing  (m, 2) the wall's normal there, so that a point's foot is not found on the other side of a thin wall
        """
        low, high = self.curve.domain
        seeds = np.linspace(low, high, SEEDS * len(self.curve.knots))
        s = seeds[nearest_facing(self.curve.point(seeds), self.normal(seeds), section, facing)]
        step = seeds[1] - seeds[0]
        for _ in range(4):
            off, first, second = (self.curve.derivative(s, k) for k in range(3))
            off = off - section
            slope = np.einsum("ij,ij->i", first, first) + np.einsum("ij,ij->i", off, second)
            # beyond the centre of curvature Newton runs away from the foot point: never more than a seed's distance
            move = np.einsum("ij,ij->i", off, first) / np.maximum(slope, 0.1)
            s = np.clip(s - np.clip(move, -step, step), low, high)
        return s


def wall_profile(
    wall: Wall, axis: Axis, *, reach: float = REACH, nearness: float = NEARNESS, start: BSplineCurve | None = None
) -> Profile:
    """The profile of a wall near its hole, read off the wall as scanned.

    As scanned, not as smoothed: the turn averages noise and relief away just as well, and a low-pass filter that is
    strong enough for relief cuts across the bend between base and wall by up to a millimetre.
    reach     units by which the profile goes on beyond the hole where the wall does
    nearness  radians; walls count by exp(-θ²/2 nearness²) of their angle from the hole
    start     the profile's curve for nearly the same wall, from where it is sooner found
    Promises  runs from base to mouth, and on down the inner wall where the wall runs over the lip; its normal on the
              side of the wall's normals; straight on by `EXTENDED` units beyond the wall, but not over the axis; parts
              off the wheel's surface (a handle, a spout) do not bend it. Where the hole lies over the axis, the profile
              bridges it with the least bending.
    Raises    NoSurface when the wall near the hole gives no single profile, or the hole leaves too little of it.
    """
    unit = unit_length(wall, axis)
    start = None if start is None else scaled_curve(start, 1.0 / unit)
    profile = _profile_in_units(wall_in(wall, unit), axis_in(axis, unit), reach, nearness, start)
    crossing = profile.crossing
    return Profile(
        axis,
        scaled_curve(profile.curve, unit),
        profile.middle,
        None if crossing is None else crossing * unit,
    )


def _profile_in_units(wall: Wall, axis: Axis, reach: float, nearness: float, start: BSplineCurve | None) -> Profile:
    edge = axis.cylindrical(wall.edge.points)
    over = _lies_over_axis(edge)
    middle, nearness = (0.0, np.inf) if over else (_middle_angle(edge), nearness)
    samples = section_samples(wall, axis, middle=middle, nearness=nearness)
    near = cKDTree(edge[:, 1:]).query(samples.place, distance_upper_bound=reach)[0] <= reach
    if wall.over_lip:
        _check_rim_left(edge, over)
    if wall.over_lip:
        s = lengths_from_lip(samples.of(near), edge[:, 1:], wall=wall.measured)
    else:
        s = rough_lengths(samples.of(near), edge[:, 1:], side=edge_length(wall.measured))
    together = np.isfinite(s)
    samples, s = samples.of(near).of(together), s[together]
    if wall.over_lip:
        return Profile(axis, fit_lip_curve(samples, s, side=edge_length(wall.measured), start=start), middle)
    if over:
        _check_leads_away(samples, s, edge[:, 1:])
    curve = fit_foot_curve(wall, axis, samples, s, over=over, start=start)
    return Profile(axis, curve, middle, _crossing(curve) if over else None)


def _check_rim_left(edge: Floats, over: bool) -> None:
    if over:
        raise NoSurface("The hole runs from the rim to the axis: too little of the profile is left beside it.")
    steps = wrapped(np.diff(edge[:, 0]))
    taken = float(np.degrees(np.ptp(np.cumsum(steps))))
    if taken > MOST_RIM:
        raise NoSurface(
            f"The hole takes {taken:.0f} degrees of the rim, allowed {MOST_RIM}: too little is left to go by."
        )


def _lies_over_axis(edge: Floats) -> bool:
    """Whether the hole goes round the axis, or comes near it for its size."""
    steps = wrapped(np.diff(edge[:, 0], append=edge[0, 0]))
    return bool(abs(steps.sum()) > np.pi or edge[:, 1].min() < NEAR_AXIS * edge[:, 1].max())


def _check_leads_away(samples: SectionSamples, s: Floats, edge: Floats) -> None:
    """A hole over the axis lies where the profile begins; else it was read from the mouth down."""
    order = np.argsort(s)
    few = max(1, len(s) // 100)
    away = cKDTree(edge).query(samples.place)[0]
    if np.median(away[order[:few]]) > np.median(away[order[-few:]]) + NEAR_AXIS * edge[:, 0].max():
        raise NoSurface(
            "The wall around the hole over the axis faces the wrong way: fracture was taken for wall there, or the"
            " other wall for this one. Look at the sherds around the hole, or give the outer walls alone."
        )


def _crossing(curve: BSplineCurve) -> float:
    """Parameter where the curve crosses the axis for the last time on its way to the mouth."""
    t = np.linspace(*curve.domain, 4000)
    radius = curve.point(t)[:, 0]
    k = int(np.flatnonzero((radius[:-1] <= 0.0) & (radius[1:] > 0.0))[-1])
    return float(t[k] - radius[k] * (t[k + 1] - t[k]) / (radius[k + 1] - radius[k]))


def _middle_angle(edge: Floats) -> float:
    """The angle halfway between the two ends of the hole."""
    steps = wrapped(np.diff(edge[:, 0], append=edge[0, 0]))
    unrolled = edge[0, 0] + np.concatenate([[0.0], np.cumsum(steps[:-1])])
    if np.ptp(unrolled) > np.radians(300.0):
        raise NoSurface("The hole takes more than 300 degrees of the turn: too little of the wall is left beside it.")
    return float(wrapped(np.array(0.5 * (unrolled.min() + unrolled.max()))))

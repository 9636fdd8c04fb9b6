"""One wall of the missing piece from the prior of the wheel: turned profile, thin residual, and the hole's edge.

Near its edge alone a hole says nothing about its middle. A thrown vessel does: its profile, read off the whole turn,
fills the hole up to a few tenths of a millimetre, a thin plate takes what the wheel left out of round, and in the last
millimetres the face gives way to the edge that was measured.

    d ^      edge                         edge
      |     --x                            x--     wall as scanned, with relief
      |   ~~~~ \\__                      __/ ~~~~   ~ wall in the mean
      |           '----. plate  .------'
      +-----------------------------------> along the wall

    u, v     the wall laid flat (`recon.hole_patch.wheel_chart`)
    d        distance from the turned profile
    κ        curvature of the profile
    e        what is left at the edge above profile and plate
    ℓ        length over which e fades into the face, d += e exp(-(distance / ℓ)²)

Paper  [kinoshita], section 3.4, for the fitted and trimmed face; [piegl1997], section 9.2.5, for the tensor spline.
"""

from collections.abc import Callable
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.interpolate import make_interp_spline
from scipy.ndimage import gaussian_filter1d, minimum_filter1d
from scipy.spatial import cKDTree

from recon.errors import NoSurface
from recon.geometry.bspline import BSplineSurface
from recon.geometry.trimmed import TrimmedSurface
from recon.hole_patch.residual import Residual, Ring, fit_residual, tensor_rows
from recon.hole_patch.section_samples import vertex_areas_and_normals
from recon.hole_patch.sheet import Sheet
from recon.hole_patch.surroundings import Axis, Wall
from recon.hole_patch.trim_loop import SPACING as TRIM_SPACING
from recon.hole_patch.trim_loop import parameter_loop
from recon.hole_patch.unit_length import RADIUS, axis_in, scaled_curve, scaled_sheet, unit_length, wall_in
from recon.hole_patch.wheel_chart import WheelChart, wheel_chart
from recon.hole_patch.wheel_edge import (
    DOWN,
    MARGIN,
    SPACING,
    even_edge,
    loop_length,
    sound_points,
    with_clean_edge,
)
from recon.numerics.bspline_basis import greville, uniform_knots
from recon.numerics.foot_points import foot_points

__all__ = [
    "WallFit",
    "fit_any_wall",
    "fit_wall",
    "sheet_of_fit",
    "wheel_sheet",
]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

# lengths in units of the vessel (`recon.hole_patch.unit_length`) where nothing else is said
SPAN = 1.0  # between the face's knots: half of what the edge is smoothed over on either side
MOST_SPANS = 64
LOOP_SPACING, CLEANED = 1.2, 1.5  # between points of the trim loop, and what is narrower than twice that many of them
LEAST_EDGE = 0.5  # of the hole's edge, where it is walked over the lip, that must be left when it is cleaned
MEETINGS = 4  # rounds in which the face is drawn to the edge that it missed
NEIGHBOURS = 16  # points of the edge that a node averages over: 1.5 units to either side
OUT_OF_ROUND = 3.0  # relief is well below, a wrong axis well above
LIP_SPANS = 0.2, 0.5  # least length between knots over a lip, and their distance there in radii of curvature
MOST_LIP_SPANS = 96
FADING = (1.5, 6.0)  # what the knots can follow, and a quarter of the widest ring


@dataclass(frozen=True, eq=False)
class _Face:
    """A rectangle of the chart under bicubic splines, interpolated at the products of their Greville abscissae."""

    chart: WheelChart
    knots: tuple[Floats, Floats]

    def nodes(self) -> Floats:
        """(nu ns, 2) u and s of the abscissae."""
        u, s = (_abscissae(k) for k in self.knots)
        return np.stack(np.meshgrid(u, s, indexing="ij"), axis=-1).reshape(-1, 2)

    def interpolated(self, values: Floats) -> Floats:
        """(nu, ns, k) coefficients of the splines that take the values (nu ns, k) at the nodes."""
        u, s = (_abscissae(k) for k in self.knots)
        rows = make_interp_spline(u, values.reshape(len(u), len(s), -1), k=3, t=self.knots[0]).c
        return make_interp_spline(s, rows.transpose(1, 0, 2), k=3, t=self.knots[1]).c.transpose(1, 0, 2)

    def surface(self, distance: Floats) -> BSplineSurface:
        """The bicubic surface at the distances (nu ns,) from the turned profile."""
        return BSplineSurface(
            3, 3, *self.knots, self.interpolated(self.chart.space(np.column_stack([self.nodes(), distance])))
        )


@dataclass(frozen=True, eq=False)
class WallFit:
    """What is known of a wall over its hole before a face is made, all in units.

    unit      in millimetres
    wall      its edge cleaned, where it runs over a lip
    edge      (n, 3) u, v, d of the hole's edge
    residual  d over the chart, fitted to the ring
    sound     (n,) points of the edge that were measured and are no chips
    bridge    what (m, 2) u, v add to d where the edge's own stand-off is carried over the hole; None where it fades out
    """

    unit: float
    wall: Wall
    chart: WheelChart
    edge: Floats
    ring: Ring
    residual: Residual
    sound: Bools
    bridge: Callable[[Floats], Floats] | None = None

    def at(self, uv: Floats) -> Floats:
        """(m,) d at u and v (m, 2), before the face gives way to the edge."""
        distance = self.residual.at(uv)
        return distance if self.bridge is None else distance + self.bridge(uv)

    def left(self) -> Floats:
        """(n,) e along the edge."""
        return np.asarray(self.edge[:, 2] - self.at(self.edge[:, :2]))

    def fading(self) -> float:
        """ℓ in units."""
        return _fading_length(even_edge(self.edge, self.left(), self.sound))


def wheel_sheet(wall: Wall, axis: Axis, *, n_curves: int = 4) -> Sheet:
    """One wall of the missing piece as a trimmed bicubic surface.

    n_curves  number of curves that the trim loop is cut into
    Promises  S_u x S_v points away from the vessel's inside; u and v are millimetres of the wall laid flat; `base` is
              the face before it gave way to the edge. Chips in the edge (at most one point in fifty) and
              stretches that strayed from the wall do not draw the face and are left out of `edge_distance`; the notes
              count them. Where the wall runs over the lip the sheet does, and says where its tip is.
    Raises    NoSurface when the wall around the hole gives no profile or no ring, or is so far from round that the
              ring cannot be foretold from itself.
    """
    return sheet_of_fit(fit_wall(wall, axis), n_curves=n_curves)


def sheet_of_fit(fit: WallFit, *, n_curves: int = 4) -> Sheet:
    """The sheet that `wheel_sheet` makes from what is known of a wall."""
    return scaled_sheet(_sheet_in_units(fit, n_curves), fit.unit)


def _sheet_in_units(fit: WallFit, n_curves: int) -> Sheet:
    wall, chart, edge, sound = fit.wall, fit.chart, fit.edge, fit.sound
    left, measured = fit.left(), wall.edge.sherds >= 0
    face = _lip_face(chart, edge) if wall.over_lip else _face(chart, edge)
    distance = fit.at(face.nodes())
    base = face.surface(distance)
    surface = face.surface(_drawn_to_edge(face, distance, even_edge(edge, left, sound)))
    uv = foot_points(surface, wall.edge.points, edge[:, :2])
    off = np.linalg.norm(surface.point(uv) - wall.edge.points, axis=1)
    spacing = min(LOOP_SPACING, TRIM_SPACING / fit.unit)
    loop = parameter_loop(surface, uv, n_curves=n_curves, spacing=spacing, cleaning=CLEANED * spacing)
    trimmed = TrimmedSurface(surface, (loop,))
    lip = chart.tip() if wall.over_lip else None
    sides = 3 if wall.over_lip else 4
    rejected = float((measured & ~sound).sum() / measured.sum())
    return Sheet(
        trimmed,
        off[sound],
        len(fit.ring.distance),
        sides,
        base=base,
        rejected=rejected,
        lip=lip,
        sound=sound,
        notes=_notes(measured, sound),
    )


# walls are never changed, and leave with the surroundings they belong to
_FITTED: WeakKeyDictionary[Wall, tuple[Axis, WallFit]] = WeakKeyDictionary()


def fit_wall(wall: Wall, axis: Axis, *, like: WallFit | None = None) -> WallFit:
    """The chart of a wall, its residual and the hole's edge in it; raises NoSurface as `wheel_sheet` does.

    like  the fit of nearly the same wall: its profile is where this one's begins, and the residual is as stiff
    """
    fit = fit_any_wall(wall, axis, like=like)
    if fit.residual.foretold > OUT_OF_ROUND:
        raise NoSurface(
            "The wall around the hole is not round: left-out parts of it were missed by"
            f" {fit.residual.foretold / RADIUS:.1%} of the vessel's radius on average, allowed"
            f" {OUT_OF_ROUND / RADIUS:.1%}; use the box method."
        )
    return fit


def fit_any_wall(wall: Wall, axis: Axis, *, like: WallFit | None = None) -> WallFit:
    """As `fit_wall`, however far from round the wall is.

    A wall is fitted once: the second look, the sheet and its confidence ask for the same.
    """
    if like is not None:
        return _fitted(wall, axis, like)
    known = _FITTED.get(wall)
    if known is None or known[0] is not axis:
        known = _FITTED[wall] = axis, _fitted(wall, axis, None)
    return known[1]


def _fitted(wall: Wall, axis: Axis, like: WallFit | None) -> WallFit:
    unit = unit_length(wall, axis)
    wall, axis = wall_in(wall, unit), axis_in(axis, unit)
    start = None if like is None else scaled_curve(like.chart.profile.curve, like.unit / unit)
    chart = wheel_chart(wall, axis, start=start)
    if wall.edge.normals is not None:
        wall = _with_enough_edge(with_clean_edge(wall, chart, DOWN / unit), len(wall.edge.points))
    edge = chart.flat(wall.edge.points, wall.edge.normals)
    ring = _ring(wall, chart, edge)
    residual = fit_residual(ring, chart.stretch, stiffness=None if like is None else like.residual.stiffness)
    left = edge[:, 2] - residual.at(edge[:, :2])
    sound = sound_points(left, loop_length(wall.edge.points), wall.edge.sherds >= 0, unit)
    return WallFit(unit, wall, chart, edge, ring, residual, sound)


def _with_enough_edge(wall: Wall, before: int) -> Wall:
    left = len(wall.edge.points)
    if left < LEAST_EDGE * before:
        raise NoSurface(
            f"The walls around the hole keep to no wheel: {left} of {before} points of its edge lie where a turned wall"
            f" would have them, {LEAST_EDGE:.0%} needed. The sherds may not be round inside, or not in place."
        )
    return wall


def _ring(wall: Wall, chart: WheelChart, edge: Floats) -> Ring:
    """The wall as scanned within reach of the hole: half the hole's width, but 12 to 24 units."""
    width = float(np.clip(0.5 * np.ptp(edge[:, :2], axis=0).min(), 12.0, 24.0))
    away = cKDTree(wall.edge.points).query(wall.measured.vertices, distance_upper_bound=width)[0]
    near = np.flatnonzero(away < width)
    if len(near) == 0:
        raise NoSurface("No wall was found near the hole's edge.")
    areas, normals = vertex_areas_and_normals(wall.measured)
    flat = chart.flat(wall.measured.vertices[near], normals[near])
    outward = chart.space(flat + np.array([0.0, 0.0, 1.0])) - wall.measured.vertices[near]
    facing = np.einsum("ij,ij->i", outward, normals[near])
    low, high = chart.limits()
    inside = ((flat[:, :2] > low) & (flat[:, :2] < high)).all(axis=1) & (facing > 0.5)
    middle = 0.5 * (edge[:, :2].min(axis=0) + edge[:, :2].max(axis=0))
    _check_around(flat[inside, :2] - middle, width)
    kept = near[inside]
    # the farther ring counts less, and fades out, so that its width decides little
    weight = areas[kept] * facing[inside] * (1.0 - (away[kept] / width) ** 2) ** 2
    return Ring(flat[inside, :2], flat[inside, 2], weight, middle, width)


def _check_around(away: Floats, width: float) -> None:
    """Half of the turn around the hole must be wall: a hole at the rim has none above it."""
    sixteenth = np.unique((np.arctan2(away[:, 1], away[:, 0]) / (2 * np.pi) * 16).astype(np.int64) % 16)
    if len(away) < 100 or len(sixteenth) < 8:
        raise NoSurface(
            f"Too little of the wall lies near the hole: {len(away)} vertices, on"
            f" {len(sixteenth)} of 16 sides of it; give the sherds around it."
        )


def _face(chart: WheelChart, edge: Floats) -> _Face:
    """The hole's rectangle in the chart with a margin, as far as the chart goes."""
    low, high = _rectangle(chart, edge)
    spans = np.clip(np.ceil((high - low) / SPAN), 8, MOST_SPANS).astype(int)
    return _Face(chart, (_knots(spans[0], low[0], high[0]), _knots(spans[1], low[1], high[1])))


def _lip_face(chart: WheelChart, edge: Floats) -> _Face:
    """The same with knots that lie closer where the profile turns over the lip."""
    low, high = _rectangle(chart, edge)
    spans = int(np.clip(np.ceil((high[0] - low[0]) / SPAN), 8, MOST_SPANS))
    s = np.arange(low[1], high[1], 0.25 * LIP_SPANS[0])
    span = np.clip(LIP_SPANS[1] / np.maximum(chart.bend(s), 1e-6), LIP_SPANS[0], SPAN)
    # a spline forgets a change of its knots' distance within a few knots: the fine ones begin before the bend does
    density = gaussian_filter1d(minimum_filter1d(span, round(2 * SPAN / (s[1] - s[0]))), SPAN / (s[1] - s[0])) ** -1.0
    passed = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]) * np.diff(s))])
    count = int(np.clip(np.ceil(passed[-1]), 8, MOST_LIP_SPANS))
    breaks = np.interp(np.linspace(0.0, passed[-1], count + 1), passed, s)
    breaks[-1] = high[1]
    return _Face(chart, (_knots(spans, low[0], high[0]), np.concatenate([breaks[[0] * 3], breaks, breaks[[-1] * 3]])))


def _rectangle(chart: WheelChart, edge: Floats) -> tuple[Floats, Floats]:
    low, high = edge[:, :2].min(axis=0) - MARGIN, edge[:, :2].max(axis=0) + MARGIN
    least, greatest = chart.limits()
    return np.maximum(low, least), np.minimum(high, greatest)


def _abscissae(knots: Floats) -> Floats:
    # the mean of equal knots may round to a value beyond them, which the interpolation refuses
    return np.clip(greville(knots, 3), knots[0], knots[-1])


def _knots(spans: int, low: float, high: float) -> Floats:
    return uniform_knots(int(spans) + 3, 3, low, high)


def _drawn_to_edge(face: _Face, distance: Floats, edge: Floats) -> Floats:
    """(nu ns,) distances at the nodes that meet the edge (k, 3): what is missed there is faded into the face.

    A spline cannot follow every turn of the edge at once: what it missed is added again, a few times over.
    """
    fade = _fade(face, edge)
    at_edge = tensor_rows(*face.knots, edge[:, :2])
    missed = edge[:, 2]
    drawn = distance
    start = at_edge @ face.interpolated(distance).ravel()
    for _ in range(MEETINGS):
        drawn = drawn + fade @ missed
        missed = edge[:, 2] - (at_edge @ face.interpolated(drawn).ravel() - start)
    return drawn


def _fade(face: _Face, edge: Floats) -> "sparse.csr_array":
    """(nu ns, k) weights by which each node takes part in what is left at the points of the edge.

    Each row averages over the nearest stretch of the edge and sums to exp(-(distance / ℓ)²).
    """
    nodes = face.nodes()
    reach = _fading_length(edge)
    around, place = face.chart.unfolded(nodes), face.chart.unfolded(edge[:, :2])
    away, nearest = cKDTree(place).query(around, k=NEIGHBOURS)
    used = away[:, 0] < 3.0 * reach
    away, nearest = away[used], nearest[used]
    share = np.exp(-(away**2 - away[:, :1] ** 2) / (2 * SPAN**2 / 4))
    share *= (np.exp(-((away[:, 0] / reach) ** 2)) / share.sum(axis=1))[:, None]
    row = np.repeat(np.flatnonzero(used), NEIGHBOURS)
    return sparse.csr_array((share.ravel(), (row, nearest.ravel())), shape=(len(nodes), len(edge)))


def _fading_length(edge: Floats) -> float:
    """ℓ: the distance along the edge at which e has forgotten itself, its autocorrelation fallen to 1/e.

    A sherd out of place by a tenth bends the face gently over many millimetres, relief and chips over one or two: the
    best guess at a distance from the edge has the covariance of what is guessed.
    """
    e = edge[:, 2]
    power = np.abs(np.fft.rfft(e)) ** 2
    correlation = np.fft.irfft(power, len(e))
    below = np.flatnonzero(correlation[: len(e) // 2] < correlation[0] / np.e)
    forgotten = below[0] if len(below) else len(e) // 2
    return float(np.clip(forgotten * SPACING, *FADING))


def _notes(measured: Bools, sound: Bools) -> tuple[str, ...]:
    chips = int((measured & ~sound).sum())
    if not chips:
        return ()
    return (f"{chips} of {int(measured.sum())} points of the hole's edge stand off from the others and were left out.",)

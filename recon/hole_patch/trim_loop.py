"""The hole's edge as a closed row of curves on the surface.

A measured edge has spikes, jumps from sherd to sherd and places where it crosses itself; a trim loop must have none. It
is cleaned in a chart of the parameter plane in which lengths are about those on the surface, then a periodic cubic
spline is run through evenly spaced points and cut into curves.

    measured        closed, opened          evenly spaced, splined, cut
       _/\\_               _                       .-<-.
     _|    |__           _/ \\__                   /     \\        each dot a point of the row,
    |_      _/   -->    |     _/        -->      v       ^       0 where one curve ends and the next starts
      |__X_/            |____/                   0.->-.-'

Paper  [kinoshita], section 3.4 step 4; [piegl1997], section 9.2 (cubic spline interpolation).
"""

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree

from recon.errors import BadOption, NoSurface
from recon.geometry.bspline import BSplineCurve, BSplineSurface
from recon.geometry.trimmed import TrimLoop, TrimmedSurface
from recon.numerics.foot_points import foot_points
from recon.numerics.spline_parts import spline_part

__all__ = ["trim_loop", "parameter_loop", "withdrawn", "clean_polygon", "even_points", "crossings"]

Floats = NDArray[np.float64]
SPACING = 0.4
CLEANING_RADIUS = 0.6
ATTEMPTS = 3
SAMPLES_PER_SPAN = 6
SMALLEST_CURVE = 4


def trim_loop(
    surface: BSplineSurface,
    points: Floats,
    *,
    n_curves: int = 4,
    spacing: float = SPACING,
    cleaning: float = CLEANING_RADIUS,
) -> TrimLoop:
    """Project a closed polyline on the surface and run a row of curves through it.

    points    (n, 3) in millimetres, the first not repeated, in either direction; gaps are closed by straight steps
    n_curves  number of curves the loop is cut into, of about equal length
    spacing   distance between the points that the curves interpolate, in millimetres
    cleaning  radius in millimetres: what is narrower than twice that, outward or inward, is cut off or filled
    Promises  counter-clockwise in (u, v), begun near the first point, inside the domain, free of self-intersection, C2
              also where curves meet.
    Raises    NoSurface when the loop runs off the surface or cannot be freed of crossings; BadOption.
    """
    uv = foot_points(surface, points)
    return parameter_loop(surface, uv, n_curves=n_curves, spacing=spacing, cleaning=cleaning)


def parameter_loop(
    surface: BSplineSurface,
    uv: Floats,
    *,
    n_curves: int = 4,
    spacing: float = SPACING,
    cleaning: float = CLEANING_RADIUS,
) -> TrimLoop:
    """The same as `trim_loop`, for an edge (n, 2) that is already known in the surface's parameters."""
    if n_curves < 1:
        raise BadOption("n_curves", f"a loop needs at least one curve, not {n_curves}")
    scale = _lengths(surface, uv)
    for attempt in range(ATTEMPTS):
        outline = _begun_near(clean_polygon(uv * scale, radius=cleaning * 2**attempt), uv[0] * scale)
        row = even_points(outline, spacing, n_curves * SMALLEST_CURVE)
        pcurves = _periodic_spline(row / scale, row, n_curves)
        loop = TrimLoop(pcurves)
        _check_inside(surface, loop)
        per_curve = SAMPLES_PER_SPAN * (len(row) // n_curves + 1)
        if len(crossings(loop.polygon(per_curve) * scale)) == 0:
            return loop
    raise NoSurface(
        f"the hole's edge crosses itself on the surface even after features narrower than"
        f" {2 * cleaning * 2**attempt:g} mm were removed; check the sherds' pose along the hole."
    )


def withdrawn(trimmed: TrimmedSurface, clearance: float) -> TrimmedSurface:
    """The same surface, its outer loop moved inward by a length in millimetres; corners are rounded, the largest part
    is kept.

    Raises    NoSurface when nothing is left.
    """
    from manifold3d import CrossSection, FillRule, JoinType

    loop = trimmed.loops[0]
    uv = loop.polygon(SAMPLES_PER_SPAN * max(len(c.knots) for c in loop.pcurves))
    scale = _lengths(trimmed.surface, uv)
    left = CrossSection([uv * scale], FillRule.NonZero).offset(-clearance, JoinType.Round, 2.0, 48).to_polygons()
    if not left:
        raise NoSurface(f"with a clearance of {clearance:g} mm nothing is left of the piece; give a smaller one.")
    outline = np.asarray(max(left, key=_area), dtype=np.float64)
    spacing = _step(loop, scale)
    drawn = parameter_loop(
        trimmed.surface,
        outline / scale,
        n_curves=len(loop.pcurves),
        spacing=spacing,
        cleaning=CLEANING_RADIUS / SPACING * spacing,
    )
    return TrimmedSurface(trimmed.surface, (drawn,))


def _step(loop: TrimLoop, scale: Floats) -> float:
    """Millimetres between the points that a loop was drawn through, in the mean."""
    polygon = loop.polygon() * scale
    length = float(np.linalg.norm(np.diff(polygon, axis=0, append=polygon[:1]), axis=1).sum())
    return length / sum(len(np.unique(curve.knots)) - 1 for curve in loop.pcurves)


def clean_polygon(polygon: Floats, *, radius: float) -> Floats:
    """(m, 2) simple counter-clockwise polygon near a closed one (n, 2), without narrow notches, spikes and crossings.

    Closing, then opening, by a disk of the given radius; of several parts the largest, its holes filled.
    Raises    NoSurface when nothing is left.
    """
    from manifold3d import CrossSection, FillRule, JoinType

    shape = CrossSection([polygon], FillRule.NonZero)
    for step in (radius, -2.0 * radius, radius):
        shape = _filled(shape).offset(step, JoinType.Round, 2.0, 48)
    outlines = _filled(shape).to_polygons()
    if not outlines:
        raise NoSurface(f"the hole is nowhere wider than {2 * radius:g} mm on the surface.")
    return np.asarray(max(outlines, key=_area), dtype=np.float64)


def even_points(polygon: Floats, spacing: float, at_least: int = 3) -> Floats:
    """(k, d) points at equal steps of length along a closed polyline (n, d), about `spacing` apart."""
    closed = np.concatenate([polygon, polygon[:1]])
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    count = max(at_least, round(length[-1] / spacing))
    at = np.linspace(0.0, length[-1], count, endpoint=False)
    return np.stack([np.interp(at, length, column) for column in closed.T], axis=1)


def crossings(polygon: Floats) -> NDArray[np.int64]:
    """(k, 2) pairs of sides of a closed polygon (n, 2) that cross or touch, neighbours apart."""
    a, b = polygon, np.roll(polygon, -1, axis=0)
    longest = float(np.linalg.norm(b - a, axis=1).max())
    pairs = cKDTree((a + b) / 2).query_pairs(longest * (1 + 1e-9), output_type="ndarray")
    apart = np.abs(pairs[:, 0] - pairs[:, 1])
    i, j = pairs[(apart > 1) & (apart < len(polygon) - 1)].T
    first = _turn(a[i], b[i], a[j]) * _turn(a[i], b[i], b[j])
    second = _turn(a[j], b[j], a[i]) * _turn(a[j], b[j], b[i])
    return np.stack([i, j], axis=1)[(first <= 0) & (second <= 0)]


def _lengths(surface: BSplineSurface, uv: Floats) -> Floats:
    """(2,) millimetres on the surface for one unit of u and of v, mean over the loop."""
    return np.array(
        [np.linalg.norm(surface.derivative(uv, 1 - axis, axis), axis=1).mean().clip(1e-300) for axis in (0, 1)]
    )


def _begun_near(polygon: Floats, point: Floats) -> Floats:
    """The same closed polygon, begun at its vertex nearest to a point."""
    return np.roll(polygon, -int(np.argmin(np.linalg.norm(polygon - point, axis=1))), axis=0)


def _filled(shape: Any) -> Any:
    """The shape's outer outlines alone, its holes filled."""
    from manifold3d import CrossSection, FillRule

    outlines = [p for p in shape.to_polygons() if _area(p) > 0]
    return CrossSection(outlines, FillRule.NonZero)


def _area(polygon: Floats) -> float:
    x, y = np.asarray(polygon, dtype=np.float64).T
    return 0.5 * float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))


def _turn(a: Floats, b: Floats, c: Floats) -> Floats:
    return (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])


def _periodic_spline(uv: Floats, chart: Floats, n_curves: int) -> tuple[BSplineCurve, ...]:
    """One periodic cubic spline through (k, 2) points, parameter = length in the chart, cut at points of the row."""
    closed = np.concatenate([uv, uv[:1]])
    steps = np.linalg.norm(np.diff(np.concatenate([chart, chart[:1]]), axis=0), axis=1)
    t = np.concatenate([[0.0], np.cumsum(steps)])
    slope = CubicSpline(t, closed, bc_type="periodic")(t, 1)
    cuts = np.linspace(0, len(uv), n_curves + 1).round().astype(int)
    parts = [spline_part(t[i : j + 1], closed[i : j + 1], slope[[i, j]]) for i, j in pairwise(cuts)]
    return tuple(BSplineCurve(3, knots, control) for knots, control in parts)


def _check_inside(surface: BSplineSurface, loop: TrimLoop) -> None:
    polygon = loop.polygon()
    low, high = np.array(surface.domain).T
    # A loop that touches the border of the domain was clamped there: the surface is too small for the hole.
    margin = 1e-6 * (high - low)
    if (polygon < low + margin).any() or (polygon > high - margin).any():
        raise NoSurface(
            "the hole's edge runs off the surface; the sherds around the hole do not carry a patch that covers it."
        )

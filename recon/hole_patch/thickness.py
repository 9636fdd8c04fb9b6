"""Two walls and the fracture between them: the missing piece as a solid in the making.

Stations are spread evenly along the edge of the outer wall, each gets a partner on the edge of the inner wall, and the
fracture is ruled from station to partner. Where only the outer wall is known, the inner one is it, moved inward.

      outer loop   0---1---2---3---4--        stations k, evenly spaced
                   |   |    \\   \\   |         the partner is the nearest point, but partners never go back:
      inner loop   0---1-----2---3--4--       x_0 < x_1 < ...  (isotonic regression)

    x_k     length along the inner loop at the partner of station k
    t_k     parameter of station k on both loops and on the wall: mean chord length of both
    κ       principal curvature; the offset by h folds where 1 - h κ <= 0

Paper  [barlow1972], isotonic regression; [piegl1997], sections 8.4 (ruled surfaces) and 9.2 (spline interpolation);
       [docarmo1976], parallel surfaces.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline, make_interp_spline, make_lsq_spline
from scipy.optimize import isotonic_regression
from scipy.spatial import cKDTree

from recon.errors import BadOption, NoWall
from recon.geometry.bspline import BSplineCurve, BSplineSurface
from recon.geometry.trimmed import ThickPiece, TrimLoop, TrimmedSurface
from recon.hole_patch.sheet import Sheet
from recon.numerics.bspline_basis import greville, uniform_knots
from recon.numerics.foot_points import foot_points

__all__ = ["Thickness", "offset_sheet", "thick_piece", "piece_thickness"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

QUADS = 4
SPACING = 0.35  # mm between stations: below the spacing of the points that trim loops are drawn through
FEWEST = 60  # stations a part
ON_SHEET = 1e-3  # mm by which the fracture may leave a sheet between stations
HALVINGS = 4  # of the steps between stations where it does
SAMPLES = 8  # points of a loop between two stations, to measure lengths on
LEAST_STEP = 0.4  # of the mean step between partners: a wall that narrows more is pinched
SAFE = 0.05  # least share of its width that the offset wall must keep everywhere
ROUNDED = 0.35  # of the thickness: how far a sharp bend may be rounded before it is moved


@dataclass(frozen=True)
class Thickness:
    """Thickness of a piece in millimetres, from points of the outer wall to their foot points on the inner one."""

    least: float
    mean: float
    greatest: float


def thick_piece(outer: Sheet, inner: Sheet) -> ThickPiece:
    """Close the piece between its two walls by a ruled fracture in four parts.

    Promises  the sheets keep their surfaces, their loops are drawn anew through the stations; wall[k](s, 0) lies on the
              outer loop and wall[k](s, 1) on the inner one at the same parameter: exactly at the stations, and between
              them to `ON_SHEET`, unless a loop is so crooked that `HALVINGS` are not enough; loops and fracture are C2
              along the edge, also from part to part.
    Raises    NoWall when the inner wall does not lie inside the outer one everywhere.
    """
    _check_apart(outer, inner)
    loops = _Loop.of(outer.trimmed), _Loop.of(inner.trimmed)
    per_quad = max(FEWEST, round(loops[0].length / SPACING / QUADS))
    even = np.linspace(0.0, loops[0].length, QUADS * per_quad, endpoint=False)
    pairs = np.stack([even, _partners(*loops, even)], axis=1)
    band = _band(loops, pairs, np.arange(QUADS) * per_quad)
    for _ in range(HALVINGS):
        wide = band.gaps() > ON_SHEET
        if not wide.any():
            break
        pairs, corners = _halved(loops, pairs, band.corners, wide)
        band = _band(loops, pairs, corners)
    return band.piece()


def offset_sheet(outer: Sheet, thickness_mm: float) -> Sheet:
    """The inner wall of a piece of which only the outer wall is known: the outer one moved inward along its normal.

    What the outer face gave way to at the edge, relief and chips, is no part of the inner wall: where the sheet keeps a
    smoother face on the same parameters, that one is moved. Where a sharp bend would fold the moved face, the face is
    rounded first, by at most `ROUNDED` of the thickness.
    Promises  the same parameters, the same loop in them, normals to the same side; `edge_distance` is empty, since no
              edge was measured; the notes say so, and by how much the face was rounded.
    Raises    BadOption when the thickness is not positive; NoWall when the wall is curved too sharply for it.
    """
    if not thickness_mm > 0.0:
        raise BadOption("thickness", f"must be positive, not {thickness_mm} mm")
    surface = outer.base if outer.base is not None and outer.box_angle_deg is None else outer.trimmed.surface
    uv = _places(outer.trimmed.loops[0].polygon(), 60)
    rounded = _rounded_enough(surface, uv, thickness_mm)
    notes = [f"The inner wall was not measured: it is the outer one moved inward by {thickness_mm:g} mm."]
    if rounded is not surface:
        change = float(np.linalg.norm(rounded.point(uv) - surface.point(uv), axis=1).max())
        notes.append(f"The inner wall was rounded by up to {change:.2f} mm at a bend sharper than the wall is thick.")
    moved = TrimmedSurface(_parallel(rounded, thickness_mm), outer.trimmed.loops)
    return Sheet(moved, np.zeros(0), 0, 0, notes=tuple(notes))


def piece_thickness(outer: Sheet, inner: Sheet) -> Thickness:
    """Thickness of the piece between two sheets, measured on a grid of points of the outer one within its loop."""
    away = _depths(outer, inner)[1]
    return Thickness(float(away.min()), float(away.mean()), float(away.max()))


@dataclass(frozen=True, eq=False)
class _Loop:
    """A trim loop by its length on the surface."""

    trimmed: TrimmedSurface
    places: Floats  # (m + 1,) curve number plus share of its range
    lengths: Floats  # (m + 1,) from 0 to the whole length
    points: Floats  # (m + 1, 3)

    @classmethod
    def of(cls, trimmed: TrimmedSurface) -> "_Loop":
        """Sampled finely enough that polyline and curve differ in length by less than a thousandth."""
        pcurves = trimmed.loops[0].pcurves
        per_curve = [SAMPLES * max(16, len(c.knots)) for c in pcurves]
        places = np.concatenate([k + np.arange(n) / n for k, n in enumerate(per_curve)] + [[len(pcurves)]])
        points = trimmed.surface.point(_on_curves(pcurves, places))
        steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
        return cls(trimmed, places, np.concatenate([[0.0], np.cumsum(steps)]), points)

    @property
    def length(self) -> float:
        return float(self.lengths[-1])

    def at(self, length: Floats) -> Floats:
        """(m, 2) parameters of the surface at lengths along the loop, which may run round it."""
        return _on_curves(self.trimmed.loops[0].pcurves, np.interp(length % self.length, self.lengths, self.places))


def _on_curves(pcurves: tuple[BSplineCurve, ...], places: Floats) -> Floats:
    number = np.minimum(places.astype(np.int64), len(pcurves) - 1)
    uv = np.empty((len(places), 2))
    for k, curve in enumerate(pcurves):
        here = number == k
        low, high = curve.domain
        uv[here] = curve.point(low + (places[here] - k) * (high - low))
    return uv


def _partners(outer: _Loop, inner: _Loop, stations: Floats) -> Floats:
    """(n,) increasing lengths x_k along the inner loop, once round it: the nearest point, made monotone."""
    n, whole = len(stations), inner.length
    away, index = cKDTree(inner.points[:-1]).query(outer.trimmed.surface.point(outer.at(stations)))
    nearest = inner.lengths[index]
    even = np.arange(n) * whole / n
    # ahead of or behind an even pace, counted from the most usual lead: robust against single stations far off
    lead = np.exp(2j * np.pi * (nearest - even) / whole)
    start = float(np.angle(lead.mean())) * whole / (2 * np.pi)
    ahead = (nearest - even - start + whole / 2) % whole - whole / 2
    least = LEAST_STEP * whole / n
    # three turns, so that the regression has no ends in the middle one
    turns = np.concatenate([even + ahead + k * whole for k in (-1, 0, 1)])
    floor = least * np.arange(3 * n)
    monotone = isotonic_regression(turns - floor).x + floor
    # averaged over a stretch as long as the wall is thick: rulings that turn faster cut each other
    half = max(1, round(0.5 * float(away.mean()) * n / outer.length))
    window = np.ones(2 * half + 1) / (2 * half + 1)
    return np.asarray(np.convolve(monotone, window, mode="same")[n : 2 * n] + start)


@dataclass(frozen=True, eq=False)
class _Band:
    """The fracture as a periodic spline through rows of (u, v) on the outer and inner sheet and both points."""

    loops: tuple[_Loop, _Loop]
    corners: Ints  # (QUADS,) stations where a part begins
    t: Floats  # (n + 1,)
    spline: CubicSpline
    rows: Floats  # (n + 1, 10)

    def gaps(self) -> Floats:
        """(n,) greatest distance between fracture and sheets, at quarters of the way from station to station."""
        worst = np.zeros(len(self.t) - 1)
        for share in (0.25, 0.5, 0.75):
            row = self.spline(self.t[:-1] + share * np.diff(self.t))
            for loop, uv, point in zip(self.loops, (row[:, 0:2], row[:, 2:4]), (row[:, 4:7], row[:, 7:10])):
                worst = np.maximum(worst, np.linalg.norm(loop.trimmed.surface.point(uv) - point, axis=1))
        return worst

    def piece(self) -> ThickPiece:
        parts = [self._part(a, b) for a, b in zip(self.corners, np.append(self.corners[1:], len(self.t) - 1))]
        outer, inner = (loop.trimmed for loop in self.loops)
        return ThickPiece(
            _retrimmed(outer, [(t, c[:, 0:2]) for t, c in parts]),
            _retrimmed(inner, [(t, c[:, 2:4]) for t, c in parts]),
            tuple(_ruled(t, c[:, 4:7], c[:, 7:10]) for t, c in parts),
        )

    def _part(self, first: int, last: int) -> tuple[Floats, Floats]:
        """Knots and control rows of the spline between two stations: the only one with these points and end slopes."""
        at = np.s_[first : last + 1]
        slope = self.spline(self.t[[first, last]], 1)
        part = make_interp_spline(self.t[at], self.rows[at], k=3, bc_type=([(1, slope[0])], [(1, slope[1])]))
        control = part.c.copy()
        control[0], control[-1] = self.rows[first], self.rows[last]
        return part.t, control


def _band(loops: tuple[_Loop, _Loop], pairs: Floats, corners: Ints) -> _Band:
    """The fracture through stations and partners (n, 2), lengths along the two loops."""
    uv = [loop.at(column) for loop, column in zip(loops, pairs.T)]
    points = [loop.trimmed.surface.point(q) for loop, q in zip(loops, uv)]
    rows = np.concatenate([*uv, *points], axis=1)
    rows = np.concatenate([rows, rows[:1]])
    steps = [np.linalg.norm(np.diff(rows[:, columns], axis=0), axis=1) for columns in (np.s_[4:7], np.s_[7:10])]
    t = np.concatenate([[0.0], np.cumsum(0.5 * (steps[0] + steps[1]))])
    return _Band(loops, corners, t, CubicSpline(t, rows, bc_type="periodic"), rows)


def _halved(loops: tuple[_Loop, _Loop], pairs: Floats, corners: Ints, wide: Bools) -> tuple[Floats, Ints]:
    """One more station in the middle of each wide step and of its two neighbours, so that steps change gently."""
    split = np.flatnonzero(wide | np.roll(wide, 1) | np.roll(wide, -1))
    ahead = np.concatenate([pairs[1:], pairs[:1] + [loop.length for loop in loops]])
    middle = 0.5 * (pairs[split] + ahead[split])
    return np.insert(pairs, split + 1, middle, axis=0), corners + np.searchsorted(split, corners)


def _retrimmed(trimmed: TrimmedSurface, parts: list[tuple[Floats, Floats]]) -> TrimmedSurface:
    return TrimmedSurface(trimmed.surface, (TrimLoop(tuple(BSplineCurve(3, t, control) for t, control in parts)),))


def _ruled(knots: Floats, outer: Floats, inner: Floats) -> BSplineSurface:
    """Straight from one spline to the other at equal parameters."""
    return BSplineSurface(3, 1, knots, np.array([0.0, 0.0, 1.0, 1.0]), np.stack([outer, inner], axis=1))


def _check_apart(outer: Sheet, inner: Sheet) -> None:
    points, depth = _depths(outer, inner)
    if depth.min() <= 0.0:
        x, y, z = points[int(depth.argmin())]
        raise NoWall(
            f"The inner wall comes out through the outer one by {-depth.min():.2f} mm near ({x:.1f}, {y:.1f}, {z:.1f}):"
            " check which walls the sherds' faces were taken for, or give a thickness."
        )


def _depths(outer: Sheet, inner: Sheet) -> tuple[Floats, Floats]:
    """(m, 3) points of the outer sheet within its loop, and (m,) how deep under them the inner sheet lies."""
    surface = outer.trimmed.surface
    uv = _places(outer.trimmed.loops[0].polygon(), 26)
    points = surface.point(uv)
    foot = foot_points(inner.trimmed.surface, points)
    # where the fracture slants, the outer sheet reaches beyond the inner one: there the border says nothing about depth
    low, high = np.array(inner.trimmed.surface.domain).T
    covered = ((foot > low) & (foot < high)).all(axis=1)
    if not covered.any():
        raise NoWall("The inner wall lies nowhere under the outer one: the holes found in both walls do not match.")
    uv, points, under = uv[covered], points[covered], inner.trimmed.surface.point(foot[covered])
    side = np.sign(np.einsum("ij,ij->i", points - under, surface.normal(uv)))
    return points, side * np.linalg.norm(points - under, axis=1)


def _places(polygon: Floats, n: int) -> Floats:
    """(m, 2) points of an n x n grid within a closed polygon, and points on it."""
    steps = np.linspace(polygon.min(axis=0), polygon.max(axis=0), n + 2)[1:-1]
    grid = np.stack(np.meshgrid(*steps.T, indexing="ij"), axis=-1).reshape(-1, 2)
    return np.concatenate([grid[_within(polygon, grid)], polygon[:: max(1, len(polygon) // (4 * n))]])


def _within(polygon: Floats, points: Floats) -> Bools:
    """(m,) whether points (m, 2) lie inside a closed polygon (n, 2): a ray to the right crosses it an odd number of
    times.
    """
    (ax, ay), (bx, by) = polygon.T, np.roll(polygon, -1, axis=0).T
    x, y = points[:, :1], points[:, 1:]
    straddles = (ay <= y) != (by <= y)
    reach = ax + (y - ay) * np.divide(bx - ax, by - ay, out=np.zeros_like(ax), where=by != ay)
    return np.asarray((straddles & (reach > x)).sum(axis=1) % 2 == 1)


def _rounded_enough(surface: BSplineSurface, uv: Floats, thickness: float) -> BSplineSurface:
    """The surface itself where its offset does not fold, else the least coarse fit to it whose offset does not.

    A parallel surface keeps 1 - h κ of its width in each principal direction.
    """
    curvature = _greatest_curvature(surface, uv)
    rounded = surface
    spans = np.array(surface.control_net.shape[:2]) - [surface.degree_u, surface.degree_v]
    while 1.0 - thickness * _greatest_curvature(rounded, uv).max() < SAFE:
        spans = (2 * spans) // 3
        if spans.max() < 2:
            break
        rounded = _coarser(surface, np.maximum(spans, 1))
        if np.linalg.norm(rounded.point(uv) - surface.point(uv), axis=1).max() > ROUNDED * thickness:
            break
    else:
        return rounded
    x, y, z = surface.point(uv[[int(curvature.argmax())]])[0]
    raise NoWall(
        f"A wall {thickness:g} mm thick would fold near ({x:.1f}, {y:.1f}, {z:.1f}), where the outer wall is curved"
        f" with a radius of {1.0 / curvature.max():.2f} mm: give a smaller thickness, or the sherds' inner walls."
    )


def _coarser(surface: BSplineSurface, spans: Ints) -> BSplineSurface:
    """Least squares with fewer knots, over the same parameters."""
    (u0, u1), (v0, v1) = surface.domain
    u, v = np.linspace(u0, u1, 129), np.linspace(v0, v1, 129)
    knots_u, knots_v = uniform_knots(spans[0] + 3, 3, u0, u1), uniform_knots(spans[1] + 3, 3, v0, v1)
    rows = make_lsq_spline(u, surface.grid(u, v), knots_u, k=3).c
    net = make_lsq_spline(v, rows.transpose(1, 0, 2), knots_v, k=3).c.transpose(1, 0, 2)
    return BSplineSurface(3, 3, knots_u, knots_v, net)


def _parallel(surface: BSplineSurface, thickness: float) -> BSplineSurface:
    """Interpolates the moved points at the products of the surface's Greville abscissae."""
    degrees, knots = (surface.degree_u, surface.degree_v), (surface.knots_u, surface.knots_v)
    # the mean of equal knots may round to a value beyond them, which the interpolation refuses
    u, v = (np.clip(greville(t, p), t[0], t[-1]) for t, p in zip(knots, degrees))
    uv = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
    moved = (surface.point(uv) - thickness * surface.normal(uv)).reshape(len(u), len(v), 3)
    rows = make_interp_spline(u, moved, k=degrees[0], t=knots[0]).c
    net = make_interp_spline(v, rows.transpose(1, 0, 2), k=degrees[1], t=knots[1]).c.transpose(1, 0, 2)
    return BSplineSurface(*degrees, *knots, net)


def _greatest_curvature(surface: BSplineSurface, uv: Floats) -> Floats:
    """(m,) the greater principal curvature, positive where the surface bends away from its normal, as a ball does."""
    su, sv = surface.derivative(uv, 1, 0), surface.derivative(uv, 0, 1)
    normal = surface.normal(uv)
    e, f, g = (np.einsum("ij,ij->i", a, b) for a, b in ((su, su), (su, sv), (sv, sv)))
    uu, uw, ww = (-np.einsum("ij,ij->i", surface.derivative(uv, *order), normal) for order in ((2, 0), (1, 1), (0, 2)))
    area = e * g - f * f
    mean, gauss = (e * ww - 2 * f * uw + g * uu) / (2 * area), (uu * ww - uw * uw) / area
    return np.asarray(mean + np.sqrt(np.maximum(mean**2 - gauss, 0.0)))

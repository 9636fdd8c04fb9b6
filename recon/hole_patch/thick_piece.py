"""Two walls and the fracture between them: the missing piece as a solid in the making.

Stations are spread evenly along the edge of the outer wall, each gets a partner on the edge of the inner wall. From
station to partner the wall of the piece runs straight, or, where the neighbours' fracture was scanned, along it.

      outer loop   0---1---2---3---4--        stations k, evenly spaced
                   |   |    \\   \\   |         the partner is the nearest point, but partners never go back:
      inner loop   0---1-----2---3--4--       x_0 < x_1 < ...  (isotonic regression)

    x_k     length along the inner loop at the partner of station k
    t_k     parameter of station k on both loops and on the wall: mean chord length of both
    c       clearance: both loops are drawn in by it, and the wall stays as far from the fracture

Paper  [barlow1972], isotonic regression; [piegl1997], sections 8.4 (ruled surfaces) and 9.2 (spline interpolation).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.optimize import isotonic_regression
from scipy.spatial import cKDTree

from recon.geometry.bspline import BSplineCurve, BSplineSurface
from recon.geometry.mesh import TriangleMesh
from recon.geometry.trimmed import ThickPiece, TrimLoop, TrimmedSurface
from recon.hole_patch.fracture_relief import HEIGHTS, fracture_relief
from recon.hole_patch.sheet import Sheet
from recon.hole_patch.thickness import check_apart
from recon.hole_patch.trim_loop import withdrawn
from recon.numerics.bernstein import bernstein, bernstein_derivative
from recon.numerics.spline_parts import spline_part

__all__ = ["thick_piece"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

QUADS = 4
SPACING = 0.35  # mm between stations: below the spacing of the points that trim loops are drawn through
FEWEST = 60  # stations a part
ON_SHEET = 1e-3  # mm by which the fracture may leave a sheet between stations
HALVINGS = 4  # of the steps between stations where it does
SAMPLES = 8  # points of a loop between two stations, to measure lengths on
STEEPEST = np.cos(np.radians(65.0))  # between the wall and the straight one: what turns farther is about to fold
DAMPED = 1.0  # mm along the edge over which relief that would fold is taken back
DAMPINGS = 12
LEAST_STEP = 0.4  # of the mean step between partners: a wall that narrows more is pinched


def thick_piece(
    outer: Sheet, inner: Sheet, fracture: TriangleMesh | None = None, *, clearance: float = 0.0
) -> ThickPiece:
    """Close the piece between its two walls by its fracture, in four parts.

    fracture   the neighbours' fracture faces that look into the hole, which the wall of the piece then follows; where
               there are none it is straight from the outer to the inner edge
    clearance  in millimetres: how far the piece stays away from its neighbours
    Promises   the sheets keep their surfaces, their loops are drawn anew through the stations; wall[k](s, 0) lies on
               the outer loop and wall[k](s, 1) on the inner one at the same parameter: exactly at the stations, and
               between them to `ON_SHEET`, unless a loop is so crooked that `HALVINGS` are not enough; loops and
               fracture are C2 along the edge, also from part to part; the wall does not fold between stations.
    Raises     NoWall when the inner wall does not lie inside the outer one everywhere; NoSurface when nothing of the
               piece is left by the clearance.
    """
    check_apart(outer, inner)
    trimmed = [sheet.trimmed if clearance == 0.0 else withdrawn(sheet.trimmed, clearance) for sheet in (outer, inner)]
    loops = _Loop.of(trimmed[0]), _Loop.of(trimmed[1])
    per_quad = max(FEWEST, round(loops[0].length / SPACING / QUADS))
    even = np.linspace(0.0, loops[0].length, QUADS * per_quad, endpoint=False)
    pairs = np.stack([even, _partners(*loops, even)], axis=1)
    relief = _relief(loops, pairs, fracture, clearance)
    band = _band(loops, pairs, relief, np.arange(QUADS) * per_quad)
    for _ in range(HALVINGS):
        wide = band.gaps() > ON_SHEET
        if not wide.any():
            break
        pairs, relief, corners = _halved(loops, pairs, relief, band.corners, wide)
        band = _band(loops, pairs, relief, corners)
    return _unfolded(band).piece()


def _relief(loops: "tuple[_Loop, _Loop]", pairs: Floats, fracture: TriangleMesh | None, clearance: float) -> Floats:
    """(n, HEIGHTS, 3) by how much the fracture leaves the straight line from station to partner."""
    if fracture is None or fracture.n_faces == 0:
        return np.zeros((len(pairs), len(HEIGHTS), 3))
    surfaces = [loop.trimmed.surface for loop in loops]
    uv = [loop.at(column) for loop, column in zip(loops, pairs.T)]
    outer, inner = (surface.point(q) for surface, q in zip(surfaces, uv))
    normals = surfaces[0].normal(uv[0]) + surfaces[1].normal(uv[1])
    return fracture_relief(outer, inner, normals, fracture, clearance=clearance)


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
        points = trimmed.surface.point(trimmed.loops[0].at(places))
        steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
        return cls(trimmed, places, np.concatenate([[0.0], np.cumsum(steps)]), points)

    @property
    def length(self) -> float:
        return float(self.lengths[-1])

    def at(self, length: Floats) -> Floats:
        """(m, 2) parameters of the surface at lengths along the loop, which may run round it."""
        return self.trimmed.loops[0].at(np.interp(length % self.length, self.lengths, self.places))


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
    rows: Floats  # (n + 1, 10 + 3 HEIGHTS): ..., and by how much the fracture leaves the straight line

    def gaps(self) -> Floats:
        """(n,) greatest distance between fracture and sheets, at quarters of the way from station to station."""
        worst = np.zeros(len(self.t) - 1)
        for share in (0.25, 0.5, 0.75):
            row = self.spline(self.t[:-1] + share * np.diff(self.t))
            for loop, uv, point in zip(self.loops, (row[:, 0:2], row[:, 2:4]), (row[:, 4:7], row[:, 7:10])):
                worst = np.maximum(worst, np.linalg.norm(loop.trimmed.surface.point(uv) - point, axis=1))
        return worst

    def folds(self) -> Bools:
        """(n,) whether the wall turns far from the straight one anywhere between a station and the next."""
        folded = np.zeros(len(self.t) - 1, dtype=bool)
        for share in (0.0, 0.25, 0.5, 0.75):
            at = self.t[:-1] + share * np.diff(self.t)
            row, along = self.spline(at), self.spline(at, 1)
            for height in np.linspace(0.0, 1.0, 9):
                weights, slopes = (rows[0, 1:-1] for rows in _lagrange(height))
                ahead = (1.0 - height) * along[:, 4:7] + height * along[:, 7:10]
                down = row[:, 7:10] - row[:, 4:7]
                moved = ahead + np.einsum("h,nhk->nk", weights, along[:, 10:].reshape(len(at), -1, 3))
                turned = down + np.einsum("h,nhk->nk", slopes, row[:, 10:].reshape(len(at), -1, 3))
                straight, normal = np.cross(ahead, down), np.cross(moved, turned)
                sizes = np.linalg.norm(straight, axis=1) * np.linalg.norm(normal, axis=1)
                folded |= np.einsum("ij,ij->i", straight, normal) < STEEPEST * sizes
        return folded

    def damped(self, share: Floats) -> "_Band":
        """The same band with the given share (n,) of its relief at each station."""
        rows = self.rows.copy()
        rows[:, 10:] *= np.append(share, share[0])[:, None]
        return _Band(self.loops, self.corners, self.t, CubicSpline(self.t, rows, bc_type="periodic"), rows)

    def piece(self) -> ThickPiece:
        parts = [self._part(a, b) for a, b in zip(self.corners, np.append(self.corners[1:], len(self.t) - 1))]
        outer, inner = (loop.trimmed for loop in self.loops)
        return ThickPiece(
            _retrimmed(outer, [(t, c[:, 0:2]) for t, c in parts]),
            _retrimmed(inner, [(t, c[:, 2:4]) for t, c in parts]),
            tuple(_wall(t, c[:, 4:7], c[:, 7:10], c[:, 10:].reshape(len(c), -1, 3)) for t, c in parts),
        )

    def _part(self, first: int, last: int) -> tuple[Floats, Floats]:
        """Knots and control rows of the spline between two stations: the only one with these points and end slopes."""
        at = np.s_[first : last + 1]
        return spline_part(self.t[at], self.rows[at], self.spline(self.t[[first, last]], 1))


def _band(loops: tuple[_Loop, _Loop], pairs: Floats, relief: Floats, corners: Ints) -> _Band:
    """The fracture through stations and partners (n, 2), lengths along the two loops."""
    uv = [loop.at(column) for loop, column in zip(loops, pairs.T)]
    points = [loop.trimmed.surface.point(q) for loop, q in zip(loops, uv)]
    rows = np.concatenate([*uv, *points, relief.reshape(len(pairs), -1)], axis=1)
    rows = np.concatenate([rows, rows[:1]])
    steps = [np.linalg.norm(np.diff(rows[:, columns], axis=0), axis=1) for columns in (np.s_[4:7], np.s_[7:10])]
    t = np.concatenate([[0.0], np.cumsum(0.5 * (steps[0] + steps[1]))])
    return _Band(loops, corners, t, CubicSpline(t, rows, bc_type="periodic"), rows)


def _unfolded(band: _Band) -> _Band:
    """The band, its relief halved around every place where the wall would fold, until it folds nowhere."""
    whole = band.t[-1]
    for _ in range(DAMPINGS):
        folded = band.folds() if band.rows[:, 10:].any() else np.zeros(1, dtype=bool)
        if not folded.any():
            return band
        apart = np.abs(band.t[:-1, None] - band.t[:-1][folded][None, :])
        near = np.minimum(apart, whole - apart).min(axis=1)
        band = band.damped(1.0 - 0.5 * np.exp(-((near / DAMPED) ** 2)))
    return band.damped(np.zeros(len(band.t) - 1))


def _lagrange(height: float) -> tuple[Floats, Floats]:
    """(1, k) weights of the points at 0, HEIGHTS and 1, and of the derivative, in the polynomial through them."""
    heights = np.array([0.0, *HEIGHTS, 1.0])
    control = np.linalg.inv(bernstein(len(heights) - 1, heights))
    return (
        bernstein(len(heights) - 1, height) @ control,
        bernstein_derivative(len(heights) - 1, height) @ control,
    )


def _halved(
    loops: tuple[_Loop, _Loop], pairs: Floats, relief: Floats, corners: Ints, wide: Bools
) -> tuple[Floats, Floats, Ints]:
    """One more station in the middle of each wide step and of its two neighbours, so that steps change gently."""
    split = np.flatnonzero(wide | np.roll(wide, 1) | np.roll(wide, -1))
    ahead = np.concatenate([pairs[1:], pairs[:1] + [loop.length for loop in loops]])
    middle = 0.5 * (pairs[split] + ahead[split])
    between = 0.5 * (relief[split] + np.roll(relief, -1, axis=0)[split])
    return (
        np.insert(pairs, split + 1, middle, axis=0),
        np.insert(relief, split + 1, between, axis=0),
        corners + np.searchsorted(split, corners),
    )


def _retrimmed(trimmed: TrimmedSurface, parts: list[tuple[Floats, Floats]]) -> TrimmedSurface:
    return TrimmedSurface(trimmed.surface, (TrimLoop(tuple(BSplineCurve(3, t, control) for t, control in parts)),))


def _wall(knots: Floats, outer: Floats, inner: Floats, relief: Floats) -> BSplineSurface:
    """From one spline to the other at equal parameters: straight, or by a quartic through the relief between them."""
    if not relief.any():
        return BSplineSurface(3, 1, knots, np.array([0.0, 0.0, 1.0, 1.0]), np.stack([outer, inner], axis=1))
    heights = np.array([0.0, *HEIGHTS, 1.0])
    degree = len(heights) - 1
    straight = outer[:, None] + heights[None, :, None] * (inner - outer)[:, None]
    straight[:, 1:-1] += relief
    control = np.einsum("ij,njk->nik", np.linalg.inv(bernstein(degree, heights)), straight)
    control[:, 0], control[:, -1] = outer, inner
    return BSplineSurface(3, degree, knots, np.repeat([0.0, 1.0], degree + 1), control)

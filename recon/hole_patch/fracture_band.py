"""The fracture of a piece: a surface along the hole's edge, through rungs from the outer to the inner edge.

      outer edge  --0---1---2---   k   stations, the same parameter t_k on both edges and on the fracture
                    |   (    )     each rung leaves the straight line by its bend, where the walls turn into each
      inner edge  --0---1---2---   other, and by the relief of the neighbours' fracture, where that was scanned

    t_k     mean chord length of both edges

Paper  [piegl1997], sections 8.4 (ruled surfaces) and 9.2 (spline interpolation).
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from recon.geometry.bspline import BSplineCurve, BSplineSurface
from recon.numerics.bernstein import bernstein, bernstein_derivative
from recon.numerics.foot_points import foot_points
from recon.numerics.polygons import within
from recon.numerics.spline_parts import spline_part

__all__ = ["HEIGHTS", "UV", "FractureBand", "FracturePart", "rung_points"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

HEIGHTS = (0.25, 0.5, 0.75)  # of the way from the outer to the inner edge
STEEPEST = np.cos(np.radians(65.0))  # between the fracture and the one without relief: what turns farther folds soon
DAMPED = 1.0  # mm along the edge over which relief that would fold is taken back
DAMPINGS = 12
PROBED = 0.5 - 0.5 * np.cos(np.pi * np.arange(1, 14) / 14.0)  # heights at which rungs must lie between the sheets: at
# sharp edges they pass through near their ends
OWN = 0.65  # of a rung's height, that is asked whether it lies beyond the sheet from which it starts
THROUGH = 1e-3  # mm beyond a sheet, at which a rung has passed through it
LIFT = np.sin(np.radians(5.0))  # at which rungs leave a sheet at least where they are pushed back
PUSHES, PUSHED = 8, 1.5  # times that it is pushed back, and by how many times as much: a little clear of the sheet

# columns of a row
UV, ENDS = (np.s_[0:2], np.s_[2:4]), (np.s_[4:7], np.s_[7:10])
BEND = np.s_[10 : 10 + 3 * len(HEIGHTS)]
RELIEF = np.s_[10 + 3 * len(HEIGHTS) : 10 + 6 * len(HEIGHTS)]


@dataclass(frozen=True, eq=False)
class FracturePart:
    """A stretch of the fracture between two stations, with the pcurves of its edges on the outer and inner surface."""

    outer: BSplineCurve
    inner: BSplineCurve
    wall: BSplineSurface


@dataclass(frozen=True, eq=False)
class FractureBand:
    """The fracture as one cubic spline along the edge.

    surfaces  that the outer and the inner edge lie on
    closed    whether the last station is the first again
    t         (n,) parameters of the stations
    rows      (n, 10 + 6 HEIGHTS) a station's (u, v) on both surfaces, its two points, bend and relief of its rung
    """

    surfaces: tuple[BSplineSurface, BSplineSurface]
    closed: bool
    t: Floats
    rows: Floats
    spline: CubicSpline

    @classmethod
    def along(cls, surfaces: tuple[BSplineSurface, BSplineSurface], uv: tuple[Floats, Floats]) -> "FractureBand":
        """With straight rungs between places (n, 2) on both surfaces; closed where the last place is the first."""
        points = [surface.point(q) for surface, q in zip(surfaces, uv)]
        rows = np.concatenate([*uv, *points, np.zeros((len(uv[0]), 6 * len(HEIGHTS)))], axis=1)
        steps = [np.linalg.norm(np.diff(rows[:, columns], axis=0), axis=1) for columns in ENDS]
        t = np.concatenate([[0.0], np.cumsum(0.5 * (steps[0] + steps[1]))])
        closed = bool((rows[0] == rows[-1]).all())
        return cls(surfaces, closed, t, rows, _spline(t, rows, closed))

    def ends(self) -> tuple[Floats, Floats]:
        """(n, 3) points of the stations on the outer and on the inner edge."""
        return self.rows[:, ENDS[0]], self.rows[:, ENDS[1]]

    def bend(self) -> Floats:
        """(n, HEIGHTS, 3) by how much the rungs without relief leave the straight ones."""
        return self.rows[:, BEND].reshape(len(self.rows), -1, 3)

    def following(self, *, bend: Floats | None = None, relief: Floats | None = None) -> "FractureBand":
        """The band with another bend or relief, (n, HEIGHTS, 3) each."""
        rows = self.rows.copy()
        for columns, given in ((BEND, bend), (RELIEF, relief)):
            if given is not None:
                rows[:, columns] = given.reshape(len(rows), -1)
        return replace(self, rows=rows, spline=_spline(self.t, rows, self.closed))

    def gaps(self) -> Floats:
        """(n - 1,) greatest distance between fracture and surfaces, at quarters of the way from station to station."""
        worst = np.zeros(len(self.t) - 1)
        for share in (0.25, 0.5, 0.75):
            row = self.spline(self.t[:-1] + share * np.diff(self.t))
            for surface, uv, point in zip(self.surfaces, UV, ENDS):
                worst = np.maximum(worst, np.linalg.norm(surface.point(row[:, uv]) - row[:, point], axis=1))
        return worst

    def folds(self) -> Bools:
        """(n - 1,) whether relief turns the fracture far from what it would be without, between one station and the
        next.
        """
        folded = np.zeros(len(self.t) - 1, dtype=bool)
        for share in (0.0, 0.25, 0.5, 0.75):
            at = self.t[:-1] + share * np.diff(self.t)
            row, along = self.spline(at), self.spline(at, 1)
            for height in np.linspace(0.0, 1.0, 9):
                plain = np.cross(_on_rung(along, height, (BEND,)), _down_rung(row, height, (BEND,)))
                moved = np.cross(_on_rung(along, height, (BEND, RELIEF)), _down_rung(row, height, (BEND, RELIEF)))
                sizes = np.linalg.norm(plain, axis=1) * np.linalg.norm(moved, axis=1)
                folded |= np.einsum("ij,ij->i", plain, moved) < STEEPEST * sizes
        return folded

    def enters(self) -> Bools:
        """(n - 1,) whether a rung beside the step from one station to the next passes through a sheet of the piece.

        Where fracture and wall meet at a sharp edge little relief is enough. Only of a closed band: the sheets of the
        piece end at its stations.
        """
        through = np.linalg.norm(self._beyond(PROBED), axis=2).max(axis=1) > 0.0
        return np.asarray(through[:-1] | through[1:])

    def _beyond(self, heights: Floats, lift: float = 0.0) -> Floats:
        """(n, heights, 3) ways back into the piece from points of the rungs that lie beyond its sheets, else 0.

        lift  sine of the angle at which rungs leave the sheets at least: what lies lower has a way back, too
        """
        back = np.zeros((len(self.rows), len(heights), 3))
        if not self.closed:
            return back
        points = np.stack([_on_rung(self.rows, height, (BEND, RELIEF)) for height in heights], axis=1)
        sides = heights < OWN, heights > 1.0 - OWN
        for surface, uv, end, side in zip(self.surfaces, UV, self.ends(), sides):
            own = points[:, side]
            start = np.repeat(self.rows[:, uv], own.shape[1], axis=0)
            feet = foot_points(surface, own.reshape(-1, 3), start, accuracy=1e-6)
            normals = surface.normal(feet)
            above = np.einsum("ij,ij->i", own.reshape(-1, 3) - surface.point(feet), normals)
            inward = np.sign(np.median(above))
            short = lift * np.linalg.norm(own - end[:, None], axis=2).ravel() - above * inward
            through = np.flatnonzero(short > THROUGH)
            through = through[within(self.rows[:, uv], feet[through])]
            way = np.zeros_like(normals)
            way[through] = inward * short[through, None] * normals[through]
            back[:, side] += way.reshape(own.shape)
        return back

    def unfolded(self) -> "FractureBand":
        """The band, its relief halved around every place where the fracture would fold or pass through a sheet of the
        piece, until it does so nowhere; what the relief is not to blame for is pushed back through the sheet.
        """
        return self._damped()._pushed_back()

    def _damped(self) -> "FractureBand":
        if not self.rows[:, RELIEF].any():
            return self
        band = self
        for _ in range(DAMPINGS):
            folded = band.folds() | band.enters()
            if not folded.any():
                return band
            apart = np.abs(band.t[:, None] - band.t[:-1][folded][None, :])
            if self.closed:
                apart = np.minimum(apart, band.t[-1] - apart)
                apart[-1] = apart[0]  # the same station, but for rounding
            share = 1.0 - 0.5 * np.exp(-((apart.min(axis=1) / DAMPED) ** 2))
            band = band.following(relief=band.rows[:, RELIEF] * share[:, None])
        return band.following(relief=np.zeros_like(band.rows[:, RELIEF])) if band.folds().any() else band

    def _pushed_back(self) -> "FractureBand":
        """The band with the rungs that pass through a sheet pushed back, and those beside them less."""
        apart = np.abs(self.t[:, None] - self.t[None, :])
        apart = np.minimum(apart, self.t[-1] - apart)
        near = np.exp(-((apart / DAMPED) ** 2))
        nearest = np.abs(PROBED[:, None] - np.array(HEIGHTS)).argmin(axis=1)
        band = self
        for _ in range(PUSHES):
            back = band._beyond(PROBED, LIFT)
            if not back.any():
                break
            moved = np.zeros_like(band.bend())
            for k in range(len(HEIGHTS)):
                mine = back[:, nearest == k]
                deep = np.linalg.norm(mine, axis=2)
                way = mine[np.arange(len(mine)), deep.argmax(axis=1)]
                worst = (near * deep.max(axis=1)).argmax(axis=1)
                moved[:, k] = PUSHED * near[np.arange(len(worst)), worst, None] * way[worst]
            band = band.following(relief=band.rows[:, RELIEF] + moved.reshape(len(moved), -1))
        return band

    def parts(self, corners: Ints) -> tuple[FracturePart, ...]:
        """Its stretches between stations of the given numbers: C2 along the edge, also from one to the next."""
        return tuple(_part(self, first, last) for first, last in pairwise(corners))


def rung_points(outer: Floats, inner: Floats) -> Floats:
    """(n, HEIGHTS, 3) points of straight rungs from outer to inner (n, 3)."""
    return outer[:, None] + np.array(HEIGHTS)[:, None] * (inner - outer)[:, None]


def _part(band: FractureBand, first: int, last: int) -> FracturePart:
    at = np.s_[first : last + 1]
    t, rows = spline_part(band.t[at], band.rows[at], band.spline(band.t[[first, last]], 1))
    wall = _wall(t, rows[:, ENDS[0]], rows[:, ENDS[1]], rows[:, BEND] + rows[:, RELIEF])
    return FracturePart(BSplineCurve(3, t, rows[:, UV[0]]), BSplineCurve(3, t, rows[:, UV[1]]), wall)


def _spline(t: Floats, rows: Floats, closed: bool) -> CubicSpline:
    return CubicSpline(t, rows, bc_type="periodic" if closed else "not-a-knot")


def _on_rung(row: Floats, height: float, moves: tuple[slice, ...]) -> Floats:
    """(n, 3) points at a height of rungs, or derivatives along the edge, from rows of the band or its derivative."""
    weights = _lagrange(height)[0][0, 1:-1]
    straight = (1.0 - height) * row[:, ENDS[0]] + height * row[:, ENDS[1]]
    return np.asarray(straight + sum(_weighted(weights, row[:, columns]) for columns in moves))


def _down_rung(row: Floats, height: float, moves: tuple[slice, ...]) -> Floats:
    """(n, 3) derivatives of rungs at a height."""
    slopes = _lagrange(height)[1][0, 1:-1]
    straight = row[:, ENDS[1]] - row[:, ENDS[0]]
    return np.asarray(straight + sum(_weighted(slopes, row[:, columns]) for columns in moves))


def _weighted(weights: Floats, moves: Floats) -> Floats:
    return np.asarray(np.einsum("h,nhk->nk", weights, moves.reshape(len(moves), -1, 3)))


def _lagrange(height: float) -> tuple[Floats, Floats]:
    """(1, k) weights of the points at 0, HEIGHTS and 1, and of the derivative, in the polynomial through them."""
    heights = np.array([0.0, *HEIGHTS, 1.0])
    control = np.linalg.inv(bernstein(len(heights) - 1, heights))
    return (
        bernstein(len(heights) - 1, height) @ control,
        bernstein_derivative(len(heights) - 1, height) @ control,
    )


def _wall(knots: Floats, outer: Floats, inner: Floats, moves: Floats) -> BSplineSurface:
    """From one spline to the other at equal parameters: straight, or by a quartic through the points between them."""
    if not moves.any():
        return BSplineSurface(3, 1, knots, np.array([0.0, 0.0, 1.0, 1.0]), np.stack([outer, inner], axis=1))
    heights = np.array([0.0, *HEIGHTS, 1.0])
    degree = len(heights) - 1
    points = outer[:, None] + heights[None, :, None] * (inner - outer)[:, None]
    points[:, 1:-1] += moves.reshape(len(moves), -1, 3)
    control = np.einsum("ij,njk->nik", np.linalg.inv(bernstein(degree, heights)), points)
    control[:, 0], control[:, -1] = outer, inner
    return BSplineSurface(3, degree, knots, np.repeat([0.0, 1.0], degree + 1), control)

"""A piece of the rim as a solid in the making: one face over the lip, and the fracture inside its edge.

The edge of the face runs over the lip at two points. They part it into a row on the outer wall and a row on the inner
one, and the fracture is ruled between them: its ends collapse where the rows meet.

            L ,-------- lip --------. R       laid open:  L --> outer row --> R   chain 0, counter-clockwise
             /|     outer wall      |\\                     |  |  |  |  |  |        rungs of the fracture, of length 0
            | '--> stations k ----->' |                   L --> inner row --> R   at L and R; chain 1, against the loop
            |        fracture         |
            '-------------------------'

    k        stations; rungs that are shortest in all (a ribbon), so that they follow a lip however it is rolled
    t_k      parameter of station k on both chains and on the fracture: mean chord length of both

Paper  [fuchs1977], the ribbon; [piegl1997], sections 8.4 (ruled surfaces) and 9.2 (spline interpolation).
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.ndimage import uniform_filter1d
from scipy.spatial import cKDTree

from recon.errors import NoWall
from recon.geometry.bspline import BSplineCurve, BSplineSurface
from recon.geometry.trimmed import LipPiece, TrimLoop, TrimmedSurface
from recon.hole_patch.sheet import Sheet
from recon.hole_patch.thickness import Thickness
from recon.numerics.polygons import within
from recon.numerics.ribbons import ribbon
from recon.numerics.spline_parts import spline_part

__all__ = ["lip_piece", "lip_thickness"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

WALLS = 4
SPACING = 0.35  # mm between stations
FEWEST = 240  # stations
STEP = 0.15  # mm between the points of both chains that are paired
PACE = 0.3  # what a millimetre of uneven pace along the chains counts beside one of the rungs
EVEN = 0.1  # share of an even pace in the pairs: no station stands still while the other chain goes on
ON_SHEET = 1e-3  # mm by which the fracture may leave the face between stations
HALVINGS = 4  # of the steps between stations where it does
SAMPLES = 8  # points of the loop in a span of its curves, to measure lengths on


def lip_piece(sheet: Sheet) -> LipPiece:
    """Close a piece of the rim by a ruled fracture.

    sheet     runs over the lip, and says where
    Promises  the face keeps its surface, its loop is drawn anew through the stations, and begins at the lip; wall[k]
              lies on it at both sides, exactly at the stations and between them to `ON_SHEET`, unless the loop is so
              crooked that `HALVINGS` are not enough.
    Raises    NoWall when the edge does not run over the lip on two sides.
    """
    chains = _chains(sheet)
    pairs = _pairs(*chains)
    band = _band(chains, pairs)
    for _ in range(HALVINGS):
        wide = band.gaps() > ON_SHEET
        if not wide.any():
            break
        split = np.flatnonzero(wide | np.roll(wide, 1) | np.roll(wide, -1))
        pairs = np.insert(pairs, split + 1, 0.5 * (pairs[split] + pairs[split + 1]), axis=0)
        band = _band(chains, pairs)
    return band.piece()


def lip_thickness(sheet: Sheet) -> Thickness:
    """Thickness of a piece of the rim: from points of the face on the outer wall, farther from the lip than the wall is
    thick in the mean, to the nearest on the inner wall, both within the loop.
    """
    loop = sheet.trimmed.loops[0].polygon()
    lip = _lip(sheet)
    uv = _grid(loop)
    points = sheet.trimmed.surface.point(uv)
    outer, inner = uv[:, 1] < lip, uv[:, 1] >= lip
    if not outer.any() or not inner.any():
        raise NoWall("The piece lies on one side of the lip only.")
    depth = cKDTree(points[inner]).query(points[outer])[0]
    deep = lip - uv[outer, 1] > depth.mean()
    counted = deep if deep.any() else np.ones_like(deep)
    return Thickness(points[outer][counted], depth[counted])


def _grid(polygon: Floats, n: int = 80) -> Floats:
    """(m, 2) points of an n x n grid within a closed polygon."""
    steps = np.linspace(polygon.min(axis=0), polygon.max(axis=0), n)
    grid = np.stack(np.meshgrid(*steps.T, indexing="ij"), axis=-1).reshape(-1, 2)
    return grid[within(polygon, grid)]


def _lip(sheet: Sheet) -> float:
    if sheet.lip is None:
        raise NoWall("The piece does not run over the lip.")
    return sheet.lip


@dataclass(frozen=True, eq=False)
class _Chain:
    """A part of a trim loop from one lip point to the other, by its length in space."""

    trimmed: TrimmedSurface
    places: Floats  # (m,) along the loop: number of the curve plus share of its range; may run backward or past the end
    lengths: Floats  # (m,) from 0 up

    @property
    def length(self) -> float:
        return float(self.lengths[-1])

    def at(self, length: Floats) -> Floats:
        """(n, 2) parameters at lengths along the chain."""
        return self.trimmed.loops[0].at(np.interp(length, self.lengths, self.places))

    def points(self, length: Floats) -> Floats:
        return self.trimmed.surface.point(self.at(length))


def _chains(sheet: Sheet) -> tuple[_Chain, _Chain]:
    """The loop on the outer wall and, run through the other way, on the inner one; both from L to R."""
    trimmed, lip = sheet.trimmed, _lip(sheet)
    loop = trimmed.loops[0]
    per_curve = [SAMPLES * max(16, len(c.knots)) for c in loop.pcurves]
    places = np.concatenate([k + np.arange(n) / n for k, n in enumerate(per_curve)])
    uv = loop.at(places)
    up, down = _crossings(loop, places, uv, lip)
    if not len(up) or not len(down):
        raise NoWall("The hole's edge does not run over the lip on two sides: the piece would have no fracture there.")
    right = up[np.argmax(loop.at(up)[:, 0])]
    left = down[np.argmin(loop.at(down)[:, 0])]
    n = float(len(loop.pcurves))
    outer = np.concatenate([[left], _between(places, left, (right - left) % n, n), [left + (right - left) % n]])
    inner = np.concatenate([[right], _between(places, right, (left - right) % n, n), [right + (left - right) % n]])
    return _chain(trimmed, outer), _chain(trimmed, inner[::-1])


def _crossings(loop: TrimLoop, places: Floats, uv: Floats, lip: float) -> tuple[Floats, Floats]:
    """Places where the loop crosses the lip upward, and downward."""
    above = uv[:, 1] >= lip
    ahead = np.append(places[1:], float(len(loop.pcurves)))
    crossed = []
    for way in (True, False):
        k = np.flatnonzero((above != np.roll(above, -1)) & (np.roll(above, -1) == way))
        low, high = places[k], ahead[k]
        for _ in range(50):
            middle = 0.5 * (low + high)
            over = (loop.at(middle)[:, 1] >= lip) == way
            low, high = np.where(over, low, middle), np.where(over, middle, high)
        crossed.append(0.5 * (low + high))
    return crossed[0], crossed[1]


def _between(places: Floats, start: float, span: float, n: float) -> Floats:
    """The places after the start, as far as the span goes round a loop of length n."""
    off = np.sort((places - start) % n)
    return start + off[(off > 1e-6) & (off < span - 1e-6)]


def _chain(trimmed: TrimmedSurface, places: Floats) -> _Chain:
    points = trimmed.surface.point(trimmed.loops[0].at(places))
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return _Chain(trimmed, places, np.concatenate([[0.0], np.cumsum(steps)]))


def _pairs(outer: _Chain, inner: _Chain) -> Floats:
    """(k + 1, 2) lengths along both chains at the stations, from L to R."""
    even = [np.linspace(0.0, chain.length, max(FEWEST, round(chain.length / STEP))) for chain in (outer, inner)]
    # on a round bead all rungs are as good as each other: an even pace on both chains decides
    mean = 0.5 * (outer.length + inner.length)
    paced = [
        np.column_stack([chain.points(row), PACE * mean * row / chain.length])
        for chain, row in zip((outer, inner), even)
    ]
    path = ribbon(*paced)
    lengths = np.stack([row[number] for row, number in zip(even, path.T)], axis=1)
    thick = np.linalg.norm(outer.points(lengths[:, 0]) - inner.points(lengths[:, 1]), axis=1).mean()
    # averaged over a stretch as long as the wall is thick: rungs that turn faster cut each other
    lengths = _smoothed(lengths, round(thick / STEP))
    share = np.linspace(0.0, 1.0, len(lengths))[:, None]
    lengths = (1.0 - EVEN) * lengths + EVEN * share * lengths[-1]
    count = max(FEWEST, WALLS * round(max(outer.length, inner.length) / SPACING / WALLS))
    way = lengths.sum(axis=1)
    at = np.linspace(0.0, way[-1], count + 1)
    return np.stack([np.interp(at, way, column) for column in lengths.T], axis=1)


def _smoothed(rows: Floats, half: int) -> Floats:
    """Means over 2 half + 1 rows; both ends stay, mirrored in themselves beyond."""
    half = min(half, len(rows) - 1)
    before, after = 2 * rows[:1] - rows[half:0:-1], 2 * rows[-1:] - rows[-2 : -half - 2 : -1]
    mean = uniform_filter1d(np.concatenate([before, rows, after]), 2 * half + 1, axis=0)
    return np.asarray(mean[half : half + len(rows)])


@dataclass(frozen=True, eq=False)
class _Band:
    """The fracture as a spline through rows of (u, v) on both chains and both points."""

    chains: tuple[_Chain, _Chain]
    t: Floats  # (n + 1,)
    spline: CubicSpline
    rows: Floats  # (n + 1, 10)

    def gaps(self) -> Floats:
        """(n,) greatest distance between fracture and face, at quarters of the way from station to station."""
        surface = self.chains[0].trimmed.surface
        worst = np.zeros(len(self.t) - 1)
        for share in (0.25, 0.5, 0.75):
            row = self.spline(self.t[:-1] + share * np.diff(self.t))
            for uv, point in ((row[:, 0:2], row[:, 4:7]), (row[:, 2:4], row[:, 7:10])):
                worst = np.maximum(worst, np.linalg.norm(surface.point(uv) - point, axis=1))
        return worst

    def piece(self) -> LipPiece:
        corners = np.linspace(0, len(self.t) - 1, WALLS + 1).round().astype(int)
        parts = [self._part(a, b) for a, b in pairwise(corners)]
        outer = [BSplineCurve(3, t, c[:, 0:2]) for t, c in parts]
        inner = [BSplineCurve(3, t, c[:, 2:4]).reversed() for t, c in parts]
        face = TrimmedSurface(self.chains[0].trimmed.surface, (TrimLoop((*outer, *inner[::-1])),))
        return LipPiece(face, tuple(_ruled(t, c[:, 4:7], c[:, 7:10]) for t, c in parts))

    def _part(self, first: int, last: int) -> tuple[Floats, Floats]:
        """Knots and control rows of the spline between two stations: the only one with these points and end slopes."""
        at = np.s_[first : last + 1]
        return spline_part(self.t[at], self.rows[at], self.spline(self.t[[first, last]], 1))


def _band(chains: tuple[_Chain, _Chain], pairs: Floats) -> _Band:
    uv = [chain.at(column) for chain, column in zip(chains, pairs.T)]
    for end in (0, -1):  # one point, found from both sides
        uv[1][end] = uv[0][end]
    points = [chain.trimmed.surface.point(q) for chain, q in zip(chains, uv)]
    rows = np.concatenate([*uv, *points], axis=1)
    steps = [np.linalg.norm(np.diff(rows[:, columns], axis=0), axis=1) for columns in (np.s_[4:7], np.s_[7:10])]
    t = np.concatenate([[0.0], np.cumsum(0.5 * (steps[0] + steps[1]))])
    return _Band(chains, t, CubicSpline(t, rows), rows)


def _ruled(knots: Floats, outer: Floats, inner: Floats) -> BSplineSurface:
    """Straight from one spline to the other at equal parameters."""
    return BSplineSurface(3, 1, knots, np.array([0.0, 0.0, 1.0, 1.0]), np.stack([outer, inner], axis=1))

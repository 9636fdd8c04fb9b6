"""Two walls and the fracture between them: the missing piece as a solid in the making.

Stations are spread evenly along the edge of the outer wall, each gets a partner on the edge of the inner wall. From
station to partner the wall of the piece runs straight, or, where the neighbours' fracture was scanned, along it.

      outer loop   0---1---2---3---4--        stations k, evenly spaced
                   |   |    \\   \\   |         the partner is the nearest point, but partners never go back:
      inner loop   0---1-----2---3--4--       x_0 < x_1 < ...  (isotonic regression)

    x_k     length along the inner loop at the partner of station k
    c       clearance: both loops are drawn in by it, and the wall stays as far from the fracture

Paper  [barlow1972], isotonic regression.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import isotonic_regression
from scipy.spatial import cKDTree

from recon.geometry.bspline import BSplineCurve
from recon.geometry.mesh import TriangleMesh
from recon.geometry.trimmed import ThickPiece, TrimLoop, TrimmedSurface
from recon.hole_patch.foot_rungs import bend_into_rings, ring_runs
from recon.hole_patch.fracture_band import UV, FractureBand, rung_points
from recon.hole_patch.fracture_relief import fracture_relief
from recon.hole_patch.sheet import Sheet
from recon.hole_patch.thickness import check_apart
from recon.hole_patch.trim_loop import withdrawn

__all__ = ["thick_piece"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

QUADS = 4
SPACING = 0.35  # mm between stations: below the spacing of the points that trim loops are drawn through
FEWEST = 60  # stations a part
ON_SHEET = 1e-4  # mm by which the fracture may leave a sheet between stations
HALVINGS = 6  # of the steps between stations where it does
SAMPLES = 8  # points of a loop between two stations, to measure lengths on
SLOW = 0.25  # of the least step, down a foot ring
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
    corners = np.arange(QUADS) * per_quad
    band = _band(loops, pairs)
    for _ in range(HALVINGS):
        wide = band.gaps() > ON_SHEET
        if not wide.any():
            break
        pairs, corners = _halved(loops, pairs, corners, wide)
        band = _band(loops, pairs)
    bend = bend_into_rings(band)
    if bend is not None:
        band = band.following(bend=bend)
    if fracture is not None and fracture.n_faces:
        band = band.following(relief=_relief(band, fracture, clearance)).unfolded()
    parts = band.parts(np.append(corners, len(pairs)))
    return ThickPiece(
        _retrimmed(trimmed[0], [part.outer for part in parts]),
        _retrimmed(trimmed[1], [part.inner for part in parts]),
        tuple(part.wall for part in parts),
    )


def _band(loops: "tuple[_Loop, _Loop]", pairs: Floats) -> FractureBand:
    """The straight fracture between stations and partners (n, 2), lengths along the two loops."""
    uv = [np.concatenate([q, q[:1]]) for q in (loop.at(column) for loop, column in zip(loops, pairs.T))]
    return FractureBand.along((loops[0].trimmed.surface, loops[1].trimmed.surface), (uv[0], uv[1]))


def _relief(band: FractureBand, fracture: TriangleMesh, clearance: float) -> Floats:
    """(n, HEIGHTS, 3) by how much the fracture leaves the straight line from station to partner."""
    outer, inner = (ends[:-1] for ends in band.ends())
    normals = sum(surface.normal(band.rows[:-1, uv]) for surface, uv in zip(band.surfaces, UV))
    middle = 0.5 * (outer + inner)
    away = np.cross(np.roll(middle, -1, axis=0) - np.roll(middle, 1, axis=0), normals)
    away /= np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-300)
    rungs = rung_points(outer, inner) + band.bend()[:-1]
    thickness = np.full(len(outer), np.median(np.linalg.norm(outer - inner, axis=1)))
    away = np.broadcast_to(away[:, None], rungs.shape)
    relief = fracture_relief(rungs, away, fracture, thickness=thickness, clearance=clearance)
    return np.concatenate([relief, relief[:1]])


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
    points = outer.trimmed.surface.point(outer.at(stations))
    away, index = cKDTree(inner.points[:-1]).query(points)
    nearest = inner.lengths[index]
    even = np.arange(n) * whole / n
    # ahead of or behind an even pace, counted from the most usual lead: robust against single stations far off
    lead = np.exp(2j * np.pi * (nearest - even) / whole)
    start = float(np.angle(lead.mean())) * whole / (2 * np.pi)
    ahead = (nearest - even - start + whole / 2) % whole - whole / 2
    ahead, down = _down_rings(ahead, points, inner.points[index] - points)
    least = LEAST_STEP * whole / n * np.where(down, SLOW, 1.0)
    # three turns, so that the regression has no ends in the middle one
    turns = np.concatenate([even + ahead + k * whole for k in (-1, 0, 1)])
    floor = np.cumsum(np.tile(least, 3))
    monotone = isotonic_regression(turns - floor).x + floor
    # averaged over a stretch as long as the wall is thick: rulings that turn faster cut each other
    half = max(1, round(0.5 * float(away.mean()) * n / outer.length))
    return _averaged(monotone, np.tile(_kept_from(down, half), 3))[n : 2 * n] + start


def _kept_from(down: Bools, half: int) -> Ints:
    """(n,) half widths that reach over no end of a run in a closed row: what lies beyond would draw it off a ring."""
    ends = np.flatnonzero(down != np.roll(down, 1))
    if not len(ends):
        return np.full(len(down), half)
    apart = np.abs(np.arange(len(down))[:, None] - ends)
    apart = np.minimum(apart, np.minimum(np.abs(apart - 1), len(down) - apart))
    return np.minimum(half, apart.min(axis=1))


def _averaged(values: Floats, half: Ints) -> Floats:
    """(n,) means over so many values on either side; those at the ends of the row are of no use."""
    total = np.concatenate([[0.0], np.cumsum(values)])
    at = np.arange(len(values))
    first, last = np.maximum(at - half, 0), np.minimum(at + half, len(values) - 1)
    return np.asarray((total[last + 1] - total[first]) / (last - first + 1))


def _down_rings(ahead: Floats, points: Floats, chord: Floats) -> tuple[Floats, Bools]:
    """(n,) leads of partners, even along each run of stations down a foot ring and up again; and (n,) where these are.

    points, chord  (n, 3) of the stations, and from there to the nearest points of the inner loop
    """
    n = len(points)
    ahead, down = ahead.copy(), np.zeros(n, dtype=bool)
    for rows in ring_runs(points, chord):
        ahead[rows] = np.linspace(ahead[rows[0] - 1], ahead[(rows[-1] + 1) % n], len(rows))
        down[rows] = True
    return ahead, down


def _halved(loops: tuple[_Loop, _Loop], pairs: Floats, corners: Ints, wide: Bools) -> tuple[Floats, Ints]:
    """One more station in the middle of each wide step and of its two neighbours, so that steps change gently."""
    split = np.flatnonzero(wide | np.roll(wide, 1) | np.roll(wide, -1))
    ahead = np.concatenate([pairs[1:], pairs[:1] + [loop.length for loop in loops]])
    middle = 0.5 * (pairs[split] + ahead[split])
    return np.insert(pairs, split + 1, middle, axis=0), corners + np.searchsorted(split, corners)


def _retrimmed(trimmed: TrimmedSurface, pcurves: list[BSplineCurve]) -> TrimmedSurface:
    return TrimmedSurface(trimmed.surface, (TrimLoop(tuple(pcurves)),))

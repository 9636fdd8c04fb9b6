"""A piece of the rim as a solid in the making: one face over the lip, and the fracture inside its edge.

The edge of the face runs over the lip at two points. They part it into a row on the outer wall and a row on the inner
one, and the fracture spans between them: its ends collapse where the rows meet, and its rungs are arcs there.

            L ,-------- lip --------. R       laid open:  L --> outer row --> R   chain 0, counter-clockwise
             /|     outer wall      |\\                     |  |  |  |  |  |        rungs of the fracture, of length 0
            | '--> stations k ----->' |                   L --> inner row --> R   at L and R; chain 1, against the loop
            |        fracture         |
            '-------------------------'

    k        stations; rungs that are shortest in all (a ribbon), so that they follow a lip however it is rolled

Paper  [fuchs1977], the ribbon.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, uniform_filter1d
from scipy.spatial import cKDTree

from recon.errors import NoWall
from recon.geometry.bspline import BSplineSurface
from recon.geometry.mesh import TriangleMesh
from recon.geometry.trimmed import LipPiece, TrimLoop, TrimmedSurface
from recon.hole_patch.fracture_band import HEIGHTS, FractureBand, rung_points
from recon.hole_patch.fracture_relief import fracture_relief
from recon.hole_patch.sheet import Sheet
from recon.hole_patch.thickness import Thickness
from recon.hole_patch.trim_loop import withdrawn
from recon.numerics.polygons import within
from recon.numerics.ribbons import ribbon
from recon.numerics.rows import unit_vectors

__all__ = ["lip_piece", "lip_thickness"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

WALLS = 4
SPACING = 0.35  # mm between stations
FEWEST = 240  # stations
STEP = 0.15  # mm between the points of both chains that are paired
PACE = 0.3  # what a millimetre of uneven pace along the chains counts beside one of the rungs
EVEN = 0.1  # share of an even pace in the pairs: no station stands still while the other chain goes on
ON_SHEET = 1e-4  # mm by which the fracture may leave the face between stations
HALVINGS = 6  # of the steps between stations where it does
LEVELLED = 0.5  # of the median rung, along the edge over which its directions are averaged
FARTHEST = 0.5  # of the length of a rung: more relief than that would not fit beside the lip
SAMPLES = 8  # points of the loop in a span of its curves, to measure lengths on


def lip_piece(sheet: Sheet, fracture: TriangleMesh | None = None, *, clearance: float = 0.0) -> LipPiece:
    """Close a piece of the rim by its fracture.

    sheet      runs over the lip, and says where
    fracture   the neighbours' fracture faces that look into the hole, which the fracture of the piece then follows
    clearance  in millimetres: how far the piece stays away from its neighbours
    Promises   the face keeps its surface, its loop is drawn anew through the stations, and begins at the lip; wall[k]
               lies on it at both sides, exactly at the stations and between them to `ON_SHEET`, unless the loop is so
               crooked that `HALVINGS` are not enough; the fracture does not fold between stations.
    Raises     NoWall when the edge does not run over the lip on two sides; NoSurface when nothing of the piece is left
               by the clearance.
    """
    if clearance > 0.0:
        sheet = replace(sheet, trimmed=withdrawn(sheet.trimmed, clearance))
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
    sides = _Side.of(chains, pairs, 0), _Side.of(chains, pairs, 1)
    bend = _bend(band, sides)
    band = band.following(bend=bend)
    if fracture is not None and fracture.n_faces:
        rungs = rung_points(*band.ends()) + bend
        relief = _relief(band, rungs, sides, fracture, clearance)
        band = band.following(relief=relief).unfolded()
    return _piece(sheet.trimmed.surface, band)


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


def _band(chains: tuple[_Chain, _Chain], pairs: Floats) -> FractureBand:
    """The straight fracture through stations, lengths (n, 2) along both chains."""
    uv = [chain.at(column) for chain, column in zip(chains, pairs.T)]
    for end in (0, -1):  # one point, found from both sides
        uv[1][end] = uv[0][end]
    surface = chains[0].trimmed.surface
    return FractureBand.along((surface, surface), (uv[0], uv[1]))


@dataclass(frozen=True, eq=False)
class _Side:
    """Directions at the stations on one chain, as they are in the mean over a stretch of the loop: at the tip of a
    spike rungs that followed every turn of the edge would cross.

    along   (n, 3) along the edge, counter-clockwise seen from outside the vessel on the outer wall
    inward  (n, 3) into the material
    away    (n, 3) along the face, away from the piece
    """

    along: Floats
    inward: Floats
    away: Floats

    @classmethod
    def of(cls, chains: tuple[_Chain, _Chain], pairs: Floats, row: int) -> "_Side":
        whole = sum(chain.length for chain in chains)
        n = max(64, round(whole / STEP))
        at = np.arange(n) * whole / n
        first = at < chains[0].length
        uv = np.concatenate([chains[0].at(at[first]), chains[1].at(whole - at[~first])])
        surface = chains[0].trimmed.surface
        points, out = surface.point(uv), surface.normal(uv)
        rungs = [chain.points(column) for chain, column in zip(chains, pairs.T)]
        width = LEVELLED * float(np.median(np.linalg.norm(rungs[0] - rungs[1], axis=1))) * n / whole
        along = gaussian_filter1d(np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0), width, axis=0, mode="wrap")
        out = gaussian_filter1d(out, width, axis=0, mode="wrap")
        place = pairs[:, 0] if row == 0 else whole - pairs[:, 1]
        along, out = (
            np.stack([np.interp(place, at, column, period=whole) for column in rows.T], axis=1) for rows in (along, out)
        )
        return cls(
            unit_vectors(along) * (1.0 if row == 0 else -1.0), -unit_vectors(out), unit_vectors(np.cross(along, out))
        )


def _bend(band: FractureBand, sides: tuple[_Side, _Side]) -> Floats:
    """(n, HEIGHTS, 3) by how much rungs that leave the edge square to it stand off the straight ones.

    Near the lip a straight rung runs along the face and nearly in it. One that dives into the material first, square
    to the edge, is an arc there; arcs square to a round bead never cross, and in the wall they are straight.
    """
    outer, inner = band.ends()
    chord = inner - outer
    length = np.linalg.norm(chord, axis=1, keepdims=True)
    way = chord / np.maximum(length, 1e-300)
    handles = [_handle(side, sign * way) for side, sign in zip(sides, (1.0, -1.0))]
    h = np.array(HEIGHTS)[:, None, None]
    arc = 3 * h * (1 - h) * ((1 - h) * handles[0] + h * (handles[1])) * length
    straight = 3 * h * (1 - h) * h * chord + h**3 * chord
    return np.asarray((arc + straight - h * chord).transpose(1, 0, 2))


def _handle(side: _Side, way: Floats) -> Floats:
    """(n, 3) from the end of an arc to its next Bezier point, for a chord of length 1 along `way`."""
    lengthwise = np.einsum("ij,ij->i", way, side.along)[:, None]
    leaves = unit_vectors(way - lengthwise * side.along + lengthwise**2 * side.inward)
    turn = np.clip(np.einsum("ij,ij->i", leaves, way), 0.0, 1.0)[:, None]
    return np.asarray(leaves * 2.0 / (3.0 * (1.0 + turn)))


def _relief(
    band: FractureBand, rungs: Floats, sides: tuple[_Side, _Side], fracture: TriangleMesh, clearance: float
) -> Floats:
    """(n, HEIGHTS, 3) by how much the neighbours' fracture leaves the rungs; nothing at the lip, where they end."""
    outer, inner = band.ends()
    width = np.linalg.norm(inner - outer, axis=1)
    h = np.array(HEIGHTS)[None, :, None]
    away = (1 - h) * sides[0].away[:, None] + h * sides[1].away[:, None]
    away /= np.maximum(np.linalg.norm(away, axis=2, keepdims=True), 1e-300)
    thickness = np.minimum(width, np.median(width))
    relief = fracture_relief(rungs, away, fracture, thickness=thickness, clearance=clearance, closed=False)
    most = FARTHEST * thickness / np.maximum(np.linalg.norm(relief, axis=2).max(axis=1), 1e-300)
    return relief * np.minimum(most, 1.0)[:, None, None]


def _piece(surface: BSplineSurface, band: FractureBand) -> LipPiece:
    parts = band.parts(np.linspace(0, len(band.t) - 1, WALLS + 1).round().astype(int))
    loop = TrimLoop((*(part.outer for part in parts), *(part.inner.reversed() for part in reversed(parts))))
    return LipPiece(TrimmedSurface(surface, (loop,)), tuple(part.wall for part in parts))

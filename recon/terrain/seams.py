"""The vertices along the border between two map tiles, taken from a ground that is made across it.

raw     contours of the grid cross the border where its heights say: which do, in which order, is told by these alone
fitted  the ground's own curves cross near there; where one does, the vertex takes its place, tangent and curvature

heights and gradients   those of the ground across the border
Hessians                differences of its gradients, over half the way to the next vertex
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from recon.geometry.contour_map import HeightGrid
from recon.numerics.bernstein import bernstein
from recon.terrain.border import BorderVertices
from recon.terrain.curve_mesh import hermite_quintics
from recon.terrain.curve_tiling import BORDER_STEP
from recon.terrain.evaluation import elevations
from recon.terrain.ground import Terrain
from recon.terrain.limiter import BEYOND, BEYOND_ENDED
from recon.terrain.second_derivatives import VertexJets
from recon.terrain.slopes import turned_quarter

__all__ = ["Stretch", "node_vertex", "seam_vertices"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]
Place = tuple[int, int]

REACH = 1.5  # spacings of the points that a fitted contour may cross from where the grid's does
STEEP = 0.08  # sine of the angle at which it crosses, at least
ROOM = 0.4  # of the way to the next crossing that is left of it, at least
INSIDE = 0.02  # of the interval that free vertices keep from the contours' levels
SHORTER = 0.99  # of the way between vertices on a border: no tile puts further ones between
ROUNDS, FACTORS = 20, (0.3, 0.8)
SAMPLES = np.linspace(0.0, 1.0, 9)
WIDE = 40.0  # spacings between crossings beyond which the grid's own heights are taken between them
FLAT = 0.25  # of the grid's own slope: what the ground across a border has at a contour at least
AROUND = 12  # cells about a place that give height and slope there, where contours do not
SHARE = 0.5  # of the way to the next vertex over which gradients are compared


@dataclass(frozen=True, eq=False)
class Stretch:
    """A straight piece of the lattice, or a node of it, in a window of the grid.

    grid        heights around, none at a contour's level
    start, end  row and column in it; in one row, in one column, or the same
    ground      made of the window alone; None where no contour runs
    origin      (2,) place of the map at which coordinates are zero
    spacing, interval  metres between points of contours, and in height between contours
    """

    grid: HeightGrid
    start: Place
    end: Place
    ground: Terrain | None
    origin: Floats
    spacing: float
    interval: float

    def place(self, node: Place) -> Floats:
        """(2,) coordinates of a node of the grid, bit by bit those of a map's corner there."""
        return np.array([self.grid.x[node[1]], self.grid.y[node[0]]]) - self.origin

    @property
    def way(self) -> Floats:
        """(2,) unit vector from start to end: east or north."""
        return np.array([1.0, 0.0]) if self.start[0] == self.end[0] else np.array([0.0, 1.0])

    def along(self) -> tuple[Floats, Floats, Floats]:
        """Distance from the start, height, and slope across to the left, at all nodes of the grid on the stretch."""
        (j, i), (to_j, to_i) = self.start, self.end
        x, y, z = self.grid.x, self.grid.y, self.grid.heights
        if j == to_j:
            on = slice(i, to_i + 1)
            return x[on] - x[i], z[j, on], np.asarray(np.gradient(z, y, axis=0))[j, on]
        on = slice(j, to_j + 1)
        return y[on] - y[j], z[on, i], -np.asarray(np.gradient(z, x, axis=1))[on, i]


@dataclass(frozen=True, eq=False)
class _Crossings:
    """Where contours cross a stretch: distance from its start, level, whether heights rise, tangent, curvature.

    fitted  whether place, tangent and curvature are those of a fitted curve
    """

    at: Floats
    level: Floats
    rises: Flags
    tangent: Floats
    curvature: Floats
    fitted: Flags

    def __len__(self) -> int:
        return len(self.at)


def node_vertex(stretch: Stretch) -> BorderVertices:
    """The one vertex at a node of the lattice."""
    place = stretch.place(stretch.start)[None]
    low = stretch.interval * np.floor(stretch.grid.heights[stretch.start] / stretch.interval)
    jets = _jets(stretch, place, np.array([stretch.spacing]))
    return _free(place, jets, np.array([low]), np.array([low + stretch.interval]))


def seam_vertices(stretch: Stretch, first: BorderVertices, last: BorderVertices) -> BorderVertices:
    """The vertices between the two nodes at the ends of a seam, in order along it."""
    raw = _raw_crossings(stretch)
    length = float(np.linalg.norm(last.points[0] - first.points[0]))
    crossings = raw if stretch.ground is None else _fitted(raw, _curve_crossings(stretch), length, stretch.spacing)
    edges = _edges(stretch, crossings, length)
    at, met = edges.at[1:], edges.met[1:]
    points = first.points + at[:, None] * stretch.way
    gap = np.diff(np.r_[edges.at, length])
    jets = _jets(stretch, points, SHARE * np.minimum(gap[:-1], gap[1:]))
    far = np.flatnonzero(edges.wide[1:] & ~met)
    jets, plain = jets.with_rows(far, _plain_jets(stretch, points[far])), _plain_jets(stretch, points[met]).gradient
    crossings = _turned_to(crossings, jets.gradient[met], stretch.way)
    made = _free(points, jets, edges.low[1:], edges.low[1:] + stretch.interval)
    made.met[met], made.tangent[met] = first.points + raw.at[:, None] * stretch.way, crossings.tangent
    made.curvature[met] = crossings.curvature
    jets = made.jets.with_rows(np.flatnonzero(met), _on_contours(jets, met, crossings, plain))
    jets = _limited(VertexJets.joined([first.jets, jets, last.jets]), edges, gap, stretch)
    return replace(made, jets=jets, crossing=met)


def _free(points: Floats, jets: VertexJets, low: Floats, high: Floats) -> BorderVertices:
    """Free vertices, with their heights well between those of the contours around."""
    aside = INSIDE * (high - low)
    height = np.clip(jets.height, low + aside, high - aside)
    n = len(points)
    jets = VertexJets(height, jets.gradient, jets.hessian)
    met, tangent = np.full((2, n, 2), np.nan)
    return BorderVertices(points, jets, np.zeros(n, dtype=bool), met, tangent, np.full(n, np.nan), low, high)


def _raw_crossings(stretch: Stretch) -> _Crossings:
    """Crossings of the grid's own contours, with the tangents that its slopes give them."""
    s, z, across = stretch.along()
    band = np.floor(z / stretch.interval).astype(np.int64)
    edge = np.repeat(np.arange(len(z) - 1), np.abs(np.diff(band)))
    first = np.repeat(np.cumsum(np.abs(np.diff(band))) - np.abs(np.diff(band)), np.abs(np.diff(band)))
    step = np.arange(len(edge)) - first
    rises = band[edge + 1] > band[edge]
    level = stretch.interval * np.where(rises, band[edge] + 1 + step, band[edge] - step)
    share = (level - z[edge]) / (z[edge + 1] - z[edge])
    at = s[edge] + share * (s[edge + 1] - s[edge])
    up = (z[edge + 1] - z[edge]) / (s[edge + 1] - s[edge])
    left = (1 - share) * across[edge] + share * across[edge + 1]
    gradient = up[:, None] * stretch.way + left[:, None] * turned_quarter(stretch.way)
    tangent = -turned_quarter(gradient) / np.linalg.norm(gradient, axis=1, keepdims=True)
    return _Crossings(at, level, rises, tangent, np.zeros(len(at)), np.zeros(len(at), dtype=bool))


def _curve_crossings(stretch: Stretch) -> _Crossings:
    """Crossings of the curves of the ground's contours."""
    assert stretch.ground is not None
    curves, way = stretch.ground.tiling.curves, stretch.way
    net = curves.bezier + (stretch.ground.origin - stretch.origin) - stretch.place(stretch.start)
    off, far = net @ turned_quarter(way), net @ way
    length = float((stretch.place(stretch.end) - stretch.place(stretch.start)) @ way)
    near = (off.min(axis=1) <= 0) & (off.max(axis=1) >= 0) & (far.max(axis=1) >= 0) & (far.min(axis=1) <= length)
    rows = [(k, share) for k in np.flatnonzero(near).tolist() for share in _roots(off[k])]
    segment = np.array([k for k, _ in rows], dtype=np.int64)
    b, t = net[segment], np.array([[share] for _, share in rows]).reshape(-1, 1)
    u = 1 - t
    point = u**3 * b[:, 0] + 3 * u * u * t * b[:, 1] + 3 * u * t * t * b[:, 2] + t**3 * b[:, 3]
    d1 = 3 * (u * u * (b[:, 1] - b[:, 0]) + 2 * u * t * (b[:, 2] - b[:, 1]) + t * t * (b[:, 3] - b[:, 2]))
    d2 = 6 * (u * (b[:, 2] - 2 * b[:, 1] + b[:, 0]) + t * (b[:, 3] - 2 * b[:, 2] + b[:, 1]))
    speed = np.maximum(np.linalg.norm(d1, axis=1), 1e-300)
    tangent = d1 / speed[:, None]
    curvature = (d1[:, 0] * d2[:, 1] - d1[:, 1] * d2[:, 0]) / speed**3
    rises = turned_quarter(tangent) @ way > 0
    kept = (np.abs(turned_quarter(tangent) @ way) > STEEP) & ~curves.straight[segment]
    level = curves.heights[curves.contour[segment]]
    return _Crossings((point @ way)[kept], level[kept], rises[kept], tangent[kept], curvature[kept], kept[kept])


def _roots(coefficients: Floats) -> list[float]:
    """Parameters within [0, 1] at which a cubic in Bernstein form is zero."""
    a, b, c, d = coefficients.tolist()
    found = np.roots([d - 3 * c + 3 * b - a, 3 * (c - 2 * b + a), 3 * (b - a), a])
    real = found[np.abs(found.imag) < 1e-9].real
    return [float(t) for t in real if -1e-9 <= t <= 1 + 1e-9]


def _fitted(raw: _Crossings, curves: _Crossings, length: float, spacing: float) -> _Crossings:
    """The raw crossings, with place, tangent and curvature of a curve's where one is near and their order stays."""
    partner = np.full(len(raw), -1)
    gap = np.abs(raw.at[:, None] - curves.at)
    alike = (raw.level[:, None] == curves.level) & (raw.rises[:, None] == curves.rises) & (gap < REACH * spacing)
    taken = np.zeros(len(curves), dtype=bool)
    for k, c in sorted(np.argwhere(alike).tolist(), key=lambda pair: float(gap[pair[0], pair[1]])):
        if partner[k] < 0 and not taken[c]:
            partner[k], taken[c] = c, True
    while True:
        at = np.where(partner >= 0, curves.at[partner] if len(curves) else 0.0, raw.at)
        before, now = (np.diff(np.r_[0.0, places, length]) for places in (raw.at, at))
        close = now < ROOM * before
        wrong = (close[:-1] | close[1:]) & (partner >= 0)
        if not wrong.any():
            break
        partner[wrong] = -1
    own = partner >= 0
    tangent, curvature = raw.tangent.copy(), raw.curvature.copy()
    tangent[own], curvature[own] = curves.tangent[partner[own]], curves.curvature[partner[own]]
    return _Crossings(at, raw.level, raw.rises, tangent, curvature, own)


def _turned_to(crossings: _Crossings, gradient: Floats, way: Floats) -> _Crossings:
    """The crossings, those without a curve with the tangent that the ground's gradient (c, 2) gives, if it does."""
    size, along = np.linalg.norm(gradient, axis=1), gradient @ way
    turned = ~crossings.fitted & (np.abs(along) > STEEP * size) & ((along > 0) == crossings.rises)
    tangent = crossings.tangent.copy()
    tangent[turned] = -turned_quarter(gradient[turned]) / size[turned, None]
    return replace(crossings, tangent=tangent)


@dataclass(frozen=True, eq=False)
class _Edges:
    """Edges of a seam.

    at     (n,) distance from the seam's start at which each begins
    met    (n,) whether that is a crossing
    low    (n,) height of the contour below
    ended  (n,) whether the crossings before and after are of one level, or only one is there
    wide   (n,) whether these crossings are far apart, so that contours tell little of the ground
    """

    at: Floats
    met: Flags
    low: Floats
    ended: Flags
    wide: Flags


def _edges(stretch: Stretch, crossings: _Crossings, length: float) -> _Edges:
    """The edges between crossings, cut by free vertices where they are long.

    Two crossings of one level get a free vertex between them, lest the edge between them be flat.
    """
    ends = np.r_[0.0, crossings.at, length]
    low = _gap_floors(stretch, crossings)
    gap = np.diff(ends)
    same = np.zeros(len(gap), dtype=bool)
    same[1:-1] = crossings.level[1:] == crossings.level[:-1]
    ended = same.copy()
    ended[[0, -1]] = True
    parts = np.maximum(np.ceil(gap / (SHORTER * BORDER_STEP * stretch.spacing)).astype(int), 1 + same)
    leg = np.repeat(np.arange(len(gap)), parts)
    step = np.arange(len(leg)) - np.repeat(np.cumsum(parts) - parts, parts)
    at = ends[leg] + step / parts[leg] * gap[leg]
    return _Edges(at, (step == 0) & (leg > 0), low[leg], ended[leg], gap[leg] > WIDE * stretch.spacing)


def _gap_floors(stretch: Stretch, crossings: _Crossings) -> Floats:
    """(c + 1,) height of the lower contour of the band in which the seam runs before, between and after crossings."""
    first = stretch.interval * np.floor(stretch.grid.heights[stretch.start] / stretch.interval)
    return np.r_[first, np.where(crossings.rises, crossings.level, crossings.level - stretch.interval)]


def _jets(stretch: Stretch, points: Floats, reach: Floats) -> VertexJets:
    """Jets of the ground at points (n, 2), the Hessians by differences of gradients over `reach` (n,)."""
    if stretch.ground is None:
        return _plain_jets(stretch, points)
    n = len(points)
    steps = [reach[:, None] * way for way in ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0))]
    places = np.vstack([points, *(points + step for step in steps)]) + stretch.origin
    height, gradient = elevations(stretch.ground, places)
    z, g = height[:n], gradient.reshape(5, n, 2)
    here = g[0]
    lost = np.flatnonzero(~np.isfinite(z) | ~np.isfinite(here).all(axis=1))
    plain = _plain_jets(stretch, points[lost])
    z[lost], here[lost] = plain.height, plain.gradient
    change = [_difference(here, g[k], g[k + 1], reach) for k in (1, 3)]
    hessian = np.stack(change, axis=1)
    return VertexJets(z, here, (hessian + hessian.transpose(0, 2, 1)) / 2)


def _difference(here: Floats, ahead: Floats, behind: Floats, reach: Floats) -> Floats:
    """(n, 2) derivatives from values on both sides, or on the one that lies on the map."""
    known = [np.asarray(np.isfinite(side).all(axis=1))[:, None] for side in (ahead, behind)]
    rise = np.where(known[0], ahead, here) - np.where(known[1], behind, here)
    return np.asarray(rise / (np.maximum(known[0].astype(int) + known[1], 1) * reach[:, None]))


def _plain_jets(stretch: Stretch, points: Floats) -> VertexJets:
    """Jets without curvature, of the plane that is nearest to the heights around."""
    x, y = stretch.grid.x - stretch.origin[0], stretch.grid.y - stretch.origin[1]
    height, gradient = np.empty(len(points)), np.empty((len(points), 2))
    for k, (px, py) in enumerate(points.tolist()):
        i, j = int(np.searchsorted(x, px)), int(np.searchsorted(y, py))
        columns, rows = (slice(max(m - AROUND, 0), m + AROUND + 1) for m in (i, j))
        gx, gy = np.meshgrid(x[columns] - px, y[rows] - py)
        basis = np.column_stack([np.ones(gx.size), gx.ravel(), gy.ravel()])
        height[k], *gradient[k] = np.linalg.lstsq(basis, stretch.grid.heights[rows, columns].ravel(), rcond=None)[0]
    return VertexJets(height, gradient, np.zeros((len(points), 2, 2)))


def _on_contours(jets: VertexJets, chosen: Flags, crossings: _Crossings, plain: Floats) -> VertexJets:
    """The jets at crossings, made to agree with level, tangent and curvature of the contour.

    plain  (c, 2) gradients of the grid itself, taken where the ground is much flatter
    """
    t = crossings.tangent
    n = turned_quarter(t)
    slope, least = (np.maximum(np.einsum("ij,ij->i", g, n), 0.0) for g in (jets.gradient[chosen], plain))
    flat = slope < FLAT * least
    slope = np.where(flat, least, slope)
    hessian = np.where(flat[:, None, None], 0.0, jets.hessian[chosen])
    tn, nn = np.einsum("ni,nij,nj->n", t, hessian, n), np.einsum("ni,nij,nj->n", n, hessian, n)
    tt = -slope * crossings.curvature
    both = t[:, :, None] * n[:, None, :]
    made = (
        tt[:, None, None] * t[:, :, None] * t[:, None, :]
        + tn[:, None, None] * (both + both.transpose(0, 2, 1))
        + nn[:, None, None] * n[:, :, None] * n[:, None, :]
    )
    return VertexJets(crossings.level, slope[:, None] * n, made)


def _limited(jets: VertexJets, edges: _Edges, gap: Floats, stretch: Stretch) -> VertexJets:
    """Jets of the vertices between the two nodes, scaled down where the border would overshoot the contours around."""
    allowed = np.where(edges.ended, BEYOND_ENDED, BEYOND) * stretch.interval
    for _ in range(ROUNDS):
        z = _profiles(jets, gap, stretch.way)
        over = np.maximum(z.max(axis=1) - edges.low - stretch.interval, edges.low - z.min(axis=1))
        too_high = over > allowed
        factor = np.ones(len(jets.height))
        share = np.clip(allowed[too_high] / over[too_high], *FACTORS)
        at = np.flatnonzero(too_high)
        np.minimum.at(factor, np.r_[at, at + 1], np.r_[share, share])
        factor[[0, -1]] = 1.0  # the nodes belong to other seams too
        if (factor == 1.0).all():
            break
        jets = jets.scaled(factor)
    return VertexJets(jets.height[1:-1], jets.gradient[1:-1], jets.hessian[1:-1])


def _profiles(jets: VertexJets, gap: Floats, way: Floats) -> Floats:
    """(e, n) heights along the edges between n + 1 vertices in a row."""
    slope, bend = jets.gradient @ way, np.einsum("nij,i,j->n", jets.hessian, way, way)
    ends = [(jets.height[k], slope[k] * gap, bend[k] * gap**2) for k in (slice(None, -1), slice(1, None))]
    return np.asarray(hermite_quintics(*ends) @ bernstein(5, SAMPLES).T)

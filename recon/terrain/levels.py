"""Which heights a strip between contours may hold, and on which side of a contour the ground rises.

A strip is a connected part of the tiling that crosses no contour. Between two contours of different heights it lies
between these; inside a ring, or beside a single contour, the ground goes on rising or falling as it did across it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from recon.terrain.tiling import Tiling

__all__ = ["Levels", "levels"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Levels:
    """Limits of height.

    strip       (F,) strip of every triangle
    low, high   (S,) heights between which every strip should lie
    ended       (S,) whether the strip has one contour height only: a summit, a pit, or the edge of the map
    uphill      (C,) at every contour vertex 1 where the ground rises to the left, -1 to the right, 0 unknown
    """

    strip: Ints
    low: Floats
    high: Floats
    ended: NDArray[np.bool_]
    uphill: Floats


def levels(tiling: Tiling, interval: float, bands: tuple[Ints, Floats, Floats] | None = None) -> Levels:
    """Limits of height of every strip; `interval` metres is how far an ended strip may go beyond its contour.

    bands  some free vertices, and the least and the greatest height of the strips that they lie in
    """
    inner = (tiling.edge_faces >= 0).all(axis=1)
    joined = tiling.edge_faces[inner & ~tiling.is_contour]
    n = len(tiling.triangles)
    graph = coo_array((np.ones(len(joined)), (joined[:, 0], joined[:, 1])), shape=(n, n))
    n_strips, strip = connected_components(graph, directed=False)
    beside = np.flatnonzero(inner & tiling.is_contour)
    faces = tiling.edge_faces[beside]
    z = tiling.curves.heights[tiling.curves.contour[tiling.edge_segment[beside]]]
    low, high = np.full(n_strips, np.inf), np.full(n_strips, -np.inf)
    for side in (0, 1):
        np.minimum.at(low, strip[faces[:, side]], z)
        np.maximum.at(high, strip[faces[:, side]], z)
    ended = low >= high
    level = low
    low, high = _continued((low, high), ended, (strip[faces], z), interval)
    lowest, highest = _spot_range(tiling, strip, n_strips)
    told = ended & (lowest <= highest)
    low, high = np.where(told, np.fmin(level, lowest), low), np.where(told, np.fmax(level, highest), high)
    if bands is not None:
        low, high = _as_told(tiling, strip, (low, high, ended), bands)
    middle = (low + high) / 2
    rise = np.sign(middle[strip[faces[:, 0]]] - middle[strip[faces[:, 1]]])
    total = np.zeros(tiling.curves.n_vertices)
    np.add.at(total, tiling.edges[beside].ravel(), np.repeat(rise, 2))
    return Levels(strip.astype(np.int64), low, high, ended, np.sign(total))


def _spot_range(tiling: Tiling, strip: Ints, n_strips: int) -> tuple[Floats, Floats]:
    """(S,) lowest and highest spot height in every strip; inf and -inf where it has none."""
    face, corner = np.nonzero(tiling.triangles >= len(tiling.points) - len(tiling.spots))
    height = tiling.vertex_heights()[tiling.triangles[face, corner]]
    lowest, highest = np.full(n_strips, np.inf), np.full(n_strips, -np.inf)
    np.minimum.at(lowest, strip[face], height)
    np.maximum.at(highest, strip[face], height)
    return lowest, highest


def _as_told(
    tiling: Tiling, strip: Ints, limits: tuple[Floats, Floats, NDArray[np.bool_]], told: tuple[Ints, Floats, Floats]
) -> tuple[Floats, Floats]:
    """Limits of the strips, those of ended ones as told by vertices in them."""
    low, high, ended = limits
    row = np.full(len(tiling.points), -1)
    row[told[0]] = np.arange(len(told[0]))
    face, corner = np.nonzero(row[tiling.triangles] >= 0)
    here, at = strip[face], row[tiling.triangles[face, corner]]
    least, most = np.full(len(low), np.inf), np.full(len(low), -np.inf)
    np.minimum.at(least, here, told[1][at])
    np.maximum.at(most, here, told[2][at])
    known = ended & (least <= most)
    return np.where(known, least, low), np.where(known, most, high)


def _continued(
    limits: tuple[Floats, Floats], ended: NDArray[np.bool_], beside: tuple[Ints, Floats], interval: float
) -> tuple[Floats, Floats]:
    """Limits of ended strips: up where the strip across the contour lies below it, down where it lies above."""
    low, high = limits[0].copy(), limits[1].copy()
    pairs, z = beside
    up, down = np.zeros(len(low), dtype=bool), np.zeros(len(low), dtype=bool)
    for mine, other in ((0, 1), (1, 0)):
        here, there = pairs[:, mine], pairs[:, other]
        told = ended[here] & ~ended[there]
        up[here[told & (limits[1][there] <= z)]] = True
        down[here[told & (limits[0][there] >= z)]] = True
    unknown = ended & ~(up ^ down)
    high[ended & (up | unknown)] += interval
    low[ended & (down | unknown)] -= interval
    nowhere = ~np.isfinite(low)
    known = np.isfinite(limits[0])
    low[nowhere], high[nowhere] = limits[0][known].min(initial=0.0), limits[1][known].max(initial=0.0)
    return low, high

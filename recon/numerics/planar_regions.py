"""Minimal regions of straight-line graphs in many planes at once.

+-------+-------+        half-edge 2e runs along edge e, half-edge 2e + 1 back; each has its region on its left.
|  +-+  |       |        Left: one region with a hole, its loop and the hole's belong to it together; a bridge
|  +-+  |   \\   |        or a loose end (right) lies in its region with both its half-edges.
+-------+-------+
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["Regions", "minimal_regions", "point_in_loops"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Regions(NamedTuple):
    """Bounded regions of planar graphs.

    region     (2m,) region on the left of each half-edge, -1 for the unbounded one
    following  (2m,) half-edge that follows each one along its region's border
    area       (r,) area of each region's outer loop, holes not taken off
    """

    region: Ints
    following: Ints
    area: Floats


def minimal_regions(ends: Ints, positions: Floats, layer: Ints) -> Regions:
    """Regions between the edges of each layer.

    ends       (m, 2) start and end of each edge, as rows of the half-edges' own points: see positions
    positions  (2m, 2) where half-edge h starts; edges of a layer meet at their ends only
    layer      (m,) edges of different layers have nothing to do with each other
    """
    n = len(ends)
    start = ends.ravel()
    owner = np.repeat(layer, 2)
    twin = np.arange(2 * n) ^ 1
    way = positions[twin] - positions
    order = np.lexsort([np.arctan2(way[:, 1], way[:, 0]), start, owner])
    head = np.flatnonzero(np.diff(owner[order], prepend=-1) | np.diff(start[order], prepend=-1))
    before = np.arange(2 * n) - 1
    before[head] = np.append(head[1:], 2 * n) - 1
    rank = np.empty(2 * n, dtype=np.int64)
    rank[order] = np.arange(2 * n)
    following = order[before[rank[twin]]]
    loop = _loops(following)
    double = positions[:, 0] * positions[twin, 1] - positions[:, 1] * positions[twin, 0]
    n_loops = int(loop.max()) + 1 if n else 0
    area = np.bincount(loop, double, n_loops) / 2
    girth = np.bincount(loop, np.linalg.norm(way, axis=1), n_loops)
    outer = area > 1e-9 * girth**2
    parent = _parents(np.column_stack([positions, positions[twin]]), loop, owner, (outer, area))
    number = np.cumsum(outer) - 1
    of_loop = np.where(outer, number, np.where(parent >= 0, number[parent], -1))
    return Regions(of_loop[loop], following, area[outer])


def _parents(sides: Floats, loop: Ints, owner: Ints, kind: tuple[NDArray[np.bool_], Floats]) -> Ints:
    """For each loop that is no outer one, the smallest outer loop of its layer around it, or -1."""
    outer, area = kind
    by_loop = np.argsort(loop, kind="stable")
    starts = np.searchsorted(loop[by_loop], np.arange(len(area) + 1))
    first = by_loop[starts[:-1]] if len(area) else by_loop
    layer = owner[first]
    by_layer = np.lexsort([area, ~outer, layer])
    layer_starts = np.searchsorted(layer[by_layer], np.arange(int(layer.max()) + 2 if len(layer) else 1))
    box = np.empty((len(area), 4))
    if len(area):
        box[:, :2] = np.minimum.reduceat(sides[by_loop, :2], starts[:-1])
        box[:, 2:] = np.maximum.reduceat(sides[by_loop, :2], starts[:-1])
    return _smallest_around(sides[by_loop], starts, (outer, layer, box), (by_layer, layer_starts))


@njit(cache=True)
def _loops(following: Ints) -> Ints:  # pragma: no cover - compiled
    loop = np.full(len(following), -1, dtype=np.int64)
    n = 0
    for h in range(len(following)):
        if loop[h] < 0:
            g = h
            while loop[g] < 0:
                loop[g] = n
                g = following[g]
            n += 1
    return loop


@njit(cache=True)
def point_in_loops(x: float, y: float, sides: Floats) -> bool:  # pragma: no cover - compiled
    """Whether (x, y) lies inside closed chains, by the even-odd rule; sides (k, 4) from (0, 1) to (2, 3)."""
    inside = False
    for k in range(len(sides)):
        if (sides[k, 1] > y) != (sides[k, 3] > y):
            t = (y - sides[k, 1]) / (sides[k, 3] - sides[k, 1])
            if x < sides[k, 0] + t * (sides[k, 2] - sides[k, 0]):
                inside = not inside
    return inside


@njit(cache=True)
def _smallest_around(
    sides: Floats,
    starts: Ints,
    loops: tuple[NDArray[np.bool_], Ints, Floats],
    layers: tuple[Ints, Ints],
) -> Ints:  # pragma: no cover - compiled
    outer, layer, box = loops
    by_layer, layer_starts = layers
    parent = np.full(len(outer), -1, dtype=np.int64)
    for c in range(len(outer)):
        if outer[c]:
            continue
        for k in range(layer_starts[layer[c]], layer_starts[layer[c] + 1]):
            p = by_layer[k]
            if not outer[p]:
                break
            if box[p, 0] <= box[c, 0] and box[p, 1] <= box[c, 1] and box[p, 2] >= box[c, 2] and box[p, 3] >= box[c, 3]:
                own = sides[starts[p] : starts[p + 1]]
                corner = sides[starts[c]]
                touches = False
                for j in range(len(own)):
                    if own[j, 0] == corner[0] and own[j, 1] == corner[1]:
                        touches = True
                if not touches and point_in_loops(corner[0], corner[1], own):
                    parent[c] = p
                    break
    return parent

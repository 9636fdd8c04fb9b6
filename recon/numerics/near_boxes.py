"""Which of many small boxes lie near some of them, by the cells of a grid that they reach into.

+---+---+---+
|   |#s#|   |     the cells are as wide as the largest box, so each box reaches into two of them along an axis at
+---+---+---+     most; a box with no cell of a seed (s) touches none
| b |   |   |
+---+---+---+
"""

from itertools import product

import numpy as np
from numpy.typing import NDArray

__all__ = ["near_boxes"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

MOST_CELLS = 200  # along an axis


def near_boxes(corners: Floats, seeds: Bools) -> Bools:
    """(n,) whether the box around some points may touch that of a seed; true of all seeds.

    corners  (n, k, 3) points, the box being that around the k of each
    seeds    (n,)
    """
    if not seeds.any():
        return seeds
    low, high = corners.min(axis=1), corners.max(axis=1)
    origin, extent = low.min(axis=0), float(np.ptp(corners.reshape(-1, 3), axis=0).max())
    width = max(float((high - low).max()), extent / MOST_CELLS, 1e-300)
    first, last = (np.floor((bound - origin) / width).astype(np.int64) for bound in (low, high))
    shape = last.max(axis=0) + 1
    reached = np.zeros(int(shape.prod()), dtype=np.bool_)
    reach = [
        np.ravel_multi_index(np.where(ends, last, first).T, tuple(shape)) for ends in product((False, True), repeat=3)
    ]
    for cells in reach:
        reached[cells[seeds]] = True
    return np.any([reached[cells] for cells in reach], axis=0)

"""A tree of axis-parallel boxes over many things, by which compiled walks pass over what is far away.

           1                 node k has the children 2 k and 2 k + 1; leaf i is node n + i, n a power of two
         /   \\
        2     3              things come in an order that keeps near ones near, so that half of them lie together at
       / \\   / \\             every level
"""

import numpy as np
from numpy.typing import NDArray

__all__ = ["DEEPEST", "box_tree", "near_order"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

DEEPEST = 64  # nodes that wait while a tree of at most 2^62 leaves is walked down


def near_order(low: Floats, high: Floats) -> Ints:
    """(N,) boxes along a curve that keeps near ones near: ten bits a coordinate of their middles, interleaved."""
    points = 0.5 * (low + high)
    least = points.min(axis=0)
    extent = float((points.max(axis=0) - least).max()) or 1.0
    cell = ((points - least) * (1023.0 / extent)).astype(np.uint64)
    code = np.zeros(len(points), dtype=np.uint64)
    for bit in range(10):
        for axis in range(3):
            code |= ((cell[:, axis] >> np.uint64(bit)) & np.uint64(1)) << np.uint64(3 * bit + axis)
    return np.argsort(code, kind="stable")


def box_tree(low: Floats, high: Floats) -> Floats:
    """(2 n, 6) boxes of a complete binary tree: node k has the children 2 k and 2 k + 1, leaf i is node n + i.

    Rows are (low, -high); the boxes of leaves that are not there hold nothing.
    """
    n = 1 << max(len(low) - 1, 0).bit_length()
    tree = np.full((2 * n, 6), np.inf)
    tree[n : n + len(low), :3], tree[n : n + len(low), 3:] = low, -high
    while n > 1:
        tree[n // 2 : n] = np.minimum(tree[n : 2 * n : 2], tree[n + 1 : 2 * n : 2])
        n //= 2
    return tree

"""Distances of many points from a triangle mesh, compiled: what proves an error when the collapse is done.

A tree of boxes over the triangles is walked from the root, the nearer child first; a box farther than the nearest
triangle so far is passed by.  Points come in rows along the surface, so the triangle that was nearest to the last
point is the first guess for the next.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.numerics.self_intersection import box_tree, near_order
from recon.voxel_mesh.cell_lookup import point_triangle_squared

__all__ = ["distances_from"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

DEEPEST = 128  # nodes that wait: two a level


def distances_from(points: Floats, vertices: Floats, faces: Ints) -> Floats:
    """(n,) distance of every point (n, 3) from the mesh, exact to rounding."""
    corners = vertices[faces]
    low, high = corners.min(axis=1), corners.max(axis=1)
    order = near_order(low, high)
    return np.sqrt(_nearest(points, vertices, faces[order], box_tree(low[order], high[order])))


@njit(cache=True)
def _nearest(points: Floats, vertices: Floats, faces: Ints, tree: Floats) -> Floats:  # pragma: no cover - compiled
    n = len(tree) // 2
    squared = np.empty(len(points))
    waiting, least = np.empty(DEEPEST, dtype=np.int64), np.empty(DEEPEST)
    guess = 0
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        best = point_triangle_squared(x, y, z, vertices, faces[guess, 0], faces[guess, 1], faces[guess, 2])
        waiting[0], least[0], left = 1, 0.0, 1
        while left > 0:
            left -= 1
            node = waiting[left]
            if least[left] >= best:
                continue
            if node >= n:
                f = node - n
                d = point_triangle_squared(x, y, z, vertices, faces[f, 0], faces[f, 1], faces[f, 2])
                if d < best:
                    best, guess = d, f
                continue
            one, other = _box_squared(tree, 2 * node, x, y, z), _box_squared(tree, 2 * node + 1, x, y, z)
            near = 0 if one <= other else 1
            if max(one, other) < best:
                waiting[left], least[left] = 2 * node + 1 - near, max(one, other)
                left += 1
            if min(one, other) < best:
                waiting[left], least[left] = 2 * node + near, min(one, other)
                left += 1
        squared[i] = best
    return squared


@njit(cache=True)
def _box_squared(tree: Floats, node: int, x: float, y: float, z: float) -> float:  # pragma: no cover - compiled
    """Squared distance from a point to the box of a node; infinite where the box holds nothing."""
    dx = max(max(tree[node, 0] - x, x + tree[node, 3]), 0.0)
    dy = max(max(tree[node, 1] - y, y + tree[node, 4]), 0.0)
    dz = max(max(tree[node, 2] - z, z + tree[node, 5]), 0.0)
    return dx * dx + dy * dy + dz * dz

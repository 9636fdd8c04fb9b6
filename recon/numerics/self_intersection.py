"""Where a triangle mesh cuts itself.

Two triangles cut each other when they share more than their borders: an edge of one passes through the inside of the
other, or both lie in one plane and overlap there.  Touching does not count, so that neighbours are no special case.

        cuts            touches           cuts (a fold)         touches (neighbours)
          /|               |\\               ___________              /|\\
     ____/ |__          ___| \\ ___         |  /____    /            / | \\
     \\  /  | /          \\  |  \\  /         | /     \\  /            /  |  \\

Two convex sets overlap exactly when, on every axis along which they could be separated, one must be pushed to clear
the other (separating axis theorem [gottschalk1996]): the two normals and the nine products of edges, or, for triangles
in one plane, the six edge normals in that plane.  A push shorter than the margin is touching: a pair with a common
vertex or edge has an axis on which it need not be pushed at all.

Candidates come from a tree of boxes over the triangles in Morton order, which every triangle walks down for those that
come after it, so that large and small triangles may lie side by side. Nothing is kept of pairs that do not cut: a
million triangles have fifteen million pairs of boxes that meet.

a, b   (3, 3) corners of the first and second triangle of a pair
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.numerics.box_tree import DEEPEST, box_tree, near_order
from recon.numerics.rows import unit_vectors

__all__ = ["box_pairs", "crossing_triangles"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

PARALLEL = 1e-7  # sine between two edges below which the direction of their product is noise


def crossing_triangles(vertices: Floats, face_vertices: Ints, *, margin: float | None = None) -> tuple[Ints, Floats]:
    """Pairs of triangles that cut each other, and a point of space near each cut.

    vertices       (V, 3) finite
    face_vertices  (F, 3)
    margin         length below which an overlap is touching; 1e-9 of the largest extent when None
    Returns        (P, 2) triangle numbers, the smaller one first, rows in order; (P, 3) points.
    Promises       moving or scaling the mesh does not change the pairs, nor does the order of its triangles.
    """
    corners = np.asarray(vertices, dtype=np.float64)[face_vertices]
    if len(corners) == 0:
        return np.empty((0, 2), dtype=np.int64), np.empty((0, 3))
    low, high = corners.min(axis=1), corners.max(axis=1)
    extent = float((high.max(axis=0) - low.min(axis=0)).max())
    normals = unit_vectors(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    order = near_order(low, high)
    cut = _cutting(
        corners, normals, order, box_tree(low[order], high[order]), 1e-9 * extent if margin is None else margin
    )
    pairs = cut[np.lexsort((cut[:, 1], cut[:, 0]))]
    first, second = pairs.T
    middle = 0.5 * (np.maximum(low[first], low[second]) + np.minimum(high[first], high[second]))
    return pairs, middle


def box_pairs(low: Floats, high: Floats) -> Ints:
    """(P, 2) every pair i < j of axis-parallel boxes that have a point in common; low, high (N, 3)."""
    order = near_order(low, high)
    return np.sort(order[_meeting(box_tree(low[order], high[order]), len(order))], axis=1)


@njit(cache=True)
def _meeting(tree: Floats, count: int) -> Ints:
    """(P, 2) pairs i < j of the first `count` leaves whose boxes meet."""
    found = [(0, 0) for _ in range(0)]
    waiting, met = np.empty(DEEPEST, dtype=np.int64), np.empty(count, dtype=np.int64)
    for i in range(count):
        for k in range(_met_by(tree, i, waiting, met)):
            found.append((i, met[k]))
    return _pairs(found)


@njit(cache=True)
def _pairs(found: list[tuple[int, int]]) -> Ints:
    pairs = np.empty((len(found), 2), dtype=np.int64)
    for k in range(len(found)):
        pairs[k, 0], pairs[k, 1] = found[k]
    return pairs


@njit(cache=True)
def _met_by(tree: Floats, leaf: int, waiting: Ints, met: Ints) -> int:
    """How many of the leaves after one have boxes that meet its own; their numbers go into `met`.

    No generator: a program that finds one compiled by another program cannot compile what uses it.
    """
    n, n_met = len(tree) // 2, 0
    box = tree[n + leaf]
    waiting[0], left = 1, 1
    while left > 0:
        left -= 1
        node = waiting[left]
        other = tree[node]
        if not (
            box[0] <= -other[3] and other[0] <= -box[3] and box[1] <= -other[4] and other[1] <= -box[4]
            and box[2] <= -other[5] and other[2] <= -box[5]
        ):  # fmt: skip
            continue
        if node >= n:
            if node - n > leaf:
                met[n_met] = node - n
                n_met += 1
            continue
        last = 2 * node + 1  # its last leaf
        while last < n:
            last = 2 * last + 1
        if last - n > leaf:
            waiting[left], waiting[left + 1] = 2 * node + 1, 2 * node
            left += 2
    return n_met


@njit(cache=True)
def _cutting(corners: Floats, normals: Floats, order: Ints, tree: Floats, margin: float) -> Ints:
    """(P, 2) triangles, the smaller number first, that overlap by more than the margin on every separating axis."""
    found = [(0, 0) for _ in range(0)]
    waiting, met = np.empty(DEEPEST, dtype=np.int64), np.empty(len(order), dtype=np.int64)
    for i in range(len(order)):
        for k in range(_met_by(tree, i, waiting, met)):
            j = met[k]
            first, second = min(order[i], order[j]), max(order[i], order[j])
            if _cut(corners[first], corners[second], normals[first], normals[second], margin):
                found.append((first, second))
    return _pairs(found)


@njit(cache=True)
def _cut(one: Floats, other: Floats, normal: Floats, other_normal: Floats, margin: float) -> bool:
    a, b = one - one[0], other - one[0]  # near the origin, where products of coordinates lose nothing
    low, high = _span(b, normal)
    in_plane = low >= -margin and high <= margin
    if not in_plane and not (low < -margin and high > margin):
        return False
    low, high = _span(a - b[0], other_normal)
    if in_plane:
        return low >= -margin and high <= margin and _overlap_in_plane(a, b, normal, margin)
    return low < -margin and high > margin and _overlap_on_products(a, b, margin)


@njit(cache=True)
def _overlap_in_plane(a: Floats, b: Floats, normal: Floats, margin: float) -> bool:
    """On the six edge normals within the plane of the pair."""
    axis = np.empty(3)
    for k in range(6):
        triangle = a if k < 3 else b
        edge = triangle[(k + 1) % 3] - triangle[k % 3]
        size = _cross(edge, normal, axis)
        if size > 0.0 and not _overlap(a, b, axis / size, margin):
            return False
    return True


@njit(cache=True)
def _overlap_on_products(a: Floats, b: Floats, margin: float) -> bool:
    """On the products of every edge of a with every edge of b, but for those that are parallel."""
    axis = np.empty(3)
    for k in range(3):
        e = a[(k + 1) % 3] - a[k]
        for m in range(3):
            f = b[(m + 1) % 3] - b[m]
            size = _cross(e, f, axis)
            least = PARALLEL * np.sqrt(_dot(e, e)) * np.sqrt(_dot(f, f))
            if size > least and not _overlap(a, b, axis / size, margin):
                return False
    return True


@njit(cache=True)
def _overlap(a: Floats, b: Floats, axis: Floats, margin: float) -> bool:
    """Whether one must be pushed by more than the margin, whichever way: a flat triangle seen edge-on has no width, and
    yet may be cut.
    """
    low_a, high_a = _span(a, axis)
    low_b, high_b = _span(b, axis)
    return min(high_a - low_b, high_b - low_a) > margin


@njit(cache=True)
def _span(points: Floats, axis: Floats) -> tuple[float, float]:
    first, second, third = _dot(points[0], axis), _dot(points[1], axis), _dot(points[2], axis)
    return min(first, second, third), max(first, second, third)


@njit(cache=True)
def _dot(a: Floats, b: Floats) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True)
def _cross(a: Floats, b: Floats, into: Floats) -> float:
    """The product of two vectors, written into a third, and its length."""
    into[0] = a[1] * b[2] - a[2] * b[1]
    into[1] = a[2] * b[0] - a[0] * b[2]
    into[2] = a[0] * b[1] - a[1] * b[0]
    return float(np.sqrt(_dot(into, into)))

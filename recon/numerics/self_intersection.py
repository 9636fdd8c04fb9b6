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

Candidates come from a tree of boxes over the triangles in Morton order, walked level by level against itself, so
that large and small triangles may lie side by side.

a, b   (P, 3, 3) corners of the first and second triangle of each pair
"""

import numpy as np
from numpy.typing import NDArray

from recon.numerics.rows import unit_vectors

__all__ = ["crossing_triangles", "box_pairs", "triangles_cut"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

_CHUNK = 200_000


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
    pairs = box_pairs(low, high)
    cut = triangles_cut(corners, pairs, margin=1e-9 * extent if margin is None else margin)
    pairs = pairs[cut]
    pairs = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
    first, second = pairs.T
    middle = 0.5 * (np.maximum(low[first], low[second]) + np.minimum(high[first], high[second]))
    return pairs, middle


def box_pairs(low: Floats, high: Floats) -> Ints:
    """(P, 2) every pair i < j of axis-parallel boxes that have a point in common; low, high (N, 3)."""
    order = np.argsort(_morton_codes(0.5 * (low + high)), kind="stable")
    levels = _box_tree(low[order], high[order])
    pairs = np.zeros((1, 2), dtype=np.int64)
    for boxes in reversed(levels[:-1]):
        pairs = _overlapping(_children(pairs), boxes)
    pairs = pairs[(pairs[:, 0] != pairs[:, 1]) & (pairs < len(order)).all(axis=1)]
    return np.sort(order[pairs], axis=1)


def triangles_cut(corners: Floats, pairs: Ints, *, margin: float) -> Flags:
    """(P,) whether the two triangles of each pair overlap by more than the margin on every separating axis.

    corners  (F, 3, 3) corner points of every triangle
    pairs    (P, 2) triangle numbers
    """
    normals = unit_vectors(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    cut = np.zeros(len(pairs), dtype=bool)
    for start in range(0, len(pairs), _CHUNK):
        rows = slice(start, start + _CHUNK)
        cut[rows] = _chunk_cut(corners, normals, pairs[rows], margin)
    return cut


def _chunk_cut(corners: Floats, normals: Floats, pairs: Ints, margin: float) -> Flags:
    first, second = pairs.T
    a, b = corners[first], corners[second]
    b = b - a[:, :1]
    a = a - a[:, :1]  # near the origin, where products of coordinates lose nothing
    over_a, flat_b = _through_plane(a, b, normals[first], margin)
    over_b, flat_a = _through_plane(b, a, normals[second], margin)
    in_plane = flat_a & flat_b
    cut = np.zeros(len(pairs), dtype=bool)
    rows = np.flatnonzero(in_plane)
    cut[rows] = _overlap_on_all(a[rows], b[rows], _axes_in_plane(a[rows], b[rows], normals[first[rows]]), margin)
    rows = np.flatnonzero(over_a & over_b & ~in_plane)
    cut[rows] = _overlap_on_all(a[rows], b[rows], _axes_of_edges(a[rows], b[rows]), margin)
    return cut


def _through_plane(a: Floats, b: Floats, normal: Floats, margin: float) -> tuple[Flags, Flags]:
    """Whether b reaches to both sides of the plane of a, and whether it lies within that plane."""
    height = np.einsum("pij,pj->pi", b - a[:, :1], normal)
    low, high = height.min(axis=1), height.max(axis=1)
    return (low < -margin) & (high > margin), (low >= -margin) & (high <= margin)


def _axes_in_plane(a: Floats, b: Floats, normal: Floats) -> Floats:
    """(P, 6, 3) unit normals of the six edges within the plane of the pair."""
    edges = np.concatenate([_edges(a), _edges(b)], axis=1)
    return unit_vectors(np.cross(edges, normal[:, None]))


def _axes_of_edges(a: Floats, b: Floats) -> Floats:
    """(P, 9, 3) unit products of every edge of a with every edge of b; zero where the two are parallel."""
    ea, eb = _edges(a), _edges(b)
    axes = np.cross(ea[:, :, None], eb[:, None])
    length = np.linalg.norm(axes, axis=3, keepdims=True)
    # the direction of a product of nearly parallel edges is noise, and a noisy axis separates what is not apart
    least = 1e-7 * np.linalg.norm(ea, axis=2)[:, :, None, None] * np.linalg.norm(eb, axis=2)[:, None, :, None]
    axes = np.where(length > least, axes / np.where(length > 0.0, length, 1.0), 0.0)
    return axes.reshape(len(a), 9, 3)


def _overlap_on_all(a: Floats, b: Floats, axes: Floats, margin: float) -> Flags:
    """Whether the projections overlap by more than the margin on every axis (P, K, 3) that is not zero."""
    on_a, on_b = axes @ a.transpose(0, 2, 1), axes @ b.transpose(0, 2, 1)
    # how far one would have to be pushed to either side; a flat triangle seen edge-on has no width, and yet may be cut
    overlap = np.minimum(on_a.max(axis=2) - on_b.min(axis=2), on_b.max(axis=2) - on_a.min(axis=2))
    return np.all((overlap > margin) | ~axes.any(axis=2), axis=1)


def _edges(a: Floats) -> Floats:
    return np.roll(a, -1, axis=1) - a


def _morton_codes(points: Floats) -> NDArray[np.uint64]:
    """(N,) position of each point along a curve that keeps near points near: ten bits a coordinate, interleaved."""
    low = points.min(axis=0)
    extent = float((points.max(axis=0) - low).max()) or 1.0
    cell = ((points - low) * (1023.0 / extent)).astype(np.uint64)
    code = np.zeros(len(points), dtype=np.uint64)
    for bit in range(10):
        for axis in range(3):
            code |= ((cell[:, axis] >> np.uint64(bit)) & np.uint64(1)) << np.uint64(3 * bit + axis)
    return code


def _box_tree(low: Floats, high: Floats) -> list[Floats]:
    """Boxes (n, 6) of a complete binary tree, leaves first; rows are (low, -high), and empty boxes hold nothing."""
    n = 1 << max(len(low) - 1, 0).bit_length()
    leaves = np.full((n, 6), np.inf)
    leaves[: len(low), :3], leaves[: len(low), 3:] = low, -high
    levels = [leaves]
    while len(levels[-1]) > 1:
        levels.append(np.minimum(levels[-1][0::2], levels[-1][1::2]))
    return levels


def _children(pairs: Ints) -> Ints:
    """Pairs of children of pairs of nodes, each unordered pair once."""
    i, j = 2 * pairs[:, 0], 2 * pairs[:, 1]
    apart = i != j
    crossed = np.concatenate([np.stack([i + di, j + dj], axis=1) for di, dj in ((0, 0), (0, 1), (1, 1))])
    return np.concatenate([crossed, np.stack([i[apart] + 1, j[apart]], axis=1)])


def _overlapping(pairs: Ints, boxes: Floats) -> Ints:
    first, second = boxes[pairs[:, 0]], boxes[pairs[:, 1]]
    return pairs[(first[:, :3] <= -second[:, 3:]).all(axis=1) & (second[:, :3] <= -first[:, 3:]).all(axis=1)]

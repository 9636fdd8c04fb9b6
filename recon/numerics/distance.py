"""Distances between points and triangle meshes, exact to rounding, for many points at once.

A tree of boxes over the triangles is walked for all points together, one level a step. A pair (point, box) is
dropped when the box is farther than the nearest triangle point known so far, so nothing nearer can be lost, whatever
the shape of the triangles:

    level 0   [                   all                    ]
    level 1   [ quarter ][ quarter ][ quarter ][ quarter ]
    ...
    leaves    [t t t][t t t] ...           equally many triangles each; some appear twice to fill up

Boxes are turned to the principal axes of what they hold. Upright ones would do for points near the mesh, but from afar
a slanting patch looks one box nearer than it is, and a hundred times as many triangles had to be measured.

p      query point             frame   three unit rows, the axes of a box
a b c  corners of a triangle   low, high  range of the box along each axis
best   squared distance to the nearest triangle point known so far
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

__all__ = [
    "Closest",
    "barycentric",
    "TriangleTree",
    "closest_points",
    "Deviation",
    "one_sided_deviation",
    "hausdorff_distance",
    "sample_surface",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Surface = tuple[Floats, Ints]

LEAF = 6  # triangles a leaf, at most about this many; measured: 4 to 8 are equally fast
CHUNK = 1 << 14  # points a walk: keeps the pairs of a walk in the cache, and bounds the memory
MIN_SEEDS = 20_000  # first guesses, at least about this many: few large triangles need several each
PAIRS = 1 << 19  # pairs a walk may grow to before its points are halved


class Closest(NamedTuple):
    """Nearest places of a mesh.

    points     (n, 3) nearest point of the mesh to every query point
    distances  (n,) how far it is
    faces      (n,) the face it lies on; one of them where several are equally near
    """

    points: Floats
    distances: Floats
    faces: Ints


class TriangleTree:
    """Triangles prepared for many nearest-point queries; `closest_points` for a single one.

    vertices (V, 3), faces (F, 3) with F >= 1; faces may be slivers or have no area at all.
    """

    def __init__(self, vertices: Floats, faces: Ints) -> None:
        if len(faces) == 0:
            raise ValueError("a tree over no triangles has no nearest point")
        # Products of map coordinates lose what their differences keep: work about the centre.
        self._centre = vertices[faces].mean(axis=(0, 1))
        self._corners = (vertices - self._centre)[faces]
        self._order = _tree_order(self._corners)
        self._levels = _box_levels(self._corners[self._order].reshape(len(self._order), -1, 3))
        self._normals = _unit_normals(self._corners)
        seeds, self._seed_face = _seeds(self._corners)
        self._seed_tree = cKDTree(seeds)

    def closest(self, points: Floats) -> Closest:
        """Nearest point of the mesh to every one of `points` (n, 3), exact to rounding."""
        starts = range(0, max(len(points), 1), CHUNK)
        found = _joined([self._walk(points[i : i + CHUNK] - self._centre) for i in starts])
        return found._replace(points=found.points + self._centre)

    def _walk(self, points: Floats) -> Closest:
        face = self._seed_face[self._seed_tree.query(points)[1]]
        place, best = nearest_on_triangles(points, self._corners[face])
        query, node = np.arange(len(points)), np.zeros(len(points), dtype=np.int64)
        for level in self._levels[1:]:
            query, node = np.repeat(query, 4), (4 * node[:, None] + np.arange(4)).ravel()
            near = level.squared_distance(points[query], node) < best[query]
            query, node = query[near], node[near]
            if len(query) > PAIRS and len(points) > 1:
                half = len(points) // 2
                return _joined([self._walk(points[:half]), self._walk(points[half:])])
        query, triangle = self._triangles_near(points, best, query=query, node=node)
        candidate, squared = nearest_on_triangles(points[query], self._corners[triangle])
        order = np.lexsort((squared, query))
        first = order[np.diff(query[order], prepend=-1) > 0]
        first = first[squared[first] < best[query[first]]]
        place[query[first]], best[query[first]], face[query[first]] = candidate[first], squared[first], triangle[first]
        return Closest(place, np.sqrt(best), face)

    def _triangles_near(self, points: Floats, best: Floats, *, query: Ints, node: Ints) -> tuple[Ints, Ints]:
        """Pairs (point, triangle) in the leaves reached, without triangles whose plane alone is too far."""
        query, triangle = np.repeat(query, self._order.shape[1]), self._order[node].ravel()
        height = _dot(points[query] - self._corners[triangle, 0], self._normals[triangle])
        near = height**2 <= best[query]
        return query[near], triangle[near]


def closest_points(points: Floats, vertices: Floats, faces: Ints) -> Closest:
    """Nearest point of a triangle mesh to every one of `points` (n, 3), exact to rounding for any shape of triangle."""
    return TriangleTree(vertices, faces).closest(points)


def nearest_on_triangles(points: Floats, corners: Floats) -> tuple[Floats, Floats]:
    """Nearest point (n, 3) of triangle i, corners (n, 3, 3), to point i of (n, 3), and its squared distance (n,).

    The foot in the plane competes with the feet on the three sides, so a triangle without area needs no special case.
    """
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    place, squared = _nearest_on_segment(points, a, b)
    for candidate, distance in (
        _nearest_on_segment(points, b, c),
        _nearest_on_segment(points, c, a),
        _foot_in_plane(points, a, b - a, c - a),
    ):
        nearer = distance < squared
        place[nearer], squared[nearer] = candidate[nearer], distance[nearer]
    return place, squared


def _nearest_on_segment(points: Floats, start: Floats, end: Floats) -> tuple[Floats, Floats]:
    along = end - start
    length = _dot(along, along)
    t = np.divide(_dot(points - start, along), length, out=np.zeros(len(points)), where=length > 0)
    place = start + np.clip(t, 0.0, 1.0)[:, None] * along
    return place, _dot(points - place, points - place)


def _foot_in_plane(points: Floats, a: Floats, ab: Floats, ac: Floats) -> tuple[Floats, Floats]:
    """Foot of the perpendicular, at infinite distance where it falls outside the triangle."""
    away = points - a
    bb, bc, cc = _dot(ab, ab), _dot(ab, ac), _dot(ac, ac)
    pb, pc = _dot(away, ab), _dot(away, ac)
    area = bb * cc - bc * bc
    v, w = cc * pb - bc * pc, bb * pc - bc * pb
    inside = (v > 0) & (w > 0) & (v + w < area)
    scale = np.divide(1.0, area, out=np.zeros(len(points)), where=inside)
    place = a + (v * scale)[:, None] * ab + (w * scale)[:, None] * ac
    return place, np.where(inside, _dot(points - place, points - place), np.inf)


def _dot(a: Floats, b: Floats) -> Floats:
    return np.einsum("ij,ij->i", a, b)


class _Level(NamedTuple):
    """The turned boxes of one level of the tree: frame (n, 3, 3), low and high (n, 3)."""

    frame: Floats
    low: Floats
    high: Floats

    def squared_distance(self, points: Floats, node: Ints) -> Floats:
        """(m,) squared distance of point i to box node[i], zero inside."""
        turned = np.einsum("ijk,ik->ij", self.frame[node], points)
        outside = np.maximum(np.maximum(self.low[node] - turned, turned - self.high[node]), 0.0)
        return _dot(outside, outside)


def _tree_order(corners: Floats) -> Ints:
    """(4^L, leaf) triangle numbers block by block: halved at the median of the longest axis, twice a level."""
    n = len(corners)
    levels = max(0, int(np.ceil(np.log2(max(n / LEAF, 1.0)) / 2)))
    order = np.arange(4**levels * -(-n // 4**levels))[None, :] % n
    middle = corners.sum(axis=1)
    for _ in range(2 * levels):
        points = middle[order]
        axis = np.ptp(points, axis=1).argmax(axis=1)
        keys = np.take_along_axis(points, axis[:, None, None], axis=2)[:, :, 0]
        half = order.shape[1] // 2
        order = np.take_along_axis(order, np.argpartition(keys, half, axis=1), axis=1).reshape(-1, half)
    return order


def _box_levels(corners: Floats) -> list[_Level]:
    """Boxes of every level, the root first, around the corners (4^L, points a leaf, 3)."""
    levels: list[_Level] = []
    blocks = corners
    while True:
        middle = blocks.mean(axis=1, keepdims=True)
        spread = blocks - middle
        frame = np.linalg.eigh(spread.transpose(0, 2, 1) @ spread)[1].transpose(0, 2, 1)
        turned = spread @ frame.transpose(0, 2, 1)
        at = np.einsum("ijk,ik->ij", frame, middle[:, 0])
        levels.insert(0, _Level(frame, at + turned.min(axis=1), at + turned.max(axis=1)))
        if len(blocks) == 1:
            return levels
        blocks = blocks.reshape(len(blocks) // 4, -1, 3)


def _unit_normals(corners: Floats) -> Floats:
    """(F, 3) unit normals; zero, which excludes nothing, for triangles too thin to have one."""
    a, b, c = corners.transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    size = np.maximum(_dot(b - a, b - a), _dot(c - a, c - a))[:, None]
    return np.divide(normal, length, out=np.zeros_like(normal), where=length > 1e-3 * size)


def _seeds(corners: Floats) -> tuple[Floats, Ints]:
    """Points on the triangles, and the triangle of each: one on a usual triangle, many along a long one.

    They give the walk its first bound; the nearer it is, the less is walked.
    """
    side = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2)
    shortest = side.argmin(axis=1)
    row = np.arange(len(corners))
    middle = 0.5 * (corners[row, shortest] + corners[row, (shortest + 1) % 3])
    length = side.max(axis=1)
    spacing = max(float(length.sum()) / max(2 * len(corners), MIN_SEEDS), 1e-300)
    count = np.maximum(np.ceil(length / (2.0 * spacing)), 1.0).astype(np.int64)
    face = np.repeat(row, count)
    t = (np.arange(len(face)) - np.repeat(np.cumsum(count) - count, count) + 0.5) / count[face]
    return middle[face] + t[:, None] * (corners[face, (shortest[face] + 2) % 3] - middle[face]), face


def _joined(parts: list[Closest]) -> Closest:
    return Closest(*(np.concatenate(column) for column in zip(*parts)))


class Deviation(NamedTuple):
    """How far samples of one surface lie from another: the largest, the mean and the root mean square distance."""

    maximum: float
    mean: float
    rms: float


def one_sided_deviation(surface: Surface, other: Surface, *, n_samples: int = 10_000) -> Deviation:
    """Deviation of `surface` from `other`, each given as (vertices, faces).

    Mean and rms are over points spread evenly over the area of `surface`; the maximum is over its vertices too.
    It is not symmetric: parts of `other` far from `surface` do not count.
    """
    vertices, faces = surface
    even = sample_surface(vertices, faces, n_samples)
    distances = closest_points(np.concatenate([even, vertices[np.unique(faces)]]), *other).distances
    spread = distances[: len(even)]
    return Deviation(float(distances.max()), float(spread.mean()), float(np.sqrt(np.mean(spread**2))))


def hausdorff_distance(surface: Surface, other: Surface, *, n_samples: int = 10_000) -> float:
    """Symmetric Hausdorff distance over vertices and samples, a lower bound; each surface is (vertices, faces)."""
    one = one_sided_deviation(surface, other, n_samples=n_samples)
    two = one_sided_deviation(other, surface, n_samples=n_samples)
    return max(one.maximum, two.maximum)


def sample_surface(vertices: Floats, faces: Ints, n_samples: int) -> Floats:
    """(n, 3) points spread evenly over the area, the same ones every time.

    Strata of equal area in the order of the faces, each with one point of an additive recurrence [roberts2018].
    """
    a, b, c = vertices[faces].transpose(1, 0, 2)
    total = np.cumsum(np.linalg.norm(np.cross(b - a, c - a), axis=1))
    step = np.arange(n_samples) + 0.5
    face = np.minimum(np.searchsorted(total, step / n_samples * total[-1], side="right"), len(faces) - 1)
    r, s = (step * 0.7548776662466927) % 1.0, (step * 0.5698402909980532) % 1.0
    folded = r + s > 1.0
    r, s = np.where(folded, 1.0 - r, r)[:, None], np.where(folded, 1.0 - s, s)[:, None]
    return (1.0 - r - s) * a[face] + r * b[face] + s * c[face]


def barycentric(points: Floats, corners: Floats) -> Floats:
    """(m, 3) shares of the corners (m, 3, 3) in points (m, 3) of their triangles; zeros where one has no area."""
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    twice = np.maximum(np.einsum("ij,ij->i", across, across), 1e-300)
    shares = [
        np.einsum("ij,ij->i", np.cross(corners[:, a] - points, corners[:, b] - points), across) / twice
        for a, b in ((1, 2), (2, 0), (0, 1))
    ]
    return np.clip(np.stack(shares, axis=1), 0.0, 1.0)

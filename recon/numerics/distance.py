"""Distances between points and triangle meshes, exact to rounding, for many points at once.

A tree of boxes over the triangles is walked down for every point, the nearer child first. A box is passed by when it is
farther than the nearest triangle so far, so nothing nearer can be lost, whatever the shape of the triangles:

    p   .            ______________
         \\ best    |  ____   ____ |      points mostly come in rows along a surface: what was nearest to the last
          \\       | |box1| |box2||      one is the first guess for the next
           '-t     |  '--'   '--' |

p      query point
a b c  corners of a triangle
best   squared distance to the nearest triangle so far
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.numerics.box_tree import DEEPEST, box_tree, near_order

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
        corners = (vertices - self._centre)[faces]
        low, high = corners.min(axis=1), corners.max(axis=1)
        self._order = near_order(low, high)
        self._corners = corners[self._order]
        self._tree = box_tree(low[self._order], high[self._order])

    def closest(self, points: Floats) -> Closest:
        """Nearest point of the mesh to every one of `points` (n, 3), exact to rounding."""
        own = np.asarray(points, dtype=np.float64).reshape(-1, 3) - self._centre
        row = _nearest(own, self._corners, self._order, self._tree)
        place, squared = nearest_on_triangles(own, self._corners[row])
        return Closest(place + self._centre, np.sqrt(squared), self._order[row])


@njit(cache=True)
def _nearest(points: Floats, corners: Floats, number: Ints, tree: Floats) -> Ints:  # pragma: no cover - compiled
    """(n,) rows of the triangles (F, 3, 3), in the order of the tree's leaves, that are nearest to points (n, 3).

    number  (F,) of the triangles: of several equally near the one with the least is taken, whatever was asked before
    """
    n = len(tree) // 2
    found = np.empty(len(points), dtype=np.int64)
    waiting, least = np.empty(2 * DEEPEST, dtype=np.int64), np.empty(2 * DEEPEST)
    row = 0
    for i in range(len(points)):
        p = points[i]
        best = _triangle_squared(p, corners[row])
        waiting[0], least[0], left = 1, 0.0, 1
        while left > 0:
            left -= 1
            node = waiting[left]
            if least[left] > best:
                continue
            if node >= n:
                squared = _triangle_squared(p, corners[node - n])
                if squared < best or (squared == best and number[node - n] < number[row]):
                    best, row = squared, node - n
                continue
            one, other = _box_squared(p, tree[2 * node]), _box_squared(p, tree[2 * node + 1])
            near = 0 if one <= other else 1
            if max(one, other) <= best:
                waiting[left], least[left] = 2 * node + 1 - near, max(one, other)
                left += 1
            if min(one, other) <= best:
                waiting[left], least[left] = 2 * node + near, min(one, other)
                left += 1
        found[i] = row
    return found


@njit(cache=True)
def _box_squared(p: Floats, box: Floats) -> float:  # pragma: no cover - compiled
    """Squared distance from a point to a box (low, -high); infinite where the box holds nothing."""
    total = 0.0
    for k in range(3):
        total += max(max(box[k] - p[k], p[k] + box[3 + k]), 0.0) ** 2
    return total


@njit(cache=True)
def _triangle_squared(p: Floats, corners: Floats) -> float:  # pragma: no cover - compiled
    """Squared distance from a point to a triangle (3, 3), as of `nearest_on_triangles`."""
    squared = np.inf
    for k in range(3):
        squared = min(squared, _segment_squared(p, corners[k], corners[(k + 1) % 3]))
    bb, bc, cc, pb, pc = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(3):
        b, c, d = corners[1, k] - corners[0, k], corners[2, k] - corners[0, k], p[k] - corners[0, k]
        bb, bc, cc, pb, pc = bb + b * b, bc + b * c, cc + c * c, pb + d * b, pc + d * c
    area, v, w = bb * cc - bc * bc, cc * pb - bc * pc, bb * pc - bc * pb
    if v > 0.0 and w > 0.0 and v + w < area:
        v, w = v / area, w / area
        total = 0.0
        for k in range(3):
            a = corners[0, k]
            total += (p[k] - a - v * (corners[1, k] - a) - w * (corners[2, k] - a)) ** 2
        squared = min(squared, total)
    return squared


@njit(cache=True)
def _segment_squared(p: Floats, start: Floats, end: Floats) -> float:  # pragma: no cover - compiled
    length, along = 0.0, 0.0
    for k in range(3):
        length += (end[k] - start[k]) ** 2
        along += (p[k] - start[k]) * (end[k] - start[k])
    t = min(max(along / length, 0.0), 1.0) if length > 0.0 else 0.0
    total = 0.0
    for k in range(3):
        total += (p[k] - start[k] - t * (end[k] - start[k])) ** 2
    return total


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

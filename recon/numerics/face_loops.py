"""Loops over the faces of a large mesh, compiled: no array of the corners of all faces is made.

Six numbers a vertex, three corners of three coordinates twice, are what a line of array arithmetic takes for every
step of it; these loops take nothing beyond their results.

vertices (V, 3), faces (F, 3); area_vectors (F, 3) normals as long as the areas; across (F, 3) sides, as `paired_sides`
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = [
    "all_around",
    "agreeing_corners",
    "bent_sides",
    "corner_sums",
    "longest_sides",
    "normal_sums",
    "turned_pairs",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
SmallInts = NDArray[np.int32]
Bools = NDArray[np.bool_]


@njit(cache=True)
def _cross(vertices: Floats, a: int, b: int, c: int) -> tuple[float, float, float]:  # pragma: no cover - compiled
    ux, uy, uz = vertices[b, 0] - vertices[a, 0], vertices[b, 1] - vertices[a, 1], vertices[b, 2] - vertices[a, 2]
    vx, vy, vz = vertices[c, 0] - vertices[a, 0], vertices[c, 1] - vertices[a, 1], vertices[c, 2] - vertices[a, 2]
    return uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


@njit(cache=True)
def normal_sums(vertices: Floats, faces: Ints) -> Floats:  # pragma: no cover - compiled
    """(V, 3) the sum of the normals of the faces around, each twice as long as its area."""
    out = np.zeros((len(vertices), 3))
    for f in range(len(faces)):
        x, y, z = _cross(vertices, faces[f, 0], faces[f, 1], faces[f, 2])
        for corner in range(3):
            vertex = faces[f, corner]
            out[vertex, 0] += x
            out[vertex, 1] += y
            out[vertex, 2] += z
    return out


@njit(cache=True)
def longest_sides(vertices: Floats, faces: Ints) -> tuple[Floats, float]:  # pragma: no cover - compiled
    """(F,) the longest side of every face, and the area of all together."""
    longest, area = np.empty(len(faces)), 0.0
    for f in range(len(faces)):
        x, y, z = _cross(vertices, faces[f, 0], faces[f, 1], faces[f, 2])
        area += 0.5 * np.sqrt(x * x + y * y + z * z)
        most = 0.0
        for corner in range(3):
            p, q = faces[f, corner], faces[f, (corner + 1) % 3]
            square = 0.0
            for axis in range(3):
                square += (vertices[p, axis] - vertices[q, axis]) ** 2
            most = max(most, square)
        longest[f] = np.sqrt(most)
    return longest, area


@njit(cache=True)
def bent_sides(vertices: Floats, faces: Ints, across: SmallInts, cosine: float) -> Bools:  # pragma: no cover
    """(F, 3) sides whose two faces have normals farther apart than the angle of this cosine; one side of each edge."""
    out = np.zeros(faces.shape, dtype=np.bool_)
    for f in range(len(faces)):
        x, y, z = _cross(vertices, faces[f, 0], faces[f, 1], faces[f, 2])
        for side in range(3):
            if across[f, side] <= 3 * f + side:
                continue
            g = across[f, side] // 3
            p, q, r = _cross(vertices, faces[g, 0], faces[g, 1], faces[g, 2])
            lengths = np.sqrt((x * x + y * y + z * z) * (p * p + q * q + r * r))
            out[f, side] = x * p + y * q + z * r < cosine * lengths
    return out


@njit(cache=True)
def agreeing_corners(
    area_vectors: Floats, normals: Floats, faces: Ints, cosine: float
) -> Bools:  # pragma: no cover - compiled
    """(F, 3) whether the normal of the face and the unit normal (V, 3) of the corner are nearer than this cosine."""
    out = np.zeros(faces.shape, dtype=np.bool_)
    for f in range(len(faces)):
        x, y, z = area_vectors[f, 0], area_vectors[f, 1], area_vectors[f, 2]
        least = cosine * np.sqrt(x * x + y * y + z * z)
        for corner in range(3):
            v = faces[f, corner]
            out[f, corner] = x * normals[v, 0] + y * normals[v, 1] + z * normals[v, 2] > least
    return out


@njit(cache=True)
def all_around(corners: Bools, faces: Ints, n: int) -> Bools:  # pragma: no cover - compiled
    """(n,) whether something holds at all face corners (F, 3) that meet in a vertex."""
    out = np.ones(n, dtype=np.bool_)
    for f in range(len(faces)):
        for corner in range(3):
            if not corners[f, corner]:
                out[faces[f, corner]] = False
    return out


@njit(cache=True)
def corner_sums(vectors: Floats, chosen: Bools, faces: Ints, n: int) -> Floats:  # pragma: no cover - compiled
    """(n, 3) for every vertex the sum of the vectors (F, 3) of the chosen faces around it."""
    out = np.zeros((n, 3))
    for f in range(len(faces)):
        if chosen[f]:
            for corner in range(3):
                vertex = faces[f, corner]
                for axis in range(3):
                    out[vertex, axis] += vectors[f, axis]
    return out


@njit(cache=True)
def turned_pairs(
    vertices: Floats, faces: SmallInts, one: SmallInts, two: SmallInts, cosines: Floats
) -> Ints:  # pragma: no cover - compiled
    """Which pairs of faces, one[i] and two[i], have normals farther apart than the angle of cosines[i]."""
    normals = np.empty((len(faces), 3))
    for f in range(len(faces)):
        x, y, z = _cross(vertices, faces[f, 0], faces[f, 1], faces[f, 2])
        length = max(np.sqrt(x * x + y * y + z * z), 1e-300)
        normals[f, 0], normals[f, 1], normals[f, 2] = x / length, y / length, z / length
    turned = np.zeros(len(one), dtype=np.bool_)
    for i in range(len(one)):
        p, q = one[i], two[i]
        cosine = normals[p, 0] * normals[q, 0] + normals[p, 1] * normals[q, 1] + normals[p, 2] * normals[q, 2]
        turned[i] = cosine < cosines[i]
    return np.flatnonzero(turned)

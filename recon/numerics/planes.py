"""Planes, circles, and sections of triangle meshes by planes.

          b                 A face is cut where the plane's distance changes its sign along an edge:
         /|\\                sides of the plane        + - -
    ----+-+-+-- plane       the two crossings are joined to one segment.
       /  |  \\
      a-------c

    n    unit normal of a plane
    c    a point of it, the centre of a circle in it
"""

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

__all__ = ["fit_plane", "section_segments", "circle_through", "enclosing_circle"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def fit_plane(points: Floats) -> tuple[Floats, Floats]:
    """Least-squares plane of points (m, 3): centroid (3,) and unit vectors (3, 3) as rows, the last one the normal.

    The first row is the direction in which the points reach farthest; the rows are right-handed.
    """
    centroid = points.mean(axis=0)
    _, _, axes = np.linalg.svd(points - centroid, full_matrices=False)
    axes[2] = np.cross(axes[0], axes[1])
    return centroid, axes


def section_segments(vertices: Floats, face_vertices: Ints, distances: Floats) -> Floats:
    """(k, 2, d) segments in which a mesh meets a plane, one for each face that crosses it.

    vertices   (V, d) coordinates to interpolate: in space, or in any affine frame
    distances  (V,) signed distance of every vertex from the plane, in any unit; 0 counts as above
    Promises   the ends lie on mesh edges; faces that share a cut edge share that end exactly.
    """
    above = distances >= 0.0
    corners = above[face_vertices]
    count = corners.sum(axis=1)
    cut = (count == 1) | (count == 2)
    faces, corners = face_vertices[cut], corners[cut]
    # The corner that is alone on its side of the plane is where both cut edges start.
    lone = np.argmax(corners == (corners.sum(axis=1) == 1)[:, None], axis=1)
    row = np.arange(len(faces))
    apex = faces[row, lone]
    ends = np.stack([faces[row, (lone + 1) % 3], faces[row, (lone + 2) % 3]], axis=1)
    return np.stack([_crossing(vertices, distances, apex, ends[:, k]) for k in (0, 1)], axis=1)


def circle_through(a: Floats, b: Floats, c: Floats) -> tuple[Floats, Floats, Floats]:
    """Circles through point triples (m, 3): centres (m, 3), radii (m,), unit normals (m, 3) along (a - b) x (c - b).

    Three points on a line give an infinite radius, a centre that is not finite and a zero normal.
    """
    p, q = a - b, c - b
    cross = np.cross(p, q)
    twice = 2.0 * np.einsum("ij,ij->i", cross, cross)[:, None]
    pp, qq = (np.einsum("ij,ij->i", x, x)[:, None] for x in (p, q))
    with np.errstate(divide="ignore", invalid="ignore"):
        offset = np.cross(pp * q - qq * p, cross) / twice
        size = np.linalg.norm(cross, axis=1, keepdims=True)
        normals = np.where(size > 0, cross / size, 0.0)
    radii = np.where(size[:, 0] > 0, np.linalg.norm(offset, axis=1), np.inf)
    return b + offset, radii, normals


def enclosing_circle(points: Floats) -> tuple[Floats, float]:
    """Smallest circle around points in the plane (m, 2): centre (2,) and radius.

    Grows a set of supporting points: solve it exactly, add the farthest point outside, until none is.
    """
    support = points[:1]
    for _ in range(len(points)):
        centre, radius, support = _smallest_of(support)
        away = np.linalg.norm(points - centre, axis=1)
        far = int(np.argmax(away))
        if away[far] <= radius * (1 + 1e-12) + 1e-300:
            break
        support = np.concatenate([support, points[far : far + 1]])
    return centre, radius


def _crossing(vertices: Floats, distances: Floats, start: Ints, end: Ints) -> Floats:
    # From the lower number to the higher: both faces of an edge compute the same point, bit for bit.
    first, last = np.minimum(start, end), np.maximum(start, end)
    share = distances[first] / (distances[first] - distances[last])
    return vertices[first] + share[:, None] * (vertices[last] - vertices[first])


def _smallest_of(points: Floats) -> tuple[Floats, float, Floats]:
    """Smallest circle around at most four points, and those of them that it rests on."""
    best = (points[0], 0.0 if len(points) == 1 else np.inf, points[:1])
    flat = np.pad(points, ((0, 0), (0, 1)))
    for size in (2, 3):
        for chosen in combinations(range(len(points)), size):
            if size == 2:
                centre = points[list(chosen)].mean(axis=0)
                radius = float(np.linalg.norm(points[chosen[0]] - centre))
            else:
                centres, radii, _ = circle_through(*(flat[i : i + 1] for i in chosen))
                centre, radius = centres[0, :2], float(radii[0])
            if radius < best[1] and (np.linalg.norm(points - centre, axis=1) <= radius * (1 + 1e-12)).all():
                best = (centre, radius, points[list(chosen)])
    return best

"""What a mesh file holds before it is a mesh: points, polygons over them, and what was noticed on the way.

Polygons become triangles here. A fan would leave a polygon that is not convex, so corners are cut off one at a time:

        3                     3
       / \\                   / \\        an ear: a corner that turns left (seen against the polygon's
      /   2---1   -->        /   2        area vector) and whose triangle holds no other corner
     /       /              /   /
    4-------0              4---0
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.errors import BadGeometry

__all__ = ["PolygonSoup", "together", "triangulated", "strip_triangles"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

MOST_CORNERS = 2000  # clipping ears takes n² steps; no scanner and no modeller writes larger faces in earnest
LARGEST = 1e15  # beyond it a coordinate is damage in any unit, and its powers soon overflow


@dataclass(frozen=True, eq=False)
class PolygonSoup:
    """Polygons as a file lists them, not checked yet.

    points       (n, 3)
    corners      (c,) point numbers of all polygons, one polygon after the other
    sizes        (m,) number of corners of each polygon, summing up to c
    notes        what whoever reads the mesh should know
    millimetres  length of the file's unit, or None where the file names none
    """

    points: Floats
    corners: Ints
    sizes: Ints
    notes: tuple[str, ...] = ()
    millimetres: float | None = None


def together(
    bodies: Sequence[tuple[Floats, Ints]], name: str, *, millimetres: float, notes: tuple[str, ...] = ()
) -> PolygonSoup:
    """One soup of bodies of triangles, points (n, 3) and faces (m, 3) each.

    Raises  BadGeometry for a corner that names no point of its own body: it would name one of another.
    """
    points, corners, first = [np.empty((0, 3))], [np.empty((0, 3), np.int64)], 0
    for number, (own, faces) in enumerate(bodies):
        if len(faces) and not (faces.min() >= 0 and faces.max() < len(own)):
            odd = faces[(faces < 0) | (faces >= len(own))][0]
            raise BadGeometry(name, f"a face of body {number} names point {odd}, but the body has {len(own)}")
        points.append(own)
        corners.append(faces + first)
        first += len(own)
    rows = np.concatenate(corners)
    return PolygonSoup(np.concatenate(points), rows.ravel(), np.full(len(rows), 3), notes, millimetres)


def triangulated(soup: PolygonSoup, name: str) -> Ints:
    """(F, 3) triangles that cover the polygons, each polygon's own in a row, in the order and the sense of the file.

    Raises  BadGeometry for a polygon of fewer than three corners, a corner that names no point, or a point in use whose
            coordinates are no finite numbers, or absurdly large.
    """
    _check(soup, name)
    begin = np.cumsum(soup.sizes) - soup.sizes
    place = np.cumsum(soup.sizes - 2) - (soup.sizes - 2)
    faces = np.empty((int((soup.sizes - 2).sum()), 3), dtype=np.int64)
    three, four = np.flatnonzero(soup.sizes == 3), np.flatnonzero(soup.sizes == 4)
    faces[place[three]] = soup.corners[begin[three][:, None] + np.arange(3)]
    pairs = _halved(soup.points, soup.corners[begin[four][:, None] + np.arange(4)])
    faces[place[four]], faces[place[four] + 1] = pairs[:, 0], pairs[:, 1]
    for i in np.flatnonzero(soup.sizes > 4).tolist():
        polygon = soup.corners[begin[i] : begin[i] + soup.sizes[i]]
        order = _clipped(soup.points[polygon], f"{name}: face {i}")
        faces[place[i] : place[i] + len(order)] = polygon[order]
    return faces


def strip_triangles(strip: Ints) -> Ints:
    """(F, 3) triangles of triangle strips; -1 ends a strip, and every second triangle of a strip is turned over."""
    where = np.arange(len(strip))
    start = np.maximum.accumulate(np.where(strip < 0, where + 1, 0))[: max(len(strip) - 2, 0)]
    windows = np.stack([strip[:-2], strip[1:-1], strip[2:]], axis=1) if len(strip) > 2 else np.empty((0, 3), np.int64)
    odd = (where[: len(windows)] - start) % 2 == 1
    windows[odd] = windows[odd][:, [1, 0, 2]]
    return windows[(windows >= 0).all(axis=1)]


def _check(soup: PolygonSoup, name: str) -> None:
    if (soup.sizes < 3).any():
        face = int(np.argmax(soup.sizes < 3))
        raise BadGeometry(name, f"face {face} names {soup.sizes[face]} points where a face needs three")
    outside = (soup.corners < 0) | (soup.corners >= len(soup.points))
    if outside.any():
        corner = int(np.argmax(outside))
        face = int(np.searchsorted(np.cumsum(soup.sizes), corner, side="right"))
        raise BadGeometry(
            name,
            f"face {face} names point {soup.corners[corner]}, but the file holds points 0 to {len(soup.points) - 1}",
        )
    finite = np.asarray(np.isfinite(soup.points).all(axis=1))
    if not finite[soup.corners].all():
        point = int(soup.corners[np.argmin(finite[soup.corners])])
        raise BadGeometry(name, f"point {point}, which a face uses, has a coordinate that is not a finite number")
    far = np.abs(soup.points).max(axis=1) > LARGEST
    if far[soup.corners].any():
        point = int(soup.corners[np.argmax(far[soup.corners])])
        size = np.abs(soup.points[point]).max()
        raise BadGeometry(name, f"point {point} has a coordinate of {size:.3g}, more than anything measured has")


def _halved(points: Floats, quads: Ints) -> Ints:
    """(Q, 2, 3) two triangles for each of the (Q, 4) quads, along the diagonal that folds them less."""
    a, b, c, d = points[quads].transpose(1, 0, 2)
    across = np.cross(c - a, d - b)
    first = np.minimum(_dot(np.cross(b - a, c - a), across), _dot(np.cross(c - a, d - a), across))
    other = np.minimum(_dot(np.cross(b - a, d - a), across), _dot(np.cross(c - b, d - b), across))
    # Parallelograms tie; rounding must not pick their diagonals at random.
    turn = other > first + 1e-9 * np.abs(first)
    return np.where(turn[:, None, None], quads[:, [[0, 1, 3], [1, 2, 3]]], quads[:, [[0, 1, 2], [0, 2, 3]]])


def _clipped(corners: Floats, what: str) -> Ints:
    """(n - 2, 3) triangles of one polygon, corners (n, 3), by clipping ears; by a fan where it is convex."""
    n = len(corners)
    xy = _in_plane(corners)
    fan = np.stack([np.zeros(n - 2, np.int64), np.arange(1, n - 1), np.arange(2, n)], axis=1)
    if (_turn(np.roll(xy, 1, axis=0), xy, np.roll(xy, -1, axis=0)) > 0).all() and (_turn(*xy[fan.T]) > 0).all():
        return fan
    if n > MOST_CORNERS:
        raise BadGeometry(what, f"has {n} corners and is not convex; export the mesh in triangles")
    left = list(range(n))
    triangles = []
    while len(left) > 3:
        ear = next((i for i in range(len(left)) if _is_ear(xy, left, i)), 0)
        triangles.append((left[ear - 1], left[ear], left[(ear + 1) % len(left)]))
        del left[ear]
    return np.array([*triangles, left], dtype=np.int64)


def _in_plane(corners: Floats) -> Floats:
    """(n, 2) corners seen against the polygon's area vector, so that it runs counter-clockwise."""
    about = corners - corners.mean(axis=0)
    normal = np.cross(about, np.roll(about, -1, axis=0)).sum(axis=0)
    drop = int(np.abs(normal).argmax())
    kept = [(drop + 1) % 3, (drop + 2) % 3]
    return about[:, kept if normal[drop] >= 0 else kept[::-1]]


def _is_ear(xy: Floats, left: list[int], i: int) -> bool:
    a, b, c = xy[left[i - 1]], xy[left[i]], xy[left[(i + 1) % len(left)]]
    if _turn(a, b, c) <= 0:
        return False
    p = xy[left]
    inside = (_turn(a, b, p) >= 0) & (_turn(b, c, p) >= 0) & (_turn(c, a, p) >= 0)
    at_corner = (p == a).all(axis=1) | (p == b).all(axis=1) | (p == c).all(axis=1)
    return not (inside & ~at_corner).any()


def _turn(a: Floats, b: Floats, c: Floats) -> Floats:
    """Twice the signed area of the triangle a b c, positive when it runs counter-clockwise."""
    return (b[..., 0] - a[..., 0]) * (c[..., 1] - a[..., 1]) - (b[..., 1] - a[..., 1]) * (c[..., 0] - a[..., 0])


def _dot(a: Floats, b: Floats) -> Floats:
    return np.einsum("ij,ij->i", a, b)

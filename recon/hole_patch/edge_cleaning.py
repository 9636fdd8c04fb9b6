"""A hole's edge made fit for trimming: no spikes, no hairs, no crossings, one sense of rotation.

    ____      hair: the line runs out along a crack or scanning gap and back; the two
   |    |_____     points at its mouth are near each other, the way round is long
   | hole ____>    and encloses little: it is cut off there
   |_____|

Lines are looked at in a chart: seen from a point below the middle of the hole, on a sphere, laid flat by the
stereographic projection; right-handed seen from outside, and free of folds where the wall bulges outward.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

__all__ = ["chart_points", "clean_rows", "crossings", "signed_area"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

SPIKE = np.cos(np.radians(100.0))  # a point where the line turns by more than this is the tip of a tooth one face wide
WIDE, NARROW = 3.0, 0.75  # widths of hairs, in edge lengths of the mesh
LONG_WIDE, LONG_NARROW = 8.0, 3.3  # how much longer than wide a hair is; a true corner of 15° or 35° is as slender


def chart_points(points: Floats, outward: Floats) -> Floats:
    """(n, 2) chart coordinates of a closed line, given the outward normals (n, 3) of the vessel along it."""
    middle = points.mean(axis=0)
    up = outward.mean(axis=0)
    up /= max(float(np.linalg.norm(up)), 1e-300)
    reach = float(np.linalg.norm(points - middle, axis=1).max())
    ray = points - (middle - reach * up)
    ray /= np.maximum(np.linalg.norm(ray, axis=1, keepdims=True), 1e-300)
    least = np.eye(3)[np.argmin(np.abs(up))]
    across = np.cross(least, up)
    across /= np.linalg.norm(across)
    flat = np.stack([ray @ across, ray @ np.cross(up, across)], axis=1)
    return np.asarray(2.0 * reach * flat / (1.0 + np.maximum(ray @ up, -0.99))[:, None])


def signed_area(uv: Floats) -> float:
    """Area inside a closed polygon (n, 2), positive when it runs counter-clockwise."""
    x, y = uv.T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def clean_rows(points: Floats, uv: Floats, spacing: float) -> Ints:
    """Numbers, in order, of the points of a closed line that remain when spikes, hairs and crossings are cut off.

    points   (n, 3) and uv (n, 2), the same line in space and in its chart
    spacing  edge length of the mesh: hairs are told by their width in it
    """
    rows = _without_repeats(points, np.arange(len(points)))
    for _ in range(20):
        before = len(rows)
        rows = _without_spikes(points, rows)
        rows = _without_hairs(points, uv, rows, spacing)
        rows = _without_crossings(uv, rows)
        if len(rows) == before or len(rows) < 4:
            break
    return rows


def _without_repeats(points: Floats, rows: Ints) -> Ints:
    step = np.linalg.norm(points[rows] - np.roll(points[rows], 1, axis=0), axis=1)
    return rows[step > 1e-9 * max(float(step.sum()), 1e-300)]


def _without_spikes(points: Floats, rows: Ints) -> Ints:
    for _ in range(10):
        p = points[rows]
        back, ahead = p - np.roll(p, 1, axis=0), np.roll(p, -1, axis=0) - p
        size = np.linalg.norm(back, axis=1) * np.linalg.norm(ahead, axis=1)
        spike = (back * ahead).sum(axis=1) < SPIKE * size
        spike &= ~np.roll(spike, 1)  # of two in a row the first goes: the second may then be none
        if not spike.any() or len(rows) - spike.sum() < 4:
            break
        rows = rows[~spike]
    return rows


def _without_hairs(points: Floats, uv: Floats, rows: Ints, spacing: float) -> Ints:
    for _ in range(200):
        if len(rows) < 8:
            break
        p = points[rows]
        steps = np.linalg.norm(np.roll(p, -1, axis=0) - p, axis=1)
        way, total = np.concatenate([[0.0], np.cumsum(steps)]), float(steps.sum())
        i, j = cKDTree(p).query_pairs(WIDE * spacing, output_type="ndarray").T
        width = np.linalg.norm(p[i] - p[j], axis=1)
        along = np.abs(way[j] - way[i])
        along = np.minimum(along, total - along)
        hair = np.flatnonzero(along > np.where(width < NARROW * spacing, LONG_NARROW, LONG_WIDE) * width)
        if not len(hair):
            break
        worst = hair[np.argmax(along[hair])]
        rows = _larger_part(uv, rows, int(min(i[worst], j[worst])), int(max(i[worst], j[worst])))
    return rows


def _larger_part(uv: Floats, rows: Ints, i: int, j: int) -> Ints:
    """Cut the polygon along the chord from its i-th to its j-th point and keep the part that encloses more."""
    inner, outer = rows[i : j + 1], np.concatenate([rows[: i + 1], rows[j:]])
    return inner if abs(signed_area(uv[inner])) > abs(signed_area(uv[outer])) else outer


def crossings(uv: Floats) -> Ints:
    """(m, 2) numbers i < j of the segments of a closed polygon that cross; segment i runs from point i to the next."""
    a, b = uv, np.roll(uv, -1, axis=0)
    n = len(uv)
    i, j = _overlapping(np.minimum(a, b), np.maximum(a, b))
    apart = (j - i > 1) & (j - i < n - 1)
    i, j = i[apart], j[apart]
    split = (_side(a[i], b[i], a[j]) * _side(a[i], b[i], b[j]) <= 0) & (
        _side(a[j], b[j], a[i]) * _side(a[j], b[j], b[i]) <= 0
    )
    return np.stack([i[split], j[split]], axis=1)


def _overlapping(low: Floats, high: Floats) -> tuple[Ints, Ints]:
    """Pairs i < j of boxes that overlap."""
    meet = (low[:, None, 0] <= high[None, :, 0]) & (low[None, :, 0] <= high[:, None, 0])
    meet &= (low[:, None, 1] <= high[None, :, 1]) & (low[None, :, 1] <= high[:, None, 1])
    i, j = np.nonzero(np.triu(meet, 2))
    return i, j


def _side(a: Floats, b: Floats, p: Floats) -> Floats:
    d, e = b - a, p - a
    return np.asarray(d[:, 0] * e[:, 1] - d[:, 1] * e[:, 0])


def _without_crossings(uv: Floats, rows: Ints) -> Ints:
    for _ in range(100):
        pairs = crossings(uv[rows])
        if not len(pairs) or len(rows) < 6:
            break
        i, j = pairs[np.argmin(pairs[:, 1] - pairs[:, 0])]
        rows = _apart(uv, rows, int(i), int(j))
    return rows


def _apart(uv: Floats, rows: Ints, i: int, j: int) -> Ints:
    """Undo the crossing of segments i and j: drop the points between them on the side that encloses less."""
    inner, outer = rows[i + 1 : j + 1], np.concatenate([rows[: i + 1], rows[j + 1 :]])
    if len(inner) < 3:
        return outer
    return inner if abs(signed_area(uv[inner])) > abs(signed_area(uv[outer])) else outer

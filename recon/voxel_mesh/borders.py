"""Borders between patches: along the curve where two sheets meet, or along triangles on the one sheet there is.

    sheet A | sheet B     a row of edges between two corners becomes one curve on both, walked step by step
    sheet A | free        its vertices lie on A, each on its own grid edge, and the edges between them are straight
    corner                where three patches or more meet: on all their sheets

A rounding and the plane that it touches have no sharp curve in common: the plane through its axis takes its place.
All lengths in voxels.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.geometry.analytic import AnalyticSurface, Cylinder, Plane
from recon.voxel_mesh.patches import FREE, Patches
from recon.voxel_mesh.settled_surfaces import Ends
from recon.voxel_mesh.sheets import DEEP, Sheet, stabbed_places

__all__ = ["Chain", "Placed", "conditions", "placed_vertices", "walked_curve"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

FARTHEST = 2.5  # voxels that a vertex may move to the curve or the corner where it belongs
NEWTON, MET = 25, 1e-9
STEP = 0.5  # voxels along a curve from point to point
TANGENT = 0.95  # cosine of the angle between normals of a plane and a cylinder that touch
LEAST_ANGLE = 0.08  # sine of the angle between two sheets whose curve can be told


@dataclass(frozen=True, eq=False)
class Chain:
    """Edges between two patches: from the first of its vertices to the last, which are one on a ring; the patch
    `left` lies to its left.
    """

    vertices: Ints
    left: int
    right: int

    @property
    def is_ring(self) -> bool:
        return bool(self.vertices[0] == self.vertices[-1])


@dataclass(frozen=True, eq=False)
class Placed:
    """place (V, 3) of every vertex, the chains between patches, and the vertices (n,) that found no place."""

    place: Floats
    chains: list[Chain]
    bad: Ints


def placed_vertices(
    faces: Ints, twin: Ints, patches: Patches, *, sheets: Sequence[Sheet], ends: Ends, smooth: Floats
) -> Placed:
    """Vertices on the sheets of the patches around them, those of no patch where the smoothing has them."""
    place = smooth.copy()
    n = len(smooth)
    pairs = np.unique(np.column_stack([faces.ravel(), np.repeat(patches.sheet, 3)]), axis=0)
    pairs = pairs[pairs[:, 1] != FREE]
    count = np.bincount(pairs[:, 0], minlength=n)
    single = pairs[count[pairs[:, 0]] == 1]
    beside_free = np.zeros(n, dtype=bool)
    beside_free[faces[patches.sheet == FREE]] = True
    bad: list[int] = []
    for k, sheet in enumerate(sheets):
        rows = single[single[:, 1] == k, 0]
        place[rows] = stabbed_places(sheet, ends, rows)
        bad += rows[beside_free[rows] & (np.abs(sheet.surface.distance(place[rows])) > 1.1 * DEEP)].tolist()
    bad += _put_on_curves(place, pairs[count[pairs[:, 0]] > 1], sheets, 0.5 * (ends.solid + ends.empty))
    return Placed(place, _chains(faces, twin, patches.patch), np.array(bad, dtype=np.int64))


def _put_on_curves(place: Floats, pairs: Ints, sheets: Sequence[Sheet], middle: Floats) -> list[int]:
    """Move vertices of several sheets, pairs (n, 2) of vertex and sheet, onto all of them; those that cannot be."""
    bad: list[int] = []
    first = np.flatnonzero(np.diff(pairs[:, 0], prepend=-1))
    for rows in np.split(pairs, first[1:]):
        if len(rows):
            v = int(rows[0, 0])
            there = _met(middle[v], conditions(rows[:, 1].tolist(), sheets, middle[v]))
            if there is None or np.linalg.norm(there - middle[v]) > FARTHEST:
                bad.append(v)
            else:
                place[v] = there
    return bad


def conditions(numbers: Iterable[int], sheets: Sequence[Sheet], near: Floats) -> list[AnalyticSurface]:
    """Surfaces that meet at an angle in what the sheets of some numbers have in common near a place."""
    own = sorted(numbers)
    found: list[AnalyticSurface] = []
    for k in own:
        touches = [t.plane for t in sheets[k].touches if t.other in own]
        surface = sheets[k].surface
        if not touches and isinstance(surface, Cylinder):
            touches = [
                plane
                for j in own
                if (plane := _touching_plane(surface, sheets[j].surface, near)) is not None and j != k
            ]
        found += touches or [surface]
    return found


def _touching_plane(cylinder: Cylinder, other: AnalyticSurface, near: Floats) -> Plane | None:
    """The plane through the axis of a cylinder at right angles to a plane that it touches; None where it does not."""
    if not isinstance(other, Plane) or abs(cylinder.axis @ other.normal_vector) > LEAST_ANGLE:
        return None
    if abs(cylinder.normal(near[None])[0] @ other.normal_vector) < TANGENT:
        return None
    if abs(abs(other.distance(cylinder.point[None])[0]) - cylinder.radius) > DEEP:
        return None
    across = np.cross(cylinder.axis, other.normal_vector)
    across /= np.linalg.norm(across)
    return Plane(across, float(across @ cylinder.point))


def _met(start: Floats, surfaces: Sequence[AnalyticSurface]) -> Floats | None:
    """The place nearest to a start where surfaces meet; None where they do not, or at too small an angle."""
    x = start.copy()
    for _ in range(NEWTON):
        normals = np.array([surface.normal(x[None])[0] for surface in surfaces])
        miss = np.array([surface.distance(x[None])[0] for surface in surfaces])
        if np.abs(miss).max() < MET:
            break
        if np.linalg.svd(normals, compute_uv=False)[min(len(normals), 3) - 1] < LEAST_ANGLE:
            return None
        x = x - np.linalg.lstsq(normals, miss, rcond=None)[0]
    return x if np.abs(miss).max() < 1e-6 else None


def walked_curve(start: Floats, end: Floats | None, toward: Floats, pair: Sequence[AnalyticSurface]) -> Floats | None:
    """Points (n, 3) on two surfaces from a start to an end, or once around; None where the walk does not arrive.

    toward  (m, 3) places along the way
    """
    if end is not None and all(isinstance(surface, Plane) for surface in pair):
        return np.array([start, end])
    length = float(np.linalg.norm(np.diff(toward, axis=0), axis=1).sum())
    ahead = toward[min(3, len(toward) - 1)] - start
    points = [start]
    for _ in range(int(4.0 * length / STEP) + 20):
        normals = np.array([surface.normal(points[-1][None])[0] for surface in pair])
        way = np.cross(*normals)
        size = np.linalg.norm(way)
        if size < LEAST_ANGLE:
            return None
        way *= np.sign(way @ ahead) / size
        left = (start if end is None else end) - points[-1]
        if (len(points) > 3 or end is not None) and left @ way > 0.0 and np.linalg.norm(left) < 1.5 * STEP:
            return _straightened(np.array([*points, start if end is None else end]))
        there = _met(points[-1] + STEP * way, pair)
        if there is None:
            return None
        ahead = there - points[-1]
        points.append(there)
    return None


def _straightened(points: Floats) -> Floats:
    """The two ends alone of points on a line."""
    way = points[-1] - points[0]
    length = np.linalg.norm(way)
    if not length > 0.0:
        return points
    arm = points - points[0]
    off = arm - np.outer(arm @ way / length**2, way)
    return points[[0, -1]] if np.abs(off).max() < MET * 1e3 else points


def _chains(faces: Ints, twin: Ints, patch: Ints) -> list[Chain]:
    """Rows of edges between the same two patches, from corner to corner or around."""
    all_sides = np.arange(len(twin))
    border = np.flatnonzero(patch[all_sides // 3] != patch[twin // 3])
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    is_corner = np.bincount(start[border], minlength=int(faces.max()) + 1) > 2
    key = {(int(start[h]), int(patch[h // 3]), int(patch[twin[h] // 3])): int(h) for h in border}
    left = set(border.tolist())
    found = []
    for h in [*border[is_corner[start[border]]].tolist(), *border.tolist()]:
        if h not in left or patch[h // 3] > patch[twin[h] // 3]:
            continue
        sides = [h]
        while not is_corner[end[sides[-1]]] and end[sides[-1]] != start[h]:
            sides.append(key[int(end[sides[-1]]), int(patch[h // 3]), int(patch[twin[h] // 3])])
        left.difference_update(sides)
        left.difference_update(twin[sides].tolist())
        vertices = np.append(start[sides], end[sides[-1]])
        found.append(Chain(vertices, int(patch[h // 3]), int(patch[twin[h] // 3])))
    return found

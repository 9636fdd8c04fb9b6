"""A solid back to voxels: the proof that it has every voxel centre on its right side.

Of a closed mesh: each column of centres along the last axis meets it at some heights; between the first and the
second, the third and the fourth ... it is inside.  Of a turned part no mesh is needed, which would itself be off: each
centre is held against the profile at its own (r, z).
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from recon.geometry.mesh import TriangleMesh
from recon.geometry.turned import TurnedPart
from recon.geometry.voxel_grid import VoxelGrid
from recon.numerics.distance import closest_points

__all__ = ["WrongSide", "turned_wrong_side", "wrong_side"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

BESIDE = 1.7e-7  # voxels beside the centres, so that no column runs through a vertex of a straight part
MOST = 5_000  # wrong centres whose depth is measured
FINE = 0.02  # voxels between the points of a profile
BIN = 0.1  # voxels of height whose pieces of the profile are looked up together


class WrongSide(NamedTuple):
    """Centres on the wrong side of a mesh: how many, and how far in voxels the deepest lies from it."""

    centres: int
    deepest: float


def wrong_side(grid: VoxelGrid, mesh: TriangleMesh) -> WrongSide:
    """Compare a closed mesh in model units with the grid it is to stand for."""
    index = (mesh.vertices - grid.origin) @ grid.direction / grid.spacing
    inside = np.zeros(grid.solid.shape, dtype=np.bool_)
    shifted = index + np.array([BESIDE, 1.618 * BESIDE, 0.0])
    low = np.floor(shifted[mesh.face_vertices].min(axis=1)).astype(np.int64)
    high = np.ceil(shifted[mesh.face_vertices].max(axis=1)).astype(np.int64)
    crossings = np.zeros((grid.solid.shape[0], grid.solid.shape[1]), dtype=np.int64)
    _cross(shifted, mesh.face_vertices, low, high, crossings, np.zeros(0), np.zeros((0, 0), dtype=np.int64))
    starts = np.concatenate([[0], np.cumsum(crossings.ravel())])[:-1].reshape(crossings.shape)
    heights = np.zeros(int(crossings.sum()))
    _cross(shifted, mesh.face_vertices, low, high, np.zeros_like(crossings), heights, starts)
    _fill(inside, crossings, starts, heights)
    wrong = np.argwhere(inside != grid.solid)
    if not len(wrong):
        return WrongSide(0, 0.0)
    places = grid.place(wrong[:: max(1, len(wrong) // MOST)] * grid.proportions)
    away = closest_points(places, mesh.vertices, mesh.face_vertices).distances
    return WrongSide(len(wrong), float(away.max()) / grid.voxel)


def turned_wrong_side(grid: VoxelGrid, part: TurnedPart) -> WrongSide:
    """Compare a part in model units with the grid it is to stand for."""
    rows = [np.concatenate([row, row[:1]]) for row in part.outlines(FINE * grid.voxel)]
    segments = np.concatenate([np.hstack([row[:-1], row[1:]]) for row in rows])
    low = float(segments[:, 1].min())
    n_bins = int((segments[:, 1].max() - low) / (BIN * grid.voxel)) + 1
    first, last = (
        (end - low) / (BIN * grid.voxel) for end in (segments[:, 1::2].min(axis=1), segments[:, 1::2].max(axis=1))
    )
    table = _binned(first.astype(np.int64), np.minimum(last.astype(np.int64), n_bins - 1), n_bins)
    steps = np.ascontiguousarray((grid.direction * grid.spacing).T)
    inside = _inside_profile(
        grid.solid.shape, grid.origin - part.origin, steps, part.axis, segments, low, BIN * grid.voxel, *table
    )
    wrong = np.argwhere(inside != grid.solid)
    if not len(wrong):
        return WrongSide(0, 0.0)
    arm = grid.place(wrong * grid.proportions) - part.origin
    z = arm @ part.axis
    at = np.column_stack([np.linalg.norm(arm - z[:, None] * part.axis, axis=1), z])
    fine = np.concatenate([p.points(max(2, int(p.length / (FINE * grid.voxel)))) for loop in part.loops for p in loop])
    away = cKDTree(fine[fine[:, 0] > 0.0]).query(at)[0]
    return WrongSide(len(wrong), float(away.max()) / grid.voxel)


def _binned(first: Ints, last: Ints, n: int) -> tuple[Ints, Ints]:
    """Rows by bin: those of bin b are rows[start[b]:start[b + 1]]."""
    count = last - first + 1
    row = np.repeat(np.arange(len(first)), count)
    number = np.repeat(first, count) + np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
    order = np.argsort(number, kind="stable")
    return np.searchsorted(number[order], np.arange(n + 1)), row[order]


@njit(cache=True)
def _inside_profile(
    shape: tuple[int, int, int],
    origin: Floats,
    steps: Floats,
    axis: Floats,
    segments: Floats,
    low: float,
    size: float,
    start: Ints,
    rows: Ints,
) -> NDArray[np.bool_]:  # pragma: no cover - compiled
    """Whether each centre is inside: a ray away from the axis crosses the profile an odd number of times."""
    inside = np.zeros(shape, dtype=np.bool_)
    for i in range(shape[0]):
        for j in range(shape[1]):
            for k in range(shape[2]):
                x = origin[0] + i * steps[0, 0] + j * steps[1, 0] + k * steps[2, 0]
                y = origin[1] + i * steps[0, 1] + j * steps[1, 1] + k * steps[2, 1]
                w = origin[2] + i * steps[0, 2] + j * steps[1, 2] + k * steps[2, 2]
                z = x * axis[0] + y * axis[1] + w * axis[2]
                at = int(np.floor((z - low) / size))
                if at < 0 or at + 1 >= len(start):
                    continue
                r = np.sqrt(max(x * x + y * y + w * w - z * z, 0.0))
                for e in range(start[at], start[at + 1]):
                    a, b, c, d = segments[rows[e]]
                    if (b > z) != (d > z) and r < a + (z - b) / (d - b) * (c - a):
                        inside[i, j, k] = not inside[i, j, k]
    return inside


@njit(cache=True)
def _cross(
    v: Floats, faces: Ints, low: Ints, high: Ints, count: Ints, height: Floats, start: Ints
) -> None:  # pragma: no cover - compiled
    """Count where columns meet triangles, or note the heights where there is room for them."""
    nx, ny = count.shape
    for t in range(len(faces)):
        a, b, c = faces[t, 0], faces[t, 1], faces[t, 2]
        ux, uy, wx, wy = v[b, 0] - v[a, 0], v[b, 1] - v[a, 1], v[c, 0] - v[a, 0], v[c, 1] - v[a, 1]
        det = ux * wy - uy * wx
        if det == 0.0:
            continue
        for i in range(max(0, low[t, 0]), min(nx - 1, high[t, 0]) + 1):
            for j in range(max(0, low[t, 1]), min(ny - 1, high[t, 1]) + 1):
                px, py = i - v[a, 0], j - v[a, 1]
                s, w = (px * wy - py * wx) / det, (ux * py - uy * px) / det
                if s >= 0 and w >= 0 and s + w <= 1:
                    if len(height):
                        height[start[i, j] + count[i, j]] = v[a, 2] + s * (v[b, 2] - v[a, 2]) + w * (v[c, 2] - v[a, 2])
                    count[i, j] += 1


@njit(cache=True)
def _fill(inside: NDArray[np.bool_], count: Ints, start: Ints, height: Floats) -> None:  # pragma: no cover - compiled
    nx, ny, nz = inside.shape
    for i in range(nx):
        for j in range(ny):
            z = np.sort(height[start[i, j] : start[i, j] + count[i, j]])
            for k in range(0, len(z) - 1, 2):
                for m in range(max(0, int(np.ceil(z[k]))), min(nz - 1, int(np.floor(z[k + 1]))) + 1):
                    inside[i, j, m] = True

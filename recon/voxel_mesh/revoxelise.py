"""A closed mesh back to voxels: the proof that a solid has every voxel centre on its right side.

Each column of centres along the last axis meets the mesh at some heights; between the first and the second, the third
and the fourth ... it is inside.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.geometry.mesh import TriangleMesh
from recon.geometry.voxel_grid import VoxelGrid
from recon.numerics.distance import closest_points

__all__ = ["WrongSide", "wrong_side"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

BESIDE = 1.7e-7  # voxels beside the centres, so that no column runs through a vertex of a straight part
MOST = 5_000  # wrong centres whose depth is measured


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

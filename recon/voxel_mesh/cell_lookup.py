"""Which triangles of the grid's surface lie near a point: found by cell, without a search.

Marching cubes gives the triangles cell by cell, and none leaves its cell.  So the cells are numbered in blocks of
8 x 8 x 8, only those blocks that hold triangles have a table, and a look-up is two array reads:

    point -> cell -> block of the cell -> first triangle of the cell, and how many

`distance_within` stops at the first triangle that is near enough, since what is asked is never the distance but
whether it stays below a bound.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.voxel_mesh.marching_cubes import GridSurface

__all__ = ["CellLookup", "cell_lookup", "distance_within", "point_triangle_squared"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
BLOCK = 8


class CellLookup(NamedTuple):
    """Triangles by cell.

    vertices     (V, 3) in voxels
    faces        (F, 3) vertex numbers, cell by cell
    proportions  (3,) size of a cell
    low          (3,) index of the first cell of the first block
    block        (BX, BY, BZ) number of each block's table, -1 without
    first        (B, 8, 8, 8) first triangle of each cell, -1 without
    counts       (B, 8, 8, 8) triangles of each cell
    """

    vertices: Floats
    faces: NDArray[np.int32]
    proportions: Floats
    low: Ints
    block: NDArray[np.int32]
    first: NDArray[np.int32]
    counts: NDArray[np.int8]


def cell_lookup(surface: GridSurface, proportions: Floats) -> CellLookup:
    """Look-up over a surface whose vertices may have slid along their grid edges."""
    faces = surface.face_vertices
    # a cell begins at the least index of its grid edges; what they share along each axis tells which cell it is
    middle = (surface.edge_voxel + 0.5 * np.eye(3)[surface.edge_axis])[faces].mean(axis=1)
    cell = np.floor(middle).astype(np.int64)
    new = np.flatnonzero((np.diff(cell, axis=0, prepend=cell[:1] - 1) != 0).any(axis=1))
    cells, count = cell[new], np.diff(np.append(new, len(faces)))
    low = cells.min(axis=0)
    place = (cells - low) // BLOCK
    shape = place.max(axis=0) + 1
    block = np.full(shape, -1, dtype=np.int32)
    used, number = np.unique(np.ravel_multi_index(tuple(place.T), tuple(shape)), return_inverse=True)
    block.ravel()[used] = np.arange(len(used))
    first = np.full((len(used), BLOCK, BLOCK, BLOCK), -1, dtype=np.int32)
    counts = np.zeros(first.shape, dtype=np.int8)
    at = (number, *((cells - low) % BLOCK).T)
    first[at], counts[at] = new, count
    size = np.asarray(proportions, dtype=np.float64)
    return CellLookup(surface.vertices, faces.astype(np.int32), size, low, block, first, counts)


@njit(cache=True)
def distance_within(
    look: CellLookup, x: float, y: float, z: float, enough: float, limit: float
) -> float:  # pragma: no cover - compiled
    """Squared distance from a point to the surface, exact up to `limit`; any below the square of `enough` will do.

    Beyond `limit` some value larger than its square is returned.
    """
    px, py, pz = look.proportions[0], look.proportions[1], look.proportions[2]
    ci, cj, ck = int(np.floor(x / px)), int(np.floor(y / py)), int(np.floor(z / pz))
    ri, rj, rk = int(np.ceil(limit / px)), int(np.ceil(limit / py)), int(np.ceil(limit / pz))
    best, near = 4.0 * limit * limit, enough * enough
    # the point's own cell first: most often it settles the question
    for i in range(ci - ri - 1, ci + ri + 1):
        own = i < ci - ri
        i = ci if own else i
        dx = max(max(i * px - x, x - (i + 1) * px), 0.0)
        for j in range(cj if own else cj - rj, cj + 1 if own else cj + rj + 1):
            dy = max(max(j * py - y, y - (j + 1) * py), 0.0)
            if dx * dx + dy * dy >= best:
                continue
            for k in range(ck if own else ck - rk, ck + 1 if own else ck + rk + 1):
                dz = max(max(k * pz - z, z - (k + 1) * pz), 0.0)
                if dx * dx + dy * dy + dz * dz >= best:
                    continue
                first, count = _cell(look.low, look.block, look.first, look.counts, i, j, k)
                for t in range(first, first + count):
                    a, b, c = look.faces[t, 0], look.faces[t, 1], look.faces[t, 2]
                    best = min(best, point_triangle_squared(x, y, z, look.vertices, a, b, c))
                if best <= near:
                    return best
    return best


@njit(cache=True, inline="always")
def _cell(low, block, first, count, i, j, k):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """First triangle of a cell and their number."""
    i, j, k = i - low[0], j - low[1], k - low[2]
    bi, bj, bk = i >> 3, j >> 3, k >> 3
    if i < 0 or j < 0 or k < 0 or bi >= block.shape[0] or bj >= block.shape[1] or bk >= block.shape[2]:
        return 0, 0
    b = block[bi, bj, bk]
    if b < 0:
        return 0, 0
    return first[b, i & 7, j & 7, k & 7], count[b, i & 7, j & 7, k & 7]


@njit(cache=True)
def point_triangle_squared(
    x: float, y: float, z: float, place: Floats, a: int, b: int, c: int
) -> float:  # pragma: no cover - compiled
    """Squared distance from a point to the triangle of three rows of `place`.

    Its regions are told apart by the signs of barycentric terms.
    Paper  [ericson2005], 5.1.5.
    """
    ax, ay, az = place[a, 0], place[a, 1], place[a, 2]
    bx, by, bz = place[b, 0], place[b, 1], place[b, 2]
    cx, cy, cz = place[c, 0], place[c, 1], place[c, 2]
    abx, aby, abz = bx - ax, by - ay, bz - az
    acx, acy, acz = cx - ax, cy - ay, cz - az
    apx, apy, apz = x - ax, y - ay, z - az
    d1 = abx * apx + aby * apy + abz * apz
    d2 = acx * apx + acy * apy + acz * apz
    if d1 <= 0.0 and d2 <= 0.0:
        return apx * apx + apy * apy + apz * apz
    bpx, bpy, bpz = x - bx, y - by, z - bz
    d3 = abx * bpx + aby * bpy + abz * bpz
    d4 = acx * bpx + acy * bpy + acz * bpz
    if d3 >= 0.0 and d4 <= d3:
        return bpx * bpx + bpy * bpy + bpz * bpz
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        return _off_line(apx, apy, apz, abx, aby, abz, d1 / (d1 - d3))
    cpx, cpy, cpz = x - cx, y - cy, z - cz
    d5 = abx * cpx + aby * cpy + abz * cpz
    d6 = acx * cpx + acy * cpy + acz * cpz
    if d6 >= 0.0 and d5 <= d6:
        return cpx * cpx + cpy * cpy + cpz * cpz
    vb = d5 * d2 - d1 * d6
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        return _off_line(apx, apy, apz, acx, acy, acz, d2 / (d2 - d6))
    va = d3 * d6 - d5 * d4
    if va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        return _off_line(bpx, bpy, bpz, cx - bx, cy - by, cz - bz, w)
    total = va + vb + vc
    if not total > 0.0:
        return apx * apx + apy * apy + apz * apz
    v, w = vb / total, vc / total
    fx, fy, fz = apx - v * abx - w * acx, apy - v * aby - w * acy, apz - v * abz - w * acz
    return fx * fx + fy * fy + fz * fz


@njit(cache=True)
def _off_line(
    px: float, py: float, pz: float, ex: float, ey: float, ez: float, t: float
) -> float:  # pragma: no cover - compiled
    fx, fy, fz = px - t * ex, py - t * ey, pz - t * ez
    return fx * fx + fy * fy + fz * fz

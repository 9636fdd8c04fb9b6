"""Which triangles of a grid's surface lie near a point: found by cell, without a search.

Marching cubes gives the triangles cell by cell, and none leaves its cell.  So the cells are numbered in blocks of
8 x 8 x 8, only those blocks that hold triangles have a table, and a look-up is two array reads:

    point -> cell -> block of the cell -> first triangle of the cell, and how many

A point's own cell is asked first; what it holds tells how far the neighbours need to be asked.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = [
    "CellLookup",
    "cell_lookup",
    "empty_lookup",
    "nearest_in_cell",
    "nearest_within",
    "point_triangle_squared",
    "surface_distances",
    "triangle_squared",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
BLOCK = 8


class CellLookup(NamedTuple):
    """Triangles by cell: few arrays, since each costs time whenever compiled functions call one another.

    size     (3,) of a cell, in voxels
    low      (3,) index of the first cell of the first block
    block    (BX, BY, BZ) number of each block's table, -1 without
    span     (B, 8, 8, 8) of each cell the first triangle, times eight, plus their number: never more than five
    corners  (F, 9) the triangles, cell by cell
    """

    size: Floats
    low: Ints
    block: NDArray[np.int32]
    span: NDArray[np.int32]
    corners: Floats


def cell_lookup(corners: Floats, cell: Ints, size: Floats) -> CellLookup:
    """Look-up over triangles (F, 3, 3) that come cell by cell; the cell (F, 3) of each, and the size (3,) of a cell."""
    new = np.flatnonzero((np.diff(cell, axis=0, prepend=cell[:1] - 1) != 0).any(axis=1))
    cells, count = cell[new], np.diff(np.append(new, len(corners)))
    low = cells.min(axis=0)
    place = (cells - low) // BLOCK
    shape = place.max(axis=0) + 1
    block = np.full(shape, -1, dtype=np.int32)
    used, number = np.unique(np.ravel_multi_index(tuple(place.T), tuple(shape)), return_inverse=True)
    block.ravel()[used] = np.arange(len(used))
    span = np.zeros((len(used), BLOCK, BLOCK, BLOCK), dtype=np.int32)
    span[(number, *((cells - low) % BLOCK).T)] = 8 * new + count
    return CellLookup(np.array(size, dtype=np.float64), low, block, span, corners.reshape(-1, 9))


def empty_lookup() -> CellLookup:
    """Look-up over no triangles, for a collapse that asks for no distance."""
    nowhere = np.full((1, 1, 1), -1, dtype=np.int32)
    tables = np.zeros((0, BLOCK, BLOCK, BLOCK), dtype=np.int32)
    return CellLookup(np.ones(3), np.zeros(3, dtype=np.int64), nowhere, tables, np.zeros((0, 9)))


@njit(cache=True)
def surface_distances(look: CellLookup, points: Floats) -> Floats:  # pragma: no cover - compiled
    """(n,) distance of every point (n, 3), in voxels, from the surface."""
    distances = np.empty(len(points))
    for i in range(len(points)):
        limit, square = 1.0, np.inf
        while square > limit * limit:
            limit *= 2.0
            square = nearest_within(look, points[i, 0], points[i, 1], points[i, 2], limit)[0]
        distances[i] = np.sqrt(square)
    return distances


@njit(cache=True)
def nearest_within(
    look: CellLookup, x: float, y: float, z: float, limit: float
) -> tuple[float, int]:  # pragma: no cover - compiled
    """Squared distance from a point to the surface, and the triangle where it is, exact up to `limit`.

    Beyond `limit` some value larger than its square is returned, and any triangle.
    """
    px, py, pz = look.size[0], look.size[1], look.size[2]
    ci, cj, ck = int(np.floor(x / px)), int(np.floor(y / py)), int(np.floor(z / pz))
    best, at = _nearest_of_cell(look, ci, cj, ck, x, y, z, 4.0 * limit * limit, 0)
    reach = min(np.sqrt(best), limit)
    li, hi = int(np.floor((x - reach) / px)), int(np.floor((x + reach) / px))
    lj, hj = int(np.floor((y - reach) / py)), int(np.floor((y + reach) / py))
    lk, hk = int(np.floor((z - reach) / pz)), int(np.floor((z + reach) / pz))
    for i in range(li, hi + 1):
        dx = max(max(i * px - x, x - (i + 1) * px), 0.0)
        for j in range(lj, hj + 1):
            dy = max(max(j * py - y, y - (j + 1) * py), 0.0)
            if dx * dx + dy * dy >= best:
                continue
            for k in range(lk, hk + 1):
                dz = max(max(k * pz - z, z - (k + 1) * pz), 0.0)
                if dx * dx + dy * dy + dz * dz < best and not (i == ci and j == cj and k == ck):
                    best, at = _nearest_of_cell(look, i, j, k, x, y, z, best, at)
    return best, at


@njit(cache=True, inline="always")
def nearest_in_cell(
    look: CellLookup, x: float, y: float, z: float, beyond: float
) -> tuple[float, int]:  # pragma: no cover - compiled
    """As `nearest_within`, from the triangles of the own cell alone; `beyond` where none is nearer."""
    i, j, k = np.floor(x / look.size[0]), np.floor(y / look.size[1]), np.floor(z / look.size[2])
    return _nearest_of_cell(look, int(i), int(j), int(k), x, y, z, beyond, 0)


@njit(cache=True, inline="always")
def _nearest_of_cell(
    look: CellLookup, i: int, j: int, k: int, x: float, y: float, z: float, best: float, at: int
) -> tuple[float, int]:  # pragma: no cover - compiled
    i, j, k = i - look.low[0], j - look.low[1], k - look.low[2]
    bi, bj, bk = i >> 3, j >> 3, k >> 3
    nx, ny, nz = look.block.shape
    if bi < 0 or bj < 0 or bk < 0 or bi >= nx or bj >= ny or bk >= nz:
        return best, at
    b = look.block[bi, bj, bk]
    if b < 0:
        return best, at
    span = look.span[b, i & 7, j & 7, k & 7]
    for t in range(span >> 3, (span >> 3) + (span & 7)):
        d = triangle_squared(look, t, x, y, z)
        if d < best:
            best, at = d, t
    return best, at


@njit(cache=True, inline="always")
def triangle_squared(look: CellLookup, t: int, x: float, y: float, z: float) -> float:  # pragma: no cover - compiled
    """Squared distance from a point to triangle t of the surface."""
    c = look.corners
    return corners_squared(x, y, z, c[t, 0], c[t, 1], c[t, 2], c[t, 3], c[t, 4], c[t, 5], c[t, 6], c[t, 7], c[t, 8])


@njit(cache=True, inline="always")
def point_triangle_squared(
    x: float, y: float, z: float, place: Floats, a: int, b: int, c: int
) -> float:  # pragma: no cover - compiled
    """Squared distance from a point to the triangle of three rows of `place`."""
    p = place
    return corners_squared(x, y, z, p[a, 0], p[a, 1], p[a, 2], p[b, 0], p[b, 1], p[b, 2], p[c, 0], p[c, 1], p[c, 2])


@njit(cache=True)
def corners_squared(x, y, z, ax, ay, az, bx, by, bz, cx, cy, cz):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Squared distance from a point to a triangle, whose regions are told apart by the signs of barycentric terms.

    Paper  [ericson2005], 5.1.5.
    """
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

"""The bound on the error while edges collapse, in both directions.

    there   samples of the grid's surface hang, in a list a face, on the face they were nearest to; when faces change,
            their samples go to the nearest of the faces that come in their place, and none may be farther than allowed
    back    a new face is tested point by point against the grid's surface.  The distance grows no faster than one goes:
            when a triangle's middle is d away and its corners r from the middle, no point of it is farther than d + r;
            where that does not settle it, it is cut in four, down to a size that only a spike of the distance survives

One way alone leaks: a face may span a notch that no sample of it sees, or a spike may rise from a face with no sample.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.voxel_mesh.cell_lookup import CellLookup, distance_within, point_triangle_squared

__all__ = ["Bound", "face_bound", "no_bound", "keeps_bound", "hand_over", "face_distance"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SMALLEST = 0.3  # voxels: a triangle smaller than this about its middle is judged by its middle
NEAR = 1e-4  # squared voxels: as good as on the face


class Bound(NamedTuple):
    """Samples and the distance they may have.

    sample    (S, 3) places                       first  (F,) first sample of each face, -1 without
    following (S,) next sample of the same face   goes   (S,) scratch: the ring face each sample would go to
    distance  (S,) to the face it hangs on        came   (S,) scratch: how far that is
    limit     (1,) largest distance allowed; not positive when nothing is bounded
    stack     (40, 9) scratch: triangles still to be judged
    """

    sample: Floats
    first: NDArray[np.int32]
    following: NDArray[np.int32]
    distance: NDArray[np.float32]
    goes: NDArray[np.int32]
    came: NDArray[np.float32]
    limit: Floats
    stack: Floats


def face_bound(vertices: Floats, faces: Ints, limit: float) -> Bound:
    """Samples at the vertices, each on one of its faces, and in the middle of every face."""
    n, m = len(vertices), len(faces)
    sample = np.concatenate([vertices, vertices[faces].mean(axis=1)])
    home = np.zeros(n, dtype=np.int64)
    home[faces.ravel()] = np.repeat(np.arange(m), 3)
    first = np.arange(n, n + m, dtype=np.int32)
    following = np.full(n + m, -1, dtype=np.int32)
    order = np.argsort(home, kind="stable")
    last = np.flatnonzero(np.diff(home[order], append=-1))
    following[order] = np.append(order[1:], -1)
    following[order[last]] = -1
    begins = order[np.flatnonzero(np.diff(home[order], prepend=-1))]
    following[n + home[begins]] = begins
    return Bound(sample, first, following, *_scratch(n + m), np.array([limit]), np.empty((40, 9)))


def no_bound() -> Bound:
    """Nothing is bounded."""
    none = np.zeros(0, dtype=np.int32)
    return Bound(np.zeros((0, 3)), none, none.copy(), *_scratch(0), np.array([-1.0]), np.empty((40, 9)))


def _scratch(n: int) -> tuple[NDArray[np.float32], NDArray[np.int32], NDArray[np.float32]]:
    return np.zeros(n, dtype=np.float32), np.zeros(n, dtype=np.int32), np.zeros(n, dtype=np.float32)


@njit(cache=True)
def _next(h: int) -> int:  # pragma: no cover - compiled
    return h - 2 if h % 3 == 2 else h + 1


@njit(cache=True)
def keeps_bound(
    bound: Bound,
    look: CellLookup,
    corner: NDArray[np.int32],
    place: Floats,
    ring: NDArray[np.int32],
    n_ring: int,
    gone: int,
    lost: int,
    u: int,
) -> bool:  # pragma: no cover - compiled
    """Whether the ring, its inner vertex u in its new place, keeps both bounds; notes where each sample would go."""
    limit = bound.limit[0]
    if not limit > 0.0:
        return True
    if distance_within(look, place[u, 0], place[u, 1], place[u, 2], limit, limit) > limit * limit:
        return False
    for r in range(n_ring + 2):
        f = ring[r] // 3 if r < n_ring else gone if r == n_ring else lost
        s = bound.first[f]
        while s >= 0:
            x, y, z = bound.sample[s, 0], bound.sample[s, 1], bound.sample[s, 2]
            best, at = np.inf, -1
            for step in range(n_ring):
                k = r + step if r < n_ring else step
                k = k - n_ring if k >= n_ring else k
                h = ring[k]
                d = point_triangle_squared(x, y, z, place, u, corner[_next(h)], corner[_next(_next(h))])
                if d < best:
                    best, at = d, k
                    if d <= NEAR:
                        break
            if best > limit * limit:
                return False
            bound.goes[s], bound.came[s] = at, np.sqrt(best)
            s = bound.following[s]
    for r in range(n_ring):
        h = ring[r]
        b, c = corner[_next(h)], corner[_next(_next(h))]
        if face_distance(look, place, u, b, c, bound.stack, limit, limit) > limit:
            return False
    return True


@njit(cache=True)
def hand_over(
    bound: Bound, ring: NDArray[np.int32], n_ring: int, gone: int, lost: int
) -> None:  # pragma: no cover - compiled
    """Hang the ring's samples where `keeps_bound` found them to go."""
    if not bound.limit[0] > 0.0:
        return
    chain = -1
    for r in range(n_ring + 2):
        f = ring[r] // 3 if r < n_ring else gone if r == n_ring else lost
        s = bound.first[f]
        bound.first[f] = -1
        while s >= 0:
            following = bound.following[s]
            bound.following[s] = chain
            chain = s
            s = following
    while chain >= 0:
        following = bound.following[chain]
        f = ring[bound.goes[chain]] // 3
        bound.following[chain] = bound.first[f]
        bound.first[f] = chain
        bound.distance[chain] = bound.came[chain]
        chain = following


@njit(cache=True)
def face_distance(
    look: CellLookup, place: Floats, a: int, b: int, c: int, stack: Floats, floor: float, limit: float
) -> float:  # pragma: no cover - compiled
    """Largest distance found from a triangle to the grid's surface, where it is above `floor`; stops beyond `limit`."""
    for i in range(3):
        stack[0, i], stack[0, 3 + i], stack[0, 6 + i] = place[a, i], place[b, i], place[c, i]
    depth, worst = 1, floor
    while depth > 0:
        depth -= 1
        ax, ay, az = stack[depth, 0], stack[depth, 1], stack[depth, 2]
        bx, by, bz = stack[depth, 3], stack[depth, 4], stack[depth, 5]
        cx, cy, cz = stack[depth, 6], stack[depth, 7], stack[depth, 8]
        x, y, z = (ax + bx + cx) / 3.0, (ay + by + cy) / 3.0, (az + bz + cz) / 3.0
        r = max((ax - x) ** 2 + (ay - y) ** 2 + (az - z) ** 2, (bx - x) ** 2 + (by - y) ** 2 + (bz - z) ** 2)
        r = np.sqrt(max(r, (cx - x) ** 2 + (cy - y) ** 2 + (cz - z) ** 2))
        small = r <= SMALLEST or depth > 36
        d = 0.0
        if small or r < worst:
            d = np.sqrt(distance_within(look, x, y, z, worst if small else worst - r, limit))
            if d > limit:
                return d
        if small:
            worst = max(worst, d)
        elif d + r > worst:
            kx, ky, kz = 0.5 * (ax + bx), 0.5 * (ay + by), 0.5 * (az + bz)
            lx, ly, lz = 0.5 * (bx + cx), 0.5 * (by + cy), 0.5 * (bz + cz)
            mx, my, mz = 0.5 * (cx + ax), 0.5 * (cy + ay), 0.5 * (cz + az)
            _put(stack, depth, ax, ay, az, kx, ky, kz, mx, my, mz)
            _put(stack, depth + 1, bx, by, bz, lx, ly, lz, kx, ky, kz)
            _put(stack, depth + 2, cx, cy, cz, mx, my, mz, lx, ly, lz)
            _put(stack, depth + 3, kx, ky, kz, lx, ly, lz, mx, my, mz)
            depth += 4
    return worst


@njit(cache=True, inline="always")
def _put(stack, row, ax, ay, az, bx, by, bz, cx, cy, cz):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    stack[row, 0], stack[row, 1], stack[row, 2] = ax, ay, az
    stack[row, 3], stack[row, 4], stack[row, 5] = bx, by, bz
    stack[row, 6], stack[row, 7], stack[row, 8] = cx, cy, cz

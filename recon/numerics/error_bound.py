"""The bound on the error while edges collapse, in both directions.

    there   samples of the grid's surface hang, in a list a face, on the face they were nearest to; when faces change,
            their samples go to the nearest of the faces that come in their place, and none may be farther than allowed
    back    a new face is tested piece by piece against the grid's surface.  A triangle of that surface is convex, so
            a piece whose three corners are near enough to the same one is near enough all over; where the triangle
            nearest to the middle does not settle it, the piece is halved across its longest side
    guard   where asked for, the grid edge of every sample at a vertex has to cross the face on which it hangs: then the
            two voxel centres at its ends stay on their sides

One way alone leaks: a face may span a notch that no sample of it sees, or a spike may rise from a face with no sample.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.numerics.cell_lookup import (
    CellLookup,
    nearest_in_cell,
    nearest_within,
    point_triangle_squared,
    triangle_squared,
)

__all__ = ["Bound", "face_bound", "hanging_bound", "no_bound", "keeps_bound", "hand_over", "face_within"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

ONE_FACE = 6.0  # squared voxels: a side longer than this is near no single triangle of the grid
SMALLEST = 0.06  # of the squared limit: a piece with shorter sides that is not settled lies at the limit itself
TESTED = 0.98  # of the limit, for what is tested piece by piece: many flat collapses may follow
SAMPLED = 0.94  # of the limit, for samples: between them the distance may be larger
ON_SIDE = 1e-9  # of a face: a grid edge that runs through its side crosses it
NEAR = 0.25  # of the squared limit: near enough for a sample to stay


class Bound(NamedTuple):
    """Samples and the distance they may have.

    sample    (S, 3) places                       first  (F,) first sample of each face, -1 without
    following (S,) next sample of the same face   goes   (S,) scratch: the ring face each sample would go to
    reach     (F,) how far at most any point of a face is from the grid's surface
    limit     (1,) largest distance allowed; not positive when nothing is bounded
    stack     (40, 9) scratch: triangles still to be judged
    guard     (G, 3) of the first samples: axis of the grid edge, -1 without, and where along it both centres are
    """

    sample: Floats
    first: NDArray[np.int32]
    following: NDArray[np.int32]
    goes: NDArray[np.int32]
    reach: NDArray[np.float32]
    limit: Floats
    stack: Floats
    guard: Floats


def face_bound(vertices: Floats, faces: Ints, limit: float, *, guard: Floats | None = None) -> Bound:
    """Samples at the vertices, each on one of its faces, and in the middle of every face.

    guard  (V, 3) grid edges that the surface has to cross, see `Bound`
    """
    home = np.empty(len(vertices), dtype=np.int64)
    home[faces.ravel()] = np.repeat(np.arange(len(faces)), 3)
    samples = np.concatenate([vertices, vertices[faces].mean(axis=1)])
    bound = hanging_bound(samples, np.append(home, np.arange(len(faces))), len(faces), limit)
    return bound if guard is None else bound._replace(guard=guard)


def hanging_bound(samples: Floats, home: Ints, n_faces: int, limit: float, *, reach: float = 0.0) -> Bound:
    """Samples (S, 3), each on the face that `home` (S,) says; reach as in a Bound, the same for all faces."""
    order = np.argsort(home, kind="stable")
    ends = np.diff(home[order], append=-1) != 0
    begins = order[np.diff(home[order], prepend=-1) != 0]
    following = np.full(len(samples), -1, dtype=np.int32)
    following[order[:-1]] = np.where(ends[:-1], -1, order[1:])
    first = np.full(n_faces, -1, dtype=np.int32)
    first[home[begins]] = begins
    return Bound(
        samples,
        first,
        following,
        np.zeros(len(samples), dtype=np.int32),
        np.full(n_faces, reach, dtype=np.float32),
        np.array([limit]),
        np.empty((40, 9)),
        np.zeros((0, 3)),
    )


def no_bound() -> Bound:
    """Nothing is bounded."""
    none = np.zeros(0, dtype=np.int32)
    return Bound(
        np.zeros((0, 3)),
        none,
        none.copy(),
        none.copy(),
        np.zeros(0, dtype=np.float32),
        np.array([-1.0]),
        np.empty((40, 9)),
        np.zeros((0, 3)),
    )


@njit(cache=True, inline="always")
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
    v: int,
    before: Floats,
) -> bool:  # pragma: no cover - compiled
    """Whether the ring keeps both bounds; notes where each sample would go.

    u, v  the vertices that become one; u is in its new place already, `before` is where it was
    """
    limit = bound.limit[0]
    if not limit > 0.0:
        return True
    reach = max(bound.reach[gone], bound.reach[lost])
    for r in range(n_ring):
        reach = max(reach, bound.reach[ring[r] // 3])
    reach += _thickness(corner, place, ring, n_ring, u, v, before)
    follows = reach <= limit
    if not follows and nearest_within(look, place[u, 0], place[u, 1], place[u, 2], limit)[0] > limit * limit:
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
                    if d <= NEAR * limit * limit:
                        break
            if best > SAMPLED * SAMPLED * limit * limit:
                return False
            if s < len(bound.guard) and bound.guard[s, 0] >= 0.0:
                at = _crossed(bound, s, corner, place, ring, n_ring, u)
                if at < 0:
                    return False
            bound.goes[s] = at
            s = bound.following[s]
    tested = TESTED * limit
    bound.reach[gone] = bound.reach[lost] = reach if follows else tested
    for r in range(n_ring):
        h = ring[r]
        b, c = corner[_next(h)], corner[_next(_next(h))]
        if not follows and not face_within(look, place, u, b, c, bound.stack, tested):
            return False
    return True


@njit(cache=True)
def _crossed(
    bound: Bound, s: int, corner: NDArray[np.int32], place: Floats, ring: NDArray[np.int32], n_ring: int, u: int
) -> int:  # pragma: no cover - compiled
    """The ring face that the grid edge of a sample crosses, -1 when it crosses none."""
    axis = int(bound.guard[s, 0])
    i, j = (axis + 1) % 3, (axis + 2) % 3
    x, y = bound.sample[s, i], bound.sample[s, j]
    for k in range(n_ring):
        b, c = corner[_next(ring[k])], corner[_next(_next(ring[k]))]
        ax, ay = place[u, i] - x, place[u, j] - y
        bx, by = place[b, i] - x, place[b, j] - y
        cx, cy = place[c, i] - x, place[c, j] - y
        wa, wb, wc = bx * cy - by * cx, cx * ay - cy * ax, ax * by - ay * bx
        total = wa + wb + wc
        if total == 0.0 or min(wa / total, min(wb / total, wc / total)) < -ON_SIDE:
            continue
        height = (wa * place[u, axis] + wb * place[b, axis] + wc * place[c, axis]) / total
        if bound.guard[s, 1] <= height <= bound.guard[s, 2]:
            return k
    return -1


@njit(cache=True)
def _thickness(
    corner: NDArray[np.int32], place: Floats, ring: NDArray[np.int32], n_ring: int, u: int, v: int, before: Floats
) -> float:  # pragma: no cover - compiled
    """Thickness of the layer in which the patch lies before and after; infinite where that bounds nothing.

    Both patches have the same border.  When all new faces look to one side of a plane, the new patch has one point
    over every point within the border's shadow, the old patch at least one, and the two are in the same layer.
    """
    nx, ny, nz = 0.0, 0.0, 0.0
    for r in range(n_ring):
        ax, ay, az = _area(corner, place, ring[r], u)
        nx, ny, nz = nx + ax, ny + ay, nz + az
    size = np.sqrt(nx * nx + ny * ny + nz * nz)
    if not size > 0.0:
        return np.inf
    nx, ny, nz = nx / size, ny / size, nz / size
    low = nx * before[0] + ny * before[1] + nz * before[2]
    high = low
    for w in (u, v):
        t = nx * place[w, 0] + ny * place[w, 1] + nz * place[w, 2]
        low, high = min(low, t), max(high, t)
    for r in range(n_ring):
        ax, ay, az = _area(corner, place, ring[r], u)
        if not nx * ax + ny * ay + nz * az > 0.0:
            return np.inf
        w = corner[_next(ring[r])]
        t = nx * place[w, 0] + ny * place[w, 1] + nz * place[w, 2]
        low, high = min(low, t), max(high, t)
    return high - low


@njit(cache=True, inline="always")
def _area(
    corner: NDArray[np.int32], place: Floats, h: int, u: int
) -> tuple[float, float, float]:  # pragma: no cover - compiled
    """Twice the area vector of the face that a halfedge leads into, u in place of its start."""
    b, c = corner[_next(h)], corner[_next(_next(h))]
    bx, by, bz = place[b, 0] - place[u, 0], place[b, 1] - place[u, 1], place[b, 2] - place[u, 2]
    cx, cy, cz = place[c, 0] - place[u, 0], place[c, 1] - place[u, 1], place[c, 2] - place[u, 2]
    return by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx


@njit(cache=True)
def hand_over(
    bound: Bound, ring: NDArray[np.int32], n_ring: int, gone: int, lost: int
) -> None:  # pragma: no cover - compiled
    """Hang the ring's samples where `keeps_bound` found them to go."""
    if not bound.limit[0] > 0.0:
        return
    for r in range(n_ring):
        bound.reach[ring[r] // 3] = bound.reach[gone]
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
        chain = following


@njit(cache=True)
def face_within(
    look: CellLookup, place: Floats, a: int, b: int, c: int, stack: Floats, limit: float
) -> bool:  # pragma: no cover - compiled
    """Whether no point of a triangle is farther than the limit from the grid's surface; False where that stays open."""
    for i in range(3):
        stack[0, i], stack[0, 3 + i], stack[0, 6 + i] = place[a, i], place[b, i], place[c, i]
    square = limit * limit
    depth = 1
    while depth > 0:
        depth -= 1
        ax, ay, az = stack[depth, 0], stack[depth, 1], stack[depth, 2]
        bx, by, bz = stack[depth, 3], stack[depth, 4], stack[depth, 5]
        cx, cy, cz = stack[depth, 6], stack[depth, 7], stack[depth, 8]
        x, y, z = (ax + bx + cx) / 3.0, (ay + by + cy) / 3.0, (az + bz + cz) / 3.0
        d, t = nearest_in_cell(look, x, y, z, 2.0 * square)
        if d > square:
            d, t = nearest_within(look, x, y, z, limit)
            if d > square:
                return False
        ab = (ax - bx) ** 2 + (ay - by) ** 2 + (az - bz) ** 2
        bc = (bx - cx) ** 2 + (by - cy) ** 2 + (bz - cz) ** 2
        ca = (cx - ax) ** 2 + (cy - ay) ** 2 + (cz - az) ** 2
        longest = max(ab, max(bc, ca))
        if longest < ONE_FACE and _all_within(look, t, square, ax, ay, az, bx, by, bz, cx, cy, cz):
            continue
        if longest < SMALLEST * square or depth > 36:
            return False
        if bc >= ab and bc >= ca:
            ax, ay, az, bx, by, bz, cx, cy, cz = bx, by, bz, cx, cy, cz, ax, ay, az
        elif ca >= ab:
            ax, ay, az, bx, by, bz, cx, cy, cz = cx, cy, cz, ax, ay, az, bx, by, bz
        mx, my, mz = 0.5 * (ax + bx), 0.5 * (ay + by), 0.5 * (az + bz)
        _put(stack, depth, ax, ay, az, mx, my, mz, cx, cy, cz)
        _put(stack, depth + 1, mx, my, mz, bx, by, bz, cx, cy, cz)
        depth += 2
    return True


@njit(cache=True, inline="always")
def _all_within(look, t, square, ax, ay, az, bx, by, bz, cx, cy, cz):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Whether three points are near enough to one triangle: then all between them are, for it is convex."""
    return (
        triangle_squared(look, t, ax, ay, az) <= square
        and triangle_squared(look, t, bx, by, bz) <= square
        and triangle_squared(look, t, cx, cy, cz) <= square
    )


@njit(cache=True, inline="always")
def _put(stack, row, ax, ay, az, bx, by, bz, cx, cy, cz):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    stack[row, 0], stack[row, 1], stack[row, 2] = ax, ay, az
    stack[row, 3], stack[row, 4], stack[row, 5] = bx, by, bz
    stack[row, 6], stack[row, 7], stack[row, 8] = cx, cy, cz

"""Weights of the control points of a patch at a place in it: compiled loops over many places.

A place is (patch, v, w). In a triangle u = 1 - v - w, v, w are barycentric; a quadrilateral is the unit square with
its corners 0 to 3 at (0, 0), (1, 0), (1, 1), (0, 1). In a regular patch the weights are polynomials: quartic Bernstein
polynomials times one table in a triangle, a product of uniform B-splines in a quadrilateral. In an irregular one the
place lies in one of three sub-patches of a copy of the patch, halved `level` times toward corner 0 (`limit_tables`):

    triangle        sub 0  at corner 1   (v', w') = (2 w, 2 u)          sub 2  in the middle   (1 - 2 u, 1 - 2 v)
                    sub 1  at corner 2   (v', w') = (2 u, 2 v)
    quadrilateral   sub 0  at corner 1   (v', w') = (2 v - 1, 2 w)      sub 2  at corner 3     (2 v, 2 w - 1)
                    sub 1  at corner 2   (v', w') = (2 v - 1, 2 w - 1)

Orders of derivatives: rows 0 value, 1 and 2 by v and w, 3, 4 and 5 by vv, vw and ww.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.subdivision.limit_tables import N_LEVELS

__all__ = [
    "MAX_SUPPORT",
    "N_BASIS",
    "NetCache",
    "PatchArrays",
    "net_cache",
    "patch_frame",
    "patch_weights",
    "points_at",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

MAX_SUPPORT = 80  # points a patch may depend on
N_BASIS = 16  # room for the polynomials of a patch: 15 quartic, 16 bicubic, 9 bi-quadratic


N_SLOTS = 128  # control nets at hand: those of a patch and of its neighbours; more would leave the nearest cache
NETS_A_PATCH = 3 * N_LEVELS + 1  # one of a regular patch; three a level of an irregular one


class PatchArrays(NamedTuple):
    """The patches of a limit surface, flat, for compiled code.

    support_starts  (C + 1,) where the row of each patch begins in `support`
    support         (S,) numbers of the points it depends on
    tables          (C,) number of its table; -1 for a regular patch
    across          (C, k) the side across each side, k patch + side; -1 on a border; k = 3 or 4 corners a patch
    regular         (B, R) points of its basis over the R points of a regular patch; the unit matrix where k = 4
    table_starts    (T,) where each table begins in `weights`
    weights         limit (K), tangents (2 K), levels (N_LEVELS 3 B K), table after table
    """

    support_starts: Ints
    support: Ints
    tables: Ints
    across: Ints
    regular: Floats
    table_starts: Ints
    weights: Floats


@njit(cache=True)
def _quartics(v: float, w: float, n_rows: int, out: Floats) -> None:
    """Quartic Bernstein polynomials into out (n_rows, 15); n_rows 1, 3 or 6."""
    u = 1.0 - v - w
    u2, v2, w2 = u * u, v * v, w * w
    u3, v3, w3 = u2 * u, v2 * v, w2 * w
    uv, uw, vw = u * v, u * w, v * w
    # order (i j k) of u^i v^j w^k: 400 310 220 130 040 | 301 211 121 031 | 202 112 022 | 103 013 | 004
    b = out[0]
    b[0], b[1], b[2], b[3], b[4] = u2 * u2, 4 * u3 * v, 6 * u2 * v2, 4 * u * v3, v2 * v2
    b[5], b[6], b[7], b[8] = 4 * u3 * w, 12 * u2 * vw, 12 * u * v2 * w, 4 * v3 * w
    b[9], b[10], b[11] = 6 * u2 * w2, 12 * uv * w2, 6 * v2 * w2
    b[12], b[13], b[14] = 4 * u * w3, 4 * v * w3, w2 * w2
    if n_rows == 1:
        return
    b = out[1]
    b[0], b[1], b[2], b[3], b[4] = (
        -4 * u3,
        4 * u3 - 12 * u2 * v,
        12 * u2 * v - 12 * u * v2,
        12 * u * v2 - 4 * v3,
        4 * v3,
    )
    b[5], b[6], b[7], b[8] = -12 * u2 * w, 12 * u2 * w - 24 * uv * w, 24 * uv * w - 12 * v2 * w, 12 * v2 * w
    b[9], b[10], b[11] = -12 * u * w2, 12 * u * w2 - 12 * v * w2, 12 * v * w2
    b[12], b[13], b[14] = -4 * w3, 4 * w3, 0.0
    b = out[2]
    b[0], b[1], b[2], b[3], b[4] = -4 * u3, -12 * u2 * v, -12 * u * v2, -4 * v3, 0.0
    b[5], b[6], b[7], b[8] = 4 * u3 - 12 * u2 * w, 12 * u2 * v - 24 * uv * w, 12 * u * v2 - 12 * v2 * w, 4 * v3
    b[9], b[10], b[11] = 12 * u2 * w - 12 * u * w2, 24 * uv * w - 12 * v * w2, 12 * v2 * w
    b[12], b[13], b[14] = 12 * u * w2 - 4 * w3, 12 * v * w2, 4 * w3
    if n_rows == 3:
        return
    b = out[3]
    b[0], b[1], b[2], b[3], b[4] = 12 * u2, 24 * uv - 24 * u2, 12 * u2 - 48 * uv + 12 * v2, 24 * uv - 24 * v2, 12 * v2
    b[5], b[6], b[7], b[8] = 24 * uw, 24 * vw - 48 * uw, 24 * uw - 48 * vw, 24 * vw
    b[9], b[10], b[11] = 12 * w2, -24 * w2, 12 * w2
    b[12], b[13], b[14] = 0.0, 0.0, 0.0
    b = out[4]
    b[0], b[1], b[2], b[3], b[4] = 12 * u2, 24 * uv - 12 * u2, 12 * v2 - 24 * uv, -12 * v2, 0.0
    b[5], b[6] = 24 * uw - 12 * u2, 12 * u2 - 24 * uv - 24 * uw + 24 * vw
    b[7], b[8] = 24 * uv - 12 * v2 - 24 * vw, 12 * v2
    b[9], b[10], b[11] = 12 * w2 - 24 * uw, 24 * uw - 12 * w2 - 24 * vw, 24 * vw
    b[12], b[13], b[14] = -12 * w2, 12 * w2, 0.0
    b = out[5]
    b[0], b[1], b[2], b[3], b[4] = 12 * u2, 24 * uv, 12 * v2, 0.0, 0.0
    b[5], b[6], b[7], b[8] = 24 * uw - 24 * u2, 24 * vw - 48 * uv, -24 * v2, 0.0
    b[9], b[10], b[11] = 12 * u2 - 48 * uw + 12 * w2, 24 * uv - 48 * vw, 12 * v2
    b[12], b[13], b[14] = 24 * uw - 24 * w2, 24 * vw, 12 * w2


@njit(cache=True)
def _turn_triangle(sub: int, scale: float, n_rows: int, b: Floats) -> None:
    """Derivatives by (v', w') into derivatives by (v, w), in place; scale is 2^(level + 1)."""
    if n_rows == 1:
        return
    for i in range(15):
        p, q = b[1, i], b[2, i]
        if sub == 0:
            b[1, i], b[2, i] = -scale * q, scale * (p - q)
        elif sub == 1:
            b[1, i], b[2, i] = scale * (q - p), -scale * p
        else:
            b[1, i], b[2, i] = scale * (p - q), scale * p
        if n_rows == 6:
            pp, pq, qq = b[3, i], b[4, i], b[5, i]
            square = scale * scale
            if sub == 0:
                b[3, i], b[4, i], b[5, i] = square * qq, square * (qq - pq), square * (pp - 2 * pq + qq)
            elif sub == 1:
                b[3, i], b[4, i], b[5, i] = square * (qq - 2 * pq + pp), square * (pp - pq), square * pp
            else:
                b[3, i], b[4, i], b[5, i] = square * (pp - 2 * pq + qq), square * (pp - pq), square * pp


@njit(cache=True)
def _uniform(t: float, degree: int, b: Floats) -> None:
    """Uniform B-splines of degree 2 or 3 on one span into b (3, 4): values, first and second derivatives."""
    s = 1.0 - t
    if degree == 2:
        b[0, 0], b[0, 1], b[0, 2] = 0.5 * s * s, 0.5 + s * t, 0.5 * t * t
        b[1, 0], b[1, 1], b[1, 2] = -s, s - t, t
        b[2, 0], b[2, 1], b[2, 2] = 1.0, -2.0, 1.0
        return
    b[0, 0], b[0, 3] = s * s * s / 6.0, t * t * t / 6.0
    b[0, 1], b[0, 2] = 2.0 / 3.0 - t * t + 0.5 * t * t * t, 2.0 / 3.0 - s * s + 0.5 * s * s * s
    b[1, 0], b[1, 1], b[1, 2], b[1, 3] = -0.5 * s * s, 1.5 * t * t - 2.0 * t, 2.0 * s - 1.5 * s * s, 0.5 * t * t
    b[2, 0], b[2, 1], b[2, 2], b[2, 3] = s, 3.0 * t - 2.0, 3.0 * s - 2.0, t


@njit(cache=True)
def _products(v: float, w: float, n_rows: int, degree: int, scale: float, out: Floats) -> None:
    """Products of uniform B-splines into out (n_rows, (degree + 1)^2), v running fastest; scale of the derivatives."""
    a, b = np.empty((3, 4)), np.empty((3, 4))
    _uniform(v, degree, a)
    _uniform(w, degree, b)
    n = degree + 1
    for j in range(n):
        for i in range(n):
            at = j * n + i
            out[0, at] = a[0, i] * b[0, j]
            if n_rows > 1:
                out[1, at] = scale * a[1, i] * b[0, j]
                out[2, at] = scale * a[0, i] * b[1, j]
            if n_rows > 3:
                out[3, at] = scale * scale * a[2, i] * b[0, j]
                out[4, at] = scale * scale * a[1, i] * b[1, j]
                out[5, at] = scale * scale * a[0, i] * b[2, j]


@njit(cache=True)
def _regular_weights(regular: Floats, triangle: bool, v: float, w: float, n_rows: int, b: Floats, out: Floats) -> None:
    n_basis, size = regular.shape
    if not triangle:
        _products(v, w, n_rows, 3 if size == 16 else 2, 1.0, out)
        return
    _quartics(v, w, n_rows, b)
    for r in range(n_rows):
        for j in range(size):
            out[r, j] = 0.0
        for i in range(n_basis):
            x = b[r, i]
            for j in range(size):
                out[r, j] += x * regular[i, j]


@njit(cache=True)
def _near_corner(triangle: bool, v: float, w: float) -> bool:
    """Whether the place is in the copy of the patch at corner 0, half as large."""
    return v + w <= 0.5 if triangle else max(v, w) < 0.5


@njit(cache=True)
def _sub_patch(patches: PatchArrays, v: float, w: float, n_rows: int, scale: float, b: Floats) -> int:
    """The sub-patch away from corner 0 in which the place lies; its polynomials, derivatives by (v, w), into b."""
    if patches.across.shape[1] == 4:
        right, upper = v >= 0.5, w >= 0.5
        degree = 3 if len(patches.regular) == 16 else 2
        _products(2.0 * v - right, 2.0 * w - upper, n_rows, degree, scale, b)
        return 2 if not right else (1 if upper else 0)
    u = 1.0 - v - w
    if v >= 0.5:
        sub, a, c = 0, 2.0 * w, 2.0 * u
    elif w >= 0.5:
        sub, a, c = 1, 2.0 * u, 2.0 * v
    else:
        sub, a, c = 2, 1.0 - 2.0 * u, 1.0 - 2.0 * v
    _quartics(a, c, n_rows, b)
    _turn_triangle(sub, scale, n_rows, b)
    return sub


@njit(cache=True)
def patch_weights(patches: PatchArrays, patch: int, v: float, w: float, n_rows: int, b: Floats, out: Floats) -> int:
    """Weights of the support of a patch into out (n_rows, MAX_SUPPORT); b (6, N_BASIS) is room to work.

    Returns the support's size.

    At an irregular corner the first derivatives are the tangents of the limit, and the second are not numbers.
    """
    size = patches.support_starts[patch + 1] - patches.support_starts[patch]
    table = patches.tables[patch]
    triangle = patches.across.shape[1] == 3
    if table < 0:
        _regular_weights(patches.regular, triangle, v, w, n_rows, b, out)
        return size
    start = patches.table_starts[table]
    level, scale = 0, 2.0
    while _near_corner(triangle, v, w) and level < N_LEVELS:
        v, w, level, scale = 2.0 * v, 2.0 * w, level + 1, 2.0 * scale
    if level == N_LEVELS:
        for j in range(size):
            out[0, j] = patches.weights[start + j]
            for r in range(1, n_rows):
                out[r, j] = patches.weights[start + r * size + j] if r < 3 else np.nan
        return size
    sub = _sub_patch(patches, v, w, n_rows, scale, b)
    n_basis = len(patches.regular)
    at = start + 3 * size + (level * 3 + sub) * n_basis * size
    rows = patches.weights[at : at + n_basis * size]
    for r in range(n_rows):
        for j in range(size):
            out[r, j] = patches.weights[start + j] if r == 0 else 0.0
        for i in range(n_basis):
            x = b[r, i]
            for j in range(size):
                out[r, j] += x * rows[i * size + j]
    return size


@njit(cache=True)
def points_at(patches: PatchArrays, points: Floats, patch: Ints, v: Floats, w: Floats, n_rows: int) -> Floats:
    """(n, n_rows, 3) position and derivatives at n places; n_rows 1, 3 or 6; points (R, 3) of the refined mesh."""
    out = np.zeros((len(patch), n_rows, 3))
    b = np.empty((6, N_BASIS))
    weights = np.empty((6, MAX_SUPPORT))
    for i in range(len(patch)):
        size = patch_weights(patches, patch[i], v[i], w[i], n_rows, b, weights)
        first = patches.support_starts[patch[i]]
        for j in range(size):
            p = patches.support[first + j]
            for r in range(n_rows):
                for k in range(3):
                    out[i, r, k] += weights[r, j] * points[p, k]
    return out


class NetCache(NamedTuple):
    """Control nets of the polynomials that were asked for last, as many walks stay where they are.

    keys  (N_SLOTS,) which polynomial is in each slot, -1 for none
    nets  (N_SLOTS, N_BASIS + 1, 3) its control points less an origin, and the origin
    """

    keys: Ints
    nets: Floats


def net_cache() -> NetCache:
    """An empty one; it holds for one set of points."""
    return NetCache(np.full(N_SLOTS, -1), np.empty((N_SLOTS, N_BASIS + 1, 3)))


@njit(cache=True)
def _fill_net(patches: PatchArrays, points: Floats, patch: int, at: int, net: Floats) -> None:
    """The control points of a patch, or of the sub-patch whose rows begin in the tables at `at`, into net.

    These are differences from the limit of corner 0: near to it, nothing else would be left of them.
    """
    first = patches.support_starts[patch]
    size = patches.support_starts[patch + 1] - first
    n_basis = len(patches.regular)
    start = patches.table_starts[patches.tables[patch]]
    for i in range(n_basis + 1):
        x, y, z = 0.0, 0.0, 0.0
        for j in range(size):
            p = patches.support[first + j]
            if i == n_basis:
                a = 0.0 if at < 0 else patches.weights[start + j]
            else:
                a = patches.regular[i, j] if at < 0 else patches.weights[at + i * size + j]
            x += a * points[p, 0]
            y += a * points[p, 1]
            z += a * points[p, 2]
        net[i, 0], net[i, 1], net[i, 2] = x, y, z


@njit(cache=True)
def patch_frame(
    patches: PatchArrays, points: Floats, patch: int, v: float, w: float, cache: NetCache, b: Floats, out: Floats
) -> None:
    """Point and first derivatives of a patch into out (3, 3); b (6, N_BASIS) is room to work.

    At an irregular corner the derivatives are the tangents of the limit.
    """
    table, triangle = patches.tables[patch], patches.across.shape[1] == 3
    n_basis = len(patches.regular)
    at, key = -1, patch * NETS_A_PATCH
    if table < 0:
        if triangle:
            _quartics(v, w, 3, b)
        else:
            _products(v, w, 3, 3 if n_basis == 16 else 2, 1.0, b)
    else:
        level, scale = 0, 2.0
        while _near_corner(triangle, v, w) and level < N_LEVELS:
            v, w, level, scale = 2.0 * v, 2.0 * w, level + 1, 2.0 * scale
        size = patches.support_starts[patch + 1] - patches.support_starts[patch]
        start = patches.table_starts[table]
        if level == N_LEVELS:
            _corner_frame(patches, points, patch, start, out)
            return
        sub = level * 3 + _sub_patch(patches, v, w, 3, scale, b)
        at, key = start + 3 * size + sub * n_basis * size, key + sub
    slot = key % N_SLOTS
    if cache.keys[slot] != key:
        _fill_net(patches, points, patch, at, cache.nets[slot])
        cache.keys[slot] = key
    nets = cache.nets
    for r in range(3):
        x, y, z = 0.0, 0.0, 0.0
        for i in range(n_basis):
            a = b[r, i]
            x += a * nets[slot, i, 0]
            y += a * nets[slot, i, 1]
            z += a * nets[slot, i, 2]
        out[r, 0], out[r, 1], out[r, 2] = x, y, z
    for axis in range(3):
        out[0, axis] += nets[slot, n_basis, axis]


@njit(cache=True)
def _corner_frame(patches: PatchArrays, points: Floats, patch: int, start: int, out: Floats) -> None:
    """Limit point and tangents at corner 0 of an irregular patch, whose table begins at `start`, into out (3, 3)."""
    first = patches.support_starts[patch]
    size = patches.support_starts[patch + 1] - first
    for r in range(3):
        for axis in range(3):
            out[r, axis] = 0.0
            for j in range(size):
                out[r, axis] += patches.weights[start + r * size + j] * points[patches.support[first + j], axis]

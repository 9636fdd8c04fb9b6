"""Stretches of straight lines along which no other line runs, near enough to be the same.

one     a------------------b
others  ~~~~~~~~    ~~~~~~~~         the stretch of `one` that is too far from every line of the others is a lone one
                ^^^^
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["SAME", "cut_beside", "lone_stretches"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SAME = 3.0  # snaps between lines that may be the same: the ends of both have moved


def lone_stretches(one: Floats, others: Floats, tolerance: float) -> tuple[Ints, Floats]:
    """Stretches of lines, longer than the tolerance, that are further than the tolerance from all other lines.

    one, others  (n, 2, 2) and (m, 2, 2) ends
    Returns      line of `one` (k,) and ends (k, 2, 2) of each stretch
    """
    order = np.argsort(others[:, :, 0].min(axis=1))
    boxed = others[order].reshape(-1, 4)
    left, right = others[order, :, 0].min(axis=1), others[order, :, 0].max(axis=1)
    # how far left one has to go back in the order to meet every line that still reaches a place
    widest = np.maximum.accumulate(right) if len(right) else right
    number, ends = _lone(np.ascontiguousarray(one.reshape(-1, 4)), boxed, (left, widest), tolerance)
    return number, ends.reshape(-1, 2, 2)


def cut_beside(lines: Floats, points: Floats, reach: float) -> Floats:
    """Lines (n, 2, 2) in pieces (k, 2, 2), cut where points (p, 2) lie beside them, no further than `reach` away."""
    sorted_points = points[np.argsort(points[:, 0])]
    return _cut(np.ascontiguousarray(lines.reshape(-1, 4)), sorted_points, reach).reshape(-1, 2, 2)


@njit(cache=True)
def _lone(
    one: Floats, others: Floats, sweep: tuple[Floats, Floats], tolerance: float
) -> tuple[Ints, Floats]:  # pragma: no cover - compiled
    left, widest = sweep
    number, rows = [0 for _ in range(0)], [np.zeros(4) for _ in range(0)]
    low, high = np.empty(len(others)), np.empty(len(others))
    for i in range(len(one)):
        a, b = one[i, :2], one[i, 2:]
        size = np.hypot(b[0] - a[0], b[1] - a[1])
        if size <= tolerance:
            continue
        first = np.searchsorted(widest, min(a[0], b[0]) - tolerance)
        last = np.searchsorted(left, max(a[0], b[0]) + tolerance)
        n = 0
        for j in range(first, last):
            if max(others[j, 1], others[j, 3]) < min(a[1], b[1]) - tolerance:
                continue
            if min(others[j, 1], others[j, 3]) > max(a[1], b[1]) + tolerance:
                continue
            low[n], high[n] = _beside(a, b, others[j], tolerance)
            if low[n] < high[n]:
                n += 1
        order = np.argsort(low[:n])
        done = 0.0
        for k in range(n + 1):
            at = low[order[k]] if k < n else 1.0
            if (at - done) * size > tolerance:
                number.append(i)
                rows.append(np.append(a + done * (b - a), a + at * (b - a)))
            if k < n:
                done = max(done, high[order[k]])
    ends = np.empty((len(rows), 4))
    for k in range(len(rows)):
        ends[k] = rows[k]
    return np.array(number, dtype=np.int64), ends


@njit(cache=True)
def _beside(
    a: Floats, b: Floats, other: Floats, tolerance: float
) -> tuple[float, float]:  # pragma: no cover - compiled
    """Shares of the line from a to b between which it lies in the box, one tolerance wide, around another line."""
    wx, wy = other[2] - other[0], other[3] - other[1]
    length = np.hypot(wx, wy)
    if length == 0:
        return 1.0, 0.0
    wx, wy = wx / length, wy / length
    low, high = 0.0, 1.0
    for along in (True, False):
        nx, ny = (wx, wy) if along else (-wy, wx)
        start = (a[0] - other[0]) * nx + (a[1] - other[1]) * ny
        grow = (b[0] - a[0]) * nx + (b[1] - a[1]) * ny
        least, most = -tolerance, (length + tolerance) if along else tolerance
        if abs(grow) < 1e-300:
            if not least <= start <= most:
                return 1.0, 0.0
            continue
        enter, leave = (least - start) / grow, (most - start) / grow
        low, high = max(low, min(enter, leave)), min(high, max(enter, leave))
    return low, high


@njit(cache=True)
def _cut(lines: Floats, points: Floats, reach: float) -> Floats:  # pragma: no cover - compiled
    pieces = [np.zeros(4) for _ in range(0)]
    along = np.empty(len(points) + 2)
    for i in range(len(lines)):
        x, y = lines[i, 0], lines[i, 1]
        wx, wy = lines[i, 2] - x, lines[i, 3] - y
        size = np.hypot(wx, wy)
        along[0], n = 0.0, 1
        first = np.searchsorted(points[:, 0], min(x, x + wx) - reach)
        last = np.searchsorted(points[:, 0], max(x, x + wx) + reach)
        for k in range(first, last):
            gx, gy = points[k, 0] - x, points[k, 1] - y
            at = (gx * wx + gy * wy) / size
            if reach < at < size - reach and abs(gx * wy - gy * wx) <= reach * size:
                along[n] = at / size
                n += 1
        along[n] = 1.0
        shares = np.sort(along[: n + 1])
        start = 0.0
        for share in shares[1:]:
            # points beside each other cut once
            if share == 1.0 or (share - start) * size > reach:
                pieces.append(np.array([x + start * wx, y + start * wy, x + share * wx, y + share * wy]))
                start = share
    made = np.empty((len(pieces), 4))
    for k in range(len(pieces)):
        made[k] = pieces[k]
    return made

"""A cubic smoothing spline along a row of points in the plane, open or closed, its knots where the points need them.

    minimise  sum w_i |c(s_i) - p_i|^2 + sum (stiffness * h_j)^4 integral over [t_j, t_j+1] of |c''|^2 ds

    t_0 ... t_n       knots; three more on either side make them `padded`, so that t_j is padded[j + 3]
    h_j               width of the span from t_j to t_j+1
    c_j ... c_j+3     coefficients of span j, counted round on a ring
    ends              first and second derivative of an open spline at its first and last point, where they are given

The normal equations have three diagonals beside the main one, and three unknowns more that close a ring: a Cholesky
factor of the band, with those three as its border, costs a fixed time a knot.

Paper  [deboor1978], chapters X and XIV.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.numerics.narrow_bands import solved_open, solved_ring

__all__ = ["FREE_ENDS", "bezier_segments", "fitted_coefficients", "fitted_knots", "worst_misses"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

GRADING = 2.001  # times the width of its neighbours that a span may have
WAY = 0.4  # of the way to its neighbours that a parameter moves in a step at most
MOST_ROUNDS = 14
FREE_ENDS = np.full((2, 2, 2), np.nan)


@njit(cache=True)
def fitted_knots(
    rows: tuple[Floats, Floats, Floats, Floats, Bools],
    knots: Floats,
    ring: bool,
    stiffness: float,
    shortest: float,
    ends: Floats,
) -> tuple[Floats, Floats]:
    """Knots with spans halved until the spline misses no point by more than it may, and the points' new parameters.

    rows       (m, 2) points; (m,) length that each stands for, its parameter, how far the spline may stay from it,
               and whether its parameter is kept
    knots      (n + 1,) to begin with, six spans at least on a ring, three with given ends
    shortest   span that is halved, in what its points may miss
    ends       (2, 2, 2) as for `fitted_coefficients`
    """
    points, weight, parameter, allowed, fixed = rows
    s = parameter
    for _ in range(MOST_ROUNDS):
        padded = _padded(knots, ring)
        coefficients = fitted_coefficients(points, weight, s, knots, ring, np.full(len(knots) - 1, stiffness), ends)
        s, distance = _slid(points, s, fixed, padded, coefficients, ring)
        halved = _halved(knots, ring, _too_far(s, distance, allowed, padded, shortest))
        if len(halved) == len(knots):
            break
        knots = halved
    return knots, s


@njit(cache=True)
def fitted_coefficients(
    points: Floats, weight: Floats, parameter: Floats, knots: Floats, ring: bool, stiffness: Floats, ends: Floats
) -> Floats:
    """(k, 2) coefficients of the spline that fits best; those at the ends of an open one are its first and last point.

    stiffness  (n,) of every span, as a share of its width
    ends       (2, 2, 2) at the first and the last point the derivative of an open spline and its second one, NaN where
               they are free
    """
    padded = _padded(knots, ring)
    n = len(knots) - 1 if ring else len(knots) + 2
    band, right = np.zeros((n, 4)), np.zeros((n, 2))
    value = np.empty(4)
    a = 3
    for i in range(len(points)):
        a = _span_at(padded, a, parameter[i])
        _values(padded, a, parameter[i], value)
        for p in range(4):
            row = (a - 3 + p) % n
            share = weight[i] * value[p]
            right[row, 0] += share * points[i, 0]
            right[row, 1] += share * points[i, 1]
            for q in range(p, 4):
                band[row, q - p] += share * value[q]
    _stiffen(band, padded, stiffness)
    if ring:
        return solved_ring(band, right)
    return solved_open(band, right, _end_coefficients(points, padded, ends))


@njit(cache=True)
def worst_misses(
    points: Floats, parameter: Floats, fixed: Bools, knots: Floats, coefficients: Floats, ring: bool
) -> Floats:
    """(n,) the farthest that a point of each span lies from the spline, after one step toward its foot."""
    padded = _padded(knots, ring)
    s, distance = _slid(points, parameter, fixed, padded, coefficients, ring)
    worst = np.zeros(len(knots) - 1)
    a = 3
    for i in range(len(s)):
        a = _span_at(padded, a, s[i])
        worst[a - 3] = max(worst[a - 3], distance[i])
    return worst


@njit(cache=True)
def bezier_segments(knots: Floats, coefficients: Floats, ring: bool) -> Floats:
    """(n, 4, 2) Bezier control points of the spans; neighbours share their ends to the last bit."""
    padded = _padded(knots, ring)
    spans, n = len(knots) - 1, len(coefficients)
    out = np.empty((spans, 4, 2))
    value, slope = np.empty(4), np.empty(4)
    for j in range(spans):
        for end in range(2):
            s = padded[j + 3 + end]
            _values(padded, j + 3, s, value)
            _slopes(padded, j + 3, s, slope)
            third = (1 - 2 * end) * (padded[j + 4] - padded[j + 3]) / 3
            for c in range(2):
                point, way = 0.0, 0.0
                for k in range(4):
                    point += value[k] * coefficients[(j + k) % n, c]
                    way += slope[k] * coefficients[(j + k) % n, c]
                out[j, 3 * end, c] = point
                out[j, 1 + end, c] = point + third * way
    for c in range(2):
        if not ring:
            out[0, 0, c], out[spans - 1, 3, c] = coefficients[0, c], coefficients[n - 1, c]
        for j in range(1, spans):
            out[j, 0, c] = out[j - 1, 3, c]
        if ring:
            out[spans - 1, 3, c] = out[0, 0, c]
    return out


@njit(cache=True)
def _padded(knots: Floats, ring: bool) -> Floats:
    n = len(knots)
    out = np.empty(n + 6)
    for k in range(n):
        out[k + 3] = knots[k]
    for k in range(3):
        out[k] = knots[n - 4 + k] - knots[n - 1] if ring else knots[0]
        out[n + 3 + k] = knots[n - 1] + knots[1 + k] if ring else knots[n - 1]
    return out


@njit(cache=True)
def _span_at(padded: Floats, a: int, s: float) -> int:
    """Place of the knot at which the span of parameter s starts, from that of a parameter before it."""
    while a < len(padded) - 5 and padded[a + 1] <= s:
        a += 1
    return a


@njit(cache=True)
def _low_values(padded: Floats, a: int, s: float, degree: int, out: Floats) -> None:
    """The degree + 1 basis functions of the span that starts at padded[a], by the recursion of Cox and de Boor."""
    out[0] = 1.0
    for p in range(1, degree + 1):
        carried = 0.0
        for k in range(p):
            left, right = padded[a + 1 + k - p], padded[a + 1 + k]
            share = out[k] / (right - left)
            out[k] = carried + share * (right - s)
            carried = share * (s - left)
        out[p] = carried


@njit(cache=True)
def _derived(padded: Floats, a: int, p: int, out: Floats) -> None:
    """Basis functions of degree p - 1 replaced by the derivatives of those of degree p."""
    before = 0.0
    for k in range(p):
        slope = p * out[k] / (padded[a + 1 + k] - padded[a + 1 + k - p])
        out[k] = before - slope
        before = slope
    out[p] = before


@njit(cache=True)
def _values(padded: Floats, a: int, s: float, out: Floats) -> None:
    _low_values(padded, a, s, 3, out)


@njit(cache=True)
def _slopes(padded: Floats, a: int, s: float, out: Floats) -> None:
    _low_values(padded, a, s, 2, out)
    _derived(padded, a, 3, out)


@njit(cache=True)
def _bends(padded: Floats, a: int, s: float, out: Floats) -> None:
    _low_values(padded, a, s, 1, out)
    _derived(padded, a, 2, out)
    _derived(padded, a, 3, out)


@njit(cache=True)
def _stiffen(band: Floats, padded: Floats, stiffness: Floats) -> None:
    """Add the bending term: the second derivative is linear on a span, so two Gauss points integrate its square."""
    bend = np.empty(4)
    for j in range(len(stiffness)):
        low, width = padded[j + 3], padded[j + 4] - padded[j + 3]
        for place in (0.5 - np.sqrt(1 / 12), 0.5 + np.sqrt(1 / 12)):
            _bends(padded, j + 3, low + place * width, bend)
            for p in range(4):
                share = (stiffness[j] * width) ** 4 * width / 2 * bend[p]
                for q in range(p, 4):
                    band[(j + p) % len(band), q - p] += share * bend[q]


@njit(cache=True)
def _end_coefficients(points: Floats, padded: Floats, ends: Floats) -> Floats:
    """(2, 3, 2) the three coefficients at either end, counted from there; NaN where they are not told."""
    out = np.full((2, 3, 2), np.nan)
    for end in range(2):
        way = 1.0 - 2.0 * end
        k = 3 if end == 0 else len(padded) - 5
        near = padded[k + 1] - padded[k]
        next_one = padded[k + 2] - padded[k + 1] if end == 0 else padded[k] - padded[k - 1]
        for c in range(2):
            slope, bend = way * ends[end, 0, c], ends[end, 1, c]
            out[end, 0, c] = points[0 if end == 0 else len(points) - 1, c]
            out[end, 1, c] = out[end, 0, c] + near / 3 * slope
            out[end, 2, c] = out[end, 1, c] + (near + next_one) / 3 * (slope + near / 2 * bend)
    return out


@njit(cache=True)
def _slid(
    points: Floats, parameter: Floats, fixed: Bools, padded: Floats, coefficients: Floats, ring: bool
) -> tuple[Floats, Floats]:
    """Parameters one Gauss-Newton step nearer to the feet of their points, in their order, and the distances there."""
    n, m = len(coefficients), len(points)
    moved, distance = parameter.copy(), np.empty(m)
    value, slope = np.empty(4), np.empty(4)
    a = 3
    for i in range(m):
        a = _span_at(padded, a, parameter[i])
        _values(padded, a, parameter[i], value)
        _slopes(padded, a, parameter[i], slope)
        mx, my, vx, vy = points[i, 0], points[i, 1], 0.0, 0.0
        for k in range(4):
            cx, cy = coefficients[(a - 3 + k) % n, 0], coefficients[(a - 3 + k) % n, 1]
            mx -= value[k] * cx
            my -= value[k] * cy
            vx += slope[k] * cx
            vy += slope[k] * cy
        step = 0.0
        if 0 < i < m - 1 and not fixed[i]:
            room = WAY * max(min(parameter[i] - parameter[i - 1], parameter[i + 1] - parameter[i]), 0.0)
            step = min(max((mx * vx + my * vy) / max(vx * vx + vy * vy, 1e-12), -room), room)
        moved[i] += step
        distance[i] = np.hypot(mx - step * vx, my - step * vy)
    return moved, distance


@njit(cache=True)
def _too_far(parameter: Floats, distance: Floats, allowed: Floats, padded: Floats, shortest: float) -> Bools:
    """(n,) spans with a point that is missed by more than allowed, and that are not too short already."""
    spans = len(padded) - 7
    worst, finest = np.zeros(spans), np.full(spans, np.inf)
    chosen = np.empty(spans, dtype=np.bool_)
    a = 3
    for i in range(len(parameter)):
        a = _span_at(padded, a, parameter[i])
        worst[a - 3] = max(worst[a - 3], distance[i] / allowed[i])
        finest[a - 3] = min(finest[a - 3], allowed[i])
    for j in range(spans):
        chosen[j] = worst[j] > 1.0 and padded[j + 4] - padded[j + 3] > shortest * finest[j]
    return chosen


@njit(cache=True)
def _halved(knots: Floats, ring: bool, chosen: Bools) -> Floats:
    """Knots with the chosen spans halved, then those more than twice as wide as a neighbour."""
    n_new = chosen.sum()
    while n_new:
        spans = len(knots) - 1
        out = np.empty(spans + 1 + n_new)
        k = 0
        for j in range(spans):
            out[k] = knots[j]
            if chosen[j]:
                k += 1
                out[k] = (knots[j] + knots[j + 1]) / 2
            k += 1
        out[k] = knots[spans]
        knots, chosen = out, _too_wide(out, ring)
        n_new = chosen.sum()
    return knots


@njit(cache=True)
def _too_wide(knots: Floats, ring: bool) -> Bools:
    n = len(knots) - 1
    chosen = np.empty(n, dtype=np.bool_)
    for j in range(n):
        before, after = (j - 1) % n, (j + 1) % n
        width = knots[j + 1] - knots[j]
        chosen[j] = (j > 0 or ring) and width > GRADING * (knots[before + 1] - knots[before])
        chosen[j] |= (j + 1 < n or ring) and width > GRADING * (knots[after + 1] - knots[after])
    return chosen

"""Uniform cubic B-splines on unit spans, as kernels want them: knots clamped at both ends, none that is not needed.

Clamping goes by the polar form f of the curve: at the start f(0, 0, 0) = (p0 + 4 p1 + p2) / 6 and f(0, 0, 1) =
(2 p1 + p2) / 3, in the middle f(k, k+1, k+2) = p_(k+2) as before.

A knot is needed where the third derivative jumps, and its jump is a fourth difference of the control points. One
refinement of a subdivision mesh puts a knot in the middle of every span, and no jump there.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from recon.numerics.bspline_basis import basis_matrix, greville

__all__ = ["clamped_cubic"]

Floats = NDArray[np.float64]

ROUNDING = 1e-13  # of the coordinates: a fourth difference below it is none


def clamped_cubic(points: Floats) -> tuple[Floats, Floats]:
    """Clamped knots on [0, n] and control points, as few as it takes, of a uniform cubic B-spline of n spans.

    points  (n + 3, ...) its control points; the rows of a net are curves that share their knots
    """
    n = len(points) - 3
    jumps = np.abs(np.diff(points, n=4, axis=0)).max(axis=tuple(range(1, points.ndim)), initial=0.0)
    needed = jumps > ROUNDING * np.abs(points).max()
    full = _clamped(points)
    if needed.all():
        return _knots(np.arange(n + 1.0)), full
    kept = np.concatenate([[0.0], 1.0 + np.flatnonzero(needed), [float(n)]])
    return _knots(kept), np.tensordot(_without_knots(n, kept.tobytes()), full, axes=1)


def _knots(breaks: Floats) -> Floats:
    return np.concatenate([np.repeat(breaks[0], 3), breaks, np.repeat(breaks[-1], 3)])


@lru_cache(maxsize=4096)
def _without_knots(n: int, kept: bytes) -> Floats:
    """Control points over the kept knots, from those over all of them."""
    fine, coarse = _knots(np.arange(n + 1.0)), _knots(np.frombuffer(kept))
    places = greville(fine, 3)
    return np.asarray(
        np.linalg.pinv(basis_matrix(coarse, 3, places).toarray()) @ basis_matrix(fine, 3, places).toarray()
    )


def _clamped(points: Floats) -> Floats:
    """(n + 3, ...) control points on knots that are clamped at both ends."""
    out = points.copy()
    if len(points) == 4:  # one span: both ends at once, a Bezier segment
        p0, p1, p2, p3 = points
        out[0], out[1], out[2], out[3] = p0 + 4 * p1 + p2, 4 * p1 + 2 * p2, 2 * p1 + 4 * p2, p1 + 4 * p2 + p3
        return out / 6.0
    out[0], out[1] = (points[0] + 4 * points[1] + points[2]) / 6.0, (2 * points[1] + points[2]) / 3.0
    out[-1], out[-2] = (points[-1] + 4 * points[-2] + points[-3]) / 6.0, (2 * points[-2] + points[-3]) / 3.0
    return out

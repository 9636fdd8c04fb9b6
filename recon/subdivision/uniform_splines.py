"""Uniform B-splines on unit spans, as kernels want them: knots clamped at both ends, none that is not needed.

Clamping goes by the polar form f of the curve. Cubic: f(0, 0, 0) = (p0 + 4 p1 + p2) / 6 and f(0, 0, 1) =
(2 p1 + p2) / 3 at the start, f(k, k+1, k+2) = p_(k+2) in the middle as before. Quadratic: f(0, 0) = (p0 + p1) / 2.

A knot is needed where the highest derivative jumps; for degree d its jump is a difference of order d + 1 of the control
points. One refinement of a subdivision mesh puts a knot in the middle of every span, and no jump there.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from recon.numerics.bspline_basis import basis_matrix, clamped_knots, greville

__all__ = ["clamped"]

Floats = NDArray[np.float64]

ROUNDING = 1e-13  # of the coordinates: a fourth difference below it is none


def clamped(points: Floats, degree: int) -> tuple[Floats, Floats]:
    """Clamped knots on [0, n] and control points, as few as it takes, of a uniform B-spline of n spans.

    points  (n + degree, ...) its control points, degree 2 or 3; the rows of a net are curves that share their knots
    """
    n = len(points) - degree
    jumps = np.abs(np.diff(points, n=degree + 1, axis=0)).max(axis=tuple(range(1, points.ndim)), initial=0.0)
    needed = jumps > ROUNDING * np.abs(points).max()
    full = _clamped_cubic(points) if degree == 3 else _clamped_quadratic(points)
    if needed.all():
        return clamped_knots(np.arange(n + 1.0), degree), full
    kept = np.concatenate([[0.0], 1.0 + np.flatnonzero(needed), [float(n)]])
    return clamped_knots(kept, degree), np.tensordot(_without_knots(n, degree, kept.tobytes()), full, axes=1)


@lru_cache(maxsize=4096)
def _without_knots(n: int, degree: int, kept: bytes) -> Floats:
    """Control points over the kept knots, from those over all of them."""
    fine, coarse = clamped_knots(np.arange(n + 1.0), degree), clamped_knots(np.frombuffer(kept), degree)
    places = greville(fine, degree)
    there = basis_matrix(coarse, degree, places).toarray()
    return np.asarray(np.linalg.pinv(there) @ basis_matrix(fine, degree, places).toarray())


def _clamped_quadratic(points: Floats) -> Floats:
    out = points.copy()
    out[0], out[-1] = (points[0] + points[1]) / 2.0, (points[-1] + points[-2]) / 2.0
    return out


def _clamped_cubic(points: Floats) -> Floats:
    out = points.copy()
    if len(points) == 4:  # one span: both ends at once, a Bezier segment
        p0, p1, p2, p3 = points
        out[0], out[1], out[2], out[3] = p0 + 4 * p1 + p2, 4 * p1 + 2 * p2, 2 * p1 + 4 * p2, p1 + 4 * p2 + p3
        return out / 6.0
    out[0], out[1] = (points[0] + 4 * points[1] + points[2]) / 6.0, (2 * points[1] + points[2]) / 3.0
    out[-1], out[-2] = (points[-1] + 4 * points[-2] + points[-3]) / 6.0, (2 * points[-2] + points[-3]) / 3.0
    return out

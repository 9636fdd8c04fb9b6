"""B-spline basis functions on clamped knot vectors, and their derivatives, as sparse rows of weights.

    p          degree
    t          knot_vector, non-decreasing, ends repeated p + 1 times, len(t) = n + p + 1
    N_{i,p}    basis function of control point i
    span       s with t[s] <= x < t[s + 1]; only N_{s-p} .. N_s differ from zero there

Paper  [piegl1997], sections 2.2 to 2.5.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse
from scipy.interpolate import BSpline

__all__ = ["clamped_knots", "uniform_knots", "knot_spans", "basis_matrix", "greville"]

Floats = NDArray[np.float64]


def clamped_knots(breaks: ArrayLike, degree: int) -> Floats:
    """Knot vector with simple inner knots at the inner `breaks` and full multiplicity at both ends."""
    b = np.asarray(breaks, dtype=np.float64)
    return np.concatenate([np.full(degree, b[0]), b, np.full(degree, b[-1])])


def uniform_knots(n_control: int, degree: int, start: float = 0.0, end: float = 1.0) -> Floats:
    """Clamped knot vector for `n_control` control points with equal spans over [start, end]."""
    return clamped_knots(np.linspace(start, end, n_control - degree + 1), degree)


def knot_spans(knots: Floats, degree: int, x: Floats) -> NDArray[np.int64]:
    """(m,) span of every parameter; the end of the range belongs to the last span that is not empty."""
    last = np.searchsorted(knots, knots[-1], side="left") - 1
    return np.clip(np.searchsorted(knots, x, side="right") - 1, degree, last).astype(np.int64)


def basis_matrix(knots: Floats, degree: int, x: ArrayLike, derivative: int = 0) -> sparse.csr_array:
    """(m, n) sparse matrix that maps control points to the curve's points (or derivatives) at `x`.

    Parameters outside the knot range are clamped to it. Rows sum to 1, or to 0 for a derivative.
    Paper  [piegl1997], equations 2.5 and 2.7: a derivative is the basis of lower degree on knot differences.
    """
    at = np.clip(np.asarray(x, dtype=np.float64).ravel(), knots[degree], knots[-degree - 1])
    if derivative > degree:
        return sparse.csr_array((at.size, len(knots) - degree - 1))
    low = degree - derivative
    inner = knots[derivative : len(knots) - derivative]
    matrix = sparse.csr_array(BSpline.design_matrix(at, inner, low))
    for p in range(low + 1, degree + 1):
        t = knots[degree - p : len(knots) - (degree - p)]
        n = len(t) - p - 1
        step = t[1 + p : n + p] - t[1:n]
        scale = np.divide(p, step, out=np.zeros(n - 1), where=step > 0)
        matrix = matrix @ sparse.diags_array([-scale, scale], offsets=[0, 1], shape=(n - 1, n))
    return sparse.csr_array(matrix)


def greville(knots: Floats, degree: int) -> Floats:
    """(n,) Greville abscissae: the mean of the `degree` knots that belong to each control point."""
    n = len(knots) - degree - 1
    return np.array([knots[i + 1 : i + degree + 1].mean() for i in range(n)])

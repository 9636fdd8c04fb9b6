"""Bernstein polynomials: values, degree elevation, products, and halving of a cubic.

    B_i^n(t) = (n over i) t^i (1 - t)^(n - i),   0 <= i <= n,   t in [0, 1]

Paper  [piegl1997], sections 1.3 and 5.2.
"""

from math import comb

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "bernstein",
    "bernstein_derivative",
    "bernstein_product",
    "degree_elevation",
    "reparametrization",
    "cubic_halving",
]

Floats = NDArray[np.float64]


def bernstein(degree: int, t: ArrayLike) -> Floats:
    """(m, degree + 1) values of the Bernstein polynomials at the parameters (m,); rows sum to 1."""
    x = np.asarray(t, dtype=np.float64).ravel()[:, None]
    i = np.arange(degree + 1)
    return np.array([comb(degree, k) for k in i], dtype=np.float64) * x**i * (1.0 - x) ** (degree - i)


def bernstein_derivative(degree: int, t: ArrayLike) -> Floats:
    """(m, degree + 1) first derivatives of the Bernstein polynomials at the parameters (m,); rows sum to 0."""
    lower = degree * bernstein(degree - 1, t)
    pad = np.zeros((len(lower), 1))
    return np.hstack([pad, lower]) - np.hstack([lower, pad])


def degree_elevation(low: int, high: int) -> Floats:
    """(high + 1, low + 1) matrix that writes a Bezier curve of degree `low` as one of degree `high`, the same curve.

    Paper  [piegl1997], section 5.5.
    """
    raised = np.zeros((high + 1, low + 1))
    for i in range(high + 1):
        for j in range(max(0, i - high + low), min(low, i) + 1):
            raised[i, j] = comb(low, j) * comb(high - low, i - j) / comb(high, i)
    return raised


def bernstein_product(first: int, second: int) -> Floats:
    """(m + n + 1, m + 1, n + 1) tensor that makes the coefficients of the product of polynomials of degree m and n."""
    product = np.zeros((first + second + 1, first + 1, second + 1))
    for i in range(first + 1):
        for j in range(second + 1):
            product[i + j, i, j] = comb(first, i) * comb(second, j) / comb(first + second, i + j)
    return product


def reparametrization(degree: int, start: float, end: float) -> Floats:
    """(n + 1, n + 1) matrix to the control points of the same polynomial curve over [start, end] in place of [0, 1]."""
    t = np.linspace(0.0, 1.0, degree + 1)
    return np.asarray(np.linalg.solve(bernstein(degree, t), bernstein(degree, start + t * (end - start))))


def cubic_halving() -> Floats:
    """(5, 4) matrix from the four control points of a cubic Bezier curve to the five on knots [0 0 0 0 .5 1 1 1 1].

    The curve does not change. Paper  [piegl1997], section 5.2 (insertion of one knot: each new point is a mean of two).
    """
    return np.array([[2, 0, 0, 0], [1, 1, 0, 0], [0, 1, 1, 0], [0, 0, 1, 1], [0, 0, 0, 2]], dtype=np.float64) / 2.0

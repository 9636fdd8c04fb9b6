"""Where another knot would lower the error most, and in which direction.

A knot in a span of u adds one function of u there, times all functions of v. What is left of the data after a fit is
square to all functions there are, so the sum of squares falls by about

    gain = sum_j <h, f N_j>^2 / <f N_j, f N_j>        f(u) = (4 x (1 - x))^2 over the span, x from 0 to 1
                                                      h    heights of the points over the surface

Large errors alone do not say whether it is u or v that lacks knots; these sums do.
"""

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from recon.geometric_fit.spline_space import SplineSpace
from recon.geometric_fit.tensor_space import TensorSpace

__all__ = ["knot_gains"]

Floats = NDArray[np.float64]


def knot_gains(space: TensorSpace, uv: Floats, height: Floats, weights: Floats) -> tuple[Floats, Floats]:
    """(spans of u,) and (spans of v,): gain of a knot in the middle of each span, a control point that it costs.

    uv  (n, 2) feet;  height  (n,);  weights  (n,) how much each counts
    Spans that hold fewer points than a knot there would cost gain nothing.
    """
    one = _gains(space.u, space.v, (uv[:, 0], uv[:, 1]), height, weights)
    two = _gains(space.v, space.u, (uv[:, 1], uv[:, 0]), height, weights)
    return one, two


def _gains(
    split: SplineSpace, other: SplineSpace, at: tuple[Floats, Floats], height: Floats, weights: Floats
) -> Floats:
    place, number = split.within(at[0]), split.span(at[0])
    n_spans = len(split.breaks) - 1
    x = (place - split.breaks[number]) / np.diff(split.breaks)[number]
    bump = (4.0 * x * (1.0 - x)) ** 2
    along = other.rows(at[1])
    products = _sums(number, weights * height * bump, along, n_spans)
    squares = _sums(number, weights * bump**2, along.power(2), n_spans)
    gain = np.divide(products**2, squares, out=np.zeros_like(squares), where=squares > 1e-6 * squares.max(initial=0.0))
    held = np.bincount(number, minlength=n_spans) >= other.n_control
    return np.where(held, gain.sum(axis=1) / other.n_control, 0.0)


def _sums(number: NDArray[np.int64], values: Floats, rows: sparse.csr_array, n_spans: int) -> Floats:
    """(n_spans, n_control) sums over the points of each span of a value times each function."""
    points = np.arange(len(number))
    by_span = sparse.csr_array((values, (number, points)), shape=(n_spans, len(number)))
    return np.asarray((by_span @ rows).todense())

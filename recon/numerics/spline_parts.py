"""A part of an interpolating cubic spline as a B-spline of its own.

Paper  [piegl1997], section 9.2: with the slopes at both ends, one C2 cubic spline runs through a row of points.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

__all__ = ["spline_part"]

Floats = NDArray[np.float64]


def spline_part(t: Floats, rows: Floats, slopes: Floats) -> tuple[Floats, Floats]:
    """(n + 6,) knots and (n + 2, d) control rows of the cubic spline through rows (n, d) at parameters t (n,).

    slopes    (2, d) derivatives at both ends; those of a longer spline make it a part of that one
    Promises  the first and the last control row are those of `rows` to the last bit.
    """
    spline = make_interp_spline(t, rows, k=3, bc_type=([(1, slopes[0])], [(1, slopes[1])]))
    control = spline.c.copy()
    control[0], control[-1] = rows[0], rows[-1]
    return spline.t, control

"""Bezier curves and patches of degree five in rows, as one B-spline on unit spans with the fewest knots.

A knot stays as often as the pieces on its two sides make it: four times where they share position and tangent alone,
three times where their curvature agrees, too, not at all where they are one polynomial.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import SuperLU, splu

from recon.numerics.bspline_basis import basis_matrix, greville

__all__ = ["DEGREE", "quintic_spline"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

DEGREE = 5
TIMES_TANGENT, TIMES_CURVATURE = 4, 3  # a knot stays where what lies beside it shares so much
ROUNDING = 1e-12  # of the coordinates: a difference of differences below it is none


def quintic_spline(pieces: Floats) -> tuple[Floats, Floats]:
    """Clamped knots on [0, n] and control points of n pieces (n, 6, ...) whose ends and tangents meet.

    The rows of a net are curves that share their knots.
    """
    n = len(pieces)
    times = _times(pieces)
    fine = np.concatenate([pieces[:, :DEGREE].reshape(DEGREE * n, *pieces.shape[2:]), pieces[-1:, DEGREE]])
    knots, there, fine_basis = _joining(times.tobytes())
    return knots, there.solve(fine_basis @ fine.reshape(len(fine), -1)).reshape(-1, *pieces.shape[2:])


def _times(pieces: Floats) -> Ints:
    """(n - 1,) how often each inner knot stays."""
    size, all_but_first = ROUNDING * float(np.abs(pieces).max()), tuple(range(1, pieces.ndim))
    times = np.zeros(len(pieces) - 1, dtype=np.int64)
    for order in (5, 4, 3, 2):
        ending = np.diff(pieces[:-1, DEGREE - order :], n=order, axis=1)
        beginning = np.diff(pieces[1:, : order + 1], n=order, axis=1)
        jumps = np.abs(beginning - ending).max(axis=all_but_first)
        times[jumps > size] = TIMES_CURVATURE if order > 2 else TIMES_TANGENT
    return times


@lru_cache(maxsize=4096)
def _joining(times: bytes) -> tuple[Floats, SuperLU, sparse.csr_array]:
    """Knots where each stays so often, and the bases at Greville's points: of those knots, ready to be solved, and of
    the pieces. A spline is what it is at these points."""
    kept = np.frombuffer(times, dtype=np.int64)
    n = len(kept) + 1
    inner, whole = np.arange(1.0, n), np.full(DEGREE + 1, float(n))
    coarse = np.concatenate([np.zeros(DEGREE + 1), np.repeat(inner, kept), whole])
    fine = np.concatenate([np.zeros(DEGREE + 1), np.repeat(inner, DEGREE), whole])
    places = greville(coarse, DEGREE)
    there = sparse.csc_array(basis_matrix(coarse, DEGREE, places))
    return coarse, splu(there, permc_spec="NATURAL"), basis_matrix(fine, DEGREE, places)

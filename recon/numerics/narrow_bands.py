"""Small symmetric systems with three diagonals beside the main one, open or running on round their corner, compiled.

    band[i, k]   entry at (i, i + k), k from 0 to 3; on a ring i + k is counted round
    right        (n, 2), replaced by the solution

scipy.linalg solves the open ones, too, but not out of compiled code, and a call costs more than a row of points.

Paper  [golub2013], section 4.3, on banded systems.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["solved_open", "solved_ring"]

Floats = NDArray[np.float64]


@njit(cache=True)
def solved_open(band: Floats, right: Floats, ends: Floats) -> Floats:
    """Solution with its first and last rows as given in `ends` (2, 3, 2), as far as those are told."""
    n = len(band)
    held = np.zeros(n, dtype=np.bool_)
    for end in range(2):
        for k in range(3):
            row = k if end == 0 else n - 1 - k
            if np.isfinite(ends[end, k, 0]) and not held[row]:
                held[row] = True
                _hold(band, right, row, ends[end, k])
    _solve_band(band, right)
    return right


@njit(cache=True)
def _hold(band: Floats, right: Floats, row: int, value: Floats) -> None:
    """Make the row of a symmetric band say that its unknown is `value`, and bring that to the other rows."""
    n = len(band)
    for k in range(1, 4):
        for c in range(2):
            if row + k < n:
                right[row + k, c] -= band[row, k] * value[c]
            if row - k >= 0:
                right[row - k, c] -= band[row - k, k] * value[c]
        band[row, k] = 0.0
        if row - k >= 0:
            band[row - k, k] = 0.0
    band[row, 0] = 1.0
    for c in range(2):
        right[row, c] = value[c]


@njit(cache=True)
def solved_ring(band: Floats, right: Floats) -> Floats:
    """Solution of a band that runs on round its corner: the last three unknowns as a border of the others."""
    n = len(band)
    m = n - 3
    both, corner = np.zeros((n, 5)), np.zeros((3, 3))  # the right sides, and the border's columns beside them
    border = np.zeros((m, 3))
    for i in range(n):
        both[i, 0], both[i, 1] = right[i, 0], right[i, 1]
        for k in range(4):
            j = (i + k) % n
            if i < m and j >= m:
                border[i, j - m] += band[i, k]
                band[i, k] = 0.0
            elif i >= m and j < m:
                border[j, i - m] += band[i, k]
            elif i >= m:
                corner[i - m, j - m] += band[i, k]
                if i != j:
                    corner[j - m, i - m] += band[i, k]
    for i in range(m):
        for k in range(3):
            both[i, 2 + k] = border[i, k]
    _solve_band(band[:m], both[:m])
    for k in range(3):
        for i in range(m):
            for c in range(3):
                corner[k, c] -= border[i, k] * both[i, 2 + c]
            for c in range(2):
                right[m + k, c] -= border[i, k] * both[i, c]
    _solve_small(corner, right[m:])
    for i in range(m):
        for c in range(2):
            right[i, c] = both[i, c]
            for k in range(3):
                right[i, c] -= both[i, 2 + k] * right[m + k, c]
    return right


@njit(cache=True)
def _solve_band(band: Floats, right: Floats) -> None:
    """Replace `right` by the solution of a symmetric band, band[i, k] the entry at (i, i + k), by its factor L D L'."""
    n, columns = right.shape
    for i in range(n):
        for k in range(1, min(4, n - i)):
            share = band[i, k] / band[i, 0]
            for q in range(k, min(4, n - i)):
                band[i + k, q - k] -= share * band[i, q]
            for c in range(columns):
                right[i + k, c] -= share * right[i, c]
    for i in range(n - 1, -1, -1):
        for c in range(columns):
            for k in range(1, min(4, n - i)):
                right[i, c] -= band[i, k] * right[i + k, c]
            right[i, c] /= band[i, 0]


@njit(cache=True)
def _solve_small(matrix: Floats, right: Floats) -> None:
    """Replace `right` by the solution of a symmetric positive definite matrix."""
    n, columns = right.shape
    for i in range(n):
        for k in range(i + 1, n):
            share = matrix[k, i] / matrix[i, i]
            for q in range(i, n):
                matrix[k, q] -= share * matrix[i, q]
            for c in range(columns):
                right[k, c] -= share * right[i, c]
    for i in range(n - 1, -1, -1):
        for c in range(columns):
            for k in range(i + 1, n):
                right[i, c] -= matrix[i, k] * right[k, c]
            right[i, c] /= matrix[i, i]

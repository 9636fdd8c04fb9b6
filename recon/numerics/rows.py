"""Arithmetic on arrays whose rows are vectors."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["added_at", "row_distances", "unit_vectors"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def added_at(rows: Floats, at: Ints, n: int) -> Floats:
    """(n, k) in each place the sum of the rows (m, k) that belong there, by `at` (m,); zero where none does."""
    return np.stack([np.bincount(at, weights=column, minlength=n) for column in rows.T], axis=1)


def unit_vectors(vectors: Floats) -> Floats:
    """(..., 3) the vectors (..., 3) at length 1; those of length 0 stay as they are."""
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-300))


@njit(cache=True)
def row_distances(one: Floats, other: Floats) -> Floats:  # pragma: no cover - compiled
    """(n,) how far each row of (n, 3) is from the same row of (n, 3)."""
    out = np.empty(len(one))
    for i in range(len(one)):
        x, y, z = one[i, 0] - other[i, 0], one[i, 1] - other[i, 1], one[i, 2] - other[i, 2]
        out[i] = np.sqrt(x * x + y * y + z * z)
    return out

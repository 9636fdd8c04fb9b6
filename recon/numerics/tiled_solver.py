"""Large sparse problems that come from a mesh in the plane: conjugate gradients, preconditioned tile by tile.

The unknowns are cut into tiles by their place; every tile, grown by a few rings of neighbours, is factorised once.
The sum of the tiles' solutions (additive Schwarz) is a preconditioner whose cost grows with the number of unknowns.

Paper  [hestenes1952], conjugate gradients; [dryja1987], additive Schwarz.
"""

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu

__all__ = ["TiledSolver", "plane_tiles"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

RINGS = 2
MOST_STEPS = 400


def plane_tiles(places: Floats, most: int) -> list[Ints]:
    """Places (n, 2) cut at medians across the longer side until no part holds more than `most`."""
    parts, waiting = [], [np.arange(len(places))]
    while waiting:
        part = waiting.pop()
        if len(part) <= most:
            parts.append(part)
            continue
        axis = int(np.argmax(np.ptp(places[part], axis=0)))
        order = part[np.argsort(places[part, axis], kind="stable")]
        waiting += [order[len(order) // 2 :], order[: len(order) // 2]]
    return parts


class TiledSolver:
    """Solver of A x = b for a symmetric positive definite A.

    matrix  (n, n) sparse
    tiles   disjoint unknowns of every tile, all unknowns together
    """

    def __init__(self, matrix: sparse.csr_array, tiles: list[Ints]) -> None:
        self._matrix = matrix
        pattern = sparse.csr_array((np.ones(matrix.nnz, dtype=np.int8), matrix.indices, matrix.indptr), matrix.shape)
        self._tiles = [_grown(pattern, tile) for tile in tiles]
        self._factors = [_factor(matrix, tile) for tile in self._tiles]

    def solve(self, right: Floats, start: Floats, free: NDArray[np.bool_], accuracy: float) -> Floats:
        """(n,) solution in the free unknowns with the others kept at their `start`.

        accuracy  size of what is left over that of `right`, in the norm of the preconditioner
        """
        x = start.copy()
        r = np.where(free, right - self._matrix @ x, 0.0)
        z = self._preconditioned(r, free)
        p, rho = z, float(r @ z)
        target = accuracy**2 * max(float(right @ self._preconditioned(np.where(free, right, 0.0), free)), 1e-300)
        for _ in range(MOST_STEPS):
            if rho <= target:
                break
            q = np.where(free, self._matrix @ p, 0.0)
            step = rho / float(p @ q)
            x += step * p
            r -= step * q
            z = self._preconditioned(r, free)
            rho, last = float(r @ z), rho
            p = z + (rho / last) * p
        return x

    def _preconditioned(self, r: Floats, free: NDArray[np.bool_]) -> Floats:
        out = np.zeros_like(r)
        for tile, factor in zip(self._tiles, self._factors):
            out[tile] += factor.solve(r[tile])
        return np.where(free, out, 0.0)


def _grown(pattern: sparse.csr_array, tile: Ints) -> Ints:
    inside = np.zeros(pattern.shape[0], dtype=bool)
    inside[tile] = True
    front = tile
    for _ in range(RINGS):
        near = np.unique(pattern[front].indices)
        front = near[~inside[near]]
        inside[front] = True
    return np.flatnonzero(inside)


def _factor(matrix: sparse.csr_array, tile: Ints):  # type: ignore[no-untyped-def]
    part = sparse.csc_array(matrix[tile][:, tile])
    return splu(part, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})

"""Control points by the tangent distance: a linear system that is solved without being formed.

Each data point p_i asks the surface to come to its tangent plane at the foot point S_i, and only a little to move
along it. With the weights a_ij of control point j at foot point i, the moves d_j minimise

    sum_i w_i r_i^T H_i r_i + fairness,    r_i = sum_j a_ij d_j - (p_i - S_i),    H_i = n_i n_i^T + mu I

by conjugate gradients, preconditioned with the 3 x 3 blocks of the diagonal. Fairness is the square of what control
points stand away from the mean of their neighbours, weighted as that many data points.

Paper  [wang2006], the metric, there for curves.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import sparse

from recon.geometric_fit.foot_points import Feet
from recon.subdivision.evaluation import MAX_SUPPORT, N_BASIS, PatchArrays, patch_weights
from recon.subdivision.limit_surface import LimitPatches

__all__ = ["BasisRows", "Metric", "basis_rows", "conjugate_gradients", "held", "tangent_distance_move"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
SmallInts = NDArray[np.int32]


class BasisRows(NamedTuple):
    """Weights a_ij of control points at places of the surface, row after row: a matrix in compressed rows."""

    starts: Ints
    columns: SmallInts
    values: Floats

    def matrix(self, n_control: int) -> sparse.csr_array:
        """(N, V) the same as a sparse matrix."""
        # scipy would widen the columns to the type of the starts
        starts = self.starts.astype(np.int32) if len(self.values) <= np.iinfo(np.int32).max else self.starts
        return sparse.csr_array((self.values, self.columns, starts), shape=(len(starts) - 1, n_control))


class Metric(NamedTuple):
    """How residuals count.

    normals  (N, 3) unit normals at the feet
    weights  (N,) of the data points
    tangent  mu, the share of a residual along the surface that counts
    """

    normals: Floats
    weights: Floats
    tangent: float


def basis_rows(patches: LimitPatches, feet: Feet) -> BasisRows:
    """The weights of the control points at the feet."""
    to_points = patches.points
    bound = len(feet.patch) * 13 + 1024
    while True:
        starts, columns, values, needed = _rows(
            patches.arrays,
            to_points.indptr.astype(np.int64),
            to_points.indices.astype(np.int32),
            to_points.data,
            to_points.shape[1],
            feet.patch,
            feet.v,
            feet.w,
            bound,
        )
        if needed <= bound:
            return BasisRows(starts, columns[:needed].copy(), values[:needed].copy())
        bound = needed


@njit(cache=True, nogil=True)
def _rows(
    patches: PatchArrays,
    row_starts: Ints,
    row_columns: SmallInts,
    row_values: Floats,
    n_control: int,
    patch: Ints,
    v: Floats,
    w: Floats,
    bound: int,
) -> tuple[Ints, SmallInts, Floats, int]:
    starts = np.zeros(len(patch) + 1, dtype=np.int64)
    columns, values = np.empty(bound, dtype=np.int32), np.empty(bound)
    b, c = np.empty((6, N_BASIS)), np.empty((6, MAX_SUPPORT))
    place, owner = np.zeros(n_control, dtype=np.int64), np.full(n_control, -1)
    filled = 0
    for i in range(len(patch)):
        size = patch_weights(patches, patch[i], v[i], w[i], 1, b, c)
        first = patches.support_starts[patch[i]]
        for j in range(size):
            point = patches.support[first + j]
            for k in range(row_starts[point], row_starts[point + 1]):
                column = row_columns[k]
                if owner[column] != i:
                    owner[column], place[column] = i, filled
                    if filled < bound:
                        columns[filled], values[filled] = column, 0.0
                    filled += 1
                if place[column] < bound:
                    values[place[column]] += c[0, j] * row_values[k]
        starts[i + 1] = filled
    return starts, columns, values, filled


def tangent_distance_move(
    rows: BasisRows,
    residuals: Floats,
    metric: Metric,
    fairness: sparse.csr_array,
    control_points: Floats,
    *,
    accuracy: float = 3e-2,
    max_iterations: int = 40,
) -> Floats:
    """(V, 3) moves of the control points toward the data.

    residuals  (N, 3) p - S at the feet
    fairness   (V, V) sparse, K: the energy of control points X is the sum of X^T K X over the three coordinates
    accuracy   the residual of the equations at which the iteration stops, as a share of the first
    """
    n_control = len(control_points)
    right = _data_side(rows, residuals, metric.normals, metric.weights, metric.tangent, n_control)
    right -= fairness @ control_points
    blocks = _diagonal_blocks(rows, metric.normals, metric.weights, metric.tangent, n_control)
    blocks = held(blocks, fairness)

    def applied(x: Floats) -> Floats:
        out = _normal_product(rows, x, metric.normals, metric.weights, metric.tangent)
        out += fairness @ x
        return out

    return conjugate_gradients(applied, right, blocks, accuracy=accuracy, max_iterations=max_iterations)


def held(blocks: Floats, fairness: sparse.csr_array) -> Floats:
    """The blocks (V, 3, 3) with those of the fairness; control points that no data reach are held a little."""
    return blocks + (fairness.diagonal() + 1e-9 * blocks.max(initial=1e-300))[:, None, None] * np.eye(3)


def conjugate_gradients(
    applied: Callable[[Floats], Floats], right: Floats, blocks: Floats, *, accuracy: float, max_iterations: int
) -> Floats:
    """(V, 3) where a symmetric operator gives `right` (V, 3), preconditioned with blocks (V, 3, 3) of its diagonal."""
    inverse = np.linalg.inv(blocks)
    moves, residual = np.zeros_like(right), right.copy()
    preconditioned = np.einsum("nij,nj->ni", inverse, residual)
    direction = preconditioned.copy()
    energy = float(np.vdot(residual, preconditioned))
    goal = accuracy * accuracy * energy
    for _ in range(max_iterations):
        if energy <= goal or energy <= 0.0:
            break
        product = applied(direction)
        share = energy / float(np.vdot(direction, product))
        moves += share * direction
        residual -= share * product
        preconditioned = np.einsum("nij,nj->ni", inverse, residual)
        last, energy = energy, float(np.vdot(residual, preconditioned))
        direction = preconditioned + (energy / last) * direction
    return moves


@njit(cache=True, nogil=True)
def _data_side(
    rows: BasisRows, residuals: Floats, normals: Floats, weights: Floats, mu: float, n_control: int
) -> Floats:
    """A^T H r, (V, 3)."""
    out = np.zeros((n_control, 3))
    for i in range(len(residuals)):
        n, r = normals[i], residuals[i]
        along = n[0] * r[0] + n[1] * r[1] + n[2] * r[2]
        x = weights[i] * (along * n[0] + mu * r[0])
        y = weights[i] * (along * n[1] + mu * r[1])
        z = weights[i] * (along * n[2] + mu * r[2])
        for k in range(rows.starts[i], rows.starts[i + 1]):
            j, a = rows.columns[k], rows.values[k]
            out[j, 0] += a * x
            out[j, 1] += a * y
            out[j, 2] += a * z
    return out


@njit(cache=True, nogil=True)
def _normal_product(rows: BasisRows, moves: Floats, normals: Floats, weights: Floats, mu: float) -> Floats:
    """A^T H A d, (V, 3), in one pass over the data points."""
    out = np.zeros_like(moves)
    for i in range(len(normals)):
        x, y, z = 0.0, 0.0, 0.0
        for k in range(rows.starts[i], rows.starts[i + 1]):
            j, a = rows.columns[k], rows.values[k]
            x += a * moves[j, 0]
            y += a * moves[j, 1]
            z += a * moves[j, 2]
        n = normals[i]
        along = n[0] * x + n[1] * y + n[2] * z
        x = weights[i] * (along * n[0] + mu * x)
        y = weights[i] * (along * n[1] + mu * y)
        z = weights[i] * (along * n[2] + mu * z)
        for k in range(rows.starts[i], rows.starts[i + 1]):
            j, a = rows.columns[k], rows.values[k]
            out[j, 0] += a * x
            out[j, 1] += a * y
            out[j, 2] += a * z
    return out


@njit(cache=True, nogil=True)
def _diagonal_blocks(rows: BasisRows, normals: Floats, weights: Floats, mu: float, n_control: int) -> Floats:
    """(V, 3, 3) blocks of A^T H A on the diagonal."""
    out = np.zeros((n_control, 3, 3))
    for i in range(len(normals)):
        n = normals[i]
        for k in range(rows.starts[i], rows.starts[i + 1]):
            j, a = rows.columns[k], weights[i] * rows.values[k] * rows.values[k]
            for p in range(3):
                for q in range(3):
                    out[j, p, q] += a * n[p] * n[q]
                out[j, p, p] += a * mu
    return out

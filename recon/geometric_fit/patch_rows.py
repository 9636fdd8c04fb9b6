"""Weights of the control points at the feet, kept patch after patch: all feet in a patch have the same control points.

    patch 0                     patch 1
    columns  4  7  9 12         columns  2  4  5        every row of a patch has a weight for each of its columns, so
    row      .  .  .  .         row      .  .  .        a product gathers and scatters once a patch, not once a row
    row      .  .  .  .

A scan has some points in every patch, and these products are most of a round. Weights are kept in single precision:
they only say where control points go; where the surface is, foot points say.

a_ij  weight of control point j at foot i;   n_i  unit normal;   w_i  how much a point counts;   mu  the share along
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import sparse

from recon.geometric_fit.foot_points import Feet, patch_order
from recon.geometric_fit.tangent_distance import conjugate_gradients, held
from recon.subdivision.evaluation import MAX_SUPPORT, N_BASIS, PatchArrays, patch_weights
from recon.subdivision.limit_surface import LimitPatches

__all__ = ["Metric", "PatchColumns", "PatchPart", "mean_move", "patch_columns", "patch_move", "patch_part"]

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Ints = NDArray[np.int64]
SmallInts = NDArray[np.int32]

LIGHT = 1e-3  # of the mean over the control points: one with less answers for next to no point


@dataclass(frozen=True, eq=False)
class PatchColumns:
    """The control points that each patch of a surface depends on.

    starts  (P + 1,) where those of each patch begin in `columns`
    """

    patches: LimitPatches
    starts: Ints
    columns: SmallInts


class Metric(NamedTuple):
    """How residuals count: H = normal n n^T + tangent I, the square of the distance where the first is 0."""

    normal: float
    tangent: float


@dataclass(frozen=True, eq=False)
class PatchPart:
    """Some points that pull at the surface, patch after patch.

    columns     of the patches
    row_starts  (P + 1,) where the rows of each patch begin
    values      the weights a, row after row
    normals     (n, 3) n and weights (n,) w of every row
    right       (V, 3) A^T H r, r from the feet to the points
    blocks      (V, 3, 3) of A^T H A on the diagonal
    mass        (V,) sum of a w: what the points weigh that a control point answers for
    metric      H
    """

    columns: PatchColumns
    row_starts: Ints
    values: Singles
    normals: Singles
    weights: Singles
    right: Floats
    blocks: Floats
    mass: Floats
    metric: Metric

    def product(self, moves: Floats) -> Floats:
        """(V, 3) A^T H A d for moves d (V, 3)."""
        out = np.zeros_like(moves)
        rows = (self.columns.starts, self.columns.columns, self.row_starts, self.values)
        _product(rows, (self.normals, self.weights), self.metric, moves, out)
        return out


def patch_columns(patches: LimitPatches) -> PatchColumns:
    """What depends on the connections of the control mesh alone."""
    matrix = patches.points
    columns, starts = _columns(
        patches.arrays, matrix.indptr.astype(np.int64), matrix.indices.astype(np.int32), matrix.shape[1]
    )
    return PatchColumns(patches, starts, columns)


def patch_part(columns: PatchColumns, feet: Feet, targets: Floats, weights: Floats, metric: Metric) -> PatchPart:
    """Points (n, 3) that pull at the surface from their feet, each as much as its weight (n,)."""
    matrix, n = columns.patches.points, len(feet.patch)
    order, row_starts = patch_order(feet.patch, len(columns.starts) - 1)
    values = np.empty(int((np.diff(row_starts) * np.diff(columns.starts)).sum()), dtype=np.float32)
    _fill(
        columns.patches.arrays,
        (matrix.indptr.astype(np.int64), matrix.indices.astype(np.int32), matrix.data, matrix.shape[1]),
        (columns.starts, columns.columns, row_starts, order),
        (feet.v, feet.w),
        values,
    )
    normals, weight = np.empty((n, 3), dtype=np.float32), np.empty(n, dtype=np.float32)
    right, blocks = np.zeros((matrix.shape[1], 3)), np.zeros((matrix.shape[1], 3, 3))
    mass = np.zeros(matrix.shape[1])
    rows = (columns.starts, columns.columns, row_starts, values)
    _right_and_blocks(
        rows, order, (targets, feet.positions, feet.normals, weights), metric, (normals, weight, right, blocks, mass)
    )
    return PatchPart(columns, row_starts, values, normals, weight, right, blocks, mass, metric)


def mean_move(parts: Sequence[PatchPart]) -> Floats:
    """(V, 3) for each control point the mean of the residuals around it, weighted with its basis function.

    Never farther than the points are off, so it hardly folds a surface. Where next to no point is, it is short.
    """
    mass = np.sum([part.mass for part in parts], axis=0)
    pull = np.sum([part.right for part in parts], axis=0)
    return np.asarray(pull / np.maximum(mass, max(LIGHT * mass.mean(), 1e-300))[:, None])


def patch_move(
    parts: Sequence[PatchPart],
    fairness: sparse.csr_array,
    sliding: Floats,
    control_points: Floats,
    *,
    accuracy: float,
    max_iterations: int,
) -> Floats:
    """(V, 3) moves of the control points toward the points of all parts: as `tangent_distance_move`.

    sliding  (V, 3, 3) what a move of each control point costs
    """
    right = np.sum([part.right for part in parts], axis=0) - fairness @ control_points
    blocks = held(np.sum([part.blocks for part in parts], axis=0), fairness) + sliding

    def applied(x: Floats) -> Floats:
        own = fairness @ x + np.einsum("nij,nj->ni", sliding, x)
        return np.asarray(sum((part.product(x) for part in parts), start=own))

    return conjugate_gradients(applied, right, blocks, accuracy=accuracy, max_iterations=max_iterations)


@njit(cache=True)
def _columns(
    patches: PatchArrays, starts: Ints, columns: SmallInts, n_control: int
) -> tuple[SmallInts, Ints]:  # pragma: no cover - compiled
    n = len(patches.tables)
    firsts = np.zeros(n + 1, dtype=np.int64)
    owner = np.full(n_control, -1)
    found = np.empty(16 * n + 1024, dtype=np.int32)
    filled = 0
    for patch in range(n):
        for j in range(patches.support_starts[patch], patches.support_starts[patch + 1]):
            point = patches.support[j]
            for k in range(starts[point], starts[point + 1]):
                column = columns[k]
                if owner[column] == patch:
                    continue
                owner[column] = patch
                if filled == len(found):
                    grown = np.empty(2 * filled, dtype=np.int32)
                    grown[:filled] = found
                    found = grown
                found[filled] = column
                filled += 1
        firsts[patch + 1] = filled
    return found[:filled].copy(), firsts


@njit(cache=True, nogil=True)
def _fill(
    patches: PatchArrays,
    matrix: tuple[Ints, SmallInts, Floats, int],
    rows: tuple[Ints, SmallInts, Ints, SmallInts],
    feet: tuple[Floats, Floats],
    values: Singles,
) -> None:  # pragma: no cover - compiled
    """Weights of the points of a patch at each foot, times the weights of the control points in these."""
    (starts, columns, data, n_control), (column_starts, patch_columns, row_starts, order) = matrix, rows
    v, w = feet
    b, c = np.empty((6, N_BASIS)), np.empty((6, MAX_SUPPORT))
    place, sums = np.zeros(n_control, dtype=np.int64), np.empty(n_control)
    most = 0
    for patch in range(len(patches.tables)):
        most = max(most, column_starts[patch + 1] - column_starts[patch])
    shares = np.empty((MAX_SUPPORT, most))
    at = 0
    for patch in range(len(patches.tables)):
        if row_starts[patch] == row_starts[patch + 1]:
            continue
        first, n = column_starts[patch], column_starts[patch + 1] - column_starts[patch]
        for k in range(n):
            place[patch_columns[first + k]] = k
        support = patches.support_starts[patch]
        size = patches.support_starts[patch + 1] - support
        for j in range(size):
            for k in range(n):
                shares[j, k] = 0.0
            point = patches.support[support + j]
            for k in range(starts[point], starts[point + 1]):
                shares[j, place[columns[k]]] += data[k]
        for row in range(row_starts[patch], row_starts[patch + 1]):
            i = order[row]
            patch_weights(patches, patch, v[i], w[i], 1, b, c)
            for k in range(n):
                sums[k] = 0.0
            for j in range(size):
                weight = c[0, j]
                for k in range(n):
                    sums[k] += weight * shares[j, k]
            for k in range(n):
                values[at + k] = sums[k]
            at += n


@njit(cache=True, nogil=True)
def _right_and_blocks(
    rows: tuple[Ints, SmallInts, Ints, Singles],
    order: SmallInts,
    pulls: tuple[Floats, Floats, Floats, Floats],
    metric: Metric,
    found: tuple[Singles, Singles, Floats, Floats, Floats],
) -> None:  # pragma: no cover - compiled
    """Normals and weights of the rows, and the sums over them."""
    (column_starts, columns, row_starts, values), (targets, feet, unit, given) = rows, pulls
    normals, weights, right, blocks, mass = found
    mu, at = metric.tangent, 0
    for patch in range(len(column_starts) - 1):
        first, n = column_starts[patch], column_starts[patch + 1] - column_starts[patch]
        for row in range(row_starts[patch], row_starts[patch + 1]):
            i = order[row]
            x, y, z, w = unit[i, 0], unit[i, 1], unit[i, 2], given[i]
            normals[row, 0], normals[row, 1], normals[row, 2], weights[row] = x, y, z, w
            p, q, r = targets[i, 0] - feet[i, 0], targets[i, 1] - feet[i, 1], targets[i, 2] - feet[i, 2]
            along = metric.normal * (x * p + y * q + z * r)
            p, q, r = w * (along * x + mu * p), w * (along * y + mu * q), w * (along * z + mu * r)
            xx, xy, xz = metric.normal * x * x + mu, metric.normal * x * y, metric.normal * x * z
            yy, yz, zz = metric.normal * y * y + mu, metric.normal * y * z, metric.normal * z * z + mu
            for k in range(n):
                a, j = values[at + k], columns[first + k]
                mass[j] += a * w
                right[j, 0] += a * p
                right[j, 1] += a * q
                right[j, 2] += a * r
                a *= a * w
                blocks[j, 0, 0] += a * xx
                blocks[j, 0, 1] += a * xy
                blocks[j, 0, 2] += a * xz
                blocks[j, 1, 1] += a * yy
                blocks[j, 1, 2] += a * yz
                blocks[j, 2, 2] += a * zz
            at += n
    for j in range(len(blocks)):
        blocks[j, 1, 0], blocks[j, 2, 0], blocks[j, 2, 1] = blocks[j, 0, 1], blocks[j, 0, 2], blocks[j, 1, 2]


@njit(cache=True, nogil=True, fastmath=True)
def _product(
    rows: tuple[Ints, SmallInts, Ints, Singles],
    metrics: tuple[Singles, Singles],
    metric: Metric,
    moves: Floats,
    out: Floats,
) -> None:  # pragma: no cover - compiled
    (column_starts, columns, row_starts, values), (normals, weights) = rows, metrics
    mu, most = metric.tangent, 0
    for patch in range(len(column_starts) - 1):
        most = max(most, column_starts[patch + 1] - column_starts[patch])
    here, there = np.empty((3, most)), np.empty((3, most))
    at = 0
    for patch in range(len(column_starts) - 1):
        if row_starts[patch] == row_starts[patch + 1]:
            continue
        first, n = column_starts[patch], column_starts[patch + 1] - column_starts[patch]
        for k in range(n):
            for axis in range(3):
                here[axis, k], there[axis, k] = moves[columns[first + k], axis], 0.0
        for row in range(row_starts[patch], row_starts[patch + 1]):
            x, y, z = 0.0, 0.0, 0.0
            for k in range(n):
                a = values[at + k]
                x += a * here[0, k]
                y += a * here[1, k]
                z += a * here[2, k]
            p, q, r, w = normals[row, 0], normals[row, 1], normals[row, 2], weights[row]
            along = metric.normal * (p * x + q * y + r * z)
            x, y, z = w * (along * p + mu * x), w * (along * q + mu * y), w * (along * r + mu * z)
            for k in range(n):
                a = values[at + k]
                there[0, k] += a * x
                there[1, k] += a * y
                there[2, k] += a * z
            at += n
        for k in range(n):
            for axis in range(3):
                out[columns[first + k], axis] += there[axis, k]

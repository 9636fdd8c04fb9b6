"""How the control points of a curve move, given the error vectors at the feet of the data points.

    PATENT    d_j = sum_i N_j(t_i) e_i / sum_i N_j(t_i): the mean of the error vectors, weighted with the basis function
    TANGENT   the tangent distance: sum_i r_i^T H_i r_i least, a linear system that is solved by conjugate gradients and
              never formed; r_i = sum_j N_j(t_i) d_j - e_i,  H_i = I - (1 - mu) T_i T_i^T

    e_i   error vector from the foot to the data point;   T_i   unit tangent at the foot

Paper  [maekawa2009], paragraphs 0143 to 0147, for PATENT; [wang2006] for TANGENT.
"""

from enum import StrEnum

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import LinearOperator, cg

from recon.geometric_fit.spline_space import SplineSpace

__all__ = ["CurveUpdate", "curve_move"]

Floats = NDArray[np.float64]

MU = 0.05  # what a step along the tangent counts beside one across
STIFFNESS = 1e-7  # of the data's weight: what a bend of the polygon counts, where no data hold a control point
ACCURACY = 1e-3  # of the conjugate gradients, beside their start; the next round takes up what is left
MOST_STEPS = 60


class CurveUpdate(StrEnum):
    """Rule by which control points move."""

    TANGENT = "tangent"
    PATENT = "patent"


def curve_move(
    space: SplineSpace, control: Floats, points: Floats, feet: Floats, update: CurveUpdate, *, fixed: NDArray[np.int64]
) -> Floats:
    """(n_control, d) by how much the control points move; those of the numbers `fixed` stay.

    points  (n, d);  feet  (n,) their parameters
    """
    rows = space.rows(feet)
    error = points - rows @ control
    free = np.ones((space.n_control, 1))
    free[fixed] = 0.0
    if update is CurveUpdate.PATENT:
        weight = np.asarray(rows.sum(axis=0)).ravel()[:, None]
        return np.asarray(free * (rows.T @ error) / np.maximum(weight, 1e-12))
    tangent = space.rows(feet, 1) @ control
    tangent /= np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-300)
    return _tangent_move(rows, error, tangent, _bends(space), free)


def _tangent_move(
    rows: sparse.csr_array, error: Floats, tangent: Floats, bends: sparse.csr_array, free: Floats
) -> Floats:
    shape = (rows.shape[1], error.shape[1])
    stiff = STIFFNESS * len(error) * (bends.T @ bends)

    def metric(r: Floats) -> Floats:
        return np.asarray(r - (1.0 - MU) * np.einsum("ij,ij->i", r, tangent)[:, None] * tangent)

    def applied(x: Floats) -> Floats:
        d = free * x.reshape(shape)
        return np.asarray(free * (rows.T @ metric(rows @ d) + stiff @ d) + (1.0 - free) * x.reshape(shape)).ravel()

    squares = rows.power(2).T @ (1.0 - (1.0 - MU) * tangent**2)
    diagonal = free * (squares + stiff.diagonal()[:, None]) + (1.0 - free)
    scale = 1.0 / np.maximum(diagonal, 1e-300).ravel()
    size = shape[0] * shape[1]
    system = LinearOperator((size, size), matvec=applied, dtype=np.float64)
    preconditioner = LinearOperator((size, size), matvec=lambda x: scale * x, dtype=np.float64)
    right = (free * (rows.T @ metric(error))).ravel()
    moved, _ = cg(system, right, rtol=ACCURACY, maxiter=MOST_STEPS, M=preconditioner)
    return np.asarray(free * moved.reshape(shape))


def _bends(space: SplineSpace) -> sparse.csr_array:
    """Second differences of neighbouring control points, around the seam where there is one."""
    n = space.n_control
    if space.periodic:
        at = np.arange(n)
        columns = np.stack([at, (at + 1) % n, (at + 2) % n], axis=1)
    else:
        columns = np.arange(n - 2)[:, None] + np.arange(3)
    number = np.repeat(np.arange(len(columns)), 3)
    values = np.tile([1.0, -2.0, 1.0], len(columns))
    return sparse.csr_array((values, (number, columns.ravel())), shape=(len(columns), n))

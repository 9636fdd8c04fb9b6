"""Weights of a NURBS surface, moved by the tangent distance while the control points stay.

With w_k = exp(q_k) a surface point S = sum R_k P_k moves by R_k (P_k - S) for a change of q_k, so the moves minimise

    sum_i g_i (sum_k R_k (P_k - S_i) . n_i  dq_k  -  r_i . n_i)^2  +  damping |dq|^2

n_i   normal at the foot of point i;   r_i   error vector;   g_i   how much it counts

Paper  [piegl1997], section 11.4: what a weight does to the surface.
"""

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import lsqr

from recon.geometric_fit.tensor_space import NetFeet, TensorSpace, net_rows

__all__ = ["moved_weights"]

Floats = NDArray[np.float64]

DAMPING = 0.03  # of the mean square of what a weight does: weights that the data say nothing of stay as they are
LARGEST_STEP = 0.3  # of a logarithm in a round
RANGE = np.log(8.0)  # of the logarithms: a weight much larger than its neighbours bends the parameters
STEPS = 30


def moved_weights(space: TensorSpace, net: Floats, feet: NetFeet, points: Floats, counts: Floats) -> Floats:
    """The net with other weights and the same control points.

    points  (n, 3) data;  counts  (n,) how much each of them counts
    """
    weights, control = net[..., 3], (net[..., :3] / net[..., 3:]).reshape(-1, 3)
    rows, normals = net_rows(space, net, feet.uv), feet.normals
    owner = np.repeat(np.arange(len(points)), np.diff(rows.starts))
    lever = np.einsum("ij,ij->i", control[rows.columns] - feet.positions[owner], normals[owner])
    scale = np.sqrt(counts)
    values = rows.values * lever * scale[owner]
    system = sparse.csr_array((values, rows.columns, rows.starts), shape=(len(points), space.n_control))
    right = scale * np.einsum("ij,ij->i", points - feet.positions, normals)
    usual = float(np.square(values).sum()) / space.n_control
    step = lsqr(system, right, damp=np.sqrt(DAMPING * usual), iter_lim=STEPS)[0]
    moved = np.log(weights).ravel() + np.clip(step, -LARGEST_STEP, LARGEST_STEP)
    moved = np.exp(np.clip(moved - moved.mean(), -RANGE, RANGE)).reshape(weights.shape)
    return np.concatenate([control.reshape(*weights.shape, 3) * moved[..., None], moved[..., None]], axis=2)

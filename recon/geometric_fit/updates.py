"""How control points move in a round, given the error vectors at the foot points: one rule a name.

    TANGENT        the tangent distance, a linear system solved iteratively and never formed (`tangent_distance`)
    LEAST_SQUARES  the same system with the full distance: what the patent compares itself with
    PATENT         mean of the error vectors on the faces around, weighted with the barycentric coordinate
    BASIS          the same mean, weighted with the basis function of the control point
    NESTEROV       BASIS with momentum
    ANDERSON       BASIS, the last five moves combined so that their residual is least

Paper  [maekawa2009] for PATENT, [wang2006] for TANGENT, [nesterov1983], [anderson1965].
"""

from enum import StrEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from recon.geometric_fit.foot_points import Feet
from recon.geometric_fit.tangent_distance import Metric, basis_rows, tangent_distance_move
from recon.subdivision.limit_surface import LimitPatches

__all__ = ["Pull", "Update", "Updater"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

TANGENT_SHARE = 0.02  # mu: how much of a residual along the surface counts
HISTORY = 5  # moves that Anderson's combination looks back on


class Update(StrEnum):
    """The rule by which control points move."""

    TANGENT = "tangent"
    LEAST_SQUARES = "least-squares"
    PATENT = "patent"
    BASIS = "basis"
    NESTEROV = "nesterov"
    ANDERSON = "anderson"


class Pull(NamedTuple):
    """What pulls at the surface in one round.

    feet      (N) places on the surface, with the normals of the planes the residuals are measured to
    targets   (N, 3) where each should come to
    weights   (N,) how much it counts
    faces     (F, k) the control faces, three- or four-sided
    fairness  (V, V) sparse energy of the control mesh
    """

    feet: Feet
    targets: Floats
    weights: Floats
    faces: Ints
    fairness: sparse.csr_array


class Updater:
    """One rule with what it remembers between rounds; a new one after every change of the control mesh."""

    def __init__(self, rule: Update) -> None:
        self._rule = rule
        self._speed: Floats | None = None
        self._age = 1.0
        self._moves: list[Floats] = []
        self._points: list[Floats] = []

    def moved(self, patches: LimitPatches, control_points: Floats, pull: Pull) -> Floats:
        """(V, 3) the control points after the round."""
        if self._rule in (Update.TANGENT, Update.LEAST_SQUARES):
            return control_points + self._solved(patches, control_points, pull)
        move = _mean_move(patches, len(control_points), pull, hat=self._rule is Update.PATENT)
        if self._rule is Update.NESTEROV:
            return self._with_momentum(control_points + move)
        if self._rule is Update.ANDERSON:
            return self._combined(control_points, move)
        return control_points + move

    def _solved(self, patches: LimitPatches, control_points: Floats, pull: Pull) -> Floats:
        rows = basis_rows(patches, pull.feet)
        residuals = pull.targets - pull.feet.positions
        if self._rule is Update.TANGENT:
            metric = Metric(pull.feet.normals, pull.weights, TANGENT_SHARE)
            return tangent_distance_move(rows, residuals, metric, pull.fairness, control_points)
        metric = Metric(np.zeros_like(pull.feet.normals), pull.weights, 1.0)
        return tangent_distance_move(
            rows, residuals, metric, pull.fairness, control_points, accuracy=1e-6, max_iterations=300
        )

    def _with_momentum(self, stepped: Floats) -> Floats:
        last, self._speed = self._speed, stepped
        if last is None:
            return stepped
        age = (1.0 + np.sqrt(1.0 + 4.0 * self._age**2)) / 2.0
        share, self._age = (self._age - 1.0) / age, age
        return stepped + share * (stepped - last)

    def _combined(self, control_points: Floats, move: Floats) -> Floats:
        self._moves, self._points = (
            [*self._moves, move][-HISTORY - 1 :],
            [*self._points, control_points][-HISTORY - 1 :],
        )
        if len(self._moves) == 1:
            return control_points + move
        change = np.stack([(b - a).ravel() for a, b in zip(self._moves, self._moves[1:])], axis=1)
        travel = np.stack([(b - a).ravel() for a, b in zip(self._points, self._points[1:])], axis=1)
        share = np.linalg.lstsq(change, move.ravel(), rcond=1e-8)[0]
        return control_points + move - ((travel + change) @ share).reshape(move.shape)


def _mean_move(patches: LimitPatches, n_control: int, pull: Pull, *, hat: bool) -> Floats:
    """sum u e / sum u for every control point; u is its barycentric coordinate, or its basis function."""
    if hat:
        k = pull.faces.shape[1]
        shares = _control_barycentric(pull.feet) if k == 3 else _control_bilinear(pull.feet)
        rows = np.repeat(np.arange(len(shares)), k)
        columns = pull.faces[np.minimum(pull.feet.patch // 4, len(pull.faces) - 1)].ravel()
        weights = sparse.csr_array(sparse.coo_array((shares.ravel(), (rows, columns)), shape=(len(shares), n_control)))
    else:
        weights = basis_rows(patches, pull.feet).matrix(n_control)
    scaled = sparse.csr_array(sparse.diags_array(pull.weights) @ weights)
    total = np.asarray(scaled.sum(axis=0)).ravel()[:, None]
    pulled = scaled.T @ (pull.targets - pull.feet.positions)
    return np.divide(pulled, total, out=np.zeros((n_control, 3)), where=total > 1e-12)


def _control_barycentric(feet: Feet) -> Floats:
    """(N, 3) barycentric coordinates in the control face of places in its four patches."""
    child, v, w = feet.patch % 4, feet.v, feet.w
    u = 1.0 - v - w
    out = np.empty((len(v), 3))
    row, corner = np.arange(len(v)), child % 3
    out[row, corner], out[row, (corner + 1) % 3], out[row, (corner + 2) % 3] = u + (v + w) / 2.0, v / 2.0, w / 2.0
    middle = child == 3
    out[middle] = np.stack([u + w, u + v, v + w], axis=1)[middle] / 2.0
    return out


def _control_bilinear(feet: Feet) -> Floats:
    """(N, 4) bilinear weights of the corners of the control face of places in its four patches."""
    corner, v, w = feet.patch % 4, feet.v / 2.0, feet.w / 2.0
    out = np.empty((len(v), 4))
    row = np.arange(len(v))
    for i, share in enumerate(((1.0 - v) * (1.0 - w), v * (1.0 - w), v * w, (1.0 - v) * w)):
        out[row, (corner + i) % 4] = share
    return out

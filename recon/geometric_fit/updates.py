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
from recon.geometric_fit.patch_rows import Metric, PatchPart, patch_move
from recon.geometric_fit.tangent_distance import BasisRows, basis_rows, tangent_distance_move
from recon.geometric_fit.tangent_distance import Metric as PointMetric
from recon.subdivision.limit_surface import LimitPatches

__all__ = ["METRICS", "PatchPull", "Pull", "Update", "Updater", "rows_for"]

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


# of the rules that solve a system, how residuals count, and how exactly it is solved
METRICS = {Update.TANGENT: Metric(1.0, TANGENT_SHARE), Update.LEAST_SQUARES: Metric(0.0, 1.0)}
SOLUTION = {Update.TANGENT: (3e-2, 40), Update.LEAST_SQUARES: (1e-6, 300)}


class Pull(NamedTuple):
    """What pulls at the surface in one round.

    rows      (N, V) shares of the control points in each place: those that the rule weighs with (`rows_for`)
    residuals (N, 3) from each place to where it should come to
    normals   (N, 3) of the planes the residuals are measured to
    weights   (N,) how much each counts
    fairness  (V, V) sparse energy of the control points
    """

    rows: BasisRows
    residuals: Floats
    normals: Floats
    weights: Floats
    fairness: sparse.csr_array


def rows_for(rule: Update, patches: LimitPatches, feet: Feet, faces: Ints) -> BasisRows:
    """What a rule weighs error vectors with at feet on a subdivision surface.

    faces  (F, k) the control faces, three- or four-sided
    """
    if rule is not Update.PATENT:
        return basis_rows(patches, feet)
    k = faces.shape[1]
    shares = _control_barycentric(feet) if k == 3 else _control_bilinear(feet)
    columns = faces[np.minimum(feet.patch // 4, len(faces) - 1)]
    return BasisRows(np.arange(0, k * len(shares) + 1, k), columns.ravel().astype(np.int32), shares.ravel())


class PatchPull(NamedTuple):
    """The same on a subdivision surface, for the rules that solve a system.

    parts     points that pull, each weighed with the basis functions
    fairness  (V, V) sparse energy of the control points
    sliding   (V, 3, 3) what a move of each control point costs
    """

    parts: tuple[PatchPart, ...]
    fairness: sparse.csr_array
    sliding: Floats


class Updater:
    """One rule with what it remembers between rounds; a new one after every change of the control mesh."""

    def __init__(self, rule: Update) -> None:
        self._rule = rule
        self._speed: Floats | None = None
        self._age = 1.0
        self._moves: list[Floats] = []
        self._points: list[Floats] = []

    def moved(self, control_points: Floats, pull: Pull | PatchPull) -> Floats:
        """(V, 3) the control points after the round."""
        if isinstance(pull, PatchPull):
            accuracy, most = SOLUTION[self._rule]
            return control_points + patch_move(*pull, control_points, accuracy=accuracy, max_iterations=most)
        if self._rule in METRICS:
            return control_points + self._solved(control_points, pull)
        move = _mean_move(len(control_points), pull)
        if self._rule is Update.NESTEROV:
            return self._with_momentum(control_points + move)
        if self._rule is Update.ANDERSON:
            return self._combined(control_points, move)
        return control_points + move

    def _solved(self, control_points: Floats, pull: Pull) -> Floats:
        (normal, tangent), (accuracy, most) = METRICS[self._rule], SOLUTION[self._rule]
        metric = PointMetric(normal * pull.normals, pull.weights, tangent)
        return tangent_distance_move(
            pull.rows, pull.residuals, metric, pull.fairness, control_points, accuracy=accuracy, max_iterations=most
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


def _mean_move(n_control: int, pull: Pull) -> Floats:
    """sum u e / sum u for every control point; u is its share in the place of the error vector e."""
    scaled = sparse.csr_array(sparse.diags_array(pull.weights) @ pull.rows.matrix(n_control))
    total = np.asarray(scaled.sum(axis=0)).ravel()[:, None]
    pulled = scaled.T @ pull.residuals
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

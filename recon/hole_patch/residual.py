"""What is left of a wall when the turned profile is taken away: a thin, smooth sheet over the hole's chart.

The residual d(u, s) is known in a ring around the hole and has to be continued across it. A tensor-product spline is
fitted to the ring by weighted least squares with the energy of a thin plate, and the plate is as stiff as foretells
best those sectors of the ring that were left out.

       . : : : .         ring of samples, one of its sectors (x) left out:
     : :     x x :       how well do the others foretell it?
     :  hole  x x x
     : :     : : :
       ' : : : '

    u        r̄ θ, angle times the mean radius of the hole's edge, so that both coordinates are lengths on the wall
    s        length along the profile
    d        distance from the turned profile
    B_i B_j  products of cubic B-splines in u and s
    λ        weight of the plate's energy beside the samples, whose weights sum to 1; λ = ℓ⁴ / area of the ring

Paper  [wahba1990], thin plates and cross-validation.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import cho_factor, cho_solve

from recon.numerics.bspline_basis import basis_matrix, uniform_knots

__all__ = ["Residual", "Ring", "fit_residual", "tensor_rows"]

Floats = NDArray[np.float64]
Matrix = NDArray[np.float64] | sparse.csr_array

# lengths ℓ in units of the vessel (`recon.hole_patch.unit_length`) below which the plate smooths waves away: from a few
# knots to stiffer than any vessel
STIFFNESS_LENGTHS = np.geomspace(4.0, 64.0, 9)
SECTORS = 8  # an eighth of the turn around a hole leaves a gap about as wide as the ring
MOST_SPANS = 14
ROBUST_ROUNDS = 4


@dataclass(frozen=True, eq=False)
class Ring:
    """Samples of the residual around a hole.

    chart     (m, 2) u and s
    distance  (m,) d
    weight    (m,) not negative
    middle    (2,) middle of the hole in u and s
    width     of the ring
    """

    chart: Floats
    distance: Floats
    weight: Floats
    middle: Floats
    width: float


@dataclass(frozen=True, eq=False)
class Residual:
    """A fitted residual.

    knots_u, knots_s  of the cubic splines
    coefficients      (nu, ns)
    stiffness         ℓ that was chosen
    foretold          mean distance by which sectors left out of the ring were missed
    """

    knots_u: Floats
    knots_s: Floats
    coefficients: Floats
    stiffness: float
    foretold: float

    def at(self, chart: Floats) -> Floats:
        """(m,) residual at chart points (m, 2); outside the rectangle of the samples the value at its border."""
        return np.asarray(tensor_rows(self.knots_u, self.knots_s, chart) @ self.coefficients.ravel())


def fit_residual(ring: Ring, radius: Callable[[Floats], Floats], *, stiffness: float | None = None) -> Residual:
    """Fit a plate to the ring and choose its stiffness by leaving out sectors.

    radius     of the turned profile at (k,) values of s, in units of the mean radius that u was made with
    stiffness  ℓ where it was chosen before: nothing is left out then, and `foretold` is 0
    Promises   of all stiffnesses that foretell the ring equally well, but for the scatter between sectors, the
               greatest; a handle or a chip in the ring does not bend the plate.
    """
    knots_u, knots_s = (_knots(column, ring.width) for column in ring.chart.T)
    rows = tensor_rows(knots_u, knots_s, ring.chart)
    energy = _plate_energy(knots_u, knots_s, radius)
    area = np.prod(np.ptp(ring.chart, axis=0))
    lam = STIFFNESS_LENGTHS**4 / area
    weight = _robust_weights(rows, ring, lam[len(lam) // 2] * energy)
    foretold = 0.0
    if stiffness is None:
        missed, scatter = _foretold(rows, ring, weight, [x * energy for x in lam])
        best = int(np.argmin(missed))
        # the one-standard-error rule: what the sectors cannot tell apart is decided for the smoother plate
        chosen = int(np.flatnonzero(missed <= missed[best] + scatter[best])[-1])
        stiffness, foretold = float(STIFFNESS_LENGTHS[chosen]), float(missed[chosen])
    coefficients = _solve(*_normal_equations(rows, ring.distance, weight), stiffness**4 / area * energy)
    shape = (len(knots_u) - 4, len(knots_s) - 4)
    return Residual(knots_u, knots_s, coefficients.reshape(shape), stiffness, foretold)


def _knots(column: Floats, width: float) -> Floats:
    """Spans of a quarter of the ring's width, so that the plate bends freely within it, but not too many of them."""
    low, high = float(column.min()), float(column.max())
    n = int(np.clip(np.ceil((high - low) / (width / 4)), 4, MOST_SPANS))
    return uniform_knots(n + 3, 3, low, high)


def tensor_rows(knots_u: Floats, knots_s: Floats, chart: Floats) -> sparse.csr_array:
    """(m, nu ns) products B_i(u) B_j(s) at chart points (m, 2)."""
    bu, bs = basis_matrix(knots_u, 3, chart[:, 0]), basis_matrix(knots_s, 3, chart[:, 1])
    nu, ns, m = bu.shape[1], bs.shape[1], len(chart)
    column = bu.indices.reshape(m, 4, 1) * ns + bs.indices.reshape(m, 1, 4)
    value = bu.data.reshape(m, 4, 1) * bs.data.reshape(m, 1, 4)
    return sparse.csr_array((value.ravel(), column.ravel(), np.arange(0, 16 * m + 1, 16)), shape=(m, nu * ns))


def _plate_energy(knots_u: Floats, knots_s: Floats, radius: Callable[[Floats], Floats]) -> Floats:
    """(n, n) matrix of ∫ d_xx² + 2 d_xs² + d_ss² dx ds on the turned profile, where x = ρ u and ρ = r(s) / r̄."""
    u, du = _gauss_points(knots_u)
    s, ds = _gauss_points(knots_s)
    rho = radius(s)
    along = [_gram(knots_u, u, du, k) for k in range(3)]
    across = [_gram(knots_s, s, ds * rho**power, k) for k, power in ((2, 1), (1, -1), (0, -3))]
    return np.asarray(sum(c * np.kron(a, b) for c, a, b in zip((1.0, 2.0, 1.0), along, across)))


def _gauss_points(knots: Floats) -> tuple[Floats, Floats]:
    """Two Gauss points a span, and their weights: exact for the product of two second derivatives of cubics."""
    breaks = np.unique(knots)
    half = np.diff(breaks)[:, None] / 2
    points = (breaks[:-1] + breaks[1:])[:, None] / 2 + half * np.array([-1.0, 1.0]) / np.sqrt(3.0)
    return points.ravel(), np.broadcast_to(half, points.shape).ravel()


def _gram(knots: Floats, points: Floats, weight: Floats, derivative: int) -> Floats:
    b = basis_matrix(knots, 3, points, derivative)
    return np.asarray((b.T @ (b * weight[:, None])).todense())


def _normal_equations(rows: sparse.csr_array, distance: Floats, weight: Floats) -> tuple[Floats, Floats]:
    weighted = rows * weight[:, None]
    return np.asarray((rows.T @ weighted).todense()), np.asarray(weighted.T @ distance)


def _solve(matrix: Floats, right: Floats, energy: Floats) -> Floats:
    # the energy of a stiff plate drowns the samples that hold it: a trace of ridge keeps the sum definite in float64
    ridge = (1e-10 * np.trace(matrix) + 1e-13 * np.trace(energy)) / len(matrix)
    return np.asarray(cho_solve(cho_factor(matrix + energy + ridge * np.eye(len(matrix))), right))


def _robust_weights(rows: sparse.csr_array, ring: Ring, energy: Floats) -> Floats:
    """(m,) weights that sum to 1: those of the ring times Tukey's biweight of the distance from a plate."""
    weight = ring.weight / ring.weight.sum()
    for _ in range(ROBUST_ROUNDS):
        fitted = rows @ _solve(*_normal_equations(rows, ring.distance, weight), energy)
        away = np.abs(fitted - ring.distance)
        scale = max(1.4826 * float(np.median(away)), 1e-9)
        weight = ring.weight * np.clip(1.0 - (away / (4.685 * scale)) ** 2, 0.0, None) ** 2
        weight = weight / weight.sum()
    return weight


def _foretold(rows: sparse.csr_array, ring: Ring, weight: Floats, energies: list[Floats]) -> tuple[Floats, Floats]:
    """For every energy the mean distance by which left-out sectors are missed, and the standard error of that mean."""
    away = ring.chart - ring.middle
    sector = (np.arctan2(away[:, 1], away[:, 0]) / (2 * np.pi) * SECTORS).astype(np.int64) % SECTORS
    matrix, right = _normal_equations(rows, ring.distance, weight)
    missed = []
    for k in range(SECTORS):
        out = sector == k
        if weight[out].sum() < 0.01 / SECTORS:
            continue
        less, less_right = _normal_equations(rows[out], ring.distance[out], weight[out])
        fits = np.stack([_solve(matrix - less, right - less_right, energy) for energy in energies], axis=1)
        missed.append(np.average(np.abs(rows[out] @ fits - ring.distance[out, None]), axis=0, weights=weight[out]))
    table = np.array(missed)
    return table.mean(axis=0), table.std(axis=0) / np.sqrt(len(table))

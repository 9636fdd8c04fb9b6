"""The base patch drawn to the measured points around the hole.

The samples lie in a narrow ring along the hole's edge; inside the ring nothing is measured, and a plain fit of the
5 x 5 control points is singular there. The base patch speaks for the inside: what is fitted is the displacement from
it, and the displacement may depart from a quadratic only as far as the samples demand. (A quadratic itself is free: a
ring that knows its heights and slopes determines one, and the base patch is wrong by about that.)

    S     surface; S0 the base patch on knots [0 0 0 0 .5 1 1 1 1] in both directions, the same surface
    p_i   samples, (u_i, v_i) their foot points, n_i the surface's normals there
    D     displacement of the control net,   S = S0 + Σ D_ij N_i(u) N_j(v)
    J(D)  change of bending, ∫∫ |D_uuu|² + 3 |D_uuv|² + 3 |D_uvv|² + |D_vvv|² over the unit square
    w     weight of the prior, found by cross-validation: whole sectors of the ring are left out and foretold

    e     the box's normal; the base patch is a graph over the plane across it
    τ     weight against displacement across e, 0 unless the surface folds or slips from under the samples: then the
          least that prevents it (a displacement along e alone leaves a graph a graph)

          minimise  mean_i (n_i . (S(u_i, v_i) - p_i))² + µ |tangential part|² + w J(D) + τ ∫∫ |D - (D . e) e|²

Paper  [kinoshita], section 3.4 steps 2 and 3; the prior and the choice of its weight are ours.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from itertools import product
from math import comb

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from recon.errors import NoSurface
from recon.geometry.bspline import BSplineSurface
from recon.hole_patch.surroundings import Wall
from recon.numerics.bernstein import cubic_halving
from recon.numerics.bspline_basis import basis_matrix, clamped_knots
from recon.numerics.foot_points import foot_points

__all__ = ["FittedSurface", "edge_samples", "fit_surface", "distances_from", "foot_points"]

Floats = NDArray[np.float64]
SAMPLE_RADIUS = 2.0
HALVED_KNOTS = clamped_knots([0.0, 0.5, 1.0], 3)
ROUNDS = 10
TANGENTIAL = 0.01
SETTLED = 1e-5
SECTORS = 3
DRIFT_WEIGHTS = (0.0, 1e-3, 1e-2, 1e-1, 1e3)
FOLD_GRID = 33
LEAST_FACING = 0.05
PRIOR_WEIGHTS = np.logspace(-8, 0, 17)


@dataclass(frozen=True, eq=False)
class FittedSurface:
    """A surface and how it meets its samples: mean distance in millimetres, number of rounds, weight of the prior."""

    surface: BSplineSurface
    mean_distance: float
    rounds: int
    prior_weight: float


def edge_samples(wall: Wall, *, radius: float = SAMPLE_RADIUS) -> Floats:
    """(m, 3) measured vertices of a wall within `radius` millimetres of a vertex of the hole's edge.

    Paper  [kinoshita], section 3.4 step 2.
    """
    away, _ = cKDTree(wall.edge.points).query(wall.measured.vertices, distance_upper_bound=radius)
    return np.asarray(wall.measured.vertices[away <= radius])


def fit_surface(base: BSplineSurface, samples: Floats, *, acceptance: float = 0.5) -> FittedSurface:
    """Fit a bicubic Bezier patch, split once in each direction, to samples (m, 3) around the hole.

    acceptance  largest mean distance in millimetres
    Promises    of all rounds the surface with the least mean distance; without samples the base patch itself.
    Raises      NoSurface when no round stays within the acceptance.
    Paper       [kinoshita], section 3.4 step 3.
    """
    start = _halved(base)
    if len(samples) == 0:
        return FittedSurface(start, 0.0, 0, float("inf"))
    weight = _prior_weight(start, samples, foot_points(start, samples))
    beside = _n_beside(start, samples)
    for drift in DRIFT_WEIGHTS:
        best = _least_of_rounds(start, samples, weight=weight, drift=drift)
        if not _is_folded(best.surface, start) and _n_beside(best.surface, samples) <= beside:
            break
    if best.mean_distance > acceptance:
        raise NoSurface(
            f"the fitted surface stays {best.mean_distance:.2f} mm (mean) from the {len(samples)} samples around the"
            f" hole, more than the {acceptance:g} mm asked for; loosen the acceptance or check the pose of the sherds."
        )
    return best


def distances_from(surface: BSplineSurface, points: Floats) -> Floats:
    """(m,) distances of points from a surface."""
    return np.asarray(np.linalg.norm(surface.point(foot_points(surface, points)) - points, axis=1))


def _halved(base: BSplineSurface) -> BSplineSurface:
    """The same bicubic patch on knots [0 0 0 0 .5 1 1 1 1] in both directions."""
    halving = cubic_halving()
    net = np.einsum("ai,bj,ijk->abk", halving, halving, base.control_net)
    return BSplineSurface(3, 3, HALVED_KNOTS, HALVED_KNOTS, net)


def _least_of_rounds(start: BSplineSurface, samples: Floats, *, weight: float, drift: float) -> FittedSurface:
    """Foot points and refits in turn until the control net rests; the surface nearest to the samples on the way."""
    prior = weight * np.kron(_energy(3), np.eye(3)) + drift * np.kron(_energy(0), _across(start))
    surface, uv = start, foot_points(start, samples)
    best = FittedSurface(start, float("inf"), 0, weight)
    size = float(np.ptp(start.control_net, axis=(0, 1)).max())
    for rounds in range(ROUNDS):
        mean = float(np.linalg.norm(surface.point(uv) - samples, axis=1).mean())
        if mean < best.mean_distance:
            best = FittedSurface(surface, mean, rounds, weight)
        moved = _refitted(surface, samples, uv, start=start.control_net, prior=prior)
        change = float(np.abs(moved.control_net - surface.control_net).max())
        surface, uv = moved, foot_points(moved, samples, uv, accuracy=SETTLED)
        if change < SETTLED * size:
            break
    return best


def _refitted(surface: BSplineSurface, samples: Floats, uv: Floats, *, start: Floats, prior: Floats) -> BSplineSurface:
    """One weighted least-squares step: all coordinates of the displacement from `start` at once."""
    rows = _tensor_rows(uv)
    n = surface.normal(uv)
    offset = samples - rows @ start.reshape(-1, 3)
    metric = np.einsum("mi,mj->mij", n, n) * (1.0 - TANGENTIAL) + TANGENTIAL * np.eye(3)
    pulled = np.einsum("mij,mj->mi", metric, offset)
    count = rows.shape[1]
    left = np.zeros((count, 3, count, 3))
    for i, j in product(range(3), range(3)):
        left[:, i, :, j] = rows.T @ (metric[:, i, j, None] * rows)
    matrix = left.reshape(3 * count, 3 * count) / len(samples)
    right = (rows.T @ pulled).ravel() / len(samples)
    displacement = np.linalg.solve(matrix + prior + _floor(matrix), right)
    return replace(surface, control_net=start + displacement.reshape(start.shape))


def _is_folded(surface: BSplineSurface, start: BSplineSurface) -> bool:
    """Whether some normal no longer points to the side of the start's rectangle that its own normals do."""
    at = np.linspace(0.0, 1.0, FOLD_GRID)
    uv = np.stack(np.meshgrid(at, at, indexing="ij"), axis=-1).reshape(-1, 2)
    return bool((surface.normal(uv) @ _direction(start)).min() < LEAST_FACING)


def _n_beside(surface: BSplineSurface, samples: Floats) -> int:
    """How many samples have their foot point on the border of the domain: the surface has slipped from under them."""
    uv = foot_points(surface, samples, accuracy=SETTLED)
    return int(((uv <= 0.0) | (uv >= 1.0)).any(axis=1).sum())


def _direction(surface: BSplineSurface) -> Floats:
    """(3,) unit normal of a patch as a whole, from the area of its corner quadrilateral."""
    net = surface.control_net
    area = np.cross(net[-1, -1] - net[0, 0], net[0, -1] - net[-1, 0])
    return np.asarray(area / np.linalg.norm(area))


def _across(surface: BSplineSurface) -> Floats:
    """(3, 3) projection across the patch's direction."""
    e = _direction(surface)
    return np.eye(3) - np.outer(e, e)


def _prior_weight(surface: BSplineSurface, samples: Floats, uv: Floats) -> float:
    """The weight whose displacement, along the normals, best foretells sectors of the ring that it was not given."""
    rows = _tensor_rows(uv)
    offset = np.einsum("mi,mi->m", samples - surface.point(uv), surface.normal(uv))
    errors = np.zeros(len(PRIOR_WEIGHTS))
    for kept in _leaving_out_sectors(uv):
        normal_matrix = rows[kept].T @ rows[kept] / kept.sum()
        right = rows[kept].T @ offset[kept] / kept.sum()
        for k, weight in enumerate(PRIOR_WEIGHTS):
            solved = np.linalg.solve(normal_matrix + weight * _energy(3) + _floor(normal_matrix), right)
            errors[k] += np.abs(rows[~kept] @ solved - offset[~kept]).sum()
    # Of equals the stiffest: without two sectors to compare nothing speaks for a pliant patch.
    return float(PRIOR_WEIGHTS[len(errors) - 1 - int(np.argmin(errors[::-1]))])


def _leaving_out_sectors(uv: Floats) -> Iterator[NDArray[np.bool_]]:
    """(m,) which samples are kept while one third of the ring is left out, for six thirds in turn.

    The middle of a third is about as far from the kept samples as the middle of the hole is from the ring.
    """
    x, y = (uv - uv.mean(axis=0)).T
    turns = SECTORS * (np.arctan2(y, x) / (2.0 * np.pi) + 0.5)
    for phase in (0.0, 0.5):
        sector = np.floor(turns + phase).astype(np.int64) % SECTORS
        for left_out in range(SECTORS):
            kept = sector != left_out
            if kept.any() and not kept.all():
                yield kept


def _tensor_rows(uv: Floats) -> Floats:
    """(m, 25) weights of the control net at parameter pairs."""
    bu, bv = (basis_matrix(HALVED_KNOTS, 3, column).toarray() for column in uv.T)
    return np.einsum("ma,mb->mab", bu, bv).reshape(len(uv), -1)


@cache
def _energy(order: int) -> Floats:
    """(25, 25) quadratic form of a displacement's control values: its squared derivatives of an order over the square.

    Order 3 is J. Exact, by Gauss quadrature in each half.
    """
    nodes, weights = np.polynomial.legendre.leggauss(4)
    at = np.concatenate([(nodes + 1) / 4, (nodes + 3) / 4])
    mass = np.tile(weights / 4, 2)
    rows = [basis_matrix(HALVED_KNOTS, 3, at, k).toarray() for k in range(order + 1)]
    gram = [b.T @ (mass[:, None] * b) for b in rows]
    return sum((comb(order, k) * np.kron(gram[k], gram[order - k]) for k in range(order + 1)), np.zeros((25, 25)))


def _floor(matrix: Floats) -> Floats:
    """The least multiple of the identity that keeps a solve regular where the samples leave even a tilt free."""
    return 1e-10 * float(np.trace(matrix)) / len(matrix) * np.eye(len(matrix))

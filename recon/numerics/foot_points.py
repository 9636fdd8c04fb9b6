"""Foot points: for each given point the nearest point of a parametric surface.

Inside the domain the foot point p* = S(u, v) satisfies (S - p) . S_u = (S - p) . S_v = 0; on its border the same holds
for the direction along the border, and across it the distance may only grow inward.

    S    surface, twice differentiable piecewise
    d    S(u, v) - p
    g    gradient of |d|²/2 by (u, v)
    H    its Hessian; where it is not safely positive, the part of first derivatives alone (Gauss-Newton)

Paper  [piegl1997], section 6.1 (point projection), with a line search and an active set added.
"""

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

__all__ = ["ParametricSurface", "foot_points"]

Floats = NDArray[np.float64]
Domain = tuple[tuple[float, float], tuple[float, float]]
LARGEST_SEED_GRID = 256
MOST_ROUNDS = 60
HALVINGS = 12


class ParametricSurface(Protocol):
    """What is asked of a surface here: a rectangle of parameters, a grid of points, and derivatives to second order."""

    @property
    def domain(self) -> Domain: ...
    def derivative(self, uv: ArrayLike, order_u: int, order_v: int) -> Floats: ...
    def grid(self, u: ArrayLike, v: ArrayLike) -> Floats: ...


def foot_points(
    surface: ParametricSurface,
    points: Floats,
    start: Floats | None = None,
    *,
    seeds: int = 33,
    accuracy: float = 1e-12,
) -> Floats:
    """(m, 2) parameters of the surface point nearest to each of `points` (m, 3), inside the domain.

    start     (m, 2) first guesses; without them the nearest of seeds x seeds points of the surface
    accuracy  length of the last Newton step, as a share of the surface's size
    Promises  the distance never grows from the guess on. A guess that is nearest to another part of a folded surface
              leads to that part.
    Paper     [piegl1997], section 6.1.
    """
    low, high = np.array(surface.domain).T
    points = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    uv = _seeds(surface, points, min(seeds, LARGEST_SEED_GRID)) if start is None else np.clip(start, low, high)
    size = float(np.ptp(surface.grid(np.linspace(low[0], high[0], 5), np.linspace(low[1], high[1], 5)), (0, 1)).max())
    active = np.arange(len(points))
    for _ in range(MOST_ROUNDS):
        if len(active) == 0:
            break
        moved, lengths = _newton_step(surface, points[active], uv[active], low, high)
        uv[active] = moved
        active = active[lengths > accuracy * size]
    return uv


def _seeds(surface: ParametricSurface, points: Floats, count: int) -> Floats:
    (u0, u1), (v0, v1) = surface.domain
    u, v = np.linspace(u0, u1, count), np.linspace(v0, v1, count)
    _, nearest = cKDTree(surface.grid(u, v).reshape(-1, 3)).query(points)
    return np.stack([u[nearest // count], v[nearest % count]], axis=1)


def _newton_step(
    surface: ParametricSurface, points: Floats, uv: Floats, low: Floats, high: Floats
) -> tuple[Floats, Floats]:
    """Parameters after one guarded step, and the length of that step in space."""
    d = surface.derivative(uv, 0, 0) - points
    su, sv = surface.derivative(uv, 1, 0), surface.derivative(uv, 0, 1)
    gradient = np.stack([_dot(d, su), _dot(d, sv)], axis=1)
    hessian = _hessian(surface, uv, d, su, sv)
    held = ((uv <= low) & (gradient > 0)) | ((uv >= high) & (gradient < 0))
    step = _solve(hessian, np.where(held, 0.0, gradient), held)
    moved = _shortened(surface, points, uv, step, low, high, _dot(d, d))
    change = moved - uv
    return moved, np.linalg.norm(su * change[:, :1] + sv * change[:, 1:], axis=1)


def _hessian(surface: ParametricSurface, uv: Floats, d: Floats, su: Floats, sv: Floats) -> Floats:
    first = np.stack([_dot(su, su), _dot(su, sv), _dot(sv, sv)], axis=1)
    second = np.stack([_dot(d, surface.derivative(uv, i, 2 - i)) for i in (2, 1, 0)], axis=1)
    full = first + second
    # The determinant and the trace are those of a matrix scaled by the first derivatives: a pure number decides.
    scaled = full / np.stack([first[:, 0], np.sqrt(first[:, 0] * first[:, 2]), first[:, 2]], axis=1).clip(1e-300)
    positive = (scaled[:, 0] > 1e-3) & (scaled[:, 0] * scaled[:, 2] - scaled[:, 1] ** 2 > 1e-6)
    return np.where(positive[:, None], full, first)


def _solve(hessian: Floats, gradient: Floats, held: NDArray[np.bool_]) -> Floats:
    """Step -H⁻¹ g with the held coordinates left where they are."""
    a, b, c = hessian.T
    a, c = np.where(held[:, 0], 1.0, a), np.where(held[:, 1], 1.0, c)
    b = np.where(held.any(axis=1), 0.0, b)
    determinant = np.maximum(a * c - b * b, 1e-14 * a * c + 1e-300)
    gu, gv = gradient.T
    return np.stack([b * gv - c * gu, b * gu - a * gv], axis=1) / determinant[:, None]


def _shortened(
    surface: ParametricSurface, points: Floats, uv: Floats, step: Floats, low: Floats, high: Floats, now: Floats
) -> Floats:
    """Parameters after the step, halved wherever it would lead farther away."""
    moved = np.clip(uv + step, low, high)
    share = np.ones(len(uv))
    worse = np.arange(len(uv))
    for _ in range(HALVINGS):
        away = surface.derivative(moved[worse], 0, 0) - points[worse]
        worse = worse[_dot(away, away) > now[worse] * (1 + 1e-12) + 1e-26]
        if len(worse) == 0:
            return moved
        share[worse] *= 0.5
        moved[worse] = np.clip(uv[worse] + share[worse, None] * step[worse], low, high)
    moved[worse] = uv[worse]
    return moved


def _dot(a: Floats, b: Floats) -> Floats:
    return np.einsum("ij,ij->i", a, b)

"""Steps 4 and 5, the curve mesh: height and gradient along every edge, from the jets at its ends.

    contour edge   c(t) cubic in plan, z constant,            gradient  s(t) J c'(t)                   s cubic Hermite
    tiling edge    A + t d in plan, z quintic Hermite,        gradient  (z'(t) d + r(t) J d) / |d|^2   r cubic Hermite

Both gradients are polynomials, the same for the two patches on the edge: that is why patches meet G1 exactly.

Paper  [zhang2006], section 4.2, whose boundary curves are cubics; quintics take the Hessian in.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.numerics.bernstein import bernstein, bernstein_derivative
from recon.terrain.second_derivatives import VertexJets
from recon.terrain.slopes import turned_quarter
from recon.terrain.tiling import Tiling

__all__ = ["EdgeFields", "edge_fields", "hermite_quintics"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class EdgeFields:
    """Heights (m, n) and gradients (m, n, 2) at n even parameters along m edges; `place` (E,) finds an edge."""

    height: Floats
    gradient: Floats
    place: NDArray[np.int64]


def edge_fields(tiling: Tiling, jets: VertexJets, n: int, edges: NDArray[np.int64]) -> EdgeFields:
    """Height and gradient at n even parameters of the given edges (m,), in the edges' own direction."""
    t = np.linspace(0.0, 1.0, n)
    height, gradient = _tiling_edges(tiling, jets, t, edges)
    curved = tiling.is_contour[edges]
    height[curved] = jets.height[tiling.edges[edges[curved], 0]][:, None]
    gradient[curved] = _contour_gradients(tiling, jets, t, edges[curved])
    place = np.full(len(tiling.edges), -1)
    place[edges] = np.arange(len(edges))
    return EdgeFields(height, gradient, place)


def _tiling_edges(tiling: Tiling, jets: VertexJets, t: Floats, edges: NDArray[np.int64]) -> tuple[Floats, Floats]:
    i, j = tiling.edges[edges].T
    d = tiling.points[j] - tiling.points[i]
    w = turned_quarter(d)
    ends = [
        (jets.height[k], _dot(jets.gradient[k], d), _form(jets.hessian[k], d, d), _dot(jets.gradient[k], w),
         _form(jets.hessian[k], w, d))
        for k in (i, j)
    ]  # fmt: skip
    z = hermite_quintics(*(end[:3] for end in ends))
    r = _cubic(*(end[3:] for end in ends))
    slope, turn = z @ bernstein_derivative(5, t).T, r @ bernstein(3, t).T
    square = _dot(d, d)[:, None, None]
    gradient = (slope[..., None] * d[:, None] + turn[..., None] * w[:, None]) / square
    return z @ bernstein(5, t).T, gradient


def _contour_gradients(tiling: Tiling, jets: VertexJets, t: Floats, rows: NDArray[np.int64]) -> Floats:
    b = tiling.curves.bezier[tiling.edge_segment[rows]]
    first = (3 * (b[:, 1] - b[:, 0]), 3 * (b[:, 3] - b[:, 2]))
    second = (6 * (b[:, 2] - 2 * b[:, 1] + b[:, 0]), 6 * (b[:, 3] - 2 * b[:, 2] + b[:, 1]))
    ends = []
    for k, c1, c2 in zip(tiling.edges[rows].T, first, second):
        square = _dot(c1, c1)
        left = turned_quarter(c1)
        s = _dot(jets.gradient[k], left) / square
        ends.append((s, (_form(jets.hessian[k], left, c1) - s * _dot(c1, c2)) / square))
    s = _cubic(*ends) @ bernstein(3, t).T
    velocity = np.matmul(bernstein_derivative(3, t), b)
    return s[..., None] * turned_quarter(velocity)


def _dot(a: Floats, b: Floats) -> Floats:
    return np.einsum("...d,...d->...", a, b)


def _form(hessian: Floats, a: Floats, b: Floats) -> Floats:
    return np.einsum("ni,nij,nj->n", a, hessian, b)


def _cubic(start: tuple[Floats, ...], end: tuple[Floats, ...]) -> Floats:
    """(n, 4) Bernstein coefficients of cubics from value and first derivative at both ends."""
    (a, da), (b, db) = start, end
    return np.stack([a, a + da / 3, b - db / 3, b], axis=1)


def hermite_quintics(start: tuple[Floats, ...], end: tuple[Floats, ...]) -> Floats:
    """(n, 6) Bernstein coefficients of quintics from value, first and second derivative at both ends."""
    (a, da, dda), (b, db, ddb) = start, end
    return np.stack([a, a + da / 5, a + 2 * da / 5 + dda / 20, b - 2 * db / 5 + ddb / 20, b - db / 5, b], axis=1)

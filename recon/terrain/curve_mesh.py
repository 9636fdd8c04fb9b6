"""Steps 4 and 5, the curve mesh: height and gradient along every edge, from the jets at its ends.

    contour edge   c(t) cubic in plan, z constant,            gradient  s(t) J c'(t)                   s cubic Hermite
    tiling edge    A + t d in plan, z quintic Hermite,        gradient  (z'(t) d + r(t) J d) / |d|^2   r cubic Hermite

Both gradients are polynomials, the same for the two patches on the edge: that is why patches meet G1 exactly.

Paper  [zhang2006], section 4.2, whose boundary curves are cubics; quintics take the Hessian in.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.numerics.bernstein import bernstein_product, degree_elevation
from recon.terrain.second_derivatives import VertexJets
from recon.terrain.slopes import turned_quarter
from recon.terrain.tiling import Tiling

__all__ = ["EdgeFields", "edge_fields", "hermite_quintics"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class EdgeFields:
    """Bernstein coefficients, of degree 5, of heights (m, 6) and gradients (m, 6, 2) along m edges.

    Heights are counted from that of the edge's first vertex: a ground lies so high that its rounding would tilt the
    tangent planes of narrow patches.

    place  (E,) row of an edge of the tiling, -1 where it has none
    """

    height: Floats
    gradient: Floats
    place: NDArray[np.int64]


def edge_fields(tiling: Tiling, jets: VertexJets, edges: NDArray[np.int64]) -> EdgeFields:
    """Height and gradient along the given edges (m,), in the edges' own direction."""
    height, gradient = _tiling_edges(tiling, jets, edges)
    curved = tiling.is_contour[edges]
    height[curved] = 0.0
    gradient[curved] = _contour_gradients(tiling, jets, edges[curved])
    place = np.full(len(tiling.edges), -1)
    place[edges] = np.arange(len(edges))
    return EdgeFields(height, gradient, place)


def _tiling_edges(tiling: Tiling, jets: VertexJets, edges: NDArray[np.int64]) -> tuple[Floats, Floats]:
    i, j = tiling.edges[edges].T
    d = tiling.points[j] - tiling.points[i]
    w = turned_quarter(d)
    ends = [
        (jets.height[k] - jets.height[i], _dot(jets.gradient[k], d), _form(jets.hessian[k], d, d),
         _dot(jets.gradient[k], w), _form(jets.hessian[k], w, d))
        for k in (i, j)
    ]  # fmt: skip
    z = hermite_quintics(*(end[:3] for end in ends))
    slope = 5 * np.diff(z, axis=1) @ degree_elevation(4, 5).T
    turn = _cubic(*(end[3:] for end in ends)) @ degree_elevation(3, 5).T
    gradient = slope[..., None] * d[:, None] + turn[..., None] * w[:, None]
    return z, gradient / _dot(d, d)[:, None, None]


def _contour_gradients(tiling: Tiling, jets: VertexJets, rows: NDArray[np.int64]) -> Floats:
    """(m, 6, 2) gradients along contour edges.

    Rounding lets the curvatures of short segments that meet differ by so much that the twist at their vertex would not
    be that of its Hessian, and a patch a millimetre wide would lean. The rest is put into the gradient along the
    contour, where it stays what it is: nothing.
    """
    b = tiling.curves.bezier[tiling.edge_segment[rows]]
    first = (3 * (b[:, 1] - b[:, 0]), 3 * (b[:, 3] - b[:, 2]))
    second = (6 * (b[:, 2] - 2 * b[:, 1] + b[:, 0]), 6 * (b[:, 3] - 2 * b[:, 2] + b[:, 1]))
    across, along = [], []
    for k, c1, c2 in zip(tiling.edges[rows].T, first, second):
        square = _dot(c1, c1)
        left = turned_quarter(c1)
        s = _dot(jets.gradient[k], left) / square
        across.append((s, (_form(jets.hessian[k], left, c1) - s * _dot(c1, c2)) / square))
        along.append((0.0 * s, (_form(jets.hessian[k], c1, c1) - s * _dot(c1, turned_quarter(c2))) / square))
    velocity = 3 * np.diff(b, axis=1)
    product = bernstein_product(3, 2)
    across, along = (np.einsum("kij,mi,mjd->mkd", product, _cubic(*ends), velocity) for ends in (across, along))
    return np.asarray(turned_quarter(across) + along)


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

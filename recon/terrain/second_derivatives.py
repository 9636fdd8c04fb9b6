"""Step 5: one symmetric Hessian H at every vertex, so that all patches around it agree in their twists.

Along a contour with tangent T, left normal N, curvature k and slope m (gradient m N):

    T . H T = -m k          z is constant along the contour
    N . H T = m'            the slope's change along the contour
    N . H N                 by least squares from the tiling edges, as are all three at a free vertex:
                            d . H d = 6 D - 4 a - 2 b,  w . H d = w . (g_B - g_A),
                            the longer the edge the more it counts
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.terrain.contour_curves import ContourCurves
from recon.terrain.slopes import VertexSlopes, turned_quarter
from recon.terrain.tiling import Tiling

__all__ = ["VertexJets", "vertex_jets", "contour_frames"]

Floats = NDArray[np.float64]

MOST_BEND = 4.0  # of the rise or slope of any edge at a vertex: the most that its second derivative along it may be
CHANGE = (
    2.0  # of the smaller slope over the longer neighbouring segment: the most that m' may be, so that m stays positive
)


@dataclass(frozen=True, eq=False)
class VertexJets:
    """Second-order jets of the ground at the vertices: heights (V,), gradients (V, 2), Hessians (V, 2, 2)."""

    height: Floats
    gradient: Floats
    hessian: Floats

    @classmethod
    def joined(cls, parts: Sequence["VertexJets"]) -> "VertexJets":
        """The jets of all vertices of several parts."""
        return cls(*(np.concatenate([getattr(p, name) for p in parts]) for name in ("height", "gradient", "hessian")))

    def slopes(self) -> VertexSlopes:
        """Heights and gradients alone."""
        return VertexSlopes(self.height, self.gradient)

    def with_rows(self, rows: NDArray[np.int64], other: "VertexJets") -> "VertexJets":
        """The same jets with those of some vertices replaced."""
        height, gradient, hessian = self.height.copy(), self.gradient.copy(), self.hessian.copy()
        height[rows], gradient[rows], hessian[rows] = other.height, other.gradient, other.hessian
        return VertexJets(height, gradient, hessian)

    def scaled(self, factor: Floats) -> "VertexJets":
        """The same heights with gradient and Hessian scaled by the (V,) factors, which keeps contours contours."""
        return VertexJets(self.height, self.gradient * factor[:, None], self.hessian * factor[:, None, None])


def contour_frames(curves: ContourCurves) -> tuple[Floats, Floats, Floats]:
    """(C, 2) unit tangents, (C, 2) left normals and (C,) signed curvatures at the contours' vertices."""
    first, second = curves.vertex_derivatives()
    speed = np.maximum(np.linalg.norm(first, axis=1), 1e-12)
    tangent = first / speed[:, None]
    curvature = (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / speed**3
    return tangent, turned_quarter(tangent), curvature


def vertex_jets(tiling: Tiling, slopes: VertexSlopes) -> VertexJets:
    """Hessians at all vertices beside the heights and gradients that are known."""
    tangent, normal, curvature = contour_frames(tiling.curves)
    c, v = len(tangent), len(tiling.points)
    slope = np.einsum("ij,ij->i", slopes.gradient[:c], normal)
    frame_t = np.vstack([tangent, np.tile([1.0, 0.0], (v - c, 1))])
    frame_n = turned_quarter(frame_t)
    known = np.zeros((v, 3))
    known[:c, 0] = -slope * curvature
    known[:c, 1] = _change_along(tiling.curves, slope)
    tt, tn, nn = _solved(tiling, slopes, (frame_t, frame_n), known).T
    hessian = (
        tt[:, None, None] * frame_t[:, :, None] * frame_t[:, None, :]
        + tn[:, None, None] * (frame_t[:, :, None] * frame_n[:, None, :] + frame_n[:, :, None] * frame_t[:, None, :])
        + nn[:, None, None] * frame_n[:, :, None] * frame_n[:, None, :]
    )
    gradient = slopes.gradient.copy()
    level = np.flatnonzero(tiling.curves.kinks())
    gradient[level], hessian[level] = 0.0, 0.0
    return VertexJets(slopes.height, gradient, hessian)


def _change_along(curves: ContourCurves, slope: Floats) -> Floats:
    """(C,) derivative of the slope by arc length, from the parabola through a vertex and its two neighbours."""
    length = np.maximum(curves.lengths(), 1e-12)
    rate = (slope[curves.end] - slope[curves.start]) / length
    n = len(slope)
    before, after, way_in, way_out = (np.zeros(n) for _ in range(4))
    before[curves.end], way_in[curves.end] = rate, length
    after[curves.start], way_out[curves.start] = rate, length
    change = (before * way_out + after * way_in) / np.maximum(way_in + way_out, 1e-12)
    ended = (way_in == 0) | (way_out == 0)
    change[ended] = (before + after)[ended]
    most = CHANGE * np.abs(slope) / np.maximum(way_in, way_out)
    return np.clip(change, -most, most)


def _solved(tiling: Tiling, slopes: VertexSlopes, frames: tuple[Floats, Floats], known: Floats) -> Floats:
    """(V, 3) the components TT, TN, NN: the known ones kept at contour vertices, the others by least squares."""
    use = ~tiling.is_contour
    near = tiling.edges[use].ravel()
    far = tiling.edges[use][:, ::-1].ravel()
    d = tiling.points[far] - tiling.points[near]
    change = slopes.gradient[far] - slopes.gradient[near]
    rise = slopes.height[far] - slopes.height[near]
    a = np.einsum("ij,ij->i", slopes.gradient[near], d)
    b = np.einsum("ij,ij->i", slopes.gradient[far], d)
    length = np.linalg.norm(d, axis=1)
    dt = np.einsum("ij,ij->i", d, frames[0][near]) / length
    dn = np.einsum("ij,ij->i", d, frames[1][near]) / length
    rows = np.stack(
        [np.stack([dt * dt, 2 * dt * dn, dn * dn], 1), np.stack([-dn * dt, dt * dt - dn * dn, dt * dn], 1)], 1
    )
    right = np.stack([6 * rise - 4 * a - 2 * b, np.einsum("ij,ij->i", turned_quarter(d), change)], 1)
    right = right / length[:, None] ** 2
    weight = length[:, None] ** 2
    right = right - np.einsum("ekj,ej->ek", rows, known[near])
    n = len(known)
    matrix, vector = np.zeros((n, 3, 3)), np.zeros((n, 3))
    np.add.at(matrix, near, np.einsum("eki,ekj->eij", rows, rows * weight[..., None]))
    np.add.at(vector, near, np.einsum("eki,ek->ei", rows, right * weight))
    c = tiling.curves.n_vertices
    out = known.copy()
    out[:c, 2] = vector[:c, 2] / np.maximum(matrix[:c, 2, 2], 1e-12)
    trace = np.einsum("eii->e", matrix[c:])
    steady = matrix[c:] + np.maximum(1e-3 * trace, 1e-12)[:, None, None] * np.eye(3)
    out[c:] = np.linalg.solve(steady, vector[c:, :, None])[..., 0]
    bend = np.abs(np.einsum("eki,ei->ek", rows, out[near])).max(axis=1) * length**2
    allowed = MOST_BEND * np.maximum(np.maximum(np.abs(a), np.abs(b)), np.abs(rise))
    factor = np.ones(n)
    np.minimum.at(factor, near, allowed / np.maximum(bend, 1e-300))
    factor = np.minimum(factor, 1.0)
    out[:c, 2] *= factor[:c]
    out[c:] *= factor[c:, None]
    return out

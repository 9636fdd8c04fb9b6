"""Step 4, tangents: the slope across the contour at every contour vertex, height and gradient at every free vertex.

    A o------------- d = B - A ------------>o B       a = g_A . d,  b = g_B . d,  w = J d  (J: a quarter turn),
                                                      D = z_B - z_A,  L = |d|,  A_e a third of the area beside the edge

The paper looks at the two nearest midpoints of one vertex; here one sparse least-squares problem weighs all edges:

    tiling edge    sqrt(A_e) / L^2 * ( b - a,  sqrt(3) (2 D - a - b),  g_B . w - g_A . w )
    contour edge   the third alone

The first two are the bending energy of the cubic z along the edge. On a contour the gradient is normal to it, so that
one unknown is left; bounds keep the ground rising to the side where the next contour is higher, no steeper than a
monotone cubic allows [fritsch1980], and free heights between those of the contours around.

Paper  [zhang2006], section 4.2, equation (1).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import LinearOperator, cg

from recon.terrain.levels import Levels
from recon.terrain.tiling import Tiling

__all__ = ["VertexSlopes", "vertex_slopes", "edge_areas", "turned_quarter"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

STEEPEST = 3.0  # times the mean slope of an edge: beyond it a cubic overshoots
ACTIVE_SETS = 8
ACCURACY = 1e-7


@dataclass(frozen=True, eq=False)
class VertexSlopes:
    """First-order jets of the ground at the vertices of a tiling: heights (V,), gradients (V, 2)."""

    height: Floats
    gradient: Floats


def turned_quarter(vectors: Floats) -> Floats:
    """The (..., 2) vectors turned to the left by a quarter."""
    return np.stack([-vectors[..., 1], vectors[..., 0]], axis=-1)


def edge_areas(tiling: Tiling) -> Floats:
    """(E,) a third of the area of the triangles beside every edge."""
    p = tiling.points[tiling.triangles]
    a, b = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
    area = np.r_[np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / 2, 0.0]
    return area[tiling.edge_faces].sum(axis=1) / 3


def vertex_slopes(tiling: Tiling, normals: Floats, limits: Levels) -> VertexSlopes:
    """Heights and gradients at all vertices.

    normals   (C, 2) unit normals of the contours at their vertices, to the left
    Paper     [zhang2006], section 4.2.
    """
    prolong, offset = _unknowns(tiling, normals)
    rows = _rows(tiling)
    matrix = sparse.csr_array(rows @ prolong)
    right = -matrix.T @ (rows @ offset)
    x = _bounded(sparse.csr_array(matrix.T @ matrix), right, *_bounds(tiling, normals, limits))
    jets = (prolong @ x + offset).reshape(-1, 3)
    return VertexSlopes(jets[:, 0], _tamed(tiling, jets[:, 0], jets[:, 1:]))


def _tamed(tiling: Tiling, height: Floats, gradient: Floats) -> Floats:
    """(V, 2) gradients no steeper than STEEPEST times the steepest edge at the vertex."""
    i, j = tiling.edges.T
    mean = np.abs(height[j] - height[i]) / np.linalg.norm(tiling.points[j] - tiling.points[i], axis=1)
    most = np.zeros(len(height))
    np.maximum.at(most, tiling.edges.ravel(), np.repeat(STEEPEST * mean, 2))
    size = np.maximum(np.linalg.norm(gradient, axis=1), 1e-300)
    return gradient * np.minimum(most / size, 1.0)[:, None]


def _unknowns(tiling: Tiling, normals: Floats) -> tuple[sparse.csr_array, Floats]:
    """(3 V, n) matrix and (3 V,) offset from the unknowns to (z, g_x, g_y) of all vertices."""
    c, v = len(normals), len(tiling.points)
    known = np.arange(c)
    free = np.arange(3 * c, 3 * v)
    rows = np.r_[3 * known + 1, 3 * known + 2, free]
    columns = np.r_[known, known, np.arange(c, c + 3 * (v - c))]
    values = np.r_[normals[:, 0], normals[:, 1], np.ones(len(free))]
    offset = np.zeros(3 * v)
    offset[3 * known] = tiling.vertex_heights()[:c]
    return sparse.csr_array((values, (rows, columns)), shape=(3 * v, c + 3 * (v - c))), offset


def _rows(tiling: Tiling) -> sparse.csr_array:
    """(3 E, 3 V) the rows of the module's drawing."""
    i, j = tiling.edges.T
    d = tiling.points[j] - tiling.points[i]
    w = turned_quarter(d)
    length = np.linalg.norm(d, axis=1)
    weight = np.sqrt(edge_areas(tiling)) / length**2
    along = np.where(tiling.is_contour, 0.0, weight)
    root = np.sqrt(3.0) * along
    e = 3 * np.arange(len(d))
    entries = [
        (e, 3 * j + 1, along * d[:, 0]), (e, 3 * j + 2, along * d[:, 1]),
        (e, 3 * i + 1, -along * d[:, 0]), (e, 3 * i + 2, -along * d[:, 1]),
        (e + 1, 3 * j, 2 * root), (e + 1, 3 * i, -2 * root),
        (e + 1, 3 * i + 1, -root * d[:, 0]), (e + 1, 3 * i + 2, -root * d[:, 1]),
        (e + 1, 3 * j + 1, -root * d[:, 0]), (e + 1, 3 * j + 2, -root * d[:, 1]),
        (e + 2, 3 * j + 1, weight * w[:, 0]), (e + 2, 3 * j + 2, weight * w[:, 1]),
        (e + 2, 3 * i + 1, -weight * w[:, 0]), (e + 2, 3 * i + 2, -weight * w[:, 1]),
    ]  # fmt: skip
    row, column, value = (np.concatenate(part) for part in zip(*entries))
    return sparse.csr_array((value, (row, column)), shape=(3 * len(d), 3 * len(tiling.points)))


def _bounds(tiling: Tiling, normals: Floats, limits: Levels) -> tuple[Floats, Floats]:
    """(n,) least and greatest value of every unknown."""
    c, v = len(normals), len(tiling.points)
    steepest = _steepest(tiling, normals)
    low = np.r_[np.where(limits.uphill > 0, 0.0, -steepest), np.full(3 * (v - c), -np.inf)]
    high = np.r_[np.where(limits.uphill < 0, 0.0, steepest), np.full(3 * (v - c), np.inf)]
    least, most = np.full(v, -np.inf), np.full(v, np.inf)
    np.maximum.at(least, tiling.triangles.ravel(), np.repeat(limits.low[limits.strip], 3))
    np.minimum.at(most, tiling.triangles.ravel(), np.repeat(limits.high[limits.strip], 3))
    low[c::3], high[c::3] = least[c:], most[c:]
    return low, high


def _steepest(tiling: Tiling, normals: Floats) -> Floats:
    """(C,) greatest slope at a contour vertex for which no tiling edge to another height has to overshoot."""
    z = tiling.vertex_heights()
    most = np.full(len(normals), np.inf)
    for near, far in ((0, 1), (1, 0)):
        i, j = tiling.edges[:, near], tiling.edges[:, far]
        used = (i < len(normals)) & (j < len(normals)) & ~tiling.is_contour
        i, j = i[used], j[used]
        run = np.abs(np.einsum("ij,ij->i", normals[i], tiling.points[j] - tiling.points[i]))
        rise = np.abs(z[j] - z[i])
        steep = (rise > 0) & (run > 0)
        np.minimum.at(most, i[steep], STEEPEST * rise[steep] / run[steep])
    return most


def _bounded(matrix: sparse.csr_array, right: Floats, low: Floats, high: Floats) -> Floats:
    """(n,) least-squares solution between bounds: unknowns beyond a bound are held there until they pull back."""
    diagonal = np.maximum(matrix.diagonal(), 1e-300)
    x = np.zeros(len(right))
    held = np.zeros(len(right), dtype=bool)
    for _ in range(ACTIVE_SETS):
        free = np.flatnonzero(~held)
        rows = matrix[free]
        inner = rows[:, free]
        target = right[free] - rows @ np.where(held, x, 0.0)
        scale = LinearOperator(inner.shape, matvec=lambda r, d=diagonal[free]: r / d)
        x[free], _ = cg(inner, target, x0=x[free], M=scale, rtol=ACCURACY, maxiter=2000)
        outside = (x < low) | (x > high)
        x = np.clip(x, low, high)
        pull = right - matrix @ x
        back = held & np.where(x <= low, pull > 0, pull < 0)
        if not outside.any() and not back.any():
            break
        held = (held | outside) & ~back
    return x

"""Step 4, tangents: the slope across the contour at every contour vertex, height and gradient at every free vertex.

The paper looks at the two nearest midpoints of one vertex. Here all slopes are found at once, as those of the ground
that bends least: a plate of triangles (`recon.numerics.plate_triangles`), on a contour of known height, with a
gradient normal to it, so that one unknown is left there, and three at a free vertex.

    minimise  sum over triangles of  A k^2 / sqrt(1 + (k_before / median of k_before)^2),    k the triangle's curvature

The weights make it nearly an integral of k itself: ground is bent little in most places and sharply along few lines,
where a plate, which spreads its bending, would overshoot. Bounds keep the ground rising to the side where the next
contour is higher, no steeper than a monotone cubic allows [fritsch1980], and free heights between those around.

Paper  [zhang2006], section 4.2, equation (1).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from recon.numerics.plate_triangles import bending_rows
from recon.numerics.tiled_solver import TiledSolver, plane_tiles
from recon.terrain.levels import Levels
from recon.terrain.tiling import Tiling

__all__ = ["VertexSlopes", "vertex_slopes", "triangle_areas", "turned_quarter"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

STEEPEST = 3.0  # times the mean slope of an edge: beyond it a cubic overshoots
ACTIVE_SETS = 8
REWEIGHTINGS = 4
ACCURACY, ROUGH = 1e-7, 1e-4  # of the last solution, and of those that only give weights
TILE = 1500  # unknowns of a tile


@dataclass(frozen=True, eq=False)
class VertexSlopes:
    """First-order jets of the ground at the vertices of a tiling: heights (V,), gradients (V, 2)."""

    height: Floats
    gradient: Floats


def turned_quarter(vectors: Floats) -> Floats:
    """The (..., 2) vectors turned to the left by a quarter."""
    return np.stack([-vectors[..., 1], vectors[..., 0]], axis=-1)


def vertex_slopes(tiling: Tiling, normals: Floats, limits: Levels, told: tuple[Ints, VertexSlopes]) -> VertexSlopes:
    """Heights and gradients at all vertices.

    normals   (C, 2) unit normals of the contours at their vertices, to the left
    told      some vertices, and the jets that they have
    Paper     [zhang2006], section 4.2.
    """
    prolong, offset = _unknowns(tiling, normals, limits)
    rows = _rows(tiling)
    bounds = _held(_bounds(tiling, normals, limits), normals, offset, told)
    owner = np.r_[np.arange(len(normals)), np.repeat(np.arange(len(normals), len(tiling.points)), 3)]
    tiles = plane_tiles(tiling.points[owner], TILE)
    root_area = np.sqrt(triangle_areas(tiling))
    x, weight = np.zeros(len(owner)), np.ones(len(tiling.triangles))
    for turn in range(REWEIGHTINGS):
        accuracy = ACCURACY if turn == REWEIGHTINGS - 1 else ROUGH
        system = _system(rows, weight, prolong, offset)
        x = _bounded(TiledSolver(system[0], tiles), system, x, bounds, accuracy)
        bend = np.linalg.norm((rows @ (prolong @ x + offset)).reshape(-1, 9), axis=1) / root_area
        weight = (1 + (bend / max(float(np.median(bend)), 1e-300)) ** 2) ** -0.25
    jets = (prolong @ x + offset).reshape(-1, 3)
    return VertexSlopes(jets[:, 0], jets[:, 1:])


def triangle_areas(tiling: Tiling) -> Floats:
    """(F,) areas of the triangles."""
    p = tiling.points[tiling.triangles]
    a, b = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
    return np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / 2


def _unknowns(tiling: Tiling, normals: Floats, limits: Levels) -> tuple[sparse.csr_array, Floats]:
    """(3 V, n) matrix and (3 V,) offset from the unknowns to (z, g_x, g_y) of all vertices.

    Free heights are counted from the middle of their strip.
    """
    c, v = len(normals), len(tiling.points)
    known = np.arange(c)
    free = np.arange(3 * c, 3 * v)
    rows = np.r_[3 * known + 1, 3 * known + 2, free]
    columns = np.r_[known, known, np.arange(c, c + 3 * (v - c))]
    values = np.r_[normals[:, 0], normals[:, 1], np.ones(len(free))]
    offset = np.zeros(3 * v)
    low, high = _free_heights(tiling, limits)
    offset[::3] = (low + high) / 2
    offset[3 * known] = tiling.vertex_heights()[:c]
    return sparse.csr_array((values, (rows, columns)), shape=(3 * v, c + 3 * (v - c))), offset


def _rows(tiling: Tiling) -> sparse.csr_array:
    """(9 F, 3 V) rows whose squares sum up to the bending energy."""
    corners = tiling.triangles
    values = bending_rows(tiling.points[corners])
    columns = np.repeat((3 * corners[:, :, None] + np.arange(3)).reshape(len(corners), 1, 9), 9, axis=1)
    pointer = np.arange(0, values.size + 1, 9)
    shape = (9 * len(corners), 3 * len(tiling.points))
    return sparse.csr_array((values.ravel(), columns.ravel(), pointer), shape=shape)


def _system(
    rows: sparse.csr_array, weight: Floats, prolong: sparse.csr_array, offset: Floats
) -> tuple[sparse.csr_array, Floats]:
    """(n, n) normal matrix of the weighted rows in the unknowns, and the (n,) right-hand side."""
    weighted = sparse.csr_array((rows.data * np.repeat(weight, 81), rows.indices, rows.indptr), rows.shape)
    right = weighted @ offset
    weighted = sparse.csr_array(weighted @ prolong)
    return sparse.csr_array(weighted.T @ weighted), -weighted.T @ right


def _bounds(tiling: Tiling, normals: Floats, limits: Levels) -> tuple[Floats, Floats]:
    """(n,) least and greatest value of every unknown."""
    c, v = len(normals), len(tiling.points)
    steepest = _steepest(tiling, normals)
    low = np.r_[np.where(limits.uphill > 0, 0.0, -steepest), np.full(3 * (v - c), -np.inf)]
    high = np.r_[np.where(limits.uphill < 0, 0.0, steepest), np.full(3 * (v - c), np.inf)]
    least, most = _free_heights(tiling, limits)
    low[c::3], high[c::3] = (least - most)[c:] / 2, (most - least)[c:] / 2
    return low, high


def _held(
    bounds: tuple[Floats, Floats], normals: Floats, offset: Floats, told: tuple[Ints, VertexSlopes]
) -> tuple[Floats, Floats]:
    """The bounds, with both the same where the jet of a vertex is told."""
    vertices, jets = told
    low, high = bounds[0].copy(), bounds[1].copy()
    c = len(normals)
    met, free = vertices < c, vertices >= c
    on = vertices[met]
    low[on] = high[on] = np.einsum("ij,ij->i", jets.gradient[met], normals[on])
    first = c + 3 * (vertices[free] - c)
    low[first] = high[first] = jets.height[free] - offset[3 * vertices[free]]
    for k in (0, 1):
        low[first + 1 + k] = high[first + 1 + k] = jets.gradient[free, k]
    return low, high


def _free_heights(tiling: Tiling, limits: Levels) -> tuple[Floats, Floats]:
    """(V,) least and greatest height that a free vertex at each place may have: that of a spot where there is one."""
    least, most = np.full(len(tiling.points), -np.inf), np.full(len(tiling.points), np.inf)
    np.maximum.at(least, tiling.triangles.ravel(), np.repeat(limits.low[limits.strip], 3))
    np.minimum.at(most, tiling.triangles.ravel(), np.repeat(limits.high[limits.strip], 3))
    spots = slice(len(least) - len(tiling.spots), None)
    least[spots] = most[spots] = tiling.spots[:, 2]
    return least, most


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


def _bounded(
    solver: TiledSolver,
    system: tuple[sparse.csr_array, Floats],
    start: Floats,
    bounds: tuple[Floats, Floats],
    accuracy: float,
) -> Floats:
    """(n,) least-squares solution between bounds: unknowns beyond a bound are held there until they pull back."""
    (matrix, right), (low, high) = system, bounds
    x = np.clip(start, low, high)
    held = (x == low) | (x == high)
    for _ in range(ACTIVE_SETS):
        x = solver.solve(right, x, ~held, accuracy)
        outside = (x < low) | (x > high)
        x = np.clip(x, low, high)
        pull = right - matrix @ x
        back = held & (low < high) & np.where(x <= low, pull > 0, pull < 0)
        if not outside.any() and not back.any():
            break
        held = (held | outside) & ~back
    return x

"""What keeps a control net in order: energy where no data hold it, and an eye on folds that the scan does not have.

The surface is drawn with two cells a span in each direction. Where data lie in a cell, or around it, neighbouring
triangles are not to face opposite ways; elsewhere the surface is cut away, and the energy alone keeps it smooth.

Energy  squares of second differences of the control points over their abscissae, and of mixed ones: a thin plate
"""

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, sparse

from recon.geometric_fit.scan_data import FOLD, ScanData
from recon.geometric_fit.spline_space import SplineSpace
from recon.geometric_fit.tensor_space import TensorSpace, net_rows
from recon.geometry.mesh import TriangleMesh
from recon.numerics.bspline_basis import greville
from recon.numerics.halfedges import edge_table

__all__ = ["NetEnergy", "NetGuards", "drawn_net", "net_means"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

CELLS = 2  # a span
HELD = 0.1  # share of a control point in a corner of a folded triangle from which on it is held
SAME_PLACE = 0.01  # of the diagonal: a fold of the scan so near excuses one of the surface
NEARBY = 2  # cells without data that are covered all the same, between others


def drawn_net(space: TensorSpace, net: Floats, uv: Floats, cells: int) -> TriangleMesh:
    """The surface in triangles, CELLS times so many a span, where places (n, 2) lie in the span or around it."""
    coarse = cell_grid(space.u), cell_grid(space.v)
    u, v = cell_grid(space.u, CELLS * cells), cell_grid(space.v, CELLS * cells)
    covered = np.zeros((len(u), len(v)), dtype=bool)
    covered[:-1, :-1] = np.kron(_covered(space, coarse, uv)[:-1, :-1], np.ones((cells, cells), dtype=bool))
    triangles = _cell_triangles(covered)
    used, renumbered = np.unique(triangles, return_inverse=True)
    return TriangleMesh(space.grid(net, u, v).reshape(-1, 3)[used], renumbered.reshape(-1, 3), "surface")


def cell_grid(space: SplineSpace, cells: int = CELLS) -> Floats:
    """(m,) parameters at which the surface is drawn, both ends included."""
    share = np.arange(cells) / cells
    inner = (space.breaks[:-1, None] + share * np.diff(space.breaks)[:, None]).ravel()
    return np.append(inner, space.breaks[-1])


class NetGuards:
    """Folds of the surfaces of one space; what depends on the space and the data alone is made once."""

    def __init__(self, space: TensorSpace, weights: Floats, scan: ScanData, uv: Floats) -> None:
        u, v = cell_grid(space.u), cell_grid(space.v)
        self._scan, self._shape = scan, space.shape
        at = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
        net = np.concatenate([np.zeros((*weights.shape, 3)), weights[..., None]], axis=2)
        self._to_corners = net_rows(space, net, at).matrix(space.n_control)
        self._triangles = _cell_triangles(_covered(space, (u, v), uv))
        table = edge_table(self._triangles)
        edge, self._one, self._two = table.face_pairs()
        self._ends = table.edges[edge]

    def folded(self, control_points: Floats) -> Bools:
        """(V,) the control points around a fold that the scan does not have."""
        corners = self._to_corners @ control_points
        a, b, c = corners[self._triangles].transpose(1, 0, 2)
        normal = np.cross(b - a, c - a)
        turned = np.flatnonzero(np.einsum("ij,ij->i", normal[self._one], normal[self._two]) < FOLD)
        if len(self._scan.folds) and len(turned):
            middle = corners[self._ends[turned]].mean(axis=1)
            turned = turned[self._scan.fold_tree.query(middle)[0] > SAME_PLACE * self._scan.diagonal]
        folded = np.zeros(len(control_points), dtype=bool)
        rows = self._to_corners[np.unique(self._triangles[np.concatenate([self._one[turned], self._two[turned]])])]
        folded[rows.indices[rows.data > HELD]] = True
        return folded

    def widened(self, control_points: Bools) -> Bools:
        """(V,) these control points and those beside them."""
        wide = ndimage.binary_dilation(control_points.reshape(self._shape), np.ones((3, 3)))
        return np.asarray(wide).ravel()


def _cell_triangles(covered: Bools) -> Ints:
    """(F, 3) two triangles in every cell whose lower corner is marked."""
    n, m = covered.shape
    corner = np.arange(n * m).reshape(n, m)[covered]
    a, b, c, d = corner, corner + m, corner + m + 1, corner + 1
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def _covered(space: TensorSpace, grid: tuple[Floats, Floats], uv: Floats) -> Bools:
    """(len(u), len(v)) lower corners of the cells with data in or around them."""
    u, v = grid
    covered = np.zeros((len(u), len(v)), dtype=bool)
    if space.u.periodic:  # nothing of such a surface is cut away but holes
        covered[:-1, :-1] = True
        return covered
    at = space.within(uv)
    cell = [np.clip(np.searchsorted(g, x, side="right") - 1, 0, len(g) - 2) for g, x in zip(grid, at.T)]
    filled = np.zeros((len(u) - 1, len(v) - 1), dtype=bool)
    filled[cell[0], cell[1]] = True
    near = np.pad(filled, NEARBY)
    for number in range(2 * NEARBY):
        near = _beside(near, np.logical_or if number < NEARBY else np.logical_and)
    near = near[NEARBY:-NEARBY, NEARBY:-NEARBY]
    covered[:-1, :-1] = near | filled
    return covered


def _beside(cells: Bools, find: np.ufunc) -> Bools:
    """Whether any (or), or all (and), of a cell and its eight neighbours are marked."""
    wide = np.pad(cells, 1, mode="constant")
    n, m = cells.shape
    return np.asarray(find.reduce([wide[i : i + n, j : j + m] for i in range(3) for j in range(3)]))


def net_means(space: TensorSpace) -> sparse.csr_array:
    """(V, V) mean of the neighbours of every control point in both directions."""
    (nu, nv), ones = space.shape, [sparse.eye_array(n, format="csr") for n in space.shape]
    links = sparse.kron(_links(nu, space.u.periodic), ones[1]) + sparse.kron(ones[0], _links(nv, space.v.periodic))
    return sparse.csr_array(sparse.diags_array(1.0 / np.asarray(links.sum(axis=1)).ravel()) @ links)


def _links(n: int, periodic: bool) -> sparse.csr_array:
    first = np.arange(n if periodic else n - 1)
    one_way = sparse.coo_array((np.ones(len(first)), (first, (first + 1) % n)), shape=(n, n)).tocsr()
    return sparse.csr_array(one_way + one_way.T)


class NetEnergy:
    """The thin plate of one space; how stiff it is at each control point may change."""

    def __init__(self, space: TensorSpace) -> None:
        (nu, nv), ones = space.shape, [sparse.eye_array(n, format="csr") for n in space.shape]
        bend_u, bend_v = _bends(space.u), _bends(space.v)
        slope_u, slope_v = _slopes(space.u), _slopes(space.v)
        parts = [
            (sparse.kron(bend_u, ones[1]), _owners(bend_u, np.arange(nv), nv, along_u=True)),
            (sparse.kron(ones[0], bend_v), _owners(bend_v, np.arange(nu), nv, along_u=False)),
            (np.sqrt(2.0) * sparse.kron(slope_u, slope_v), _crossed(slope_u, slope_v, nv)),
        ]
        self._rows = sparse.csr_array(sparse.vstack([rows for rows, _ in parts]))
        self._owner = np.concatenate([owner for _, owner in parts])

    def matrix(self, stiffness: Floats) -> sparse.csr_array:
        """(V, V) energy for a stiffness (V,) at every control point."""
        scaled = sparse.diags_array(np.sqrt(stiffness[self._owner])) @ self._rows
        return sparse.csr_array(scaled.T @ scaled)


def _owners(bends: sparse.csr_array, others: Ints, nv: int, *, along_u: bool) -> Ints:
    middle = bends.indices.reshape(-1, 3)[:, 1].astype(np.int64)
    return (middle[:, None] * nv + others).ravel() if along_u else (others[:, None] * nv + middle).ravel()


def _crossed(slope_u: sparse.csr_array, slope_v: sparse.csr_array, nv: int) -> Ints:
    one, two = (slope.indices.reshape(-1, 2)[:, 0].astype(np.int64) for slope in (slope_u, slope_v))
    return (one[:, None] * nv + two).ravel()


def _gaps(space: SplineSpace) -> Floats:
    """(n,) or (n - 1,) ways between neighbouring abscissae; around the seam where there is one."""
    at = greville(space.knots, space.degree)
    if not space.periodic:
        return np.diff(at)
    at = at[: space.n_control]
    return np.diff(np.append(at, at[0] + space.breaks[-1] - space.breaks[0]))


def _bends(space: SplineSpace) -> sparse.csr_array:
    """Second differences of neighbouring control points, in units of the way between them."""
    n, gaps = space.n_control, _gaps(space)
    middle = np.arange(n) if space.periodic else np.arange(1, n - 1)
    before, after = gaps[middle - 1], gaps[middle]
    mean = 0.5 * (before + after)
    values = np.stack([mean / before, -mean / before - mean / after, mean / after], axis=1)
    columns = np.stack([middle - 1, middle, middle + 1], axis=1) % n
    return _in_rows(columns, values, n)


def _slopes(space: SplineSpace) -> sparse.csr_array:
    n, gaps = space.n_control, _gaps(space)
    first = np.arange(len(gaps))
    scale = gaps.mean() / gaps
    return _in_rows(np.stack([first, first + 1], axis=1) % n, np.stack([-scale, scale], axis=1), n)


def _in_rows(columns: Ints, values: Floats, n: int) -> sparse.csr_array:
    """Rows with the entries in the order given, so that they can be told by their place."""
    starts = np.arange(0, columns.size + 1, columns.shape[1])
    return sparse.csr_array((values.ravel(), columns.ravel(), starts), shape=(len(columns), n))

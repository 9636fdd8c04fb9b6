"""What keeps a fit honest where no data point looks: surface that strays from the scan, and surface that folds.

The error from the data to the surface says nothing about surface that is nearest to no data point. Two guards do:

    stray  a sample of the surface farther from the scan than the fit is elsewhere becomes a data point of its own:
           it wants to come to the nearest point of the scan
    fold   two triangles of the tessellation more than 90 degrees apart where the scan has no such edge: the control
           points around are made stiffer, until the fold is gone
"""

from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from recon.geometric_fit.foot_points import Feet, sample_places
from recon.geometric_fit.scan_data import FOLD, ScanData
from recon.geometric_fit.tangent_distance import basis_rows
from recon.geometry.control_mesh import ControlMesh
from recon.numerics.face_loops import turned_pairs
from recon.numerics.halfedges import edge_table
from recon.subdivision.evaluation import points_at
from recon.subdivision.limit_surface import LimitPatches, tessellation_places

__all__ = ["Guards", "Strays", "fairness", "neighbour_means"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

SAME_PLACE = 0.005  # share of the diagonal within which a fold of the scan excuses a fold of the surface
CREASE_FOLD = np.cos(np.radians(120.0))  # across a crease, where a right angle is as it should be
HELD = 0.05  # weight in a fold from which on a control point is one of those that make it


class Strays(NamedTuple):
    """Samples of the surface that are too far from the scan.

    feet     where they are; `normals` point to the targets
    targets  (m, 3) the scan points they should come to
    """

    feet: Feet
    targets: Floats


class Guards:
    """Both guards for one control mesh; what depends on its connections alone is made once."""

    def __init__(self, mesh: ControlMesh, patches: LimitPatches, scan: ScanData) -> None:
        self._mesh, self._patches, self._scan, self._n_control = mesh, patches, scan, mesh.n_vertices
        self._samples = sample_places(patches)
        patch, v, w, triangles = tessellation_places(patches.sheets, 1)
        to_corners = basis_rows(patches, _feet_at(patch, v, w)).matrix(self._n_control)
        apart = triangles
        if len(mesh.crease_edges):
            to_corners, triangles = _welded(to_corners, triangles)
        self._to_corners = to_corners
        table = edge_table(triangles)
        self._triangles = triangles.astype(np.int32)
        edge, self._one, self._two = (x.astype(np.int32) for x in table.face_pairs())
        self._ends = table.edges.astype(np.int32)[edge]
        self._limit = np.full(len(edge), FOLD)
        if len(mesh.crease_edges):
            self._limit[_n_common(apart[self._one], apart[self._two]) < 2] = CREASE_FOLD

    @cached_property
    def _around(self) -> sparse.csr_array:
        """(V, V) which control points share a face."""
        mesh = self._mesh
        ones = np.ones(len(mesh.face_corners))
        incidence = sparse.csr_array((ones, mesh.face_corners, mesh.face_starts), shape=(mesh.n_faces, mesh.n_vertices))
        return sparse.csr_array(incidence.T @ incidence)

    def strays(self, control_points: Floats, allowed: float) -> Strays:
        """The samples of the surface that are farther from the scan than `allowed`, a length."""
        scan, patches, (patch, v, w) = self._scan, self._patches, self._samples
        places = points_at(patches.arrays, patches.points @ control_points, patch, v, w, 1)[:, 0]
        distance, nearest = scan.tree.query(places)
        away = places - scan.points[nearest]
        height = np.abs(np.einsum("ij,ij->i", away, scan.normals[nearest]))
        # the height over the nearest point's plane is a first guess; far beside that point it says little
        beside = distance**2 - height**2 > 9.0 * np.median(distance) ** 2
        far = np.flatnonzero((height > allowed) | (beside & (distance > allowed)))
        target, _face = scan.nearest_on_triangles_at(places[far], nearest[far])
        off = np.linalg.norm(places[far] - target, axis=1) > allowed
        far, target = far[off], target[off]
        # not the normals of the scan: beyond its border the way back is along them
        normals = target - places[far]
        normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
        return Strays(Feet(patch[far], v[far], w[far], places[far], normals), target)

    def folded(self, control_points: Floats) -> Bools:
        """(V,) the control points of faces with a fold that the scan does not have."""
        corners = self._to_corners @ control_points
        turned = turned_pairs(corners, self._triangles, self._one, self._two, self._limit)
        if len(self._scan.folds) and len(turned):
            middle = corners[self._ends[turned]].mean(axis=1)
            turned = turned[self._scan.fold_tree.query(middle)[0] > SAME_PLACE * self._scan.diagonal]
        folded = np.zeros(self._n_control, dtype=bool)
        rows = self._to_corners[np.unique(self._triangles[np.concatenate([self._one[turned], self._two[turned]])])]
        folded[rows.indices[rows.data > HELD]] = True
        return folded

    def widened(self, control_points: Bools) -> Bools:
        """(V,) these control points and all that share a face with one."""
        return control_points | (self._around @ control_points.astype(np.float64) > 0.0)


def _welded(rows: sparse.csr_array, triangles: Ints) -> tuple[sparse.csr_array, Ints]:
    """The places that `rows` stand for with those on both sides of a crease made one, and the triangles over them.

    The two sides of a crease are known by their weights, which are alike.
    """
    mark = rows @ np.random.default_rng(0).random(rows.shape[1])
    _, first, place = np.unique(np.round(mark, 10), return_index=True, return_inverse=True)
    return sparse.csr_array(rows[first]), place.ravel()[triangles]


def _n_common(one: Ints, two: Ints) -> Ints:
    """(n,) how many corners the triangles (n, 3) have in common."""
    return np.asarray((one[:, :, None] == two[:, None, :]).sum(axis=(1, 2)))


def _feet_at(patch: Ints, v: Floats, w: Floats) -> Feet:
    nowhere = np.empty((len(patch), 3))
    return Feet(patch, v, w, nowhere, nowhere)


def fairness(mesh: ControlMesh, stiffness: Floats) -> sparse.csr_array:
    """(V, V) energy of the control mesh: each point's distance from its neighbours' mean, squared, times stiffness."""
    umbrella = sparse.csr_array(neighbour_means(mesh) - sparse.eye_array(mesh.n_vertices))
    return sparse.csr_array(umbrella.T @ sparse.diags_array(stiffness) @ umbrella)


def neighbour_means(mesh: ControlMesh) -> sparse.csr_array:
    """(V, V) mean of the neighbours of each control point, on creases and borders of those along them, but at the end
    of a crease inside the surface of all.

    Corners of a border stay, unless there are creases, too: at those the means make a way out of folds.
    """
    faces, n = mesh.faces_of(int(mesh.face_starts[1])), mesh.n_vertices
    table = edge_table(faces)
    creases = np.sort(mesh.crease_edges, axis=1)
    edges = table.edges
    sharp = (table.uses == 1) | np.isin(edges[:, 0] * n + edges[:, 1], creases[:, 0] * n + creases[:, 1])
    on_sharp = np.bincount(edges[sharp].ravel(), minlength=n) > 1
    start, end = np.concatenate([edges, edges[:, ::-1]]).T
    is_corner = np.zeros(n, dtype=bool)
    corners = mesh.corner_vertices if len(creases) == 0 else mesh.corner_vertices[:0]
    is_corner[corners] = True
    counts = ~is_corner[start] & (~on_sharp[start] | np.tile(sharp, 2))
    start, end = (np.concatenate([part[counts], corners]) for part in (start, end))
    links = sparse.csr_array(sparse.coo_array((np.ones(len(start)), (start, end)), shape=(n, n)))
    degree = np.asarray(links.sum(axis=1)).ravel()
    return sparse.csr_array(sparse.diags_array(1.0 / np.maximum(degree, 1.0)) @ links)

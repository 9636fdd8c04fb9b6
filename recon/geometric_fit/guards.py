"""What keeps a fit honest where no data point looks: surface that strays from the scan, and surface that folds.

The error from the data to the surface says nothing about surface that is nearest to no data point. Two guards do:

    stray  a sample of the surface farther from the scan than the fit is elsewhere becomes a data point of its own:
           it wants to come to the tangent plane of the scan point nearest to it
    fold   two triangles of the tessellation more than 90 degrees apart where the scan has no such edge: the control
           points around are made stiffer, until the fold is gone
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial import cKDTree

from recon.geometric_fit.evaluation import points_at
from recon.geometric_fit.foot_points import Feet
from recon.geometric_fit.limit_surface import LimitPatches, tessellation_places
from recon.geometric_fit.scan_data import ScanData
from recon.geometry.control_mesh import ControlMesh
from recon.numerics.halfedges import edge_table

__all__ = ["Strays", "fairness", "fold_control_points", "neighbour_means", "stray_samples"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

SAME_PLACE = 0.005  # share of the diagonal within which a fold of the scan excuses a fold of the surface
SAMPLES = ((1 / 3, 1 / 3), (1 / 6, 1 / 6), (2 / 3, 1 / 6), (1 / 6, 2 / 3))


class Strays(NamedTuple):
    """Samples of the surface that are too far from the scan.

    feet     where they are; `normals` are those of the scan
    targets  (m, 3) the scan points they should come to
    """

    feet: Feet
    targets: Floats


def stray_samples(patches: LimitPatches, points: Floats, scan: ScanData, allowed: float) -> Strays:
    """The samples of the surface that are farther from the scan than `allowed`, a length."""
    n_patches = len(patches.sheets.faces)
    patch = np.repeat(np.arange(n_patches), len(SAMPLES))
    v, w = np.tile(np.array(SAMPLES), (n_patches, 1)).T.copy()
    places = points_at(patches.arrays, points, patch, v, w, 1)[:, 0]
    distance, nearest = scan.tree.query(places)
    away = places - scan.points[nearest]
    height = np.abs(np.einsum("ij,ij->i", away, scan.normals[nearest]))
    # beside its nearest point a sample may be as far as the points are apart: only the height over the scan counts
    beside = np.sqrt(np.maximum(distance**2 - height**2, 0.0))
    far = np.flatnonzero((height > allowed) | (beside > 4.0 * np.quantile(beside, 0.95)))
    feet = Feet(patch[far], v[far], w[far], places[far], scan.normals[nearest[far]])
    return Strays(feet, scan.points[nearest[far]])


def fold_control_points(mesh: ControlMesh, patches: LimitPatches, points: Floats, scan: ScanData) -> Bools:
    """(V,) the control points of faces with a fold that the scan does not have."""
    patch, v, w, triangles = tessellation_places(patches.sheets, 1)
    vertices = points_at(patches.arrays, points, patch, v, w, 1)[:, 0]
    table = edge_table(triangles)
    edge, face = table.edge_faces()
    pair = np.flatnonzero(edge[1:] == edge[:-1])
    a, b, c = vertices[triangles].transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    turned = pair[np.einsum("ij,ij->i", normal[face[pair]], normal[face[pair + 1]]) < 0.0]
    middle = vertices[table.edges[edge[turned]]].mean(axis=1)
    if len(scan.folds) and len(middle):
        turned = turned[cKDTree(scan.folds).query(middle)[0] > SAME_PLACE * scan.diagonal]
    folded = np.zeros(mesh.n_vertices, dtype=bool)
    per_face = len(triangles) // mesh.n_faces
    folded[mesh.faces_of(3)[np.concatenate([face[turned], face[turned + 1]]) // per_face]] = True
    return folded


def fairness(mesh: ControlMesh, stiffness: Floats) -> sparse.csr_array:
    """(V, V) energy of the control mesh: each point's distance from its neighbours' mean, squared, times stiffness."""
    umbrella = sparse.csr_array(neighbour_means(mesh) - sparse.eye_array(mesh.n_vertices))
    return sparse.csr_array(umbrella.T @ sparse.diags_array(stiffness) @ umbrella)


def neighbour_means(mesh: ControlMesh) -> sparse.csr_array:
    """(V, V) mean of the neighbours of every control point; on creases and borders of those along them."""
    faces, n = mesh.faces_of(3), mesh.n_vertices
    table = edge_table(faces)
    creases = np.sort(mesh.crease_edges, axis=1)
    edges = table.edges
    sharp = (table.uses == 1) | np.isin(edges[:, 0] * n + edges[:, 1], creases[:, 0] * n + creases[:, 1])
    on_sharp = np.zeros(n, dtype=bool)
    on_sharp[edges[sharp]] = True
    start, end = np.concatenate([edges, edges[:, ::-1]]).T
    counts = ~on_sharp[start] | np.tile(sharp, 2)
    links = sparse.csr_array(sparse.coo_array((np.ones(counts.sum()), (start[counts], end[counts])), shape=(n, n)))
    degree = np.asarray(links.sum(axis=1)).ravel()
    return sparse.csr_array(sparse.diags_array(1.0 / np.maximum(degree, 1.0)) @ links)

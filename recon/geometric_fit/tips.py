"""Tips of a scan that a coarse mesh of quadrilaterals has cut off, given quadrilaterals to cover them.

   .-.                 .-.           a cluster of points that stays far from the wrapped mesh is a tip; the face that
  (   )              o(---)o         most of it is nearest to gets a smaller one inside, which the next wrapping
o--`-'--o    -->     |\\   /|         draws out over the tip; again, where that is not enough
|       |            o-----o
"""

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from recon.geometric_fit.quad_splits import inset
from recon.geometric_fit.wrapping import wrapped
from recon.geometry.control_mesh import ControlMesh
from recon.geometry.mesh import TriangleMesh
from recon.numerics.distance import TriangleTree
from recon.numerics.halfedges import edge_table
from recon.numerics.self_intersection import crossing_triangles

__all__ = ["covered_tips"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

OFF, FAR = 0.15, 0.3  # mean edges from where on points are off, and what one of them must be for them to be a tip
TIMES = 6  # that tips are looked for
PASSES = 8  # of wrapping after each


def covered_tips(mesh: ControlMesh, scan: TriangleMesh) -> ControlMesh:
    """The mesh of quadrilaterals, wrapped over the scan, with more of them where it does not reach the scan's tips.

    Promises  no more of its triangles cut each other than before.
    """
    table = edge_table(scan.face_vertices)
    ones, n = np.ones(len(table.edges)), scan.n_vertices
    neighbours = sparse.csr_array((ones, (table.edges[:, 0], table.edges[:, 1])), shape=(n, n))
    cuts = _n_crossing(mesh)
    for _ in range(TIMES):
        over = _faces_over_tips(mesh, scan.vertices, neighbours)
        if not len(over):
            break
        grown = wrapped(inset(mesh, over), scan, PASSES)
        if (cuts_then := _n_crossing(grown)) > cuts:  # they tangle rather than reach out
            break
        mesh, cuts = grown, cuts_then
    return mesh


def _n_crossing(mesh: ControlMesh) -> int:
    """Pairs of triangles of the mesh that cut each other."""
    triangles = mesh.triangle_mesh()
    return len(crossing_triangles(triangles.vertices, triangles.face_vertices)[0])


def _faces_over_tips(mesh: ControlMesh, points: Floats, neighbours: sparse.csr_array) -> Ints:
    """Of each cluster of points that are off, the face from which they are off most in sum."""
    sides = mesh.vertices[mesh.face_corners[mesh.next_corners()]] - mesh.vertices[mesh.face_corners]
    edge = float(np.linalg.norm(sides, axis=1).mean())
    found = TriangleTree(mesh.vertices, mesh.triangle_mesh().face_vertices).closest(points)
    off = np.flatnonzero(found.distances > OFF * edge)
    n_clusters, cluster = csgraph.connected_components(neighbours[off][:, off], directed=False)
    farthest = np.zeros(n_clusters)
    np.maximum.at(farthest, cluster, found.distances[off])
    tips = np.flatnonzero(farthest > FAR * edge)
    if not len(tips):
        return tips
    # two triangles a face
    faces, shape = found.faces[off] // 2, (n_clusters, mesh.n_faces)
    sums = sparse.coo_array((found.distances[off], (cluster, faces)), shape=shape).tocsr()
    return np.unique(sums[tips].argmax(axis=1)).astype(np.int64)

"""Control points spread evenly between sharp edges, where the simplifier leaves slivers.

Quadrics do not see how far apart points are on a plane or along a cylinder: a face may be a hundred times as long as
it is wide, and a step of the fit that slides its corners a little folds it. So points that lie on no sharp edge move
toward their neighbours' mean, within the surface, and in between edges are flipped until no triangle has another's
corner in its circle, or turned between quadrilaterals.

Paper  [botsch2004], tangential smoothing and flips; the nearest point of the scan as projection.
"""

import numpy as np

from recon.geometric_fit.guards import neighbour_means
from recon.geometric_fit.quad_turns import turned_to_even_valences
from recon.geometric_fit.refinement import flip_to_delaunay
from recon.geometry.control_mesh import ControlMesh
from recon.geometry.mesh import TriangleMesh
from recon.numerics.distance import TriangleTree
from recon.numerics.halfedges import free_edges, vertex_normals

__all__ = ["relaxed"]

PASSES, PACE = 6, 0.5  # how often points move, and how far toward the mean


def relaxed(mesh: ControlMesh, scan: TriangleMesh) -> ControlMesh:
    """The mesh with its points spread over the scan, those on sharp edges and on the border as they were."""
    tree = TriangleTree(scan.vertices, scan.face_vertices)
    evened = flip_to_delaunay if int(mesh.face_starts[1]) == 3 else turned_to_even_valences
    mesh = evened(mesh)
    for _ in range(PASSES):
        faces = mesh.triangle_mesh().face_vertices
        free = np.ones(mesh.n_vertices, dtype=np.bool_)
        free[mesh.crease_edges] = free[free_edges(faces)] = False
        normals = vertex_normals(mesh.vertices, faces)
        toward = neighbour_means(mesh) @ mesh.vertices - mesh.vertices
        toward -= np.einsum("vi,vi->v", toward, normals)[:, None] * normals
        moved = mesh.vertices.copy()
        moved[free] = tree.closest(mesh.vertices[free] + PACE * toward[free]).points
        mesh = evened(mesh.with_vertices(moved))
    return mesh

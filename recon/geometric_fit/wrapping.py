"""A control mesh drawn over the scan, out to the tips that a coarse remesh has cut off.

Every point of the scan pulls the nearest face of the control mesh, as in the patent's move but with the flat faces
themselves: a control point goes by the weighted mean of the error vectors on the faces around it. Points far off pull
more, since those of a tip are few. Between the pulls control points slide within the surface toward their neighbours'
mean, which hands points on from the body to the tip:

       .:.                 .:.
      : o :               : o :
      : | :      -->      :/ \\:        o  control points,   . :  scan
    o-+-o-+-o           o-o   o-o

Paper  [maekawa2009], the move; [botsch2004], tangential smoothing.
"""

import numpy as np
from numpy.typing import NDArray

from recon.geometric_fit.guards import neighbour_means
from recon.geometry.control_mesh import ControlMesh
from recon.geometry.mesh import TriangleMesh
from recon.numerics.distance import TriangleTree, barycentric
from recon.numerics.halfedges import vertex_normals
from recon.numerics.rows import added_at

__all__ = ["wrapped"]

Floats = NDArray[np.float64]

PACE = 0.5  # how far toward the mean control points slide in a pass
FARTHEST = 10.0  # medians of the distance from where on a point pulls no harder


def wrapped(mesh: ControlMesh, scan: TriangleMesh, passes: int) -> ControlMesh:
    """The control mesh with its points where its faces lie near the scan, tips and all."""
    means, triangles, x = neighbour_means(mesh), mesh.triangle_mesh().face_vertices, mesh.vertices
    used = np.unique(scan.face_vertices)
    data = scan.vertices[used], vertex_normals(scan.vertices, scan.face_vertices)[used]
    for _ in range(passes):
        x = _pulled(x, triangles, *data)
        normals = vertex_normals(x, triangles)
        slide = means @ x - x
        slide -= np.einsum("vi,vi->v", slide, normals)[:, None] * normals
        x = x + PACE * slide
    return mesh.with_vertices(x)


def _pulled(x: Floats, triangles: NDArray[np.int64], points: Floats, facing: Floats) -> Floats:
    found = TriangleTree(x, triangles).closest(points)
    corners = triangles[found.faces]
    a, b, c = (x[corners[:, i]] for i in range(3))
    alike = np.einsum("ni,ni->n", np.cross(b - a, c - a), facing) > 0.0
    harder = alike + np.minimum(found.distances / max(float(np.median(found.distances)), 1e-300), FARTHEST) * alike
    shares = barycentric(found.points, x[corners]) * harder[:, None]
    errors = points - found.points
    total = np.bincount(corners.ravel(), shares.ravel(), len(x))[:, None]
    moves = added_at((shares[:, :, None] * errors[:, None]).reshape(-1, 3), corners.ravel(), len(x))
    return x + np.divide(moves, total, out=np.zeros_like(moves), where=total > 1e-9)

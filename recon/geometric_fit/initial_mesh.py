"""The control mesh to start from: the scan simplified by quadric error, which keeps the features.

Paper  [garland1997], the error of a collapse as a quadric; [maekawa2009], its use as initial control mesh.
"""

import fast_simplification
import numpy as np
from numpy.typing import NDArray

from recon.errors import Refusal
from recon.geometry.control_mesh import ControlMesh
from recon.geometry.mesh import TriangleMesh
from recon.numerics.halfedges import edge_table, opposite_sides

__all__ = ["initial_mesh"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

BOX = 100.0  # the simplifier compares errors with absolute numbers: scans come to it in one size
PACES = (3.0, 5.0, 7.0)  # how fast it raises the error it allows; a slower one may end before the count is reached
SHARES = (1.0, 0.99, 0.97, 0.94, 0.9, 0.8, 0.7)  # of the count, tried in turn where the last left a tangle
SPARE = 4  # times the count to which all attempts share the way


class NoControlMesh(Refusal):
    """No sound control mesh of the size asked for was found."""


def initial_mesh(scan: TriangleMesh, n_vertices: int) -> ControlMesh:
    """A manifold triangle mesh of about `n_vertices` (never more) with the shape of the scan.

    Raises  NoControlMesh when every attempt left edges or vertices that are no surface.
    """
    low, high = scan.vertices.min(axis=0), scan.vertices.max(axis=0)
    scale = BOX / max(float((high - low).max()), 1e-300)
    boxed = _simplified((scan.vertices - low) * scale, scan.face_vertices, SPARE * n_vertices)
    for share in SHARES:
        vertices, faces = _simplified(*boxed, max(int(share * n_vertices), 4))
        used, renumbered = np.unique(faces, return_inverse=True)
        if len(used) <= n_vertices and _is_manifold(faces):
            return ControlMesh.from_faces(vertices[used] / scale + low, renumbered.reshape(-1, 3))
    raise NoControlMesh(f"the scan cannot be simplified to {n_vertices} control points; ask for more.")


def _simplified(vertices: Floats, faces: Ints, n_vertices: int) -> tuple[Floats, Ints]:
    """Collapse until the vertices are few enough, slowly first, or until that leads no further."""
    for pace in (*PACES, PACES[-1]):
        used = len(np.unique(faces))
        if used <= n_vertices:
            break
        # a collapse takes a vertex and two faces
        target = max(len(faces) - 2 * (used - n_vertices), 4)
        found, triangles = fast_simplification.simplify(vertices, faces.copy(), target_count=int(target), agg=pace)
        vertices, faces = np.asarray(found, dtype=np.float64), triangles.astype(np.int64)
    return vertices, faces


def _is_manifold(faces: Ints) -> bool:
    """Whether there are faces with three corners each, and every edge has at most two, opposite in direction."""
    if len(faces) == 0 or (faces == np.roll(faces, 1, axis=1)).any():
        return False
    table = edge_table(faces)
    return not ((opposite_sides(faces) < 0) & (table.uses[table.face_edges] > 1)).any()

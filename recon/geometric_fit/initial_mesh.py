"""The control mesh to start from: the scan simplified by quadric error, which keeps the features.

Paper  [garland1997], the error of a collapse as a quadric; [maekawa2009], its use as initial control mesh.
"""

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
PACES = (3.0, 5.0, 7.0)  # how cautiously it collapses; the next is tried where the last left a tangle


class NoControlMesh(Refusal):
    """No sound control mesh of the size asked for was found."""


def initial_mesh(scan: TriangleMesh, n_vertices: int) -> ControlMesh:
    """A manifold triangle mesh of about `n_vertices` (never more) with the shape of the scan.

    Raises  NoControlMesh when every attempt left edges or vertices that are no surface.
    """
    low, high = scan.vertices.min(axis=0), scan.vertices.max(axis=0)
    scale = BOX / max(float((high - low).max()), 1e-300)
    boxed = (scan.vertices - low) * scale
    for pace in PACES:
        vertices, faces = _simplified(boxed, scan.face_vertices, n_vertices, pace)
        faces = _manifold_part(faces)
        if len(faces) and len(np.unique(faces)) <= n_vertices:
            used, renumbered = np.unique(faces, return_inverse=True)
            return ControlMesh.from_faces(vertices[used] / scale + low, renumbered.reshape(-1, 3))
    raise NoControlMesh(f"the scan cannot be simplified to {n_vertices} control points; ask for more.")


def _simplified(vertices: Floats, faces: Ints, n_vertices: int, pace: float) -> tuple[Floats, Ints]:
    """Collapse until the vertices are few enough; faces are counted from the scan's own Euler number."""
    import fast_simplification

    surplus = len(faces) - 2 * len(np.unique(faces))
    target = max(4, 2 * n_vertices + surplus)
    for _ in range(6):
        if target >= len(faces):
            return vertices, faces
        points, triangles = fast_simplification.simplify(
            vertices.astype(np.float64), faces.astype(np.int64), target_count=int(target), agg=pace
        )
        triangles = triangles.astype(np.int64)
        excess = len(np.unique(triangles)) - n_vertices
        if excess <= 0:
            break
        target -= max(2 * excess, 2)
        if target < 4:
            break
    return np.asarray(points, dtype=np.float64), triangles


def _manifold_part(faces: Ints) -> Ints:
    """The faces if every edge has at most two, opposite in direction; none otherwise."""
    good = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    faces = faces[good]
    tangled = (opposite_sides(faces) < 0) & (edge_table(faces).uses[edge_table(faces).face_edges] > 1)
    return faces[:0] if tangled.any() else faces

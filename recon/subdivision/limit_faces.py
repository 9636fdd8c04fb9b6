"""Faces of the limit surface of any control mesh, by its scheme."""

import numpy as np
from threadpoolctl import threadpool_limits

from recon.geometry.control_mesh import ControlMesh
from recon.subdivision.limit_surface import Scheme
from recon.subdivision.polygons import settled, split_polygons
from recon.subdivision.quad_faces import LimitFaces, catmull_clark_faces, doo_sabin_faces
from recon.subdivision.triangle_faces import loop_faces

__all__ = ["ACCURACY", "limit_faces", "mean_edge", "natural_scheme"]

ACCURACY = 2e-3


def natural_scheme(mesh: ControlMesh) -> Scheme:
    """Loop's for triangles; Catmull-Clark's for everything else."""
    return Scheme.LOOP if (np.diff(mesh.face_starts) == 3).all() else Scheme.CATMULL_CLARK


def mean_edge(mesh: ControlMesh) -> float:
    """Mean length of the sides of the faces."""
    sides = mesh.vertices[mesh.face_corners] - mesh.vertices[mesh.face_corners[mesh.next_corners()]]
    return float(np.linalg.norm(sides, axis=1).mean())


def limit_faces(mesh: ControlMesh, scheme: Scheme, *, accuracy: float = ACCURACY) -> LimitFaces:
    """Faces of the limit surface, semi-sharp creases included; raises as the scheme's own function does.

    accuracy  how far faces around irregular vertices may stay from the surface, in mean edges of the control mesh; met
              as far as three more refinements go, and in Doo-Sabin's scheme without any
    """
    with threadpool_limits(limits=1, user_api="blas"):  # thousands of small systems: threads would only wait
        return _faces_by_scheme(mesh, scheme, accuracy * mean_edge(mesh))


def _faces_by_scheme(mesh: ControlMesh, scheme: Scheme, allowed: float) -> LimitFaces:
    if scheme == Scheme.LOOP:
        return loop_faces(mesh, allowed=allowed)
    if scheme == Scheme.DOO_SABIN:
        return doo_sabin_faces(mesh)
    quads = settled(mesh, split_polygons)
    four = (np.diff(quads.face_starts) == 4).all()
    return catmull_clark_faces(quads if four else split_polygons(quads), allowed=allowed)

"""Faces of the limit surface of any control mesh, by its scheme."""

import numpy as np

from recon.geometry.control_mesh import ControlMesh
from recon.subdivision.limit_surface import Scheme
from recon.subdivision.polygons import split_polygons
from recon.subdivision.quad_faces import ACCURACY, LimitFaces, catmull_clark_faces, doo_sabin_faces
from recon.subdivision.triangle_faces import loop_faces

__all__ = ["limit_faces", "natural_scheme"]


def natural_scheme(mesh: ControlMesh) -> Scheme:
    """Loop's for triangles; Catmull-Clark's for everything else."""
    return Scheme.LOOP if (np.diff(mesh.face_starts) == 3).all() else Scheme.CATMULL_CLARK


def limit_faces(mesh: ControlMesh, scheme: Scheme, *, accuracy: float = ACCURACY) -> LimitFaces:
    """Faces of the limit surface; raises as the scheme's own function does.

    accuracy  as of `catmull_clark_faces`
    """
    if scheme == Scheme.CATMULL_CLARK:
        four = (np.diff(mesh.face_starts) == 4).all()
        return catmull_clark_faces(mesh if four else split_polygons(mesh), accuracy=accuracy)
    if scheme == Scheme.DOO_SABIN:
        return doo_sabin_faces(mesh)
    return loop_faces(mesh)

"""From a control mesh to the kernel shape of its limit surface, with what there is to say about it."""

from math import radians
from typing import Any, NamedTuple

import numpy as np
from OCP.TopoDS import TopoDS_Shape

from brep_export.app.workshop import Bench
from brep_export.check import ShapeKind
from brep_export.measures import kind_of
from brep_export.mosaics import mosaic_shape
from recon.geometry.control_mesh import ControlMesh
from recon.subdivision.limit_faces import ACCURACY, limit_faces, mean_edge
from recon.subdivision.limit_surface import Scheme
from recon.subdivision.quad_faces import LimitFaces
from recon.tolerance import Tolerance

__all__ = ["LimitShape", "limit_shape"]

MERGE, FIT = 1e-7, 1e-5  # tolerances of the kernel shape, as shares of the diagonal


class LimitShape(NamedTuple):
    """A kernel shape, what the gate is to expect of it, and its faces as they were before the kernel."""

    shape: TopoDS_Shape
    kind: ShapeKind
    tolerance: Tolerance
    faces: LimitFaces

    def figures(self, mesh: ControlMesh) -> dict[str, Any]:
        """What the JSON object says about the faces; lengths in mean edges of the control mesh."""
        return {
            "control_faces": mesh.n_faces,
            "faces": len(self.faces.mosaic.patches),
            "exact_faces": self.faces.n_exact,
            "faces_per_control_face": len(self.faces.mosaic.patches) / mesh.n_faces,
            "off_limit_in_edges": self.faces.off / mean_edge(mesh),
            "crease_edges": int((~self.faces.mosaic.smooth_edges).sum()),
        }


def limit_shape(
    mesh: ControlMesh, scheme: Scheme, angle_deg: float, bench: Bench, *, accuracy: float = ACCURACY
) -> LimitShape:
    """Solid of a closed control mesh, shell of an open one; angle_deg is what the gate allows along smooth edges.

    accuracy  how far caps may stay from the limit surface, in mean edges of the control mesh
    """
    diagonal = float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))
    tolerance = Tolerance(merge=MERGE * diagonal, fit=FIT * diagonal, angle=radians(angle_deg))
    with bench.phase("brep", "laying faces over the surface"):
        faces = limit_faces(mesh, scheme, accuracy=accuracy)
        shape = mosaic_shape(faces.mosaic, tolerance)
    kind = ShapeKind.SOLID if faces.mosaic.is_closed else kind_of(shape)
    if faces.off > 0.0:
        share, n_caps = 100.0 * faces.off / mean_edge(mesh), len(faces.mosaic.patches) - faces.n_exact
        bench.note(
            f"{faces.n_exact} faces are the limit surface itself; the other {n_caps}, "
            f"around irregular vertices, are off it by at most {share:.2g} % of a mean edge.",
            name="off-limit",
        )
    return LimitShape(shape, kind, tolerance, faces)

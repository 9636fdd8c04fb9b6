"""One spline surface as an open shell: cut out by loops, or with a seam where it runs around, and holes in it."""

from collections.abc import Sequence

from OCP.BRep import BRep_Tool
from OCP.TopoDS import TopoDS, TopoDS_Shell

from brep_export.faces import BUILDER, loop_wire, trimmed_face
from brep_export.shells import make_shell, network_faces
from recon.geometry.patches import PatchNetwork
from recon.geometry.trimmed import TrimLoop, TrimmedSurface
from recon.tolerance import Tolerance

__all__ = ["pierced_shell", "trimmed_shell"]


def trimmed_shell(trimmed: TrimmedSurface, tolerance: Tolerance) -> TopoDS_Shell:
    """Open kernel shell of one trimmed face; promises and raises as `trimmed_face`."""
    return make_shell([trimmed_face(trimmed, tolerance)], closed=False)


def pierced_shell(network: PatchNetwork, holes: Sequence[TrimLoop], tolerance: Tolerance) -> TopoDS_Shell:
    """Open kernel shell of a network of one patch, its seams included, with clockwise holes in it.

    Promises, Raises  as `network_shell` for its sides and `trimmed_face` for the holes.
    """
    face = TopoDS.Face_s(network_faces(network, tolerance).faces[0])
    surface = BRep_Tool.Surface_s(face)
    for hole in holes:
        BUILDER.Add(face, loop_wire(network.patches[0], hole, surface, tolerance))
    return make_shell([face], closed=False)

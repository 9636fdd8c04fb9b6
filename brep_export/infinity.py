"""Whether the point at infinity is outside a solid: line 6 of the gate.

A line through a place within a face meets the faces of the solid; beyond the last of them it runs to infinity:

      ---|///|-----|//////|---->        where the last face is met from behind, infinity is outside

The kernel's own classifier does the same, but first covers every face with a polyhedron, and most are never asked for.
"""

from collections.abc import Iterator

import numpy as np
from OCP.BRepAdaptor import BRepAdaptor_Surface
from OCP.BRepClass3d import BRepClass3d_SolidClassifier, BRepClass3d_SolidExplorer
from OCP.BRepIntCurveSurface import BRepIntCurveSurface_Inter
from OCP.gp import gp_Dir, gp_Lin, gp_Pnt, gp_Vec
from OCP.TopAbs import TopAbs_Orientation, TopAbs_ShapeEnum, TopAbs_State
from OCP.TopoDS import TopoDS, TopoDS_Shape

from brep_export.check_topology import sub_shapes

__all__ = ["infinity_is_outside"]

WAYS = ((0.31, 0.52, 0.8), (-0.53, 0.29, 0.79), (0.23, -0.81, -0.54), (-0.61, -0.42, 0.67))
LEAST_COSINE = 1e-3  # between a line and the normal of a face: less, and rounding decides on which side it leaves
NEAR = 1e-7


def infinity_is_outside(solid: TopoDS_Shape) -> bool:
    """Ask lines through the first face, and the kernel's classifier where they all run along faces or through edges."""
    face, place = TopoDS.Face_s(next(sub_shapes(solid, TopAbs_ShapeEnum.TopAbs_FACE))), gp_Pnt()
    if BRepClass3d_SolidExplorer.FindAPointInTheFace_s(face, place):
        for way in WAYS:
            crossings = sorted(_crossings(solid, gp_Lin(place, gp_Dir(*way))))
            if crossings and all(abs(cosine) > LEAST_COSINE for _, cosine in crossings):
                return crossings[0][1] < 0.0 < crossings[-1][1]
    classifier = BRepClass3d_SolidClassifier(solid)
    classifier.PerformInfinitePoint(NEAR)
    return bool(classifier.State() == TopAbs_State.TopAbs_OUT)


def _crossings(solid: TopoDS_Shape, line: gp_Lin) -> Iterator[tuple[float, float]]:
    """Parameters on the line, and the cosines between it and the outward normals there: 0 where that is in doubt."""
    found = BRepIntCurveSurface_Inter()
    found.Init(solid, line, NEAR)
    while found.More():
        face = found.Face()
        inside = found.State() == TopAbs_State.TopAbs_IN
        point, along_u, along_v = gp_Pnt(), gp_Vec(), gp_Vec()
        BRepAdaptor_Surface(face, False).D1(found.U(), found.V(), point, along_u, along_v)
        normal = np.cross(along_u.Coord(), along_v.Coord())
        cosine = float(normal @ line.Direction().Coord() / max(np.linalg.norm(normal), 1e-300))
        turned = face.Orientation() == TopAbs_Orientation.TopAbs_REVERSED
        yield found.W(), (-cosine if turned else cosine) * inside
        found.Next()

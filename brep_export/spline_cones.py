"""Cones over the B-spline faces of a kernel shape, see `recon.geometry.cone_volume`."""

import numpy as np
from OCP.BRep import BRep_Tool
from OCP.Geom import Geom_BSplineSurface, Geom_RectangularTrimmedSurface
from OCP.Geom2d import Geom2d_BSplineCurve, Geom2d_Curve, Geom2d_Line, Geom2d_TrimmedCurve
from OCP.Geom2dConvert import Geom2dConvert
from OCP.TopAbs import TopAbs_Orientation, TopAbs_ShapeEnum
from OCP.TopoDS import TopoDS, TopoDS_Face

from brep_export.check_topology import sub_shapes
from brep_export.curves import curve_from_kernel
from brep_export.occ_arrays import points_from_kernel
from brep_export.surfaces import surface_from_kernel
from recon.geometry.bspline import BSplineCurve
from recon.geometry.cone_volume import cone_volume, trimmed_cone_volume

__all__ = ["is_whole", "spline_cone"]

_EDGE = TopAbs_ShapeEnum.TopAbs_EDGE
_FORWARD, _REVERSED = TopAbs_Orientation.TopAbs_FORWARD, TopAbs_Orientation.TopAbs_REVERSED
ON_BORDER = 1e-9  # of the parameter rectangle
ON_BORDER_SPLINE = 1e-7  # the same where the kernel has projected a side on its surface


def spline_cone(face: TopoDS_Face, apex: tuple[float, float, float]) -> float | None:
    """Signed volume of the cone from the apex over a face; None where the face is no B-spline, or lacks a pcurve."""
    kernel_surface = BRep_Tool.Surface_s(face)
    if isinstance(kernel_surface, Geom_RectangularTrimmedSurface):
        kernel_surface = kernel_surface.BasisSurface()
    if not isinstance(kernel_surface, Geom_BSplineSurface):
        return None
    if is_whole(face, kernel_surface):
        volume = cone_volume(surface_from_kernel(kernel_surface), apex)
    elif kernel_surface.IsUPeriodic() or kernel_surface.IsVPeriodic():
        return None  # pcurves may run beyond the period, where the opened surface has nothing
    else:
        pcurves = _pcurves(TopoDS.Face_s(face.Oriented(_FORWARD)))
        if pcurves is None:
            return None
        volume = trimmed_cone_volume(surface_from_kernel(kernel_surface), pcurves, apex)
    return -volume if face.Orientation() == _REVERSED else volume


def _pcurves(face: TopoDS_Face) -> list[BSplineCurve] | None:
    """The pcurves of all edges of a face that looks forward, each in the direction in which the face uses it."""
    pcurves = []
    for edge in (TopoDS.Edge_s(edge) for edge in sub_shapes(face, _EDGE)):
        curve = BRep_Tool.CurveOnSurface_s(edge, face, 0.0, 0.0)
        if curve is None:
            return None
        pcurve = _neutral(curve, *BRep_Tool.Range_s(edge, face))
        pcurves.append(pcurve.reversed() if edge.Orientation() == _REVERSED else pcurve)
    return pcurves


def _neutral(curve: Geom2d_Curve, first: float, last: float) -> BSplineCurve:
    if isinstance(curve, Geom2d_Line):
        ends = np.array([curve.Value(t).Coord() for t in (first, last)])
        return BSplineCurve(1, np.repeat([first, last], 2), ends)
    whole = isinstance(curve, Geom2d_BSplineCurve) and (curve.FirstParameter(), curve.LastParameter()) == (first, last)
    return curve_from_kernel(
        curve if whole else Geom2dConvert.CurveToBSplineCurve_s(Geom2d_TrimmedCurve(curve, first, last))
    )


def is_whole(face: TopoDS_Face, surface: Geom_BSplineSurface) -> bool:
    """Whether the loops are straight lines along the border of the parameter rectangle, once around it."""
    u0, u1, v0, v1 = surface.Bounds()
    area = 0.0
    for edge in (TopoDS.Edge_s(edge) for edge in sub_shapes(face.Oriented(_FORWARD), _EDGE)):
        line = BRep_Tool.CurveOnSurface_s(edge, face, 0.0, 0.0)
        if not isinstance(line, Geom2d_Line) and not _runs_straight(line, (u0, u1), (v0, v1)):
            return False
        (ua, va), (ub, vb) = (line.Value(t).Coord() for t in BRep_Tool.Range_s(edge, face))
        a, b, c, d = ((ua - u0) / (u1 - u0), (va - v0) / (v1 - v0), (ub - u0) / (u1 - u0), (vb - v0) / (v1 - v0))
        if isinstance(line, Geom2d_Line) and not any(
            _same(x, y) and (_same(x, 0.0) or _same(x, 1.0)) for x, y in ((a, c), (b, d))
        ):
            return False
        area += 0.5 * (a * d - b * c) * (-1.0 if edge.Orientation() == _REVERSED else 1.0)
    return abs(area - 1.0) < ON_BORDER_SPLINE


def _runs_straight(curve: Geom2d_Curve, range_u: tuple[float, float], range_v: tuple[float, float]) -> bool:
    """Whether a spline lies on one side of the rectangle, as files give a side that ends in a collapsed one."""
    if not isinstance(curve, Geom2d_BSplineCurve):
        return False
    poles = points_from_kernel(curve.Poles())
    for axis, (low, high) in enumerate((range_u, range_v)):
        near = ON_BORDER_SPLINE * (high - low)
        if any((np.abs(poles[:, axis] - side) < near).all() for side in (low, high)):
            return True
    return False


def _same(x: float, y: float) -> bool:
    return abs(x - y) < ON_BORDER

"""Solids of revolution from their profiles: lines give planes, cylinders and cones, arcs spheres and tori."""

import numpy as np
from numpy.typing import NDArray
from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeEdge, BRepBuilderAPI_MakeFace, BRepBuilderAPI_MakeWire
from OCP.BRepPrimAPI import BRepPrimAPI_MakeRevol
from OCP.GC import GC_MakeArcOfCircle
from OCP.gp import gp_Ax1, gp_Dir, gp_Pnt
from OCP.TopoDS import TopoDS_Edge, TopoDS_Face, TopoDS_Shape, TopoDS_Wire

from brep_export.curves import kernel_curve
from brep_export.kernel_settings import KERNEL_FAILURES
from recon.errors import NoSolid
from recon.geometry.bspline import BSplineCurve
from recon.geometry.turned import ProfileArc, ProfileLine, ProfilePiece, TurnedPart

__all__ = ["turned_solid"]

Floats = NDArray[np.float64]


def turned_solid(part: TurnedPart) -> TopoDS_Shape:
    """The solid that the profile sweeps in one turn.

    Raises  NoSolid when the kernel makes no face or no solid of it.
    """
    side = np.cross(part.axis, np.eye(3)[int(np.abs(part.axis).argmin())])
    frame = np.stack([side / np.linalg.norm(side), part.axis])
    try:
        wires = [_wire(loop, part.origin, frame) for loop in part.loops]
        maker = BRepBuilderAPI_MakeFace(wires[0], True)
        for hole in wires[1:]:
            maker.Add(hole)
        return _turned(maker.Face(), part)
    except KERNEL_FAILURES as failure:
        raise NoSolid(f"the kernel gave up on turning the profile ({type(failure).__name__})") from failure


def _turned(face: TopoDS_Face, part: TurnedPart) -> TopoDS_Shape:
    return BRepPrimAPI_MakeRevol(face, gp_Ax1(_point(part.origin), gp_Dir(*part.axis.tolist())), 2.0 * np.pi).Shape()


def _wire(loop: tuple[ProfilePiece, ...], origin: Floats, frame: Floats) -> TopoDS_Wire:
    maker = BRepBuilderAPI_MakeWire()
    for piece in loop:
        maker.Add(_edge(piece, origin, frame))
    return maker.Wire()


def _edge(piece: ProfilePiece, origin: Floats, frame: Floats) -> TopoDS_Edge:
    if isinstance(piece, ProfileLine):
        return BRepBuilderAPI_MakeEdge(_point(origin + piece.start @ frame), _point(origin + piece.end @ frame)).Edge()
    if isinstance(piece, ProfileArc):
        ends = [_point(origin + p @ frame) for p in (piece.start, piece.middle, piece.end)]
        return BRepBuilderAPI_MakeEdge(GC_MakeArcOfCircle(*ends).Value()).Edge()
    curve = piece.curve
    placed = BSplineCurve(curve.degree, curve.knots, origin + curve.control_points @ frame)
    return BRepBuilderAPI_MakeEdge(kernel_curve(placed)).Edge()


def _point(p: Floats) -> gp_Pnt:
    return gp_Pnt(*(float(x) for x in p))

"""Area, volume and centres of many faces, all whole B-spline surfaces over the same knots at once."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from OCP.BRepAdaptor import BRepAdaptor_Surface
from OCP.BRepGProp import BRepGProp, BRepGProp_Domain, BRepGProp_Face, BRepGProp_Vinert, BRepGProp_VinertGK
from OCP.GeomAbs import GeomAbs_SurfaceType
from OCP.gp import gp_Pnt
from OCP.GProp import GProp_GProps
from OCP.TopAbs import TopAbs_Orientation
from OCP.TopoDS import TopoDS_Face

from brep_export.face_nets import FaceNets
from brep_export.spline_cones import spline_cone
from recon.geometry.cone_volume import surface_moments

__all__ = ["FaceMoments", "face_moments"]

Floats = NDArray[np.float64]
AT_ONCE = 512  # surfaces, which bounds the memory
AREA_ERROR = 1e-6  # relative, of areas of cut and of turned splines
SPLINED = (GeomAbs_SurfaceType.GeomAbs_BSplineSurface, GeomAbs_SurfaceType.GeomAbs_SurfaceOfRevolution)


@dataclass(frozen=True)
class FaceMoments:
    """Area of faces and volume of the cones over them from an apex, and both times the places of their centres."""

    area: float
    area_moment: Floats
    volume: float
    volume_moment: Floats


def face_moments(
    faces: Sequence[TopoDS_Face],
    apex: tuple[float, float, float],
    relative_error: float,
    known: tuple[FaceNets, NDArray[np.bool_]],
) -> FaceMoments:
    """Sums over the faces of one body; centres are counted from the apex.

    relative_error  of the volume of faces that are no B-splines, asked of the kernel's Gauss-Kronrod rule
    known           control nets of the faces, and which of those faces are whole
    """
    nets, whole = known
    total = np.zeros(8)
    for group in nets.groups:
        rows = np.flatnonzero(whole[group.faces])
        turned = [faces[f].Orientation() == TopAbs_Orientation.TopAbs_REVERSED for f in group.faces[rows].tolist()]
        sign = np.where(turned, -1.0, 1.0)
        for first in range(0, len(rows), AT_ONCE):
            some = slice(first, first + AT_ONCE)
            found = surface_moments(group.nets[rows[some]] - np.array(apex), group.degrees, group.knots)
            found[:, 4:] *= sign[some, None]
            total += found.sum(axis=0)
    for number in np.flatnonzero(~(whole & nets.grouped())).tolist():
        total += _of_one(faces[number], apex, relative_error)
    return FaceMoments(float(total[0]), total[1:4], float(total[4]), total[5:8])


def _of_one(face: TopoDS_Face, apex: tuple[float, float, float], relative_error: float) -> Floats:
    """(8,) of any face: area and centres as the kernel has them, the volume from the control points where it can be."""
    flat, place = GProp_GProps(), gp_Pnt(*apex)
    if BRepAdaptor_Surface(face, False).GetType() in SPLINED:
        # the plain rule does not see the knots: it is off by a few ten-thousandths on a turned spline, by 6 % and more
        # where a large spline face is cut
        BRepGProp.SurfaceProperties_s(face, flat, AREA_ERROR)
    else:
        BRepGProp.SurfaceProperties_s(face, flat)
    within = BRepGProp_Domain(face)
    rough = BRepGProp_Vinert(BRepGProp_Face(face), within, place, place)
    volume = spline_cone(face, apex)
    if volume is None:
        # the kernel's own sum over a compound of faces measures from a place of its own choice, and does not add up
        volume = BRepGProp_VinertGK(BRepGProp_Face(face), within, place, relative_error, False, False).Mass()
    centres = [np.array(p.CentreOfMass().Coord()) - apex for p in (flat, rough)]
    return np.array([flat.Mass(), *(flat.Mass() * centres[0]), volume, *(rough.Mass() * centres[1])])

"""Area, volume and centres of many faces, all whole B-spline surfaces over the same knots at once."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from OCP.BRep import BRep_Tool
from OCP.BRepGProp import BRepGProp, BRepGProp_Domain, BRepGProp_Face, BRepGProp_Vinert, BRepGProp_VinertGK
from OCP.Geom import Geom_BSplineSurface
from OCP.gp import gp_Pnt
from OCP.GProp import GProp_GProps
from OCP.TopAbs import TopAbs_Orientation
from OCP.TopoDS import TopoDS_Face

from brep_export.curves import full_knots
from brep_export.occ_arrays import numbers_from_kernel, point_grid_from_kernel
from brep_export.spline_cones import is_whole, spline_cone
from recon.geometry.cone_volume import surface_moments

__all__ = ["FaceMoments", "face_moments"]

Floats = NDArray[np.float64]
AT_ONCE = 512  # surfaces, which bounds the memory

_Key = tuple[int, int, bytes, bytes]


@dataclass(frozen=True)
class FaceMoments:
    """Area of faces and volume of the cones over them from an apex, and both times the places of their centres."""

    area: float
    area_moment: Floats
    volume: float
    volume_moment: Floats


def face_moments(faces: Sequence[TopoDS_Face], apex: tuple[float, float, float], relative_error: float) -> FaceMoments:
    """Sums over the faces of one body; centres are counted from the apex.

    relative_error  of the volume of faces that are no B-splines, asked of the kernel's Gauss-Kronrod rule
    """
    nets: dict[_Key, list[Floats]] = {}
    signs: dict[_Key, list[float]] = {}
    total = np.zeros(8)
    for face in faces:
        surface = BRep_Tool.Surface_s(face)
        key = _key(surface) if _is_plain(surface) and is_whole(face, surface) else None
        if key is None:
            total += _of_one(face, apex, relative_error)
            continue
        nets.setdefault(key, []).append(point_grid_from_kernel(surface.Poles()) - apex)
        signs.setdefault(key, []).append(-1.0 if face.Orientation() == TopAbs_Orientation.TopAbs_REVERSED else 1.0)
    for key, group in nets.items():
        degrees, knots = key[:2], (np.frombuffer(key[2]), np.frombuffer(key[3]))
        for first in range(0, len(group), AT_ONCE):
            found = surface_moments(np.array(group[first : first + AT_ONCE]), degrees, knots)
            found[:, 4:] *= np.array(signs[key][first : first + AT_ONCE])[:, None]
            total += found.sum(axis=0)
    return FaceMoments(float(total[0]), total[1:4], float(total[4]), total[5:8])


def _is_plain(surface: object) -> bool:
    return (
        isinstance(surface, Geom_BSplineSurface)
        and not (surface.IsURational() or surface.IsVRational() or surface.IsUPeriodic() or surface.IsVPeriodic())
        and min(surface.UMultiplicity(1), surface.UMultiplicity(surface.NbUKnots())) > surface.UDegree()
        and min(surface.VMultiplicity(1), surface.VMultiplicity(surface.NbVKnots())) > surface.VDegree()
    )


def _key(surface: Geom_BSplineSurface) -> _Key:
    u = full_knots(numbers_from_kernel(surface.UKnots()), numbers_from_kernel(surface.UMultiplicities()))
    v = full_knots(numbers_from_kernel(surface.VKnots()), numbers_from_kernel(surface.VMultiplicities()))
    return surface.UDegree(), surface.VDegree(), u.tobytes(), v.tobytes()


def _of_one(face: TopoDS_Face, apex: tuple[float, float, float], relative_error: float) -> Floats:
    """(8,) of any face: area and centres as the kernel has them, the volume from the control points where it can be."""
    flat, place = GProp_GProps(), gp_Pnt(*apex)
    BRepGProp.SurfaceProperties_s(face, flat)
    within = BRepGProp_Domain(face)
    rough = BRepGProp_Vinert(BRepGProp_Face(face), within, place, place)
    volume = spline_cone(face, apex)
    if volume is None:
        # the kernel's own sum over a compound of faces measures from a place of its own choice, and does not add up
        volume = BRepGProp_VinertGK(BRepGProp_Face(face), within, place, relative_error, False, False).Mass()
    centres = [np.array(p.CentreOfMass().Coord()) - apex for p in (flat, rough)]
    return np.array([flat.Mass(), *(flat.Mass() * centres[0]), volume, *(rough.Mass() * centres[1])])

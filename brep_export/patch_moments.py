"""Area, volume and their centres of many faces at once, where they are whole Bezier patches, as those of a terrain."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from OCP.BRep import BRep_Tool
from OCP.BRepGProp import BRepGProp, BRepGProp_Domain, BRepGProp_Face, BRepGProp_Vinert
from OCP.Geom import Geom_BSplineSurface
from OCP.gp import gp_Pnt
from OCP.GProp import GProp_GProps
from OCP.TopAbs import TopAbs_Orientation
from OCP.TopoDS import TopoDS_Face

from brep_export.occ_arrays import point_grid_from_kernel
from brep_export.spline_cones import is_whole
from recon.geometry.cone_volume import patch_moments

__all__ = ["Moments", "moments"]

Floats = NDArray[np.float64]
AT_ONCE = 512


@dataclass(frozen=True)
class Moments:
    """Area and volume of the cones from an apex, and the same times the place of their centres."""

    area: float
    area_moment: Floats
    volume: float
    volume_moment: Floats
    others: tuple[TopoDS_Face, ...]

    @property
    def centre_of_area(self) -> Floats:
        return self.area_moment / max(self.area, 1e-300)


def moments(faces: Sequence[TopoDS_Face], apex: tuple[float, float, float]) -> Moments:
    """Sums over the faces; `others` are no whole patches: their area is the kernel's, their volume is left out."""
    nets: dict[tuple[int, int], list[tuple[Floats, float]]] = {}
    others = []
    for face in faces:
        surface = BRep_Tool.Surface_s(face)
        if not _is_bezier(surface) or not is_whole(face, surface):
            others.append(face)
            continue
        sign = -1.0 if face.Orientation() == TopAbs_Orientation.TopAbs_REVERSED else 1.0
        key = surface.UDegree(), surface.VDegree()
        nets.setdefault(key, []).append((point_grid_from_kernel(surface.Poles()), sign))
    total = np.zeros(8)
    for group in nets.values():
        for first in range(0, len(group), AT_ONCE):
            part = group[first : first + AT_ONCE]
            away = np.array([net for net, _ in part]) - np.array(apex)
            values = patch_moments(away)
            values[:, 4:] *= np.array([sign for _, sign in part])[:, None]
            total += values.sum(axis=0)
    area_moment = total[1:4] + total[0] * np.array(apex)
    area = float(total[0])
    for face in others:
        own = GProp_GProps()
        BRepGProp.SurfaceProperties_s(face, own)
        centre = own.CentreOfMass()
        area += float(own.Mass())
        area_moment = area_moment + own.Mass() * np.array([centre.X(), centre.Y(), centre.Z()])
    return Moments(area, area_moment, float(total[4]), total[5:8], tuple(others))


def kernel_cone_moments(face: TopoDS_Face, apex: tuple[float, float, float]) -> Floats:
    """(3,) volume of the kernel's cone from the apex over a face times the place of its centre from there."""
    place = gp_Pnt(*apex)
    cone = BRepGProp_Vinert(BRepGProp_Face(face), BRepGProp_Domain(face), place, place)
    centre = cone.CentreOfMass()
    return cone.Mass() * (np.array([centre.X(), centre.Y(), centre.Z()]) - np.array(apex))


def _is_bezier(surface: object) -> bool:
    return (
        isinstance(surface, Geom_BSplineSurface)
        and surface.NbUKnots() == surface.NbVKnots() == 2
        and not (surface.IsURational() or surface.IsVRational() or surface.IsUPeriodic() or surface.IsVPeriodic())
    )

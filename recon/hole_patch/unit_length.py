"""The length that a wall is measured with: its own millimetre.

What suits a jar does not suit a thimble. Lengths that say how finely a profile is followed, how wide a ring tells of
the hole, how near the face comes to the edge, are given for a vessel of `RADIUS` millimetres; every other one is first
scaled to that size, and what was found is scaled back. Where the scan is coarse, its edges set the length.
"""

from dataclasses import replace

import numpy as np

from recon.geometry.bspline import BSplineCurve, BSplineSurface
from recon.geometry.mesh import TriangleMesh
from recon.geometry.trimmed import TrimLoop, TrimmedSurface
from recon.hole_patch.section_samples import edge_length
from recon.hole_patch.sheet import Sheet
from recon.hole_patch.surroundings import Axis, HoleEdge, Wall

__all__ = ["RADIUS", "axis_in", "scaled_curve", "scaled_sheet", "unit_length", "wall_in"]

RADIUS = 80.0  # of the vessel whose unit is a millimetre; vessels with 15 to 170 mm came out best so, or as well
MOST_OF_EDGE = 3.3  # units that an edge of the mesh may be long: between vertices nothing can be followed


def unit_length(wall: Wall, axis: Axis) -> float:
    """Millimetres of one unit; k times as many for a wall k times as large."""
    radius = float(np.quantile(axis.cylindrical(wall.measured.vertices)[:, 1], 0.95))
    return max(radius / RADIUS, edge_length(wall.measured) / MOST_OF_EDGE)


def wall_in(wall: Wall, unit: float) -> Wall:
    """The wall in units of so many millimetres."""
    edge = HoleEdge(wall.edge.points / unit, wall.edge.sherds, wall.edge.normals)
    return replace(wall, measured=_mesh_in(wall.measured, unit), plain=_mesh_in(wall.plain, unit), edge=edge)


def axis_in(axis: Axis, unit: float) -> Axis:
    """The axis in units of so many millimetres."""
    return replace(axis, point=axis.point / unit, quality=axis.quality / unit)


def scaled_sheet(sheet: Sheet, factor: float) -> Sheet:
    """A sheet made larger, its parameters too; its notes stay."""
    return replace(
        sheet,
        trimmed=TrimmedSurface(
            _scaled_surface(sheet.trimmed.surface, factor),
            tuple(TrimLoop(tuple(scaled_curve(c, factor) for c in loop.pcurves)) for loop in sheet.trimmed.loops),
        ),
        edge_distance=sheet.edge_distance * factor,
        base=None if sheet.base is None else _scaled_surface(sheet.base, factor),
        lip=None if sheet.lip is None else sheet.lip * factor,
    )


def scaled_curve(curve: BSplineCurve, factor: float) -> BSplineCurve:
    """A curve made larger, its parameter too."""
    return replace(curve, knots=curve.knots * factor, control_points=curve.control_points * factor)


def _scaled_surface(surface: BSplineSurface, factor: float) -> BSplineSurface:
    return replace(
        surface,
        knots_u=surface.knots_u * factor,
        knots_v=surface.knots_v * factor,
        control_net=surface.control_net * factor,
    )


def _mesh_in(mesh: TriangleMesh, unit: float) -> TriangleMesh:
    return replace(mesh, vertices=mesh.vertices / unit)

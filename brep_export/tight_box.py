"""The box that fits a shape tightly.

The kernel's quick box of a face is that of its control points. Its tight one is that of the surface over the rectangle
around the face's parameters, which takes in what was cut away: of a dome with its top cut off by a pocket, the top. So
the extreme places of a face are sought here, on its edges, and inside where the surface turns.
"""

from collections.abc import Callable, Iterable
from math import inf

import numpy as np
from numpy.typing import NDArray
from OCP.Bnd import Bnd_Box
from OCP.BRep import BRep_Tool
from OCP.BRepAdaptor import BRepAdaptor_Surface
from OCP.BRepBndLib import BRepBndLib
from OCP.BRepTools import BRepTools
from OCP.BRepTopAdaptor import BRepTopAdaptor_FClass2d
from OCP.GeomAbs import GeomAbs_SurfaceType
from OCP.gp import gp_Pnt, gp_Pnt2d, gp_Vec
from OCP.TopAbs import TopAbs_ShapeEnum, TopAbs_State
from OCP.TopoDS import TopoDS, TopoDS_Face, TopoDS_Shape

from brep_export.check_topology import each_once
from brep_export.surfaces import surface_from_kernel

__all__ = ["Box", "Point", "rough_box", "tight_box"]

Floats = NDArray[np.float64]
Point = tuple[float, float, float]
Box = tuple[Point, Point]

STEPS = 24  # of the grid over a face, in each parameter, from which extreme places are sought
STEPS_A_SPAN = 3  # the same of a face of many spans
MOST_STEPS = 200
ON_FACE = 1e-9  # in parameters, that a place may lie outside the face's border
_INSIDE = (TopAbs_State.TopAbs_IN, TopAbs_State.TopAbs_ON)


def rough_box(shape: TopoDS_Shape) -> Box:
    """A box around the shape that the kernel finds at once; it may be too large."""
    box = Bnd_Box()
    BRepBndLib.Add_s(shape, box, False)
    return _corners(box)


def tight_box(shape: TopoDS_Shape) -> Box:
    """Lowest and highest corner of the shape; zeros where it is empty.

    Only edges and faces whose quick box reaches out of what is known already are looked at, the farthest first.
    """
    box = Bnd_Box()
    for vertex in each_once(shape, TopAbs_ShapeEnum.TopAbs_VERTEX):
        box.Add(BRep_Tool.Pnt_s(TopoDS.Vertex_s(vertex)))
    _widen(box, each_once(shape, TopAbs_ShapeEnum.TopAbs_EDGE), _add_edge)
    _widen(box, each_once(shape, TopAbs_ShapeEnum.TopAbs_FACE), _add_face)
    return _corners(box)


def _widen(box: Bnd_Box, shapes: Iterable[TopoDS_Shape], add: Callable[[TopoDS_Shape, Bnd_Box, Bnd_Box], None]) -> None:
    quick = []
    for part in shapes:
        own = Bnd_Box()
        BRepBndLib.Add_s(part, own, False)
        quick.append((_reach(own, box), part, own))
    for reach, part, own in sorted(quick, key=lambda entry: -entry[0]):
        if reach > 0.0 and _reach(own, box) > 0.0:
            add(part, own, box)


def _add_edge(edge: TopoDS_Shape, own: Bnd_Box, box: Bnd_Box) -> None:
    del own
    BRepBndLib.AddOptimal_s(edge, box, False, False)


def _add_face(face: TopoDS_Shape, own: Bnd_Box, box: Bnd_Box) -> None:
    """Add the extreme places inside a face, whose edges are in the box already, where its quick box reaches farther."""
    surface = BRepAdaptor_Surface(TopoDS.Face_s(face))
    if surface.GetType() == GeomAbs_SurfaceType.GeomAbs_Plane:
        return
    rectangle = np.reshape(BRepTools.UVBounds_s(TopoDS.Face_s(face)), (2, 2))
    places, points = _grid(surface, rectangle)
    on_face = _Border(TopoDS.Face_s(face))
    for axis in range(3):
        for sign in (1.0, -1.0):
            if _height(own, axis, sign) > _height(box, axis, sign):
                order = np.argsort(-sign * points[:, axis])
                _add_extreme(surface, rectangle, on_face, places[order], (axis, sign), box)


def _add_extreme(
    surface: BRepAdaptor_Surface,
    rectangle: Floats,
    on_face: "_Border",
    places: Floats,
    direction: tuple[int, float],
    box: Bnd_Box,
) -> None:
    """Add the highest place of a face in a direction: uphill of the highest on the grid, where that is on the face.

    places     (n, 2) of the grid, the highest first
    direction  number of the axis, and its sign
    """
    highest = next((place for place in places if on_face.has(place)), None)
    if highest is not None:
        top = _climbed(surface, rectangle, highest, direction)
        box.Add(surface.Value(*(top if on_face.has(top) else highest)))


def _climbed(surface: BRepAdaptor_Surface, rectangle: Floats, start: Floats, direction: tuple[int, float]) -> Floats:
    """Parameters of the place of the surface, within the rectangle, that is highest uphill of the start."""
    from scipy.optimize import minimize

    axis, sign = direction
    point, along_u, along_v = gp_Pnt(), gp_Vec(), gp_Vec()
    size = np.maximum(rectangle[:, 1] - rectangle[:, 0], 1e-300)

    def depth(place: Floats) -> tuple[float, Floats]:
        surface.D1(*np.clip(rectangle[:, 0] + place * size, *rectangle.T), point, along_u, along_v)
        slope = np.array([along_u.Coord(axis + 1), along_v.Coord(axis + 1)])
        return -sign * point.Coord(axis + 1), -sign * slope * size

    found = minimize(
        depth,
        (start - rectangle[:, 0]) / size,
        jac=True,
        bounds=[(0.0, 1.0)] * 2,
        method="L-BFGS-B",
        options={"ftol": 1e-15, "gtol": 1e-12},
    )
    return np.clip(rectangle[:, 0] + found.x * size, *rectangle.T)


def _grid(surface: BRepAdaptor_Surface, rectangle: Floats) -> tuple[Floats, Floats]:
    """(n, 2) parameters inside the rectangle, denser on surfaces of many spans, and (n, 3) the points there."""
    spline = surface.GetType() == GeomAbs_SurfaceType.GeomAbs_BSplineSurface
    spans = (surface.NbUKnots() - 1, surface.NbVKnots() - 1) if spline else (1, 1)
    steps = [min(max(STEPS, STEPS_A_SPAN * count), MOST_STEPS) for count in spans]
    u, v = (low + (high - low) * (np.arange(n) + 0.5) / n for (low, high), n in zip(rectangle, steps))
    places = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
    if spline and not surface.IsUPeriodic() and not surface.IsVPeriodic():
        return places, surface_from_kernel(surface.BSpline()).grid(u, v).reshape(-1, 3)
    return places, np.array([_coordinates(surface.Value(*place)) for place in places])


class _Border:
    """Which parameters of a surface belong to a face."""

    def __init__(self, face: TopoDS_Face) -> None:
        self._classifier = BRepTopAdaptor_FClass2d(face, ON_FACE)

    def has(self, place: Floats) -> bool:
        return self._classifier.Perform(gp_Pnt2d(*place)) in _INSIDE


def _reach(inner: Bnd_Box, outer: Bnd_Box) -> float:
    """How far the first box reaches out of the second at most."""
    if outer.IsVoid():
        return inf
    (low, high), (least, most) = _corners(inner), _corners(outer)
    return max(max(b - a, c - d) for a, b, c, d in zip(low, least, high, most))


def _height(box: Bnd_Box, axis: int, sign: float) -> float:
    """How far a box reaches in a direction along an axis."""
    if box.IsVoid():
        return -inf
    low, high = _corners(box)
    return high[axis] if sign > 0.0 else -low[axis]


def _corners(box: Bnd_Box) -> Box:
    if box.IsVoid():
        return (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    return _coordinates(box.CornerMin()), _coordinates(box.CornerMax())


def _coordinates(point: gp_Pnt) -> Point:
    return point.X(), point.Y(), point.Z()

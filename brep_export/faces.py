"""Trimmed surfaces to kernel faces, and the few moves by which every vertex, edge and face of this package is made.

An edge carries one curve in space and one pcurve on each of its faces, all over one range:

        curve in space  C(t)  ~  S(p(t))  surface at the pcurve,    |C(t) - S(p(t))| <= tolerance of the edge

The kernel's own measure of that distance takes 23 samples and comes out too low on long spline edges, and its checker
believes it; so it is measured here, densely, and written into the edge.
"""

from collections.abc import Iterable, Sequence
from functools import lru_cache
from math import hypot

import numpy as np
from numpy.typing import NDArray
from OCP.Adaptor3d import Adaptor3d_CurveOnSurface
from OCP.BRep import BRep_Builder, BRep_Tool
from OCP.BRepLib import BRepLib, BRepLib_ValidateEdge
from OCP.Geom import Geom_BSplineCurve, Geom_BSplineSurface, Geom_Curve, Geom_Surface
from OCP.Geom2d import Geom2d_BSplineCurve, Geom2d_Curve, Geom2d_Line
from OCP.Geom2dAdaptor import Geom2dAdaptor_Curve
from OCP.GeomAbs import GeomAbs_Shape
from OCP.GeomAdaptor import GeomAdaptor_Curve, GeomAdaptor_Surface
from OCP.gp import gp_Dir2d, gp_Pnt, gp_Pnt2d
from OCP.TopAbs import TopAbs_Orientation
from OCP.TopExp import TopExp
from OCP.TopLoc import TopLoc_Location
from OCP.TopoDS import TopoDS, TopoDS_Edge, TopoDS_Face, TopoDS_Shape, TopoDS_Vertex, TopoDS_Wire

from brep_export.curves import kernel_pcurve, smooth_stretches
from brep_export.surfaces import kernel_surface
from recon.errors import NoSurface
from recon.geometry.bspline import BSplineCurve, BSplineSurface
from recon.geometry.trimmed import TrimLoop, TrimmedSurface
from recon.tolerance import Tolerance

__all__ = [
    "trimmed_face",
    "loop_wire",
    "KERNEL_TOLERANCE",
    "make_vertex",
    "make_edge",
    "make_degenerate_edge",
    "make_wire",
    "make_face",
    "put_pcurve",
    "straight_pcurve",
    "cover_gap",
    "edge_gap",
    "mark_covered",
    "turned",
]

Floats = NDArray[np.float64]

KERNEL_TOLERANCE = 1e-7  # the kernel's smallest tolerance of an edge or vertex: two points nearer than this are one
SAMPLES_PER_SPAN, MAX_SAMPLES = 8, 10000  # along an edge when its gap is measured
SPARE = 1.05  # for what lies between two samples
SHARE = 0.1  # of the fit tolerance is spent on an edge's curve; the rest is left to those who join it to another face
EDGE_DEGREE, MAX_SEGMENTS = 5, 5000
FORWARD, REVERSED = TopAbs_Orientation.TopAbs_FORWARD, TopAbs_Orientation.TopAbs_REVERSED
BUILDER = BRep_Builder()
HERE = TopLoc_Location()


def trimmed_face(trimmed: TrimmedSurface, tolerance: Tolerance) -> TopoDS_Face:
    """Kernel face of a trimmed surface, its normal that of the surface; holes are inner wires.

    A pcurve makes one edge, or several where it has corners.

    Promises  the edges' curves in space stay within tolerance.fit of the surface, and every edge's tolerance covers
              the distance measured.
    Raises    NoSurface when the kernel finds no such curve; BadGeometry when it cannot hold the surface.
    """
    surface = kernel_surface(trimmed.surface)
    return make_face(surface, [loop_wire(trimmed.surface, loop, surface, tolerance) for loop in trimmed.loops])


def loop_wire(surface: BSplineSurface, loop: TrimLoop, on_kernel: Geom_Surface, tolerance: Tolerance) -> TopoDS_Wire:
    """Kernel wire of a loop on a surface, which the kernel has as `on_kernel`; promises and raises as above."""
    pcurves = [stretch for pcurve in loop.pcurves for stretch in smooth_stretches(pcurve)]
    corners = surface.point(np.array([c.control_points[0] for c in pcurves]))
    vertices = [make_vertex(point) for point in corners]
    ends = vertices[1:] + vertices[:1]
    return make_wire(_edge_on_surface(c, on_kernel, v, tolerance) for c, v in zip(pcurves, zip(vertices, ends)))


def _edge_on_surface(
    pcurve: BSplineCurve, surface: Geom_Surface, ends: tuple[TopoDS_Vertex, TopoDS_Vertex], tolerance: Tolerance
) -> TopoDS_Edge:
    flat = kernel_pcurve(pcurve)
    edge = make_edge(_curve_in_space(flat, surface, tolerance.fit * SHARE), pcurve.domain, ends)
    put_pcurve(edge, flat, surface, pcurve.domain)
    gap = cover_gap(edge, [surface])
    if gap > tolerance.fit:
        raise NoSurface(
            f"An edge of the trimmed surface leaves it by {gap:.3g}, allowed {tolerance.fit:.3g}: "
            "split its pcurve or allow more."
        )
    return edge


def _curve_in_space(pcurve: Geom2d_Curve, surface: Geom_Surface, allowed: float) -> Geom_Curve:
    # an edge of its own: the kernel leaves `allowed` on it as tolerance, though it may come much nearer
    edge = TopoDS_Edge()
    BUILDER.MakeEdge(edge)
    domain = pcurve.FirstParameter(), pcurve.LastParameter()
    put_pcurve(edge, pcurve, surface, domain)
    if not BRepLib.BuildCurve3d_s(edge, allowed, GeomAbs_Shape.GeomAbs_C1, EDGE_DEGREE, MAX_SEGMENTS):
        raise NoSurface("The kernel found no curve in space for an edge of the trimmed surface.")
    return BRep_Tool.Curve_s(edge, *domain)


def make_vertex(point: Floats, tolerance: float = KERNEL_TOLERANCE) -> TopoDS_Vertex:
    """Kernel vertex at a (3,) point."""
    vertex = TopoDS_Vertex()
    BUILDER.MakeVertex(vertex, gp_Pnt(*(float(x) for x in point)), tolerance)
    return vertex


def make_edge(curve: Geom_Curve, domain: tuple[float, float], ends: tuple[TopoDS_Vertex, TopoDS_Vertex]) -> TopoDS_Edge:
    """Kernel edge along a curve in space over `domain`, from one vertex to the other (or around, when they are one)."""
    edge = _bare_edge(*ends)
    BUILDER.UpdateEdge(edge, curve, KERNEL_TOLERANCE)
    BUILDER.Range(edge, *domain)
    return edge


def make_degenerate_edge(
    pcurve: Geom2d_Curve, surface: Geom_Surface, domain: tuple[float, float], vertex: TopoDS_Vertex
) -> TopoDS_Edge:
    """Kernel edge of a side collapsed to a point: a pcurve and its range, no curve in space, one vertex, a flag."""
    edge = _bare_edge(vertex, vertex)
    put_pcurve(edge, pcurve, surface, domain)
    BUILDER.Degenerated(edge, True)
    return edge


def _bare_edge(start: TopoDS_Vertex, end: TopoDS_Vertex) -> TopoDS_Edge:
    edge = TopoDS_Edge()
    BUILDER.MakeEdge(edge)
    BUILDER.Add(edge, start.Oriented(FORWARD))
    BUILDER.Add(edge, end.Oriented(REVERSED))
    return edge


def put_pcurve(
    edge: TopoDS_Edge, pcurve: Geom2d_Curve | tuple[Geom2d_Curve, Geom2d_Curve], surface: Geom_Surface,
    domain: tuple[float, float],
) -> None:  # fmt: skip
    """Give the edge its pcurve on a surface; a pair on a seam: for the forward, then for the reversed use."""
    pair = pcurve if isinstance(pcurve, tuple) else (pcurve,)
    BUILDER.UpdateEdge(edge, *pair, surface, HERE, KERNEL_TOLERANCE)
    BUILDER.Range(edge, surface, HERE, *domain)


def straight_pcurve(start: Floats, end: Floats, domain: tuple[float, float]) -> Geom2d_Curve:
    """Straight pcurve from one (2,) parameter pair to another over `domain`; a line where it runs at unit speed.

    The same arguments bring the same curve, which nobody may change.
    """
    (u, v), (to_u, to_v) = start.tolist(), end.tolist()
    return _straight_pcurve(u, v, to_u, to_v, domain)


@lru_cache(maxsize=256)  # sides of patches over one domain run along eight lines
def _straight_pcurve(u: float, v: float, to_u: float, to_v: float, domain: tuple[float, float]) -> Geom2d_Curve:
    way_u, way_v = to_u - u, to_v - v
    span = domain[1] - domain[0]
    length = hypot(way_u, way_v)
    if abs(length - span) > 1e-12 * span:
        knots = np.repeat(np.array(domain), 2)
        return kernel_pcurve(BSplineCurve(1, knots, np.array([(u, v), (to_u, to_v)])))
    back = domain[0] / length
    return Geom2d_Line(gp_Pnt2d(u - way_u * back, v - way_v * back), gp_Dir2d(way_u, way_v))


def make_wire(edges: Iterable[TopoDS_Shape]) -> TopoDS_Wire:
    """Closed kernel wire of oriented edges, each running on from the one before."""
    wire = TopoDS_Wire()
    BUILDER.MakeWire(wire)
    for edge in edges:
        BUILDER.Add(wire, edge)
    wire.Closed(True)
    return wire


def make_face(surface: Geom_Surface, wires: Sequence[TopoDS_Wire]) -> TopoDS_Face:
    """Kernel face on a surface between its wires, the outer one first."""
    face = TopoDS_Face()
    BUILDER.MakeFace(face, surface, HERE, KERNEL_TOLERANCE)
    for wire in wires:
        BUILDER.Add(face, wire)
    return face


def turned(shape: TopoDS_Shape, reverse: bool) -> TopoDS_Shape:
    """The shape, in the opposite orientation when `reverse`."""
    return shape.Oriented(REVERSED if reverse else FORWARD)


def cover_gap(edge: TopoDS_Edge, surfaces: Sequence[Geom_Surface], *, adapt_above: float = np.inf) -> float:
    """Measure how far the edge's curve runs from each of its surfaces; give the edge, and its ends, that tolerance.

    adapt_above  a gap above this lets the kernel first adapt pcurves that run along the edge at another speed
    Promises     the edge is marked as running at the same parameter on all its surfaces, which the measure has shown.
    Returns      the largest distance.
    """
    gap = max(edge_gap(edge, surface) for surface in surfaces)
    if gap > adapt_above:
        BUILDER.SameParameter(edge, False)
        BRepLib.SameParameter_s(edge, adapt_above)
        gap = max(edge_gap(edge, surface) for surface in surfaces)
    BUILDER.SameRange(edge, True)
    BUILDER.SameParameter(edge, True)
    BUILDER.UpdateEdge(edge, max(SPARE * gap, KERNEL_TOLERANCE))
    _cover_ends(edge)
    return gap


def mark_covered(edge: TopoDS_Edge, ends: Sequence[TopoDS_Vertex], gaps: tuple[float, float]) -> None:
    """Give an edge, and its ends, the tolerance for gaps that are known: to its surfaces, and of its ends.

    Promises  as `cover_gap`: the edge is marked as running at the same parameter on all its surfaces.
    """
    BUILDER.SameRange(edge, True)
    BUILDER.SameParameter(edge, True)
    allowed = max(SPARE * gaps[0], KERNEL_TOLERANCE)
    BUILDER.UpdateEdge(edge, allowed)
    for vertex in ends:
        BUILDER.UpdateVertex(vertex, gaps[1] + allowed)


def _cover_ends(edge: TopoDS_Edge) -> None:
    """Give both end vertices a tolerance that reaches the curve's ends, with the edge's own tolerance about them."""
    first, last = BRep_Tool.Range_s(edge)
    curve = BRep_Tool.Curve_s(edge, first, last)
    tolerance = BRep_Tool.Tolerance_s(edge)
    for vertex, t in ((TopExp.FirstVertex_s(edge), first), (TopExp.LastVertex_s(edge), last)):
        BUILDER.UpdateVertex(vertex, BRep_Tool.Pnt_s(vertex).Distance(curve.Value(t)) + tolerance)


def edge_gap(edge: TopoDS_Edge, surface: Geom_Surface) -> float:
    """Largest distance between the edge's curve and the surface at its pcurve, or at both of them on a seam."""
    domain = BRep_Tool.Range_s(edge)
    curve = BRep_Tool.Curve_s(edge, *domain)
    uses = (False, True) if BRep_Tool.IsClosed_s(edge, surface, HERE) else (False,)
    pcurves = (BRep_Tool.CurveOnSurface_s(TopoDS.Edge_s(turned(edge, way)), surface, HERE, *domain) for way in uses)
    return max(_distance(curve, pcurve, surface, domain) for pcurve in pcurves)


def _distance(curve: Geom_Curve, pcurve: Geom2d_Curve, surface: Geom_Surface, domain: tuple[float, float]) -> float:
    on_surface = Adaptor3d_CurveOnSurface(Geom2dAdaptor_Curve(pcurve, *domain), GeomAdaptor_Surface(surface))
    measure = BRepLib_ValidateEdge(GeomAdaptor_Curve(curve, *domain), on_surface, True)
    measure.SetControlPointsNumber(_n_samples(curve, pcurve, surface))
    measure.Process()
    return float(measure.GetMaxDistance())


def _n_samples(curve: Geom_Curve, pcurve: Geom2d_Curve, surface: Geom_Surface) -> int:
    spans = sum(c.NbKnots() for c in (curve, pcurve) if isinstance(c, Geom_BSplineCurve | Geom2d_BSplineCurve))
    if isinstance(surface, Geom_BSplineSurface):
        spans += surface.NbUKnots() + surface.NbVKnots()
    return min(24 + SAMPLES_PER_SPAN * spans, MAX_SAMPLES)

"""Solids whose boundary is true faces in part and triangles in part: every vertex and edge is made once and shared.

A straight edge on a curved face is off it by a little, known beforehand: that is the edge's tolerance.  What a face
that runs all around its axis needs besides, a seam and pcurves, the kernel's healing adds, with the new edges put in
place of the old ones wherever else these are used.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from OCP.BRepCheck import BRepCheck_Analyzer
from OCP.BRepGProp import BRepGProp
from OCP.GC import GC_MakeArcOfCircle
from OCP.Geom import (
    Geom_Circle,
    Geom_ConicalSurface,
    Geom_Curve,
    Geom_CylindricalSurface,
    Geom_Line,
    Geom_Plane,
    Geom_SphericalSurface,
    Geom_Surface,
)
from OCP.GeomAPI import GeomAPI_Interpolate
from OCP.gp import gp_Ax2, gp_Ax3, gp_Circ, gp_Dir, gp_Pnt
from OCP.GProp import GProp_GProps
from OCP.ShapeBuild import ShapeBuild_ReShape
from OCP.ShapeFix import ShapeFix_Face
from OCP.TColgp import TColgp_HArray1OfPnt
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopoDS import TopoDS, TopoDS_Edge, TopoDS_Shape, TopoDS_Vertex

from brep_export.check_topology import sub_shapes
from brep_export.faces import BUILDER, KERNEL_TOLERANCE, SPARE, make_edge, make_face, make_vertex, make_wire, turned
from brep_export.kernel_settings import KERNEL_FAILURES
from brep_export.shells import make_shell
from brep_export.solids import signed_volume, solids_of
from recon.errors import NoSolid
from recon.geometry.analytic import AnalyticSurface, Cone, Cylinder, Plane, Sphere
from recon.geometry.mixed import MixedBoundary, MixedEdge, MixedFace

__all__ = ["RefusedFaces", "mixed_solid"]

Floats = NDArray[np.float64]

ROUND = 1e-5  # of the radius that points may be off a circle
CURVED = 1e-3  # of the slack: tolerance of curves, which run through points on both surfaces
AREA = 0.1  # of a face's area by which the kernel's may differ from the triangles', and so many squared chords besides


class RefusedFaces(NoSolid):
    """The kernel makes no sound faces on some of the surfaces."""

    def __init__(self, surfaces: Sequence[int]) -> None:
        super().__init__(f"the kernel made no sound face on {len(surfaces)} of the surfaces")
        self.surfaces = tuple(surfaces)


def mixed_solid(boundary: MixedBoundary) -> TopoDS_Shape:
    """Kernel solid, or compound of solids, within a boundary.

    Raises  RefusedFaces naming the surfaces on which the kernel makes no sound face; NoSolid.
    """
    faces = _faces(boundary)
    bodies = [[make_shell([faces[f] for f in shell], closed=True) for shell in body] for body in boundary.bodies]
    return solids_of([[(shell, signed_volume(shell)) for shell in body] for body in bodies], "mixed boundary")


def _faces(boundary: MixedBoundary) -> list[TopoDS_Shape]:
    """All faces, turned outward, with the edges that the healing of some gave to others."""
    edge_gap, vertex_gap = _gaps(boundary)
    vertices = [make_vertex(p, t) for p, t in zip(boundary.vertices, vertex_gap.tolist())]
    edges = [_edge(edge, boundary.vertices, vertices) for edge in boundary.edges]
    for edge, gap in zip(edges, edge_gap.tolist()):
        BUILDER.UpdateEdge(edge, gap)
    bare = [_bare_face(face, boundary, edges) for face in boundary.faces]
    context = ShapeBuild_ReShape()
    refused = []
    for number, face in enumerate(boundary.faces):
        if face.surface is not None:
            healed = _healed(context.Apply(bare[number]), context, boundary.slack)
            if healed is None or not _is_like(healed, face, boundary.slack):
                refused.append(face.surface)
            else:
                bare[number] = healed
    if refused:
        raise RefusedFaces(sorted(set(refused)))
    return [turned(context.Apply(shape), face.outside < 0.0) for shape, face in zip(bare, boundary.faces)]


def _gaps(boundary: MixedBoundary) -> tuple[Floats, Floats]:
    """Tolerances of the edges (E,) and the vertices (V,): how far straight edges are off the surfaces beside them."""
    ends = np.array([(e.start, e.end) for e in boundary.edges], dtype=np.int64).reshape(-1, 2)
    straight = np.array([e.points is None for e in boundary.edges], dtype=bool)
    edge_gap, vertex_gap = np.full(len(ends), KERNEL_TOLERANCE), np.full(len(boundary.vertices), KERNEL_TOLERANCE)
    for face in boundary.faces:
        if face.surface is not None:
            rows = np.array([e for loop in face.loops for e, _ in loop], dtype=np.int64)
            rows = rows[straight[rows]]
            x = boundary.vertices[ends[rows]]
            x = np.concatenate([x, x.mean(axis=1, keepdims=True)], axis=1)
            off = np.abs(boundary.surfaces[face.surface].distance(x.reshape(-1, 3))).reshape(-1, 3).max(axis=1)
            np.maximum.at(edge_gap, rows, SPARE * off)
    edge_gap[~straight] = CURVED * boundary.slack
    np.maximum.at(vertex_gap, ends, edge_gap[:, None])
    return edge_gap, vertex_gap


def _edge(edge: MixedEdge, places: Floats, vertices: list[TopoDS_Vertex]) -> TopoDS_Edge:
    ends = vertices[edge.start], vertices[edge.end]
    if edge.points is None:
        way = places[edge.end] - places[edge.start]
        length = float(np.linalg.norm(way))
        return make_edge(Geom_Line(_point(places[edge.start]), gp_Dir(*way.tolist())), (0.0, length), ends)
    curve = _curve(edge.points)
    return make_edge(curve, (curve.FirstParameter(), curve.LastParameter()), ends)


def _curve(points: Floats) -> Geom_Curve:
    """The circle or the arc that points lie on, or else a spline through them."""
    is_ring = bool((points[0] == points[-1]).all())
    n = len(points)
    trio = points[[0, n // 3, 2 * n // 3]] if is_ring else points[[0, n // 2, -1]]
    centre, radius, normal = _circle(*trio)
    arm = points - centre
    off = max(np.abs(np.linalg.norm(arm, axis=1) - radius).max(), np.abs(arm @ normal).max())
    if off <= ROUND * radius:
        if not is_ring:
            return GC_MakeArcOfCircle(*map(_point, trio)).Value()
        start = arm[0] / np.linalg.norm(arm[0])
        return Geom_Circle(gp_Circ(gp_Ax2(_point(centre), gp_Dir(*normal.tolist()), gp_Dir(*start.tolist())), radius))
    maker = GeomAPI_Interpolate(_row(points[:-1] if is_ring else points), is_ring, 1e-9)
    maker.Perform()
    return maker.Curve()


def _row(points: Floats) -> TColgp_HArray1OfPnt:
    row = TColgp_HArray1OfPnt(1, len(points))
    for k, p in enumerate(points, 1):
        row.SetValue(k, _point(p))
    return row


def _circle(a: Floats, b: Floats, c: Floats) -> tuple[Floats, float, Floats]:
    """Centre, radius and unit normal of the circle from a over b to c; a huge one where they lie on a line."""
    normal = np.cross(b - a, c - b)
    size = float(np.linalg.norm(normal))
    if size < 1e-9 * float(np.linalg.norm(c - a)) ** 2:
        return a, np.inf, np.zeros(3)
    normal /= size
    rows = np.array([b - a, c - a, normal])
    centre = np.linalg.solve(rows, np.array([(b - a) @ (a + b) / 2, (c - a) @ (a + c) / 2, normal @ a]))
    return centre, float(np.linalg.norm(a - centre)), normal


def _surface(surface: AnalyticSurface, loops: list[Floats]) -> Geom_Surface:
    """The surface with its seam where loops (n, 3) that do not run all around it leave most room for it: a hole across
    the seam would lie on two sheets.
    """
    if isinstance(surface, Plane):
        normal = surface.normal_vector
        return Geom_Plane(_point(surface.offset * normal), gp_Dir(*normal.tolist()))
    if isinstance(surface, Cylinder):
        return Geom_CylindricalSurface(_frame(surface.point, surface.axis, loops), surface.radius)
    if isinstance(surface, Sphere):
        return Geom_SphericalSurface(_frame(surface.centre, np.eye(3)[2], loops), surface.radius)
    assert isinstance(surface, Cone)
    return Geom_ConicalSurface(_frame(surface.apex, surface.axis, loops), surface.half_angle, 0.0)


def _point(p: Floats) -> gp_Pnt:
    return gp_Pnt(*(float(x) for x in p))


def _frame(point: Floats, axis: Floats, loops: list[Floats]) -> gp_Ax3:
    side = np.cross(axis, np.eye(3)[int(np.abs(axis).argmin())])
    side /= np.linalg.norm(side)
    other = np.cross(axis, side)
    angles = [np.arctan2((x - point) @ other, (x - point) @ side) for x in loops]
    seam = _widest_gap([a for a in angles if not _runs_around(a)] or angles)
    toward = np.cos(seam) * side + np.sin(seam) * other
    return gp_Ax3(_point(point), gp_Dir(*axis.tolist()), gp_Dir(*toward.tolist()))


def _runs_around(angles: Floats) -> bool:
    """Whether a loop, at these angles about an axis, runs around it."""
    steps = np.diff(angles, append=angles[:1])
    return bool(abs((steps - 2.0 * np.pi * np.round(steps / (2.0 * np.pi))).sum()) > np.pi)


def _widest_gap(angles: list[Floats]) -> float:
    """The angle in the middle of the widest gap between some."""
    if not angles:
        return 0.0
    row = np.sort(np.concatenate(angles))
    gaps = np.diff(row, append=row[0] + 2.0 * np.pi)
    widest = int(gaps.argmax())
    return float(row[widest] + 0.5 * gaps[widest])


def _bare_face(face: MixedFace, boundary: MixedBoundary, edges: list[TopoDS_Edge]) -> TopoDS_Shape:
    """The face as its surface looks, before it is turned outward."""
    if face.surface is None:
        first = [boundary.edges[e].start if way else boundary.edges[e].end for e, way in face.loops[0]]
        a, b, c = boundary.vertices[first]
        surface: Geom_Surface = Geom_Plane(_point(a), gp_Dir(*np.cross(b - a, c - a).tolist()))
    else:
        surface = _surface(boundary.surfaces[face.surface], [_points(loop, boundary) for loop in face.loops])
    reverse = face.outside < 0.0
    loops = [loop[::-1] if reverse else loop for loop in face.loops]
    return make_face(surface, [make_wire(turned(edges[e], way == reverse) for e, way in loop) for loop in loops])


def _points(loop: tuple[tuple[int, bool], ...], boundary: MixedBoundary) -> Floats:
    """Points (n, 3) along a loop."""
    rows = []
    for number, way in loop:
        edge = boundary.edges[number]
        points = boundary.vertices[[edge.start, edge.end]] if edge.points is None else edge.points
        rows.append(points[:-1] if way else points[:0:-1])
    return np.concatenate(rows)


def _healed(face: TopoDS_Shape, context: ShapeBuild_ReShape, slack: float) -> TopoDS_Shape | None:
    """The face with pcurves and seams."""
    healer = ShapeFix_Face(TopoDS.Face_s(face))
    healer.SetContext(context)
    healer.SetPrecision(slack)
    healer.SetMaxTolerance(slack)
    healer.FixMissingSeamMode = 1
    healer.FixAddNaturalBoundMode = 1 if not list(sub_shapes(face, TopAbs_ShapeEnum.TopAbs_WIRE)) else 0
    healer.FixSmallAreaWireMode = 0
    healer.FixSplitFaceMode = 0
    try:
        healer.Perform()
        result = healer.Result()
    except KERNEL_FAILURES:
        return None
    return result if result.ShapeType() == TopAbs_ShapeEnum.TopAbs_FACE else None


def _is_like(face: TopoDS_Shape, wanted: MixedFace, slack: float) -> bool:
    """Whether a face is sound and as large as it should be."""
    properties = GProp_GProps()
    BRepGProp.SurfaceProperties_s(face, properties)
    off = abs(abs(float(properties.Mass())) - wanted.area)
    return off <= AREA * wanted.area + 100.0 * slack**2 and BRepCheck_Analyzer(face).IsValid()

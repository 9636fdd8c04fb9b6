"""How far edges are from their faces, and how smoothly faces meet: line 3 of the gate.

An edge is known two or three times over: as a curve in space and as a curve on each of its faces.  Its tolerance
must cover the distance between these curves, and the distance of its ends from its vertices.

gap    largest distance between the curve in space and the curve on a face, or of an end from its vertex
angle  between the tangent planes of two faces at a point of their common edge; 0 where they join smoothly
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from math import degrees, inf

import numpy as np
from numpy.typing import NDArray
from OCP.Adaptor3d import Adaptor3d_CurveOnSurface
from OCP.BRep import BRep_Tool
from OCP.BRepAdaptor import BRepAdaptor_Curve, BRepAdaptor_Curve2d, BRepAdaptor_Surface
from OCP.BRepCheck import BRepCheck_Analyzer, BRepCheck_Result, BRepCheck_Shell, BRepCheck_Solid, BRepCheck_Status
from OCP.BRepLib import BRepLib_ValidateEdge
from OCP.GeomAbs import GeomAbs_CurveType, GeomAbs_Shape, GeomAbs_SurfaceType
from OCP.gp import gp_Pnt, gp_Vec
from OCP.TopAbs import TopAbs_Orientation, TopAbs_ShapeEnum
from OCP.TopoDS import TopoDS, TopoDS_Edge, TopoDS_Face, TopoDS_Shape

from brep_export.check_topology import EdgeUses, count, each_once, edge_polyline, sub_shapes
from brep_export.compounds import compound_of
from brep_export.survey import Survey
from recon.geometry.cone_volume import surface_tangents
from recon.geometry.promises import Defect

__all__ = [
    "EdgeGaps",
    "edge_gaps",
    "gap_defects",
    "kernel_defects",
    "max_tolerance",
    "tolerance_defects",
    "EdgeAngles",
    "angle_defects",
    "edge_angles",
]

Floats = NDArray[np.float64]
Point = tuple[float, float, float]
Found = dict[BRepCheck_Status, Point | None]

AT_ONCE = 5_000  # faces that the kernel checks at once
_SLACK = 1.001  # tolerances are set from measured gaps, and a second measurement may differ in the last digits
_FINEST = 1e-7  # the kernel never takes a tolerance below this one seriously


@dataclass(frozen=True, eq=False)
class EdgeGaps:
    """Measured gaps: of each use (M,) between curve and curve on face, and of each edge (E,) to its vertices."""

    on_faces: Floats
    at_ends: Floats

    def largest(self) -> float:
        """The largest gap of all that could be measured; 0 for a shape without edges."""
        every = np.concatenate([self.on_faces, self.at_ends])
        every = every[np.isfinite(every)]
        return float(every.max()) if len(every) else 0.0


def edge_gaps(seen: Survey) -> EdgeGaps:
    """Measure every gap of every edge; infinite where a curve is missing."""
    uses, planes = seen.uses, seen.planes
    flat = planes.flat[uses.face]
    surfaces = {f: _surface(uses.faces[f]) for f in np.flatnonzero(~planes.flat).tolist()}
    on_faces, at_ends = np.empty(len(uses.face)), planes.gaps_at_ends()
    on_faces[flat] = planes.gaps_on_faces(np.flatnonzero(flat))
    for use in np.flatnonzero(~flat).tolist():
        face = int(uses.face[use])
        on_faces[use] = _gap_on_face(uses.use_edges[use], uses.faces[face], surfaces[face])
    for edge in np.flatnonzero(~planes.bare).tolist():
        at_ends[edge] = _gap_at_ends(uses.edges[edge])
    return EdgeGaps(on_faces, at_ends)


def _surface(face: TopoDS_Face) -> BRepAdaptor_Surface | None:
    return None if BRep_Tool.Surface_s(face) is None else BRepAdaptor_Surface(face, False)


def _gap_on_face(edge: TopoDS_Edge, face: TopoDS_Face, surface: BRepAdaptor_Surface | None) -> float:
    if surface is None or not _has_curves(edge, face):
        return inf
    on_face = Adaptor3d_CurveOnSurface(BRepAdaptor_Curve2d(edge, face), surface)
    curve = BRepAdaptor_Curve(edge)
    measure = BRepLib_ValidateEdge(curve, on_face, BRep_Tool.SameParameter_s(edge))
    # a spline edge may leave its face between two samples of a fixed number
    measure.SetControlPointsNumber(
        max(22, 4 * curve.NbKnots()) if curve.GetType() == GeomAbs_CurveType.GeomAbs_BSplineCurve else 22
    )
    measure.Process()
    return float(measure.GetMaxDistance())


def _has_curves(edge: TopoDS_Edge, face: TopoDS_Face) -> bool:
    on_face = BRep_Tool.CurveOnSurface_s(edge, face, 0.0, 0.0)
    return BRep_Tool.Curve_s(edge, 0.0, 0.0) is not None and on_face is not None


def _gap_at_ends(edge: TopoDS_Edge) -> float:
    if BRep_Tool.Curve_s(edge, 0.0, 0.0) is None:
        return inf
    curve = BRepAdaptor_Curve(edge)
    gaps = [0.0]
    for vertex in sub_shapes(edge, TopAbs_ShapeEnum.TopAbs_VERTEX):
        vertex = TopoDS.Vertex_s(vertex)
        gaps.append(curve.Value(BRep_Tool.Parameter_s(vertex, edge)).Distance(BRep_Tool.Pnt_s(vertex)))
    return max(gaps)


def gap_defects(uses: EdgeUses, gaps: EdgeGaps) -> list[Defect]:
    """Edges that are farther from a face, or from a vertex, than the kernel was told."""
    edge_tolerance = np.array([BRep_Tool.Tolerance_s(e) for e in uses.edges], dtype=np.float64)
    end_tolerance = np.array([max([t, *_vertex_tolerances(e)]) for t, e in zip(edge_tolerance, uses.edges)])
    rows = (
        (
            "edge-gap",
            "an edge lies off its face by more than its tolerance",
            gaps.on_faces,
            edge_tolerance[uses.edge],
            uses.edge,
        ),
        (
            "vertex-gap",
            "an edge ends off its vertex by more than the tolerance",
            gaps.at_ends,
            end_tolerance,
            range(len(uses.edges)),
        ),
    )
    defects = []
    for code, sentence, gap, allowed, edges in rows:
        excess = np.where(np.isfinite(gap), gap - _SLACK * np.maximum(allowed, _FINEST), -1.0)
        if len(excess) and excess.max() > 0.0:
            worst = int(np.argmax(excess))
            points = edge_polyline(uses.edges[edges[worst]], 3)
            defects.append(Defect(code, sentence, points[len(points) // 2], float(gap[worst]), float(allowed[worst])))
    return defects


def _vertex_tolerances(edge: TopoDS_Edge) -> Iterator[float]:
    return (BRep_Tool.Tolerance_s(TopoDS.Vertex_s(v)) for v in sub_shapes(edge, TopAbs_ShapeEnum.TopAbs_VERTEX))


def max_tolerance(shape: TopoDS_Shape) -> float:
    """The largest tolerance of any face, edge or vertex."""
    return max(float(BRep_Tool.MaxTolerance_s(shape, kind)) for kind in _TOLERANT)


def tolerance_defects(uses: EdgeUses, shape: TopoDS_Shape, allowed: float) -> list[Defect]:
    """A tolerance above the one asked for: then the kernel calls things joined that are not."""
    largest = max_tolerance(shape)
    if largest <= allowed * _SLACK:
        return []
    wide = [e for e in uses.edges if max([BRep_Tool.Tolerance_s(e), *_vertex_tolerances(e)]) >= largest]
    where = edge_polyline(wide[0])[0] if wide else None
    return [Defect("tolerance", "a tolerance above the one asked for", where, largest, allowed)]


def kernel_defects(shape: TopoDS_Shape, explained: Collection[BRepCheck_Status] = ()) -> tuple[bool, list[Defect]]:
    """Whether the kernel's own check, geometry included, finds the shape valid, and what it finds unexplained.

    explained  findings that another line of the gate has named already
    """
    is_small = count(shape, TopAbs_ShapeEnum.TopAbs_FACE) <= AT_ONCE
    found, valid = _found_whole(shape) if is_small else _found_by_parts(shape)
    if valid:
        return True, []
    found.pop(BRepCheck_Status.BRepCheck_NoError, None)
    told = [s for s in found if s not in explained]
    named = [str(s).rpartition("BRepCheck_")[2] for s in told]
    if not named and (found or explained):
        return False, []
    sentence = f"the kernel's own check fails ({', '.join(named) or 'without a reason'})"
    return False, [Defect("kernel-invalid", sentence, found[told[0]] if told else None)]


def _found_whole(shape: TopoDS_Shape) -> tuple[Found, bool]:
    """What the kernel finds, each with its first place, and whether it calls the shape valid."""
    analyzer = BRepCheck_Analyzer(shape, True, False, False)
    if analyzer.IsValid():
        return {}, True
    found: Found = {}
    for kind in _CHECKED:
        for part in each_once(shape, kind):
            result = analyzer.Result(part)
            if result is not None:
                _note(found, result, part)
    return found, False


def _found_by_parts(shape: TopoDS_Shape) -> tuple[Found, bool]:
    """The same of a shape with many faces: solids and shells as such, then some faces at a time.

    The kernel keeps what it finds of each face, wire, edge and vertex in every solid and shell around it, some 13 kB a
    face.  Of these only what it finds in the face itself says something that lines 1 and 2 of the gate do not.
    """
    found: Found = {}
    for solid in each_once(shape, TopAbs_ShapeEnum.TopAbs_SOLID):
        _note(found, BRepCheck_Solid(TopoDS.Solid_s(solid)), solid)
        for shell in sub_shapes(solid, TopAbs_ShapeEnum.TopAbs_SHELL):
            looked_at = BRepCheck_Shell(TopoDS.Shell_s(shell))
            looked_at.InContext(solid)
            _note(found, looked_at, shell)
    for shell in sub_shapes(shape, TopAbs_ShapeEnum.TopAbs_SHELL, TopAbs_ShapeEnum.TopAbs_SOLID):
        _note(found, BRepCheck_Shell(TopoDS.Shell_s(shell)), shell)
    faces, valid = each_once(shape, TopAbs_ShapeEnum.TopAbs_FACE), found.keys() <= {BRepCheck_Status.BRepCheck_NoError}
    for first in range(0, len(faces), AT_ONCE):
        more, sound = _found_whole(compound_of(faces[first : first + AT_ONCE]))
        valid = valid and sound
        found = more | found
    return found, valid


def _note(found: Found, result: BRepCheck_Result, part: TopoDS_Shape) -> None:
    """Add what was found of a part, in itself and in what it is a part of."""
    for status in result.Status():
        found.setdefault(status, _place(part))
    result.InitContextIterator()
    while result.MoreShapeInContext():
        for status in result.StatusOnShape():
            found.setdefault(status, _place(part))
        result.NextShapeInContext()


def _place(part: TopoDS_Shape) -> Point | None:
    vertex = next(sub_shapes(part, TopAbs_ShapeEnum.TopAbs_VERTEX), None)
    return None if vertex is None else BRep_Tool.Pnt_s(TopoDS.Vertex_s(vertex)).Coord()


@dataclass(frozen=True, eq=False)
class EdgeAngles:
    """Angles in radians between tangent planes along edges that two faces, or a seam, share.

    edges    (K,) those edges
    largest  (K,) the largest angle along each
    smooth   (K,) whether the shape says that its faces join smoothly there
    """

    edges: NDArray[np.int64]
    largest: Floats
    smooth: NDArray[np.bool_]

    def overall(self) -> float:
        """The largest angle of all; 0 for a shape without inner edges."""
        return float(self.largest.max(initial=0.0))

    def over_smooth_edges(self) -> float | None:
        """The largest along edges that are said to be smooth; None where none is."""
        return float(self.largest[self.smooth].max()) if self.smooth.any() else None


def edge_angles(seen: Survey, n: int = 7) -> EdgeAngles:
    """Measure along every inner edge.

    n  samples an edge; those where a surface has no normal (the tip of a cone) are left out
    """
    uses = seen.uses
    rows = _inner_edge_uses(uses)
    if not len(rows):
        return EdgeAngles(np.empty(0, dtype=np.int64), np.empty(0), np.empty(0, dtype=bool))
    normals = _use_normals(seen, np.unique(rows), n)
    one, other = (normals[column] for column in np.searchsorted(np.unique(rows), rows).T)
    sine = np.linalg.norm(_cross(one, other), axis=2)
    cosine = np.einsum("eij,eij->ei", one, other)
    angles = np.where((sine > 0.0) | (cosine != 0.0), np.arctan2(sine, cosine), 0.0)
    # two planes are never smooth where they meet; the reader takes those for it that meet at under 0.57 degrees
    smooth = np.array(~seen.planes.flat[uses.face[rows]].all(axis=1))
    for row in np.flatnonzero(smooth).tolist():
        a, b = rows[row]
        smooth[row] = _is_smooth(uses.edges[uses.edge[a]], uses.faces[uses.face[a]], uses.faces[uses.face[b]])
    return EdgeAngles(uses.edge[rows[:, 0]], angles.max(axis=1), smooth)


def _use_normals(seen: Survey, rows: NDArray[np.int64], n: int) -> Floats:
    """(len(rows), n, 3) unit normals out of the body along some uses; zero where the face is not known there."""
    uses, tangents = seen.uses, np.empty((len(rows), n, 6))
    left = np.ones(len(rows), dtype=bool)
    share = _shares(n)[:, None]
    for group in seen.nets.groups:
        place = np.searchsorted(group.faces, uses.face[rows])
        known = group.faces[np.minimum(place, len(group.faces) - 1)] == uses.face[rows]
        known &= seen.straight[rows]
        left &= ~known
        start, end = seen.ends[rows[known]].transpose(1, 0, 2)[:, :, None]
        pair = surface_tangents((group.nets, group.degrees, group.knots), place[known], start + share * (end - start))
        turned = np.array(
            [uses.faces[f].Orientation() == _REVERSED for f in uses.face[rows[known]].tolist()], dtype=bool
        )
        pair[turned] = pair[turned][:, :, [3, 4, 5, 0, 1, 2]]
        tangents[known] = pair
    flat = seen.planes.flat[uses.face[rows]]
    left &= ~flat
    surfaces = {f: _surface(uses.faces[f]) for f in np.unique(uses.face[rows[left]])}
    tangents[left] = np.array([_tangents(uses, use, surfaces, n) for use in rows[left]]).reshape(-1, n, 6)
    tangents[flat] = 0.0
    normals = _normals(tangents)
    normals[flat] = seen.planes.normals[uses.face[rows[flat]], None]
    return normals


def _shares(n: int) -> Floats:
    """Of an edge's range: the very ends may lie on a collapsed side, where a normal is all rounding."""
    return 0.001 + 0.998 * np.linspace(0.0, 1.0, n)


def _is_smooth(edge: TopoDS_Edge, one: TopoDS_Face, other: TopoDS_Face) -> bool:
    if one.IsSame(other) or not BRep_Tool.HasContinuity_s(edge, one, other):
        return False
    return bool(BRep_Tool.Continuity_s(edge, one, other).value >= GeomAbs_Shape.GeomAbs_G1.value)


def angle_defects(uses: EdgeUses, angles: EdgeAngles, allowed: float) -> list[Defect]:
    """An edge that is said to be smooth, and along which the tangent planes differ by more than allowed."""
    judged = np.where(angles.smooth, angles.largest, 0.0)
    if judged.max(initial=0.0) <= allowed:
        return []
    worst = int(np.argmax(judged))
    points = edge_polyline(uses.edges[angles.edges[worst]], 3)
    sentence = "tangent planes differ along an edge that is said to be smooth, in degrees"
    return [Defect("edge-angle", sentence, points[len(points) // 2], degrees(judged[worst]), degrees(allowed))]


def _inner_edge_uses(uses: EdgeUses) -> NDArray[np.int64]:
    """(K, 2) the two uses of every edge that has two within its body."""
    order = np.lexsort((uses.edge, uses.body))
    key = np.stack([uses.body[order], uses.edge[order]], axis=1)
    same = (key[1:] == key[:-1]).all(axis=1)
    # three or more uses in a row are no inner edge
    alone_before = np.concatenate([[True], ~same[:-1]]) if len(same) else same
    alone_after = np.concatenate([~same[1:], [True]]) if len(same) else same
    first = np.flatnonzero(same & alone_before & alone_after)
    return np.stack([order[first], order[first + 1]], axis=1)


def _tangents(
    uses: EdgeUses, use: int, surfaces: dict[int, BRepAdaptor_Surface | None], n: int
) -> list[tuple[float, ...]]:
    """Two tangent vectors, in one row of 6 numbers, of the face at n places along one use of an edge.

    Their cross product points out of the body; it is zero where the face is not known there.
    """
    edge, face = uses.use_edges[use], uses.faces[uses.face[use]]
    surface = surfaces[int(uses.face[use])]
    if surface is None or BRep_Tool.CurveOnSurface_s(edge, face, 0.0, 0.0) is None:
        return [(0.0,) * 6] * n
    reverse = face.Orientation() == _REVERSED
    if surface.GetType() == GeomAbs_SurfaceType.GeomAbs_Plane:
        position = surface.Plane().Position()
        axes = (position.XDirection().Coord(), position.YDirection().Coord())
        return [axes[1] + axes[0] if reverse else axes[0] + axes[1]] * n
    curve = BRepAdaptor_Curve2d(edge, face)
    first, last = curve.FirstParameter(), curve.LastParameter()
    point, along_u, along_v = gp_Pnt(), gp_Vec(), gp_Vec()
    pair = (along_v, along_u) if reverse else (along_u, along_v)
    rows = []
    for share in _shares(n).tolist():
        on_face = curve.Value(first + share * (last - first))
        surface.D1(on_face.X(), on_face.Y(), point, along_u, along_v)
        rows.append(pair[0].Coord() + pair[1].Coord())
    return rows


def _normals(tangents: Floats) -> Floats:
    """(..., 3) unit normals from pairs of tangents (..., 6); zero where these are parallel but for rounding."""
    one, other = tangents[..., :3], tangents[..., 3:]
    normals = _cross(one, other)
    length, sizes = np.linalg.norm(normals, axis=-1), np.linalg.norm(one, axis=-1) * np.linalg.norm(other, axis=-1)
    sound = length > 1e-9 * sizes
    return np.asarray(normals * np.divide(1.0, length, out=np.zeros_like(length), where=sound)[..., None])


def _cross(a: Floats, b: Floats) -> Floats:
    """Cross products of (..., 3) vectors, without the bookkeeping that makes numpy's slow on small arrays."""
    (ax, ay, az), (bx, by, bz) = np.moveaxis(a, -1, 0), np.moveaxis(b, -1, 0)
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)


_REVERSED = TopAbs_Orientation.TopAbs_REVERSED
_CHECKED = (
    TopAbs_ShapeEnum.TopAbs_SOLID,
    TopAbs_ShapeEnum.TopAbs_SHELL,
    TopAbs_ShapeEnum.TopAbs_FACE,
    TopAbs_ShapeEnum.TopAbs_WIRE,
    TopAbs_ShapeEnum.TopAbs_EDGE,
    TopAbs_ShapeEnum.TopAbs_VERTEX,
)
_TOLERANT = (TopAbs_ShapeEnum.TopAbs_FACE, TopAbs_ShapeEnum.TopAbs_EDGE, TopAbs_ShapeEnum.TopAbs_VERTEX)

"""STEP of many B-spline faces beside planar ones, written straight from arrays: smaller, and read in half the time.

The kernel's writer leaves out the pcurves, or writes one for every use; without them its reader projects every edge on
its faces, which takes longest of all that it does. Sides of patches are straight in the parameter plane, and the same
few lines serve all of them:

    point p   CARTESIAN_POINT, once for all patches, curves and vertices that have it
    face f    B_SPLINE_SURFACE_WITH_KNOTS or PLANE; EDGE_LOOPs of ORIENTED_EDGEs, FACE_BOUND, ADVANCED_FACE
    edge e    EDGE_CURVE on a SURFACE_CURVE: B_SPLINE_CURVE_WITH_KNOTS or LINE, and a PCURVE on every face with a net
    line      LINE in the parameter plane, DEFINITIONAL_REPRESENTATION, shared by all uses that run there
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from OCP.BRep import BRep_Tool
from OCP.Geom import Geom_BSplineCurve, Geom_Line, Geom_Plane
from OCP.TopAbs import TopAbs_Orientation, TopAbs_ShapeEnum
from OCP.TopExp import TopExp
from OCP.TopoDS import TopoDS, TopoDS_Shape
from OCP.TopTools import TopTools_IndexedMapOfShape

from brep_export.bulk_splines import SplineRecord, curve_records
from brep_export.check_geometry import max_tolerance
from brep_export.check_topology import EdgeUses, ShapeKind, count
from brep_export.face_nets import NetGroup
from brep_export.file_header import FileHeader
from brep_export.measures import ShapeMeasures
from brep_export.step_text import UNITS, StepText, add_product, directions, number_list, real
from brep_export.survey import Survey, survey

__all__ = ["write_spline_text"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

FEWEST_FACES = 64  # below, the kernel writes as fast
DIGITS = 15  # of the largest coordinate, as the kernel writes them


def write_spline_text(
    shape: TopoDS_Shape, path: Path, header: FileHeader, measures: ShapeMeasures, seen: Survey | None = None
) -> bool:
    """Write the solids or the shell of a shape as AP214; False, and no file, where the shape has other parts.

    Faces lie on planes, or are polynomial B-splines with straight pcurves; edges are lines or polynomial B-splines.
    """
    if measures.faces < FEWEST_FACES or header.unit not in UNITS:
        return False
    parts = _parts(shape, seen or survey(shape))
    if parts is None:
        return False
    with StepText.into(path, header) as text:
        points = _points(text, parts)
        edges = _edge_curves(text, parts, points, _surfaces(text, parts, points))
        bodies, kind = _bodies(text, parts, *edges)
        add_product(text, bodies, header, kind=kind, measures=measures, accuracy=max_tolerance(shape))
    return True


class _Curve(NamedTuple):
    """Degree, knots, multiplicities and poles of a curve; degree 0: point and direction of a line."""

    degree: int
    knots: str
    poles: Floats


@dataclass(frozen=True, eq=False)
class _Parts:
    """What the file is made of.

    planes  of the faces without a net: number, and point, normal and first direction
    ends    (E, 2) vertices of every edge
    loops   of every face, rows of uses head to tail
    """

    seen: Survey
    planes: dict[int, Floats]
    curves: list[_Curve]
    vertices: Floats
    ends: Ints
    loops: list[list[Ints]]


def _parts(shape: TopoDS_Shape, seen: Survey) -> _Parts | None:
    uses, grouped = seen.uses, seen.nets.grouped()
    shells = count(shape, TopAbs_ShapeEnum.TopAbs_SHELL)
    kinds = set(uses.body_kinds)
    if len(kinds) != 1 or kinds == {ShapeKind.FACE} or shells != len(uses.bodies) or not shape.Location().IsIdentity():
        return None
    planes = {}
    for number in np.flatnonzero(~grouped).tolist():
        surface = BRep_Tool.Surface_s(uses.faces[number])
        if not isinstance(surface, Geom_Plane):
            return None
        frame = surface.Position()
        planes[number] = np.array([p.Coord() for p in (frame.Location(), frame.Direction(), frame.XDirection())])
        if not frame.Direct():
            return None
    if not (seen.straight | ~grouped[uses.face]).all() or _has_seams(uses):
        return None
    curves = _curves(uses)
    vertices, ends = _vertices(uses)
    loops = _loops(uses, ends)
    if curves is None or loops is None or sum(map(len, loops)) != count(shape, TopAbs_ShapeEnum.TopAbs_WIRE):
        return None
    return _Parts(seen, planes, curves, vertices, ends, loops)


def _has_seams(uses: EdgeUses) -> bool:
    pairs = np.stack([uses.face, uses.edge], axis=1)
    return len(np.unique(pairs, axis=0)) < len(pairs)


def _curves(uses: EdgeUses) -> list[_Curve] | None:
    """Of every edge; None where one is neither a line nor a polynomial B-spline."""
    found = [BRep_Tool.Curve_s(edge, 0.0, 0.0) for edge in uses.edges]
    if not all(isinstance(curve, Geom_Line | Geom_BSplineCurve) for curve in found):
        return None
    records = iter(curve_records([curve for curve in found if isinstance(curve, Geom_BSplineCurve)]))
    known = [_line(curve) if isinstance(curve, Geom_Line) else _spline(next(records)) for curve in found]
    return None if any(curve is None for curve in known) else [curve for curve in known if curve is not None]


def _line(line: Geom_Line) -> _Curve:
    axis = line.Position()
    return _Curve(0, "", np.array([axis.Location().Coord(), axis.Direction().Coord()]))


def _spline(record: SplineRecord | None) -> _Curve | None:
    return None if record is None else _Curve(record.degrees[0], _knot_text(record.n_knots, record.tail), record.poles)


@lru_cache(maxsize=256)
def _knot_text(n_knots: tuple[int, ...], tail: bytes) -> str:
    (values, counts), *_ = SplineRecord((), (), n_knots, np.empty((0, 3)), tail).knots()
    return f"({','.join(map(str, counts.tolist()))}),({','.join(map(real, values.tolist()))})"


def _vertices(uses: EdgeUses) -> tuple[Floats, Ints]:
    """(V, 3) places of the vertices, and the (E, 2) first and last of every edge."""
    numbers = TopTools_IndexedMapOfShape()
    ends = np.array(
        [(numbers.Add(TopExp.FirstVertex_s(e, False)), numbers.Add(TopExp.LastVertex_s(e, False))) for e in uses.edges]
    )
    places = [BRep_Tool.Pnt_s(TopoDS.Vertex_s(numbers(i))).Coord() for i in range(1, numbers.Extent() + 1)]
    return np.array(places), ends - 1


def _loops(uses: EdgeUses, ends: Ints) -> list[list[Ints]] | None:
    """Uses of every face head to tail; None where they are not in order around it."""
    order = np.argsort(uses.face, kind="stable")
    first = np.searchsorted(uses.face[order], np.arange(len(uses.faces) + 1)).tolist()
    start = np.where(uses.forward, ends[uses.edge, 0], ends[uses.edge, 1]).tolist()
    end = np.where(uses.forward, ends[uses.edge, 1], ends[uses.edge, 0]).tolist()
    found = []
    for number, face in enumerate(uses.faces):
        rows = order[first[number] : first[number + 1]].tolist()
        if face.Orientation() == TopAbs_Orientation.TopAbs_REVERSED:
            # a face that is turned over shows its wires turned over, in the order of its surface; once read it does not
            rows = rows[::-1]
        loops = _closed(rows, start, end) or _closed(rows[::-1], start, end)
        if loops is None:
            return None
        found.append(loops)
    return found


def _closed(rows: list[int], start: list[int], end: list[int]) -> list[Ints] | None:
    loops, begin = [], 0
    for place, row in enumerate(rows):
        if end[row] == start[rows[begin]]:
            loops.append(np.array(rows[begin : place + 1]))
            begin = place + 1
        elif place + 1 == len(rows) or start[rows[place + 1]] != end[row]:
            return None
    return loops


class _Points(NamedTuple):
    """Numbers of the points of every group of nets, of every curve, of every vertex, and of every plane."""

    nets: list[Ints]
    curves: list[Ints]
    vertices: Ints
    planes: Ints


def _points(text: StepText, parts: _Parts) -> _Points:
    """Every place once: neighbours share the points along their edge."""
    rows = [group.nets.reshape(-1, 3) for group in parts.seen.nets.groups]
    rows += [curve.poles if curve.degree else curve.poles[:1] for curve in parts.curves]
    rows += [parts.vertices, *(plane[:1] for plane in parts.planes.values())]
    places = np.concatenate(rows)
    decimals = max(0, DIGITS - 1 - int(np.floor(np.log10(max(np.abs(places).max(), 1e-300)))))
    places = np.round(places, decimals) + 0.0  # no negative zero
    first, slot = _distinct(places)
    number = text.add_points(places[first], decimals)[slot]
    pieces: Iterator[Ints] = iter(np.split(number, np.cumsum([len(row) for row in rows])[:-1]))
    nets = [next(pieces).reshape(group.nets.shape[:3]) for group in parts.seen.nets.groups]
    curves = [next(pieces) for _ in parts.curves]
    return _Points(nets, curves, next(pieces), np.concatenate([np.empty(0, dtype=np.int64), *pieces]))


def _distinct(places: Floats) -> tuple[Ints, Ints]:
    """Rows of which each place is the first, and the place of every row among them."""
    mixed = places.view(np.uint64) * np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], np.uint64)
    mixed ^= mixed >> np.uint64(29)
    _, first, slot = np.unique(
        mixed[:, 0] + 31 * mixed[:, 1] + 1009 * mixed[:, 2], return_index=True, return_inverse=True
    )
    if not (places[first][slot] == places).all():  # two places with one key
        _, first, slot = np.unique(places, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)  # points in the order in which they are met
    return first[order], np.argsort(order)[slot.ravel()]


def _surfaces(text: StepText, parts: _Parts, points: _Points) -> Ints:
    """(F,) numbers of the surfaces."""
    numbers = np.empty(parts.seen.nets.n_faces, dtype=np.int64)
    for group, ids in zip(parts.seen.nets.groups, points.nets):
        row = "(" + ",".join(["#%d"] * ids.shape[2]) + ")"
        form = f"B_SPLINE_SURFACE_WITH_KNOTS('',{group.degrees[0]},{group.degrees[1]},("
        form += ",".join([row] * ids.shape[1]) + f"),.UNSPECIFIED.,.F.,.F.,.F.,{_surface_knots(group)},.UNSPECIFIED.)"
        numbers[group.faces] = text.add_all(form % tuple(row) for row in ids.reshape(len(ids), -1).tolist())
    if parts.planes:
        frames = np.array(list(parts.planes.values()))
        z, x = directions(text, frames[:, 1], DIGITS), directions(text, frames[:, 2], DIGITS)
        rows = zip(points.planes.tolist(), z.tolist(), x.tolist())
        place = text.add_all(f"AXIS2_PLACEMENT_3D('',#{p},#{d},#{e})" for p, d, e in rows)
        numbers[list(parts.planes)] = text.add_all(f"PLANE('',#{p})" for p in place.tolist())
    return numbers


def _surface_knots(group: NetGroup) -> str:
    different = [np.unique(knots, return_counts=True) for knots in group.knots]
    counts = [f"({','.join(map(str, count.tolist()))})" for _, count in different]
    values = [f"({','.join(map(real, knots.tolist()))})" for knots, _ in different]
    return ",".join(counts + values)


def _edge_curves(text: StepText, parts: _Parts, points: _Points, surfaces: Ints) -> tuple[Ints, Ints]:
    """Numbers of the edges' curves (E,) and of the surfaces (F,)."""
    in_space = _curves_in_space(text, parts, points)
    uses, grouped = parts.seen.uses, parts.seen.nets.grouped()
    rows = np.flatnonzero(grouped[uses.face])
    lines = _pcurve_lines(text, parts.seen, rows)
    pcurves = text.add_all(f"PCURVE('',#{s},#{d})" for s, d in zip(surfaces[uses.face[rows]].tolist(), lines.tolist()))
    on_edge: list[list[int]] = [[] for _ in uses.edges]
    for edge, pcurve in zip(uses.edge[rows].tolist(), pcurves.tolist()):
        on_edge[edge].append(pcurve)
    shown = [e for e, found in enumerate(on_edge) if found]
    in_space[shown] = text.add_all(
        f"SURFACE_CURVE('',#{in_space[e]},{number_list(on_edge[e])},.PCURVE_S1.)" for e in shown
    )
    vertex = text.add_all(f"VERTEX_POINT('',#{p})" for p in points.vertices.tolist())
    ends = vertex[parts.ends].tolist()
    edges = text.add_all(f"EDGE_CURVE('',#{a},#{b},#{c},.T.)" for (a, b), c in zip(ends, in_space.tolist()))
    return edges, surfaces


def _curves_in_space(text: StepText, parts: _Parts, points: _Points) -> Ints:
    numbers = np.empty(len(parts.curves), dtype=np.int64)
    spline = [e for e, curve in enumerate(parts.curves) if curve.degree]
    line = [e for e, curve in enumerate(parts.curves) if not curve.degree]
    numbers[spline] = text.add_all(
        f"B_SPLINE_CURVE_WITH_KNOTS('',{parts.curves[e].degree},{number_list(points.curves[e])},"
        f".UNSPECIFIED.,.F.,.F.,{parts.curves[e].knots},.UNSPECIFIED.)"
        for e in spline
    )
    if line:
        way = directions(text, np.array([parts.curves[e].poles[1] for e in line]), DIGITS)
        vector = text.add_all(f"VECTOR('',#{d},1.)" for d in way.tolist())
        numbers[line] = text.add_all(f"LINE('',#{points.curves[e][0]},#{v})" for e, v in zip(line, vector.tolist()))
    return numbers


def _pcurve_lines(text: StepText, seen: Survey, rows: Ints) -> Ints:
    """(len(rows),) numbers of the lines in the parameter plane, each written once."""
    spans = np.array([BRep_Tool.Range_s(edge) for edge in seen.uses.edges])[seen.uses.edge[rows]]
    start, end = seen.ends[rows].transpose(1, 0, 2)
    way = (end - start) / (spans[:, 1] - spans[:, 0])[:, None]
    at = start - spans[:, :1] * way
    different, slot = np.unique(np.round(np.hstack([at, way]), DIGITS - 2) + 0.0, axis=0, return_inverse=True)
    plane = text.add(
        "( GEOMETRIC_REPRESENTATION_CONTEXT(2) PARAMETRIC_REPRESENTATION_CONTEXT() "
        "REPRESENTATION_CONTEXT('2D SPACE','') )"
    )
    point, ways = text.add_points(different[:, :2], DIGITS - 2), directions(text, different[:, 2:], DIGITS - 2)
    vector = text.add_all(f"VECTOR('',#{d},1.)" for d in ways.tolist())
    lines = text.add_all(f"LINE('',#{p},#{v})" for p, v in zip(point.tolist(), vector.tolist()))
    shown = text.add_all(f"DEFINITIONAL_REPRESENTATION('',(#{n}),#{plane})" for n in lines.tolist())
    return np.asarray(shown[slot.ravel()])


def _bodies(text: StepText, parts: _Parts, edges: Ints, surfaces: Ints) -> tuple[list[int], str]:
    """Numbers of the bodies, and the kind of the representation that holds them."""
    uses = parts.seen.uses
    sense = ["T" if forward else "F" for forward in uses.forward.tolist()]
    oriented = text.add_all(f"ORIENTED_EDGE('',*,*,#{e},.{s}.)" for e, s in zip(edges[uses.edge].tolist(), sense))
    around = text.add_all(f"EDGE_LOOP('',{number_list(oriented[loop])})" for loops in parts.loops for loop in loops)
    bound = text.add_all(f"FACE_BOUND('',#{loop},.T.)" for loop in around.tolist())
    stops = np.cumsum([len(loops) for loops in parts.loops])
    reverse = [face.Orientation() == TopAbs_Orientation.TopAbs_REVERSED for face in uses.faces]
    rows = zip(np.split(bound, stops[:-1]), surfaces.tolist(), reverse)
    faces = text.add_all(f"ADVANCED_FACE('',{number_list(b)},#{s},.{'F' if r else 'T'}.)" for b, s, r in rows)
    shells = [number_list(faces[uses.face_body == body]) for body in range(len(uses.bodies))]
    if uses.is_solid.all():
        closed = text.add_all(f"CLOSED_SHELL('',{shell})" for shell in shells)
        return text.add_all(f"MANIFOLD_SOLID_BREP('',#{shell})" for shell in closed.tolist()).tolist(), "ADVANCED_BREP"
    opened = text.add_all(f"OPEN_SHELL('',{shell})" for shell in shells)
    return [text.add(f"SHELL_BASED_SURFACE_MODEL('',{number_list(opened)})")], "MANIFOLD_SURFACE"

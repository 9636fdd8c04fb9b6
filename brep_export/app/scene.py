"""What the page of a report lets one turn: parts with their colours, numbers at their points, and the edges of shapes.

A scene is written as JSON that the page holds as it is: arrays in base64, 32-bit, about an origin of the scene's own.
"""

import json
from base64 import b64encode
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from math import dist
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from OCP.TopoDS import TopoDS_Shape

from brep_export.check import CheckReport
from brep_export.display import ShownEdges, shown_edges, shown_faces
from brep_export.kernel_settings import KERNEL_FAILURES
from recon.geometry.control_mesh import ControlMesh
from recon.geometry.mesh import TriangleMesh

__all__ = [
    "Kind",
    "Measured",
    "ScenePart",
    "kernel_parts",
    "line_part",
    "mesh_part",
    "net_part",
    "point_part",
    "shape_parts",
    "write_scene",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

MOST_TRIANGLES = 200_000  # of a scene; above it parts are thinned out, those of the result last
RESULT_SHARE = 0.6
FINENESS = 5e-4  # of the diagonal: how far the shown triangles of a shape may stay from its faces
MANY_LEGS = 20_000  # of edges, which would cover the faces and are hidden at first
SHADES = 33  # colours of the scale
EDGE = "#30343c"


class Kind(StrEnum):
    """What the cells of a part are."""

    MESH = "mesh"
    LINES = "lines"
    POINTS = "points"


@dataclass(frozen=True, eq=False)
class ScenePart:
    """One thing that can be shown or hidden.

    cells    (T, 3) triangles or (L, 2) legs of lines, as numbers of points (V, 3); None for points alone, and for legs
             whose ends follow each other
    normals  (V, 3) unit, or None: then they are averaged from the triangles
    values   (V,) numbers that colour the part, or None; scale says what they are, with their unit
    angles   (L,) degrees between the faces along legs that are edges of a shape, or None
    result   whether it was made, not measured
    shown    whether it is to be seen at first
    """

    name: str
    kind: Kind
    colour: str
    points: Floats
    cells: Ints | None = None
    normals: Floats | None = None
    values: Floats | None = None
    scale: str = ""
    angles: Floats | None = None
    result: bool = False
    shown: bool = True


@dataclass(frozen=True, eq=False)
class Measured:
    """What a shape was made from.

    parts      what was measured, as it is to be shown
    deviation  points (n, 3) of the shape to (n,) numbers that colour it; None where there is nothing to compare
    scale      what the numbers are, with their unit
    """

    parts: Sequence[ScenePart] = ()
    deviation: Callable[[Floats], Floats] | None = None
    scale: str = ""


def mesh_part(name: str, mesh: TriangleMesh, colour: str, **more: Any) -> ScenePart:
    """Triangles; `more` are further fields."""
    return ScenePart(name, Kind.MESH, colour, mesh.vertices, mesh.face_vertices, **more)


def line_part(name: str, lines: Sequence[ArrayLike], colour: str, **more: Any) -> ScenePart:
    """Polylines (n, 3), or (n, 2) in the plane z = 0."""
    rows = [_in_space(line) for line in lines]
    first = np.cumsum([0] + [len(row) for row in rows])
    legs = [np.stack([np.arange(len(r) - 1), np.arange(1, len(r))], axis=1) + at for r, at in zip(rows, first)]
    points = np.concatenate([np.empty((0, 3)), *rows])
    return ScenePart(
        name, Kind.LINES, colour, points, np.concatenate([np.empty((0, 2), dtype=np.int64), *legs]), **more
    )


def net_part(name: str, mesh: ControlMesh, colour: str, **more: Any) -> ScenePart:
    """The sides of a control mesh's faces, each once."""
    legs = np.stack([mesh.face_corners, mesh.face_corners[mesh.next_corners()]], axis=1)
    return ScenePart(name, Kind.LINES, colour, mesh.vertices, np.unique(np.sort(legs, axis=1), axis=0), **more)


def point_part(name: str, points: ArrayLike, colour: str, **more: Any) -> ScenePart:
    """Points (n, 3), or (n, 2) in the plane z = 0."""
    return ScenePart(name, Kind.POINTS, colour, _in_space(points), **more)


def _in_space(points: ArrayLike) -> Floats:
    given = np.asarray(points, dtype=np.float64)
    return given if given.shape[1] == 3 else np.column_stack([given, np.zeros(len(given))])


def shape_parts(
    name: str, shape: TopoDS_Shape, report: CheckReport, measured: Measured, *, colour: str
) -> list[ScenePart]:
    """Faces and edges of a kernel shape; of one that the kernel cannot show, the triangles of the gate, if it has them.

    measured  colours the faces by their deviation
    """
    triangles = report.triangulation
    try:
        size = dist(*report.measures.bounding_box) if report.measures else 1.0
        parts = kernel_parts(name, shape, max(FINENESS * size, 1e-9), colour=colour)
    except KERNEL_FAILURES:
        parts = []
    shown = sum(map(_n_triangles, parts))
    if triangles is not None and not 0 < shown <= RESULT_SHARE * MOST_TRIANGLES:
        edges = [part for part in parts if part.kind is Kind.LINES]
        parts = [mesh_part(name, triangles, colour, result=True), *edges]
    many = sum(len(part.angles) for part in parts if part.angles is not None) > MANY_LEGS
    return [replace(_deviating(part, measured), shown=not (many and part.angles is not None)) for part in parts]


def kernel_parts(name: str, shape: TopoDS_Shape, deflection: float, *, colour: str) -> list[ScenePart]:
    """Faces, if there are any, and edges of a kernel shape.

    deflection  length, how far triangles may stay from the faces
    """
    made = shown_faces(shape, deflection)
    edges = _edges(name, shown_edges(shape), colour, bare=not len(made.triangles))
    if not len(made.triangles):
        return [edges]
    return [ScenePart(name, Kind.MESH, colour, made.vertices, made.triangles, made.normals, result=True), edges]


def _edges(name: str, edges: ShownEdges, colour: str, *, bare: bool) -> ScenePart:
    """The edges of a shape; bare ones, which bound no face, are the shape itself."""
    points = edges.legs.reshape(-1, 3)
    if bare:
        return ScenePart(name, Kind.LINES, colour, points, result=True)
    told = f"without {edges.left_out} of the smoothest edges" if edges.left_out else ""
    return ScenePart(f"edges of {name}", Kind.LINES, EDGE, points, scale=told, angles=edges.angles, result=True)


def _deviating(part: ScenePart, measured: Measured) -> ScenePart:
    if measured.deviation is None or part.kind is not Kind.MESH:
        return part
    return replace(part, values=measured.deviation(part.points), scale=measured.scale)


def write_scene(path: Path, parts: Sequence[ScenePart], *, unit: str) -> None:
    """Write the parts, each name once, thinned out where together they are too many triangles for a page."""
    once = list({part.name: part for part in parts if len(part.points)}.values())
    if not once:
        return
    corners = np.array([[part.points.min(axis=0), part.points.max(axis=0)] for part in once])
    low, high = corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)
    middle = (low + high) / 2
    content = {
        "unit": unit,
        "box": [low.tolist(), high.tolist()],
        "shades": _shades(),
        "parts": [_packed(part, middle) for part in _thinned(once)],
    }
    path.write_text(json.dumps(content, separators=(",", ":")), encoding="utf-8")


def _thinned(parts: Sequence[ScenePart]) -> list[ScenePart]:
    made = sum(_n_triangles(part) for part in parts if part.result)
    measured = sum(_n_triangles(part) for part in parts if not part.result)
    room_made = min(made, max(RESULT_SHARE * MOST_TRIANGLES, MOST_TRIANGLES - measured))
    keep = {True: room_made / max(made, 1), False: min(1.0, (MOST_TRIANGLES - room_made) / max(measured, 1))}
    return [_with_fewer(part, keep[part.result]) for part in parts]


def _n_triangles(part: ScenePart) -> int:
    return len(part.cells) if part.kind is Kind.MESH and part.cells is not None else 0


def _with_fewer(part: ScenePart, keep: float) -> ScenePart:
    """The part with a share of its triangles, by quadric error; numbers are taken from the nearest old point."""
    if keep >= 1.0 or not _n_triangles(part):
        return part
    import fast_simplification
    from scipy.spatial import cKDTree

    target = max(int(keep * _n_triangles(part)), 4)
    # copies: the library takes no arrays that are locked
    points, triangles = fast_simplification.simplify(
        np.array(part.points), np.array(part.cells, dtype=np.int64), target_count=target
    )
    values = None if part.values is None else part.values[cKDTree(part.points).query(points)[1]]
    return replace(part, points=np.asarray(points), cells=triangles.astype(np.int64), normals=None, values=values)


def _shades() -> list[str]:
    from matplotlib import colormaps

    from brep_export.app.pictures import COLOURS

    rows = colormaps[COLOURS](np.linspace(0.0, 1.0, SHADES), bytes=True)
    return [f"#{r:02x}{g:02x}{b:02x}" for r, g, b, _ in rows.tolist()]


def _packed(part: ScenePart, origin: Floats) -> dict[str, Any]:
    return {
        "name": part.name,
        "kind": str(part.kind),
        "colour": part.colour,
        "result": part.result,
        "shown": part.shown,
        "scale": part.scale,
        "points": _text(part.points - origin, "<f4"),
        "cells": None if part.cells is None else _text(part.cells, "<u4"),
        "normals": None if part.normals is None else _text(32767.0 * part.normals, "<i2"),
        "values": None if part.values is None else _text(part.values, "<f4"),
        "angles": None if part.angles is None else _text(part.angles, "<f4"),
    }


def _text(array: NDArray[Any], kind: str) -> str:
    rounded = np.rint(array) if kind in ("<i2", "<u4") else array
    return b64encode(np.ascontiguousarray(rounded.astype(kind)).tobytes()).decode()

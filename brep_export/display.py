"""A kernel shape as it is shown: triangles with the faces' own normals, and edges with the angle that faces make there.

Unlike the triangles of the gate, these are not joined between faces: a node on an edge stands once for every face, with
the normal of each, so that shading and stripes show how the faces meet and not how triangles were averaged.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from OCP.BRep import BRep_Tool
from OCP.BRepBuilderAPI import BRepBuilderAPI_Copy
from OCP.BRepLib import BRepLib_ToolTriangulatedShape
from OCP.BRepMesh import BRepMesh_IncrementalMesh
from OCP.TopAbs import TopAbs_Orientation, TopAbs_ShapeEnum
from OCP.TopLoc import TopLoc_Location
from OCP.TopoDS import TopoDS, TopoDS_Face, TopoDS_Shape

from brep_export.check_geometry import edge_angles
from brep_export.check_topology import edge_polyline, sub_shapes
from brep_export.survey import Survey, survey

__all__ = ["FREE", "ShownEdges", "ShownFaces", "shown_edges", "shown_faces"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

FREE = -1.0  # in place of an angle: the edge has one face only
MOST_LEGS, MOST_POINTS = 80_000, 24  # straight legs of all edges together, points of one


@dataclass(frozen=True, eq=False)
class ShownFaces:
    """Triangles (T, 3) over vertices (V, 3) with unit normals (V, 3) out of the body, each face with its own."""

    vertices: Floats
    normals: Floats
    triangles: Ints


@dataclass(frozen=True, eq=False)
class ShownEdges:
    """Straight legs (L, 2, 3) of edges, and (L,) the largest angle in degrees along the edge of each, or FREE.

    left_out  number of smooth legs that are not here, where there are too many
    """

    legs: Floats
    angles: Floats
    left_out: int = 0


def shown_faces(shape: TopoDS_Shape, deflection: float, *, angle: float = 0.35) -> ShownFaces:
    """Triangles that stay within a distance of the faces; the shape itself is left as it was.

    deflection  length
    angle       radians, largest turn from one triangle to the next along an edge
    """
    shape = BRepBuilderAPI_Copy(shape, False, False).Shape()
    BRepMesh_IncrementalMesh(shape, deflection, False, angle, False)
    parts = [_face(TopoDS.Face_s(face)) for face in sub_shapes(shape, TopAbs_ShapeEnum.TopAbs_FACE)]
    first = np.cumsum([0] + [len(part.vertices) for part in parts])
    return ShownFaces(
        np.concatenate([np.empty((0, 3)), *(part.vertices for part in parts)]),
        np.concatenate([np.empty((0, 3)), *(part.normals for part in parts)]),
        np.concatenate(
            [np.empty((0, 3), dtype=np.int64), *(part.triangles + at for part, at in zip(parts, first.tolist()))]
        ),
    )


def _face(face: TopoDS_Face) -> ShownFaces:
    place = TopLoc_Location()
    nodes = BRep_Tool.Triangulation_s(face, place)
    if nodes is None or nodes.NbTriangles() == 0:
        return ShownFaces(np.empty((0, 3)), np.empty((0, 3)), np.empty((0, 3), dtype=np.int64))
    BRepLib_ToolTriangulatedShape.ComputeNormals_s(face, nodes)
    numbers = range(1, nodes.NbNodes() + 1)
    points = np.array([nodes.Node(i).Coord() for i in numbers])
    normals = np.array([nodes.Normal(i).Coord() for i in numbers])
    triangles = np.array([nodes.Triangle(i).Get() for i in range(1, nodes.NbTriangles() + 1)], dtype=np.int64) - 1
    if not place.IsIdentity():
        move = place.Transformation()
        matrix = np.array([[move.Value(i, j) for j in (1, 2, 3, 4)] for i in (1, 2, 3)])
        points, normals = points @ matrix[:, :3].T + matrix[:, 3], normals @ matrix[:, :3].T
    if face.Orientation() == TopAbs_Orientation.TopAbs_REVERSED:
        return ShownFaces(points, -normals, triangles[:, ::-1])
    return ShownFaces(points, normals, triangles)


def shown_edges(shape: TopoDS_Shape) -> ShownEdges:
    """Every edge of a shape; of a shape without faces all edges count as smooth, since nothing meets along them."""
    seen = survey(shape)
    uses = seen.uses
    if not uses.faces:
        rows = [np.array(edge_polyline(TopoDS.Edge_s(e), 400)) for e in sub_shapes(shape, TopAbs_ShapeEnum.TopAbs_EDGE)]
        return _legs(rows, np.zeros(len(rows)))
    n = int(np.clip(MOST_LEGS // max(len(uses.edges), 1), 3, MOST_POINTS))
    return _legs([np.array(edge_polyline(edge, n)) for edge in uses.edges], _angles(seen))


def _angles(seen: Survey) -> Floats:
    """(E,) of every edge: the largest angle along it in degrees, FREE where one face alone uses it."""
    measured, uses = edge_angles(seen), seen.uses
    angles = np.zeros(len(uses.edges))
    angles[np.bincount(uses.edge, minlength=len(angles)) == 1] = FREE
    np.maximum.at(angles, measured.edges, np.degrees(measured.largest))
    return angles


def _legs(rows: list[Floats], angles: Floats) -> ShownEdges:
    legs = [np.stack([row[:-1], row[1:]], axis=1) for row in rows]
    counts = [len(leg) for leg in legs]
    every, of_legs = np.concatenate([np.empty((0, 2, 3)), *legs]), np.repeat(angles, counts)
    sharpest = np.argsort(np.where(of_legs == FREE, -np.inf, -of_legs), kind="stable")[:MOST_LEGS]
    return ShownEdges(every[sharpest], of_legs[sharpest], len(every) - len(sharpest))

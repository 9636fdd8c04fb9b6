"""Triangles of a kernel shape, joined along its edges by what is shared and not by what lies near.

The kernel triangulates face by face, each face with nodes of its own.  Nodes on an edge are the same in all faces of
that edge, in the same order, so they are given one number; nodes at the ends of edges take the number of the vertex,
and all nodes on a collapsed side of a patch become one.

       face 1  o---o---o   nodes 4 5 6        edge: 4 5 6 of face 1 = 9 8 7 of face 2
               o---o---o   nodes 9 8 7        -> three vertices of the mesh, not six
       face 2
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from OCP.BRep import BRep_Tool
from OCP.BRepBuilderAPI import BRepBuilderAPI_Copy
from OCP.BRepMesh import BRepMesh_IncrementalMesh
from OCP.Poly import Poly_Triangulation
from OCP.TopAbs import TopAbs_Orientation, TopAbs_ShapeEnum
from OCP.TopExp import TopExp
from OCP.TopLoc import TopLoc_Location
from OCP.TopoDS import TopoDS, TopoDS_Compound, TopoDS_Edge, TopoDS_Face, TopoDS_Shape
from OCP.TopTools import TopTools_IndexedMapOfShape

from brep_export.check_topology import sub_shapes
from brep_export.compounds import compound_of
from brep_export.flat_faces import FlatFaces
from recon.geometry.mesh import TriangleMesh

__all__ = ["ShapeTriangulation", "triangulate"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SOUGHT_FROM = 1000  # flat faces from which on it pays to look for triangles among them

_EDGE, _FACE, _VERTEX = TopAbs_ShapeEnum.TopAbs_EDGE, TopAbs_ShapeEnum.TopAbs_FACE, TopAbs_ShapeEnum.TopAbs_VERTEX


@dataclass(frozen=True, eq=False)
class ShapeTriangulation:
    """Triangles of every face.

    mesh           all triangles, outward as the faces are; vertices joined along shared edges
    triangle_face  (T,) number of the face of each triangle, in the order of the faces of the shape
    missing        faces, by number, that the kernel could not triangulate
    """

    mesh: TriangleMesh
    triangle_face: Ints
    missing: tuple[int, ...]


def triangulate(
    shape: TopoDS_Shape,
    deflection: float,
    *,
    angle: float = 0.5,
    name: str = "shape",
    planes: FlatFaces | None = None,
) -> ShapeTriangulation:
    """Triangles that stay within a distance of the faces; the shape itself is left as it was.

    deflection  length, largest distance between an edge, or face, and its triangles
    angle       radians, largest turn from one triangle to the next along an edge
    planes      of this shape: faces that are triangles already are taken as they are
    """
    if planes is not None and planes.flat.sum() > SOUGHT_FROM and planes.uses.is_solid.all():
        return _around_triangles(planes, deflection, angle, name)
    shape = BRepBuilderAPI_Copy(shape, False, False).Shape()
    BRepMesh_IncrementalMesh(shape, deflection, False, angle, False)
    join = _Joiner(shape)
    for face in sub_shapes(shape, _FACE):
        join.add(TopoDS.Face_s(face))
    return join.result(name)


def _around_triangles(planes: FlatFaces, deflection: float, angle: float, name: str) -> ShapeTriangulation:
    """The kernel's triangles of the other faces, joined to the known ones at the vertices that they share."""
    faces = planes.uses.faces
    known, corners = planes.triangles()
    rest = np.setdiff1d(np.arange(len(faces)), known)
    compound = compound_of(faces[face] for face in rest.tolist())
    copy = BRepBuilderAPI_Copy(compound, False, False)
    if len(rest):
        BRepMesh_IncrementalMesh(copy.Shape(), deflection, False, angle, False)
    join = _Joiner(copy.Shape())
    for face in sub_shapes(copy.Shape(), _FACE):
        join.add(TopoDS.Face_s(face))
    join.add_triangles(corners, planes.points, _numbers_in(join, planes, compound, copy))
    return join.result(name, np.concatenate([rest, known]))


def _numbers_in(join: "_Joiner", planes: FlatFaces, compound: TopoDS_Compound, copy: BRepBuilderAPI_Copy) -> Ints:
    """Of all vertices, those in the joined mesh; -1 for those that its copy of the compound does not have."""
    numbers = np.full(len(planes.vertices), -1, dtype=np.int64)
    in_compound = TopTools_IndexedMapOfShape()
    TopExp.MapShapes_s(compound, _VERTEX, in_compound)
    for vertex, corner in enumerate(planes.vertices):
        if in_compound.Contains(corner):
            numbers[vertex] = join.number_of(copy.ModifiedShape(corner))
    return numbers


class _Joiner:
    """Gives every node of every face its vertex in one mesh."""

    def __init__(self, shape: TopoDS_Shape) -> None:
        self._vertex_numbers = TopTools_IndexedMapOfShape()
        TopExp.MapShapes_s(shape, _VERTEX, self._vertex_numbers)
        self._edge_numbers = TopTools_IndexedMapOfShape()
        self._on_edges: dict[int, Ints] = {}
        self._points: list[Floats] = [np.full((self._vertex_numbers.Extent(), 3), np.nan)]
        self._n = self._vertex_numbers.Extent()
        self._triangles: list[Ints] = []
        self._missing: list[int] = []
        self._n_faces = 0

    def add(self, face: TopoDS_Face) -> None:
        """Number the nodes of one face and keep its triangles."""
        place = TopLoc_Location()
        nodes = BRep_Tool.Triangulation_s(face, place)
        if nodes is None or nodes.NbTriangles() == 0:
            self._missing.append(self._n_faces)
            triangles = np.empty((0, 3), dtype=np.int64)
        else:
            number = self._number_nodes(face, nodes, place)
            triangles = number[_triangles(nodes) - 1]
            if face.Orientation() == TopAbs_Orientation.TopAbs_REVERSED:
                triangles = triangles[:, ::-1]
        self._triangles.append(triangles)
        self._n_faces += 1

    def _number_nodes(self, face: TopoDS_Face, nodes: Poly_Triangulation, place: TopLoc_Location) -> Ints:
        points = _placed(np.array([nodes.Node(i).Coord() for i in range(1, nodes.NbNodes() + 1)]), place)
        number = np.full(len(points), -1, dtype=np.int64)
        for edge in sub_shapes(face, _EDGE):
            edge = TopoDS.Edge_s(edge)
            polygon = BRep_Tool.PolygonOnTriangulation_s(edge, nodes, place)
            if polygon is not None:
                on_edge = np.array([polygon.Node(i) for i in range(1, polygon.NbNodes() + 1)], dtype=np.int64) - 1
                number[on_edge] = self._edge_vertices(edge, points[on_edge])
        inside = np.flatnonzero(number < 0)
        number[inside] = self._new(points[inside])
        return number

    def _edge_vertices(self, edge: TopoDS_Edge, points: Floats) -> Ints:
        """Mesh vertices of the nodes along an edge; the same ones whichever face asks."""
        known = self._on_edges.get(key := self._edge_numbers.Add(edge))
        if known is not None and len(known) == len(points):  # another count leaves the mesh open, which the gate names
            return known
        first = self._end(TopExp.FirstVertex_s(edge, False), points[0])
        last = self._end(TopExp.LastVertex_s(edge, False), points[-1])
        if BRep_Tool.Degenerated_s(edge):
            return np.full(len(points), first)
        self._on_edges[key] = np.concatenate([[first], self._new(points[1:-1]), [last]])
        return self._on_edges[key]

    def _end(self, vertex: TopoDS_Shape, point: Floats) -> int:
        if vertex.IsNull():
            return int(self._new(point[None])[0])
        number = self.number_of(vertex)
        self._points[0][number] = point
        return number

    def _new(self, points: Floats) -> Ints:
        self._points.append(points)
        self._n += len(points)
        return np.arange(self._n - len(points), self._n, dtype=np.int64)

    def number_of(self, vertex: TopoDS_Shape) -> int:
        return int(self._vertex_numbers.FindIndex(vertex)) - 1

    def add_triangles(self, corners: Ints, points: Floats, numbers: Ints) -> None:
        """Faces (n, 3) that are one triangle each; numbers (V,) of their corners here, -1 of those that are new."""
        old = numbers >= 0
        self._points[0][numbers[old]] = points[old]
        numbers = numbers.copy()
        numbers[~old] = self._new(points[~old])
        self._triangles += list(numbers[corners][:, None])

    def result(self, name: str, order: Ints | None = None) -> ShapeTriangulation:
        """All triangles, face by face; `order` gives the number of every face that was added, in place of 0, 1, ..."""
        order = np.arange(len(self._triangles)) if order is None else order
        triangles = np.concatenate([np.empty((0, 3), dtype=np.int64), *self._triangles])
        faces = np.repeat(order, [len(t) for t in self._triangles]).astype(np.int64)
        by_face = np.argsort(faces, kind="stable")
        triangles, faces = triangles[by_face], faces[by_face]
        a, b, c = triangles.T
        whole = (a != b) & (b != c) & (c != a)  # others are collapsed
        triangles, faces = triangles[whole], faces[whole]
        used, renumbered = np.unique(triangles, return_inverse=True)
        mesh = TriangleMesh(np.concatenate(self._points)[used], renumbered.reshape(-1, 3), name)
        return ShapeTriangulation(mesh, faces, tuple(order[self._missing].tolist()))


def _triangles(nodes: Poly_Triangulation) -> Ints:
    # by number: an iterator over a kernel array costs as much as two hundred of these calls
    return np.array([nodes.Triangle(i).Get() for i in range(1, nodes.NbTriangles() + 1)], dtype=np.int64)


def _placed(points: Floats, place: TopLoc_Location) -> Floats:
    if place.IsIdentity():
        return points
    move = place.Transformation()
    matrix = np.array([[move.Value(i, j) for j in (1, 2, 3, 4)] for i in (1, 2, 3)])
    return points @ matrix[:, :3].T + matrix[:, 3]

"""Planar faces between straight edges, fetched from the kernel once: in arrays all that is measured of them is exact.

Solids of many facets have no other faces.  Edges that have a curve on a face beside their line are left to the kernel:
the two might differ.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from OCP.BRep import BRep_Tool
from OCP.Geom import Geom_Line, Geom_Plane
from OCP.TopAbs import TopAbs_Orientation
from OCP.TopExp import TopExp
from OCP.TopoDS import TopoDS, TopoDS_Edge, TopoDS_Face, TopoDS_Shape
from OCP.TopTools import TopTools_IndexedMapOfShape

from brep_export.check_topology import EdgeUses

__all__ = ["FlatFaces", "FlatMoments", "flat_faces"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]


class FlatMoments(NamedTuple):
    """Signed volume of every body (B,), area of all faces, moment (3,) of all volumes about the origin."""

    volumes: Floats
    area: float
    volume_moment: Floats


@dataclass(frozen=True, eq=False)
class FlatFaces:
    """What was fetched; the other faces and edges have zeros, and no corners: -1.

    flat     (F,) whether a face is planar and all its edges are bare lines
    bare     (E,) whether an edge is a line with two ends and has no curve on a face
    normals  (F, 3) unit, out of the body; offsets (F,) of the planes along them
    ends     (E, 2, 3) of the lines
    corners  (E, 2) numbers of the vertices there
    vertices those vertices; points (V, 3) where they are
    """

    uses: EdgeUses
    flat: Flags
    bare: Flags
    normals: Floats
    offsets: Floats
    ends: Floats
    corners: Ints
    vertices: tuple[TopoDS_Shape, ...]
    points: Floats

    def all(self) -> bool:
        """Whether there is nothing but flat faces of solids."""
        return bool(self.flat.all() and self.uses.is_solid.all() and len(self.flat))

    def gaps_on_faces(self, rows: Ints) -> Floats:
        """(n,) of some uses in flat faces: how far their edges are from the planes, which is farthest at an end."""
        face = self.uses.face[rows]
        off = np.einsum("nki,ni->nk", self.ends[self.uses.edge[rows]], self.normals[face]) - self.offsets[face, None]
        return np.asarray(np.abs(off).max(axis=1))

    def gaps_at_ends(self) -> Floats:
        """(E,) how far the lines end from their vertices."""
        gaps = np.zeros(len(self.bare))
        bare = self.bare
        gaps[bare] = np.linalg.norm(self.ends[bare] - self.points[self.corners[bare]], axis=2).max(axis=1)
        return gaps

    def sides(self) -> tuple[Floats, Floats]:
        """(M, 3) points where every use begins and ends, as its face's border runs."""
        forward, ends = self.uses.forward[:, None], self.ends[self.uses.edge]
        return np.where(forward, ends[:, 0], ends[:, 1]), np.where(forward, ends[:, 1], ends[:, 0])

    def moments(self) -> FlatMoments:
        """Of bodies of which all faces are flat: pyramids over the faces, as high as the planes are."""
        face, n = self.uses.face, len(self.flat)
        start, end = self.sides()
        centre = 0.5 * (start.min(axis=0) + start.max(axis=0))
        first = np.searchsorted(face, np.arange(n))
        corner = start[first][face]
        areas = 0.5 * np.einsum("ij,ij->i", np.cross(start - corner, end - corner), self.normals[face])
        heights = self.offsets - self.normals @ centre
        parts = areas * heights[face] / 3.0
        middle = 0.75 * (corner + start + end) / 3.0 + 0.25 * centre
        volumes = np.bincount(self.uses.body, parts, len(self.uses.bodies)).astype(np.float64)
        return FlatMoments(volumes, float(areas.sum()), parts @ middle)

    def triangles(self) -> tuple[Ints, Ints]:
        """Flat faces of three sides whose neighbours are flat as well, and the three vertices (n, 3) of each, outward.

        A side that follows another in its wire need not begin where that one ends: two loops of bad shapes do not.
        """
        uses = self.uses
        order = np.argsort(uses.face, kind="stable")
        count = np.bincount(uses.face, minlength=len(self.flat))
        beside_other = np.zeros(len(self.bare), dtype=bool)
        beside_other[uses.edge[~self.flat[uses.face]]] = True
        other = np.bincount(uses.face, beside_other[uses.edge], len(self.flat)) > 0
        found = np.flatnonzero(self.flat & (count == 3) & ~other)
        first = np.searchsorted(uses.face[order], found)
        sides = order[first[:, None] + np.arange(3)]
        ends = np.where(
            uses.forward[sides][..., None], self.corners[uses.edge[sides]], self.corners[uses.edge[sides], ::-1]
        )
        start, end = ends[..., 0], ends[..., 1]
        # the sides of a wire may come in either order
        second = np.where(start[:, 1] == end[:, 0], start[:, 1], start[:, 2])
        third = np.where(start[:, 1] == end[:, 0], start[:, 2], start[:, 1])
        corners = np.stack([start[:, 0], second, third], axis=1)
        closed = (np.sort(start, axis=1) == np.sort(end, axis=1)).all(axis=1) & (end[:, 0] == second)
        return found[closed], corners[closed]


def flat_faces(uses: EdgeUses) -> FlatFaces:
    """Look at every edge and every face once."""
    numbers = TopTools_IndexedMapOfShape()
    lines = [_line(edge, numbers) for edge in uses.edges]
    bare = np.array([line is not None for line in lines], dtype=bool)
    rows = np.array([line or NOTHING for line in lines]).reshape(-1, 8)
    vertices = tuple(numbers(i) for i in range(1, numbers.Extent() + 1))
    points = np.array([BRep_Tool.Pnt_s(TopoDS.Vertex_s(vertex)).Coord() for vertex in vertices]).reshape(-1, 3)
    planes = np.array([_plane(face) for face in uses.faces]).reshape(-1, 4)
    known = np.einsum("ij,ij->i", planes[:, :3], planes[:, :3]) > 0.0
    known &= np.bincount(uses.face, ~bare[uses.edge], len(known)) == 0
    known &= np.bincount(uses.face, minlength=len(known)) > 0
    corners = rows[:, 6:].astype(np.int64) - 1
    return FlatFaces(
        uses, known, bare, planes[:, :3], planes[:, 3], rows[:, :6].reshape(-1, 2, 3), corners, vertices, points
    )


NOTHING = (0.0,) * 8


def _line(edge: TopoDS_Edge, numbers: TopTools_IndexedMapOfShape) -> tuple[float, ...] | None:
    """Both ends of the line, and the numbers of both vertices, from 1."""
    curves = edge.TShape().Curves()
    size = curves.Size()  # two: with a note of how smooth it is
    if size > 2 or curves.First().IsCurveOnSurface() or (size == 2 and curves.Last().IsCurveOnSurface()):
        return None
    curve = BRep_Tool.Curve_s(edge, 0.0, 0.0)
    if not isinstance(curve, Geom_Line):
        return None
    vertices = TopExp.FirstVertex_s(edge, False), TopExp.LastVertex_s(edge, False)
    if vertices[0].IsNull() or vertices[1].IsNull():
        return None
    first, last = BRep_Tool.Range_s(edge)
    begin, end = curve.Value(first).Coord(), curve.Value(last).Coord()
    return *begin, *end, numbers.Add(vertices[0]), numbers.Add(vertices[1])


def _plane(face: TopoDS_Face) -> tuple[float, ...]:
    """Normal out of the body and offset along it; zeros where the face is no plane."""
    plane = BRep_Tool.Surface_s(face)
    if not isinstance(plane, Geom_Plane):
        return (0.0,) * 4
    place = plane.Position()
    x, y, z = place.Direction().Coord()
    a, b, c = place.Location().Coord()
    way = 1.0 if place.Direct() == (face.Orientation() != TopAbs_Orientation.TopAbs_REVERSED) else -1.0
    return way * x, way * y, way * z, way * (x * a + y * b + z * c)

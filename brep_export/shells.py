"""Shells by known adjacency: planar faces and patch networks, every vertex and edge made once, nothing sewn.

    edge e: one curve in space, run by one patch forward and by the other reversed

+---->----+---->----+          sides 0 and 1 of a patch run with its outer wire, 2 and 3 against it;
|    2    |    2    |          an edge that runs against its side changes the use once more; and a patch
^3   p   1^3   q   1^          whose normal disagrees with its neighbours' is turned over, all its uses with it
|    0    e    0    |
+---->----+---->----+
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from OCP.Geom import Geom_Line, Geom_Plane, Geom_Surface
from OCP.gp import gp_Dir, gp_Pnt
from OCP.TopoDS import TopoDS_Edge, TopoDS_Face, TopoDS_Shape, TopoDS_Shell, TopoDS_Vertex, TopoDS_Wire

from brep_export.curves import kernel_curve
from brep_export.faces import (
    BUILDER,
    FORWARD,
    KERNEL_TOLERANCE,
    REVERSED,
    SPARE,
    cover_gap,
    make_degenerate_edge,
    make_edge,
    make_face,
    make_vertex,
    make_wire,
    mark_covered,
    put_pcurve,
    straight_pcurve,
    turned,
)
from brep_export.surfaces import kernel_surface
from recon.errors import NotManifold
from recon.geometry.bspline import BSplineSurface
from recon.geometry.patches import COLLAPSED, PatchNetwork, side_curve, sides_apart
from recon.tolerance import Tolerance

__all__ = ["NetworkFaces", "network_faces", "network_shell", "planar_shell", "PlanarLoops", "make_shell", "side_ends"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def make_shell(faces: Sequence[TopoDS_Shape], *, closed: bool) -> TopoDS_Shell:
    """Kernel shell of oriented faces."""
    shell = TopoDS_Shell()
    BUILDER.MakeShell(shell)
    for face in faces:
        BUILDER.Add(shell, face)
    shell.Closed(closed)
    return shell


class PlanarLoops(NamedTuple):
    """Planar faces, flattened: sides in the order of loops, loops in the order of faces.

    sides       (H,) start vertex of every side; a side ends where the next of its loop starts
    loop_sizes  (L,) sides of every loop
    loop_faces  (L,) face of every loop, not decreasing, the outer loop first
    """

    sides: Ints
    loop_sizes: Ints
    loop_faces: Ints

    def ends(self) -> Ints:
        """(H,) end vertex of every side."""
        stops = np.cumsum(self.loop_sizes)
        following = np.arange(1, len(self.sides) + 1)
        following[stops - 1] = stops - self.loop_sizes
        return self.sides[following]

    def side_faces(self) -> Ints:
        """(H,) face of every side."""
        return np.repeat(self.loop_faces, self.loop_sizes)


def planar_shell(points: Floats, loops: PlanarLoops, what: str = "polyhedron") -> tuple[TopoDS_Shell, float]:
    """Closed kernel shell of planar faces without pcurves, and the volume it encloses: negative when it is inside out.

    points    (V, 3)
    Promises  the tolerance of an edge reaches from its line to the planes of both its faces.
    Raises    NotManifold naming a place, when an edge is not run through once in each direction, or a face has no area.
    """
    used, sides = np.unique(loops.sides, return_inverse=True)
    points, loops = points[used], loops._replace(sides=sides)
    normal, offset, volume = _planes(points, loops, what)
    edge_sides, side_edges = _shared_sides(points, loops, what)
    start, end = loops.sides, loops.ends()
    face = loops.side_faces()
    miss = np.abs(np.einsum("ij,ij->i", points[start], normal[face]) - offset[face])
    edge_gap, vertex_gap = np.zeros(len(edge_sides)), np.zeros(len(points))
    np.maximum.at(edge_gap, side_edges, np.maximum(miss, _of_next(miss, loops)))
    edge_tolerance = np.maximum(SPARE * edge_gap, KERNEL_TOLERANCE)
    np.maximum.at(vertex_gap, start, edge_tolerance[side_edges])
    np.maximum.at(vertex_gap, end, edge_tolerance[side_edges])
    vertices = [make_vertex(p, t) for p, t in zip(points, vertex_gap.tolist())]
    edges = _straight_edges(points, vertices, (start[edge_sides], end[edge_sides]), edge_tolerance)
    forward = start == start[edge_sides][side_edges]
    uses = [edges[e][way] for e, way in zip(side_edges.tolist(), forward.tolist())]
    planes = [Geom_Plane(*p) for p in np.column_stack([normal, -offset]).tolist()]
    return make_shell(_planar_faces(uses, planes, loops), closed=True), volume


def _of_next(values: Floats, loops: PlanarLoops) -> Floats:
    """The value of the side that follows, for every side."""
    return values[PlanarLoops(np.arange(len(values)), loops.loop_sizes, loops.loop_faces).ends()]


def _planes(points: Floats, loops: PlanarLoops, what: str) -> tuple[Floats, Floats, float]:
    """Unit normals (F, 3) and offsets (F,) of the faces, and the volume that they enclose."""
    face, n_faces = loops.side_faces(), int(loops.loop_faces[-1]) + 1
    centre = points.mean(axis=0)
    a, b = points[loops.sides] - centre, points[loops.ends()] - centre
    double_area = np.stack([np.bincount(face, c, n_faces) for c in np.cross(a, b).T], axis=1)
    size = np.linalg.norm(double_area, axis=1)
    if not (size > 0).all():
        flat = int(np.argmin(size > 0))
        raise NotManifold(what, f"face {flat} has no area", points[loops.sides[np.argmax(face == flat)]])
    normal = double_area / size[:, None]
    height = np.bincount(face, np.einsum("ij,ij->i", a, normal[face]), n_faces) / np.bincount(face, minlength=n_faces)
    return normal, height + normal @ centre, float(height @ size) / 6.0


def _shared_sides(points: Floats, loops: PlanarLoops, what: str) -> tuple[Ints, Ints]:
    """One side of every edge (E,), along which the edge is made to run, and the edge of every side (H,)."""
    start, end = loops.sides, loops.ends()
    key = np.minimum(start, end) * len(points) + np.maximum(start, end)
    _, first, edges, uses = np.unique(key, return_index=True, return_inverse=True, return_counts=True)
    balance = np.bincount(edges, np.where(start < end, 1.0, -1.0))
    wrong = (uses != 2) | (balance != 0)
    if wrong.any():
        e = int(np.argmax(wrong))
        problem = (
            "two faces run along an edge in the same direction"
            if uses[e] == 2
            else f"an edge belongs to {uses[e]} faces where two are needed"
        )
        raise NotManifold(what, problem, points[[start[first[e]], end[first[e]]]].mean(axis=0).tolist())
    return first, edges


def _straight_edges(
    points: Floats, vertices: list[TopoDS_Vertex], ends: tuple[Ints, Ints], tolerance: Floats
) -> list[tuple[TopoDS_Shape, TopoDS_Edge]]:
    """Every edge reversed and forward. The inner loop is spelled out: it runs once for every edge of a large mesh."""
    step = points[ends[1]] - points[ends[0]]
    length = np.linalg.norm(step, axis=1)
    reversed_ends = [v.Oriented(REVERSED) for v in vertices]
    rows = zip(ends[0].tolist(), ends[1].tolist(), points[ends[0]].tolist(), step.tolist(), length.tolist())
    edges = []
    for (i, j, origin, way, size), allowed in zip(rows, tolerance.tolist()):
        edge = TopoDS_Edge()
        BUILDER.MakeEdge(edge, Geom_Line(gp_Pnt(*origin), gp_Dir(*way)), allowed)
        BUILDER.Add(edge, vertices[i])
        BUILDER.Add(edge, reversed_ends[j])
        BUILDER.Range(edge, 0.0, size)
        edges.append((edge.Oriented(REVERSED), edge))
    return edges


def _planar_faces(uses: list[TopoDS_Shape], planes: list[Geom_Plane], loops: PlanarLoops) -> list[TopoDS_Face]:
    faces: list[TopoDS_Face] = []
    first = 0
    for owner, size in zip(loops.loop_faces.tolist(), loops.loop_sizes.tolist()):
        wire = TopoDS_Wire()
        BUILDER.MakeWire(wire)
        for use in uses[first : first + size]:
            BUILDER.Add(wire, use)
        wire.Closed(True)
        first += size
        if owner == len(faces):
            faces.append(TopoDS_Face())
            BUILDER.MakeFace(faces[owner], planes[owner], KERNEL_TOLERANCE)
        BUILDER.Add(faces[owner], wire)
    return faces


class _Use(NamedTuple):
    """One side of one patch on an edge; `forward`: the edge runs as the outer wire of the patch does."""

    patch: int
    side: int
    forward: bool


def network_shell(network: PatchNetwork, tolerance: Tolerance) -> TopoDS_Shell:
    """Kernel shell of a patch network: one face a patch, one edge a shared side, collapsed sides and seams included.

    Patches may point either way; they are turned over until neighbours agree with the first patch of their part.
    Promises  every edge's tolerance covers the distance measured to its patches; the shell is marked closed when each
              edge has two uses.
    Raises    NotManifold naming a place, when an edge has more than two uses, the network has one side only, or patches
              are farther apart along an edge than tolerance.fit.
    """
    made = network_faces(network, tolerance)
    closed = bool((np.bincount(network.side_edges[network.side_edges != COLLAPSED]) == 2).all())
    return make_shell(made.faces, closed=closed)


class NetworkFaces(NamedTuple):
    """Faces of a patch network with the edges and vertices that they share, in the network's own order."""

    faces: list[TopoDS_Shape]
    edges: list[TopoDS_Edge]
    vertices: list[TopoDS_Vertex]


def network_faces(network: PatchNetwork, tolerance: Tolerance) -> NetworkFaces:
    """What `network_shell` is made of, for those who join further faces to it; promises and raises as that does."""
    uses = _edge_uses(network)
    reverse = _turned_patches(network, uses)
    surfaces = [kernel_surface(patch) for patch in network.patches]
    vertices = [make_vertex(point) for point in network.vertices]
    edges = [_network_edge(network, e, (uses[e], surfaces, vertices), tolerance) for e in range(len(uses))]
    faces = [turned(_patch_face(network, p, surfaces[p], (vertices, edges)), reverse[p]) for p in range(len(surfaces))]
    return NetworkFaces(faces, edges, vertices)


def side_ends(patch: BSplineSurface, side: int) -> tuple[Floats, Floats]:
    """The (2,) parameter pairs between which a side runs, in its own direction."""
    (u0, u1), (v0, v1) = patch.domain
    corners = ((u0, v0), (u1, v0)), ((u1, v0), (u1, v1)), ((u0, v1), (u1, v1)), ((u0, v0), (u0, v1))
    return np.array(corners[side][0]), np.array(corners[side][1])


def _edge_uses(network: PatchNetwork) -> list[list[_Use]]:
    uses: list[list[_Use]] = [[] for _ in network.edge_vertices]
    for patch, row in enumerate(network.side_edges.tolist()):
        for side, e in enumerate(row):
            if e != COLLAPSED:
                uses[e].append(_Use(patch, side, bool(network.side_forward[patch, side]) == (side < 2)))
    for e, found in enumerate(uses):
        if not 1 <= len(found) <= 2:
            raise NotManifold("patch network", f"edge {e} belongs to {len(found)} sides", _middle(network, e))
    return uses


def _middle(network: PatchNetwork, edge: int) -> list[float]:
    """A point of the edge for messages: halfway along the side that carries it."""
    found = np.argwhere(network.side_edges == edge)
    if not len(found):
        return network.vertices[network.edge_vertices[edge, 0]].tolist()
    curve = side_curve(network.patches[int(found[0, 0])], int(found[0, 1]))
    return curve.point([sum(curve.domain) / 2])[0].tolist()


def _turned_patches(network: PatchNetwork, uses: list[list[_Use]]) -> list[bool]:
    """Whether each patch must be turned over so that every edge is used once forward and once reversed."""
    around: list[list[tuple[int, bool, int]]] = [[] for _ in network.patches]
    for e, pair in enumerate(uses):
        if len(pair) == 2:
            same = pair[0].forward == pair[1].forward
            around[pair[0].patch].append((pair[1].patch, same, e))
            around[pair[1].patch].append((pair[0].patch, same, e))
    reverse: list[bool | None] = [None] * len(around)
    for seed in range(len(around)):
        if reverse[seed] is None:
            reverse[seed] = False
            front = [seed]
            while front:
                p = front.pop()
                for q, same, e in around[p]:
                    if reverse[q] is None:
                        reverse[q] = bool(reverse[p]) != same
                        front.append(q)
                    elif (reverse[q] != reverse[p]) != same:
                        raise NotManifold("patch network", "has one side only, as a Moebius strip", _middle(network, e))
    return [bool(r) for r in reverse]


def _network_edge(
    network: PatchNetwork,
    e: int,
    made: tuple[list[_Use], list[Geom_Surface], list[TopoDS_Vertex]],
    tolerance: Tolerance,
) -> TopoDS_Edge:
    """Edge in space along the first side that carries it, with a straight pcurve on every patch."""
    uses, surfaces, vertices = made
    along = [use.forward == (use.side < 2) for use in uses]  # whether the edge runs in its side's own direction
    sides = [side_curve(network.patches[use.patch], use.side) for use in uses]
    curves = [side if way else side.reversed() for side, way in zip(sides, along)]
    curve = curves[0]
    start, end = network.edge_vertices[e].tolist()
    edge = make_edge(kernel_curve(curve), curve.domain, (vertices[start], vertices[end]))
    pcurves = [
        straight_pcurve(*_turned_pair(side_ends(network.patches[use.patch], use.side), way), curve.domain)
        for use, way in zip(uses, along)
    ]
    if len(uses) == 2 and uses[0].patch == uses[1].patch:
        pair = (pcurves[0], pcurves[1]) if uses[0].forward else (pcurves[1], pcurves[0])
        put_pcurve(edge, pair, surfaces[uses[0].patch], curve.domain)
    else:
        for use, pcurve in zip(uses, pcurves):
            put_pcurve(edge, pcurve, surfaces[use.patch], curve.domain)
    gap = sides_apart(curve, curves[-1])
    if gap is not None and gap <= KERNEL_TOLERANCE:
        ends = network.vertices[[start, end]] - curve.control_points[[0, -1]]
        mark_covered(edge, (vertices[start], vertices[end]), (gap, float(np.sqrt((ends**2).sum(axis=1).max()))))
        return edge
    gap = cover_gap(edge, [surfaces[use.patch] for use in uses], adapt_above=tolerance.merge)
    if gap > tolerance.fit:
        problem = f"patches are {gap:.3g} apart along an edge, allowed {tolerance.fit:.3g},"
        raise NotManifold("patch network", problem, _middle(network, e))
    return edge


def _turned_pair(pair: tuple[Floats, Floats], forward: bool) -> tuple[Floats, Floats]:
    return pair if forward else (pair[1], pair[0])


def _patch_face(
    network: PatchNetwork, p: int, surface: Geom_Surface, made: tuple[list[TopoDS_Vertex], list[TopoDS_Edge]]
) -> TopoDS_Face:
    vertices, edges = made
    wire = []
    for side in range(4):
        e = int(network.side_edges[p, side])
        if e == COLLAPSED:
            begin, end = side_ends(network.patches[p], side)
            domain = network.patches[p].domain[side % 2]
            vertex = vertices[int(network.corner_vertices[p, side])]
            use, way = make_degenerate_edge(straight_pcurve(begin, end, domain), surface, domain, vertex), side < 2
        else:
            use, way = edges[e], bool(network.side_forward[p, side]) == (side < 2)
        wire.append(use.Oriented(FORWARD if way else REVERSED))
    return make_face(surface, [make_wire(wire)])

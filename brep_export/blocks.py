"""A patch network over a plan region, closed to a block: vertical walls down from its free border, and a flat base.

  ______
 / net  \\_____         each stretch of the border that is straight in plan gets one planar wall:
|              |           top     the border edges of the network, shared with its patches
|  wall        |  wall     sides   vertical edges, shared with the walls beside
'--------------'           bottom  one straight edge, shared with the base
     base
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from OCP.Geom import Geom_Line, Geom_Plane
from OCP.gp import gp_Ax3, gp_Dir, gp_Pnt
from OCP.TopoDS import TopoDS_Edge, TopoDS_Shape, TopoDS_Solid, TopoDS_Vertex

from brep_export.faces import BUILDER, make_edge, make_face, make_vertex, make_wire, turned
from brep_export.shells import NetworkFaces, make_shell, network_faces
from recon.errors import NotManifold
from recon.geometry.patches import COLLAPSED, PatchNetwork, side_curve
from recon.tolerance import Tolerance

__all__ = ["block_solid"]

Floats = NDArray[np.float64]
FLAT = 1e-9  # length: how far rounding may lift a control point of an edge in the base
STRAIGHT = 1e-9  # sine of the angle below which two border edges run on in one plane


class _Step(NamedTuple):
    """One border edge as its patch runs through it: the network on the left, the outside on the right."""

    edge: int
    forward: bool
    start: int
    end: int
    place: tuple[int, int]  # patch, side


def block_solid(network: PatchNetwork, level: float, tolerance: Tolerance) -> TopoDS_Solid:
    """Kernel solid between a patch network and the plane z = level, its faces outward.

    network  connected patches with normals upward, each a graph over the plan; border edges straight in plan, or at the
             level, where the network ends on the base; holes are kept
    Raises   NotManifold when the network has no border, reaches below the base, or raises as `network_shell` does.
    """
    lowest = float(network.vertices[:, 2].min())
    if lowest < level:
        raise NotManifold(
            "block", f"the base at {level:.6g} does not lie below the network, which reaches {lowest:.6g}"
        )
    made = network_faces(network, tolerance)
    loops = _border_loops(network)
    if not loops:
        raise NotManifold("block", "the network has no border to put walls on")
    walls, base_wires = [], []
    for loop in loops:
        stretches = _stretches(network, loop, level)
        feet = _Feet(network, made, level)
        bottom: list[TopoDS_Edge] = []
        for stretch in stretches:
            if _is_on_base(network, stretch[0], level):
                bottom += [turned(made.edges[step.edge], not step.forward) for step in stretch]
                continue
            line = feet.line(stretch[0].start, stretch[-1].end)
            bottom.append(turned(line, False))
            walls.append(_wall(stretch, line, feet, made))
        around = np.vstack([_sampled(network, step) for step in loop])
        base_wires.append((_area(around), make_wire(edge.Reversed() for edge in bottom[::-1])))
    base_wires.sort(key=lambda pair: -pair[0])  # the outer loop encloses the most, holes run the other way about
    plane = Geom_Plane(gp_Ax3(gp_Pnt(0.0, 0.0, level), gp_Dir(0.0, 0.0, -1.0)))
    base = make_face(plane, [wire for _, wire in base_wires])
    solid = TopoDS_Solid()
    BUILDER.MakeSolid(solid)
    BUILDER.Add(solid, make_shell([*made.faces, *walls, base], closed=True))
    solid.Closed(True)
    return solid


def _is_on_base(network: PatchNetwork, step: _Step, level: float) -> bool:
    """Whether a border edge lies in the base: only edges of one height join two vertices at the level."""
    return bool((network.vertices[[step.start, step.end], 2] == level).all()) and bool(
        (np.abs(_sampled(network, step)[:, 2] - level) < FLAT).all()
    )


def _sampled(network: PatchNetwork, step: _Step) -> Floats:
    """(n, 3) control points of a border edge from its start, without the last."""
    patch, side = step.place
    net = side_curve(network.patches[patch], side).control_points
    return net[:-1] if side < 2 else net[::-1][:-1]


class _Feet:
    """Vertices and edges in and above the base, each made once; a vertex at the level is its own foot."""

    def __init__(self, network: PatchNetwork, made: NetworkFaces, level: float) -> None:
        self.places, self._made, self._level = network.vertices, made, level
        self._feet: dict[int, TopoDS_Vertex] = {}
        self._posts: dict[int, TopoDS_Edge] = {}

    def _foot(self, vertex: int) -> TopoDS_Vertex:
        x, y, z = self.places[vertex]
        if z == self._level:
            return self._made.vertices[vertex]
        if vertex not in self._feet:
            self._feet[vertex] = make_vertex(np.array([x, y, self._level]))
        return self._feet[vertex]

    def line(self, start: int, end: int) -> TopoDS_Edge:
        ends = self._foot(start), self._foot(end)
        return _line(self.places[start], self.places[end], self._level, ends)

    def post(self, vertex: int) -> TopoDS_Edge | None:
        """The vertical edge at a corner; None where the corner lies in the base."""
        if self.places[vertex, 2] == self._level:
            return None
        if vertex not in self._posts:
            ends = self._foot(vertex), self._made.vertices[vertex]
            self._posts[vertex] = _post(self.places[vertex], self._level, ends)
        return self._posts[vertex]


def _border_loops(network: PatchNetwork) -> list[list[_Step]]:
    """Closed loops of border edges, the network on their left."""
    used = network.side_edges != COLLAPSED
    count = np.bincount(network.side_edges[used], minlength=len(network.edge_vertices))
    ahead: dict[int, _Step] = {}
    for patch, side in np.argwhere(used & (count[network.side_edges] == 1)).tolist():
        e = int(network.side_edges[patch, side])
        forward = bool(network.side_forward[patch, side]) == (side < 2)
        start, end = network.edge_vertices[e].tolist() if forward else network.edge_vertices[e][::-1].tolist()
        if start in ahead:
            raise NotManifold("block", "two borders of the network touch", network.vertices[start])
        ahead[start] = _Step(e, forward, start, end, (patch, side))
    loops = []
    while ahead:
        loop = [ahead.pop(next(iter(ahead)))]
        while loop[-1].end in ahead:
            loop.append(ahead.pop(loop[-1].end))
        loops.append(loop)
    return loops


def _stretches(network: PatchNetwork, loop: list[_Step], level: float) -> list[list[_Step]]:
    """The loop cut where it turns in plan, and where it comes down to the base or leaves it."""
    ways = np.array([network.vertices[step.end, :2] - network.vertices[step.start, :2] for step in loop])
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    before = np.roll(ways, 1, axis=0)
    low = np.array([_is_on_base(network, step, level) for step in loop])
    touching = np.array([network.vertices[step.start, 2] == level for step in loop])
    turn = (np.abs(before[:, 0] * ways[:, 1] - before[:, 1] * ways[:, 0]) > STRAIGHT) & ~(low & np.roll(low, 1))
    turn |= (low != np.roll(low, 1)) | (touching & ~low)
    first = int(np.argmax(turn))
    starts = [*((np.flatnonzero(np.roll(turn, -first))).tolist()), len(loop)]
    ordered = loop[first:] + loop[:first]
    return [ordered[a:b] for a, b in pairwise(sorted({0, *starts}))]


def _area(corners: Floats) -> float:
    x, y = corners[:, 0], corners[:, 1]
    return float((x * np.roll(y, -1) - np.roll(x, -1) * y).sum() / 2)


def _line(start: Floats, end: Floats, level: float, ends: tuple[TopoDS_Vertex, TopoDS_Vertex]) -> TopoDS_Edge:
    way = end[:2] - start[:2]
    line = Geom_Line(gp_Pnt(float(start[0]), float(start[1]), level), gp_Dir(float(way[0]), float(way[1]), 0.0))
    return make_edge(line, (0.0, float(np.linalg.norm(way))), ends)


def _post(corner: Floats, level: float, ends: tuple[TopoDS_Vertex, TopoDS_Vertex]) -> TopoDS_Edge:
    line = Geom_Line(gp_Pnt(float(corner[0]), float(corner[1]), level), gp_Dir(0.0, 0.0, 1.0))
    return make_edge(line, (0.0, float(corner[2]) - level), ends)


def _wall(stretch: list[_Step], bottom: TopoDS_Edge, feet: _Feet, network: NetworkFaces) -> TopoDS_Shape:
    """Planar face under one straight stretch of the border: back along the base, up, along the ground, down."""
    start, end = stretch[0].start, stretch[-1].end
    (x, y, z), way = (float(c) for c in feet.places[start]), feet.places[end] - feet.places[start]
    plane = Geom_Plane(gp_Ax3(gp_Pnt(x, y, z), gp_Dir(float(way[1]), -float(way[0]), 0.0)))
    near, far = feet.post(start), feet.post(end)
    up = [] if far is None else [turned(far, False)]
    down = [] if near is None else [turned(near, True)]
    top = [turned(network.edges[step.edge], step.forward) for step in reversed(stretch)]
    return make_face(plane, [make_wire([turned(bottom, False), *up, *top, *down])])

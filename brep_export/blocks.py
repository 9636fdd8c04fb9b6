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
from recon.geometry.patches import COLLAPSED, PatchNetwork
from recon.tolerance import Tolerance

__all__ = ["block_solid"]

Floats = NDArray[np.float64]
STRAIGHT = 1e-9  # sine of the angle below which two border edges run on in one plane


class _Step(NamedTuple):
    """One border edge as its patch runs through it: the network on the left, the outside on the right."""

    edge: int
    forward: bool
    start: int
    end: int


def block_solid(network: PatchNetwork, level: float, tolerance: Tolerance) -> TopoDS_Solid:
    """Kernel solid between a patch network and the plane z = level, its faces outward.

    network  patches with normals upward, each a graph over the plan; border edges straight in plan; holes are kept
    Raises   NotManifold when the network has no border, touches the base, or raises as `network_shell` does.
    """
    lowest = min(float(patch.control_net[..., 2].min()) for patch in network.patches)
    if lowest <= level:
        raise NotManifold(
            "block", f"the base at {level:.6g} does not lie below the network, which reaches {lowest:.6g}"
        )
    made = network_faces(network, tolerance)
    loops = _border_loops(network)
    if not loops:
        raise NotManifold("block", "the network has no border to put walls on")
    walls, base_wires = [], []
    for loop in loops:
        stretches = _stretches(network, loop)
        corners = [network.vertices[stretch[0].start] for stretch in stretches]
        feet = [make_vertex(np.array([x, y, level])) for x, y, _ in corners]
        bottoms = [
            _line(corners[k], corners[(k + 1) % len(corners)], level, (feet[k], feet[(k + 1) % len(feet)]))
            for k in range(len(corners))
        ]
        posts = [
            _post(corner, level, (foot, made.vertices[stretch[0].start]))
            for corner, foot, stretch in zip(corners, feet, stretches)
        ]
        n = len(corners)
        walls += [
            _wall(stretches[k], (corners[k], corners[(k + 1) % n]), (bottoms[k], posts[k], posts[(k + 1) % n]), made)
            for k in range(n)
        ]
        base_wires.append((_area(np.array(corners)), make_wire(turned(edge, True) for edge in bottoms[::-1])))
    base_wires.sort(key=lambda pair: -pair[0])  # the outer loop encloses the most, holes run the other way about
    plane = Geom_Plane(gp_Ax3(gp_Pnt(0.0, 0.0, level), gp_Dir(0.0, 0.0, -1.0)))
    base = make_face(plane, [wire for _, wire in base_wires])
    solid = TopoDS_Solid()
    BUILDER.MakeSolid(solid)
    BUILDER.Add(solid, make_shell([*made.faces, *walls, base], closed=True))
    solid.Closed(True)
    return solid


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
        ahead[start] = _Step(e, forward, start, end)
    loops = []
    while ahead:
        loop = [ahead.pop(next(iter(ahead)))]
        while loop[-1].end in ahead:
            loop.append(ahead.pop(loop[-1].end))
        loops.append(loop)
    return loops


def _stretches(network: PatchNetwork, loop: list[_Step]) -> list[list[_Step]]:
    """The loop cut where it turns in plan."""
    ways = np.array([network.vertices[step.end, :2] - network.vertices[step.start, :2] for step in loop])
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    before = np.roll(ways, 1, axis=0)
    turn = np.abs(before[:, 0] * ways[:, 1] - before[:, 1] * ways[:, 0]) > STRAIGHT
    first = int(np.argmax(turn))
    starts = [*((np.flatnonzero(np.roll(turn, -first))).tolist()), len(loop)]
    ordered = loop[first:] + loop[:first]
    return [ordered[a:b] for a, b in pairwise(starts)]


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


def _wall(
    stretch: list[_Step], corners: tuple[Floats, Floats], made: tuple[TopoDS_Edge, TopoDS_Edge, TopoDS_Edge],
    network: NetworkFaces,
) -> TopoDS_Shape:  # fmt: skip
    """Planar face under one straight stretch of the border: along the base, up, back along the ground, down."""
    bottom, near_post, far_post = made
    (x, y, z), way = (float(c) for c in corners[0]), corners[1] - corners[0]
    outward = gp_Dir(float(way[1]), -float(way[0]), 0.0)
    plane = Geom_Plane(gp_Ax3(gp_Pnt(x, y, z), outward))
    top = [turned(network.edges[step.edge], step.forward) for step in reversed(stretch)]
    return make_face(
        plane, [make_wire([turned(bottom, False), turned(far_post, False), *top, turned(near_post, True)])]
    )

"""Subdivision written down as the papers print it, face by face, to test the compiled and tabled one against.

Every face carries its place on the control mesh: the control face and the parameters (v, w) of its corners.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from recon.geometry.control_mesh import ControlMesh

Floats = NDArray[np.float64]
Edge = tuple[int, int]


class PlainMesh(NamedTuple):
    """points (V, 3), faces as rows of vertices, a place (face, (k, 2) parameters) for each, creases, corners."""

    points: Floats
    faces: list[list[int]]
    places: list[tuple[int, Floats]]
    creases: dict[Edge, float]
    corners: set[int]


def plain(mesh: ControlMesh) -> PlainMesh:
    faces = [row.tolist() for row in np.split(mesh.face_corners, mesh.face_starts[1:-1])]
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    creases = {_edge(a, b): np.inf for a, b in mesh.crease_edges.tolist()}
    corners = set(mesh.corner_vertices.tolist())
    uses: dict[int, int] = {}
    for face in faces:
        for v in face:
            uses[v] = uses.get(v, 0) + 1
    corners |= {v for v, n in uses.items() if n == 1}
    return PlainMesh(mesh.vertices, faces, [(f, square) for f in range(len(faces))], creases, corners)


def _edge(a: int, b: int) -> Edge:
    return (a, b) if a < b else (b, a)


def _edges(mesh: PlainMesh) -> dict[Edge, list[int]]:
    edges: dict[Edge, list[int]] = {}
    for f, face in enumerate(mesh.faces):
        for a, b in zip(face, face[1:] + face[:1]):
            edges.setdefault(_edge(a, b), []).append(f)
    return edges


def catmull_clark_step(mesh: PlainMesh) -> PlainMesh:
    """One step of [catmull1978] with the sharp rules of [derose1998]."""
    edges = _edges(mesh)
    sharpness = {e: np.inf if len(fs) == 1 else mesh.creases.get(e, 0.0) for e, fs in edges.items()}
    middles = np.array([mesh.points[face].mean(axis=0) for face in mesh.faces])
    numbers = {e: len(mesh.points) + i for i, e in enumerate(edges)}
    first_middle = len(mesh.points) + len(edges)
    edge_points = []
    for (a, b), fs in edges.items():
        sharp = mesh.points[[a, b]].mean(axis=0)
        share = min(sharpness[a, b], 1.0)
        smooth = np.mean([*mesh.points[[a, b]], *middles[fs]], axis=0) if len(fs) == 2 else sharp
        edge_points.append(share * sharp + (1 - share) * smooth)
    around: list[list[Edge]] = [[] for _ in mesh.points]
    for edge in edges:
        around[edge[0]].append(edge)
        around[edge[1]].append(edge)
    vertex_points = [_vertex_point(mesh, v, (at, edges), sharpness, middles) for v, at in enumerate(around)]
    faces, places = [], []
    for f, (face, (owner, at)) in enumerate(zip(mesh.faces, mesh.places)):
        n = len(face)
        for i, v in enumerate(face):
            after, before = face[(i + 1) % n], face[i - 1]
            faces.append([v, numbers[_edge(v, after)], first_middle + f, numbers[_edge(before, v)]])
            places.append(
                (owner, np.array([at[i], (at[i] + at[(i + 1) % n]) / 2, at.mean(axis=0), (at[i] + at[i - 1]) / 2]))
            )
    creases = {}
    for (a, b), s in mesh.creases.items():
        if s > 1.0:
            creases[_edge(a, numbers[a, b])] = creases[_edge(b, numbers[a, b])] = s - 1.0
    return PlainMesh(np.array([*vertex_points, *edge_points, *middles]), faces, places, creases, mesh.corners)


def _vertex_point(
    mesh: PlainMesh,
    v: int,
    known: tuple[list[Edge], dict[Edge, list[int]]],
    sharpness: dict[Edge, float],
    middles: Floats,
) -> Floats:
    around, edges = known
    own = mesh.points[v]
    ends = {e: mesh.points[e[0] if e[1] == v else e[1]] for e in around}
    sharp = [e for e in around if sharpness[e] > 0]
    n = len(around)
    faces = sorted({f for e in around for f in edges[e]})
    smooth = own
    if all(len(edges[e]) == 2 for e in around):
        smooth = (middles[faces].mean(axis=0) + np.mean([own + p for p in ends.values()], axis=0) + (n - 3) * own) / n
    if v in mesh.corners and sharp:
        return own

    def ruled(edges: list[Edge]) -> Floats:
        if len(edges) < 2:
            return smooth
        return own if len(edges) > 2 else 0.75 * own + 0.125 * sum(ends[e] for e in edges)

    still = [e for e in sharp if sharpness[e] > 1]
    if min(len(sharp), 3) == min(len(still), 3) or max(len(sharp), len(still)) < 2:
        return ruled(sharp)
    share = np.mean([sharpness[e] for e in sharp if sharpness[e] <= 1])  # [derose1998], over the edges that end
    return share * ruled(sharp) + (1 - share) * ruled(still)


def doo_sabin_step(mesh: PlainMesh) -> PlainMesh:
    """One step of [doo1978] on a closed mesh; only the faces inside old faces keep a place: their middles stay."""
    points, number = [], {}
    for f, face in enumerate(mesh.faces):
        n = len(face)
        for i, v in enumerate(face):
            share = [(3 + 2 * np.cos(2 * np.pi * (i - j) / n)) / (4 * n) for j in range(n)]
            share[i] = (n + 5) / (4 * n)
            number[f, v] = len(points)
            points.append(np.array(share) @ mesh.points[face])
    faces = [[number[f, v] for v in face] for f, face in enumerate(mesh.faces)]
    successor: dict[int, dict[int, int]] = {}
    for (a, b), (f, g) in _edges(mesh).items():
        face = mesh.faces[f]
        if face[(face.index(a) + 1) % len(face)] != b:
            f, g = g, f
        faces.append([number[f, b], number[f, a], number[g, a], number[g, b]])
        successor.setdefault(a, {})[g] = f
        successor.setdefault(b, {})[f] = g
    for v, turn in successor.items():
        loop = [next(iter(turn))]
        while turn[loop[-1]] != loop[0]:
            loop.append(turn[loop[-1]])
        faces.append([number[f, v] for f in loop])
    return PlainMesh(np.array(points), faces, mesh.places, {}, set())

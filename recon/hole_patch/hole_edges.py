"""From labelled faces to closed lines round the holes.

An edge between wall and void, the void being fracture that looks into the hole or nothing at all, is run through with
the wall on its left. On one sherd such edges make chains; the end of one is joined to the start of another, across the
crack between two sherds, so that all joins together are as short as possible.

        sherd A |  sherd B             void ahead of the arrow's right hand:
       ---->----|---->---.             chains A and B are joined where the crack ends
          hole            v
Paper  [kuhn1955] for the joining.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from recon.hole_patch.assembly import Assembly
from recon.hole_patch.fracture import majority
from recon.hole_patch.surroundings import BRIDGE
from recon.hole_patch.walls import FRACTURE

__all__ = ["Cycle", "VoidEdges", "free_border", "hole_cycles", "void_edges"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class VoidEdges:
    """Edges with wall on the left and void on the right.

    ends    (m, 2) vertices, faces (m,) the wall face of each
    lip     (m,) where a line may change from outer to inner wall
    thickness  of the wall: a gap of a few thicknesses is rather bridged than the wall changed, but for the lip
    """

    ends: Ints
    faces: Ints
    lip: Flags
    thickness: float


@dataclass(frozen=True, eq=False)
class Cycle:
    """A closed line between wall and void, wall on the left.

    points   (n, 3), the first not repeated
    normals  (n, 3) of the wall at each point, away from the material
    sherds   (n,) sherd of each point, or -1 on a bridge
    walls    (n,) OUTER or INNER: which wall the line bounds
    gap      longest bridge
    """

    points: Floats
    normals: Floats
    sherds: Ints
    walls: Ints
    gap: float

    @property
    def length(self) -> float:
        return float(np.linalg.norm(np.roll(self.points, -1, axis=0) - self.points, axis=1).sum())


def free_border(table: Assembly, closed: Flags) -> Flags:
    """(B,) border edges that no other sherd comes near to.

    closed   (S,) sherds with walls and fracture all round: any point of theirs may be the neighbour
    Near is three times the usual distance of neighbouring borders, between half and three edge lengths.
    """
    ends = table.vertices[table.border_edges]
    middle, owner = ends.mean(axis=1), table.vertex_sherd[table.border_edges[:, 0]]
    of_closed = closed[table.vertex_sherd]
    points = np.concatenate([middle, ends[:, 0], table.vertices[of_closed]])
    sherd = np.concatenate([owner, owner, table.vertex_sherd[of_closed]])
    distance = np.full(len(middle), np.inf)
    for own in np.unique(owner):
        others = points[sherd != own]
        if len(others):
            distance[owner == own], _ = cKDTree(others).query(middle[owner == own])
    usual = distance[distance < 3.0 * table.spacing]
    near = float(np.clip(3.0 * np.median(usual), 0.5 * table.spacing, 3.0 * table.spacing)) if len(usual) else 0.0
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    free = distance > near
    for own in np.unique(owner):
        mine = owner == own
        free[mine] = majority(middle[mine], lengths[mine], free[mine], radius=table.spacing)
    return free


def void_edges(table: Assembly, labels: Ints, *, hole: Flags, free: Flags, lip: Flags, thickness: float) -> VoidEdges:
    """All edges between wall and void.

    labels  (F,) wall or fracture; hole (F,) fracture that looks into the hole; free (B,) border edges with nothing near
    lip     (F,) faces so near to the mouth that a line may run from the outer to the inner wall there
    """
    i, j = table.pairs.T
    wall = labels != FRACTURE
    ahead, behind = wall[i] & hole[j], wall[j] & hole[i]
    border = free & wall[table.border_faces]
    ends = [table.pair_edges[ahead], table.pair_edges[behind][:, ::-1], table.border_edges[border]]
    faces = np.concatenate([i[ahead], j[behind], table.border_faces[border]])
    return VoidEdges(np.concatenate(ends), faces, lip[faces], thickness)


def hole_cycles(table: Assembly, normals: Floats, labels: Ints, *, void: VoidEdges) -> list[Cycle]:
    """Join the directed edges to closed lines, longest first."""
    if not len(void.ends):
        return []
    wall = labels[void.faces]
    chains = list(_chains(void.ends, wall, void.lip))
    rows = _joined(table.vertices, void, wall, chains)
    cycles = [_cycle(table, normals, labels, void, [chains[k] for k in row]) for row in rows]
    return sorted((c for c in cycles if len(c.points) >= 3), key=lambda c: -c.length)


def _chains(ends: Ints, wall: Ints, lip: Flags) -> Iterator[Ints]:
    """Rows of edges that follow each other along one wall as far as they go; from wall to wall only at the lip."""
    following: dict[int, list[int]] = {}
    for edge, begin in enumerate(ends[:, 0].tolist()):
        following.setdefault(begin, []).append(edge)
    finish, side = ends[:, 1].tolist(), wall.tolist()
    used = [False] * len(ends)
    heads = _heads(ends, wall)
    for head in [*heads, *range(len(ends))]:
        if used[head]:
            continue
        row, edge = [], head
        while edge >= 0:
            used[edge] = True
            row.append(edge)
            ahead = [e for e in following.get(finish[edge], ()) if not used[e]]
            same = [e for e in ahead if side[e] == side[edge]]
            over = [e for e in ahead if lip[e]]
            edge = (same or over or [-1])[0]
        yield np.array(row)


def _heads(ends: Ints, wall: Ints) -> list[int]:
    """Edges that no edge on the same wall leads to."""
    stride = int(wall.max()) + 1
    return np.flatnonzero(~np.isin(ends[:, 0] * stride + wall, ends[:, 1] * stride + wall)).tolist()


def _joined(vertices: Floats, void: VoidEdges, wall: Ints, chains: list[Ints]) -> list[list[int]]:
    """Rows of chains, end to start, that close with the least total of gaps; changing the wall costs extra."""
    from scipy.optimize import linear_sum_assignment

    ends = void.ends
    first, last = np.array([c[0] for c in chains]), np.array([c[-1] for c in chains])
    start, finish = vertices[ends[first, 0]], vertices[ends[last, 1]]
    cost = np.linalg.norm(finish[:, None] - start[None], axis=2)
    over = void.lip[last][:, None] & void.lip[first][None]
    cost += (wall[last][:, None] != wall[first][None]) * np.where(over, 0.25, 5.0) * void.thickness
    _, following = linear_sum_assignment(cost)
    rows, seen = [], np.zeros(len(chains), dtype=bool)
    for k in range(len(chains)):
        row: list[int] = []
        while not seen[k]:
            seen[k] = True
            row.append(k)
            k = int(following[k])
        if row:
            rows.append(row)
    return rows


def _cycle(table: Assembly, normals: Floats, labels: Ints, void: VoidEdges, row: list[Ints]) -> Cycle:
    """The points of a row of chains, with points on the bridges where two chains lie apart."""
    ends, faces = void.ends, void.faces
    points, ups, sherds, walls, widest = [], [], [], [], 0.0
    for k, chain in enumerate(row):
        vertex = np.append(ends[chain, 0], ends[chain[-1], 1])
        face = faces[np.append(chain, chain[-1])]
        after = table.vertices[ends[row[(k + 1) % len(row)][0], 0]]
        gap = float(np.linalg.norm(after - table.vertices[vertex[-1]]))
        if gap < 1e-9:
            vertex, face = vertex[:-1], face[:-1]
        n_bridge = int(gap / table.spacing)
        t = (np.arange(1, n_bridge + 1) / (n_bridge + 1))[:, None]
        points += [table.vertices[vertex], (1 - t) * table.vertices[vertex[-1]] + t * after]
        ups += [normals[face], np.repeat(normals[face[-1:]], n_bridge, axis=0)]
        sherds += [table.vertex_sherd[vertex], np.full(n_bridge, BRIDGE)]
        walls += [labels[face], np.repeat(labels[face[-1:]], n_bridge)]
        widest = max(widest, gap)
    return Cycle(np.concatenate(points), np.concatenate(ups), np.concatenate(sherds), np.concatenate(walls), widest)

"""From labels to polyhedra: coplanar fragments merged into faces, faces into shells, shells into bodies.

      A | B                 at an edge the present fragments bound solid sectors and empty ones in turn; the two that
------  e  ------           bound a solid sector belong together, here A with D and B with C. Where the two are
      D | C                 halves of one plane the edge lies inside a face; and two bodies, or two parts of one,
                            that touch along e stay apart: each gets its own copies of the vertices.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.geometry.polyhedron import PlanarFace, Polyhedron
from recon.three_view.cells import Cells, next_in_group
from recon.three_view.fragments import Fragments
from recon.three_view.tables import linked

__all__ = ["assemble", "labels_of"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]


def labels_of(cells: Cells, solid: Flags) -> Ints:
    """(f,) label of each fragment: 0 absent, +1 facing along its plane's normal, -1 facing against it."""
    front, back = solid[cells.of_side].T
    return back.astype(np.int64) - front.astype(np.int64)


@dataclass(frozen=True, eq=False)
class _Borders:
    """Half-edges along which faces end, seen from outside.

    start, end  (h,) vertices
    following   (h,) the next one along its face's loop
    twin        (h,) the one that runs back along the same edge
    fragment    (h,)
    """

    start: Ints
    end: Ints
    following: Ints
    twin: Ints
    fragment: Ints


def assemble(made: Fragments, cells: Cells, solid: Flags) -> Polyhedron:
    """The polyhedron whose material fills the solid cells.

    solid     (n_cells,) which cells are solid
    Promises  every edge of a shell is run through once in each direction; no vertex lies inside an edge.
    """
    label = labels_of(cells, solid)
    item, mate = _solid_pairs(cells, solid, label)
    inside = made.plane[cells.fragment[item]] == made.plane[cells.fragment[mate]]
    merged = np.column_stack([cells.fragment[item], cells.fragment[mate]])[inside]
    face_of = linked(merged, len(made.plane))
    borders = _borders(made, cells, (item, mate, inside), label)
    copy = _vertex_copies(borders, face_of[borders.fragment])
    position = np.zeros(int(copy.max(initial=-1)) + 1, dtype=np.int64)
    position[copy] = borders.start
    loops = _loops(borders.following)
    kept = np.bincount(copy)[copy] > 2  # a point where only two faces meet lies inside an edge
    points, rings, owner = _rings(made.wire.vertices[position], (loops, copy, kept), borders)
    first = borders.fragment[owner]
    body = _bodies(cells, solid)[cells.of_side[first, (label[first] > 0) * 1]]
    shell = _shells(borders, loops, face_of[borders.fragment])[owner]
    normals = made.planes.normals[made.plane[first]] * label[first][:, None]
    return _polyhedron(points, rings, normals, np.column_stack([body, shell, face_of[first]]))


def _solid_pairs(cells: Cells, solid: Flags, label: Ints) -> tuple[Ints, Ints]:
    """Places around edges whose fragments bound a solid sector: the one before it, the one after it."""
    rows = np.flatnonzero(label[cells.fragment])
    following = rows[next_in_group(cells.edge[rows])]
    full = solid[cells.sectors()[rows]]
    return rows[full], following[full]


def _borders(made: Fragments, cells: Cells, pairs: tuple[Ints, Ints, Flags], label: Ints) -> _Borders:
    item, mate, inside = pairs
    half = 2 * cells.use + cells.after
    partner = np.full(2 * len(made.use_edge), -1, dtype=np.int64)
    partner[half[item[~inside]]] = half[mate[~inside]]
    partner[half[mate[~inside]]] = half[item[~inside]]
    across = np.full(2 * len(made.use_edge), -1, dtype=np.int64)
    across[half[item[inside]]] = half[mate[inside]]
    across[half[mate[inside]]] = half[item[inside]]
    rows = np.flatnonzero(partner >= 0)
    following = made.following[rows]
    while (within := across[following] >= 0).any():
        following[within] = made.following[across[following[within]]]
    number = np.full(len(partner), -1, dtype=np.int64)
    number[rows] = np.arange(len(rows))
    fragment = made.region.ravel()[rows]
    ends = made.wire.edges[made.use_edge[rows // 2]]
    ends = np.where((rows % 2 == 0)[:, None], ends, ends[:, ::-1])
    # a face that looks against its plane's normal runs the other way round
    turned = label[fragment] < 0
    ahead = number[following]
    behind = np.empty_like(ahead)
    behind[ahead] = np.arange(len(ahead))
    ends = np.where(turned[:, None], ends[:, ::-1], ends)
    return _Borders(ends[:, 0], ends[:, 1], np.where(turned, behind, ahead), number[partner[rows]], fragment)


def _vertex_copies(borders: _Borders, face: Ints) -> Ints:
    """(h,) number of the vertex where a half-edge starts, one for each fan of faces around a point in space.

    Two fans share a vertex all the same where a face comes to the point twice: its loops touch there.
    """
    rows = np.arange(len(face))
    order = np.lexsort([face, borders.start])
    again = (face[order][1:] == face[order][:-1]) & (borders.start[order][1:] == borders.start[order][:-1])
    fans = np.column_stack([rows, borders.following[borders.twin]])
    return linked(np.concatenate([fans, np.column_stack([order[:-1], order[1:]])[again]]), len(face))


def _loops(following: Ints) -> Ints:
    return linked(np.column_stack([np.arange(len(following)), following]), len(following))


def _rings(points: Floats, made: tuple[Ints, Ints, Flags], borders: _Borders) -> tuple[Floats, list[list[int]], Ints]:
    """Vertices, loops of vertex numbers, and a half-edge of each; an edge of two pairs of faces is made twice."""
    loops, copy, kept = made
    chains = [_chains(h, borders, kept) for h in np.unique(loops, return_index=True)[1].tolist()]
    corners = [[int(copy[h]) for h, _ in chain] for chain in chains]
    middle: dict[int, int] = {}
    first: dict[tuple[int, int], int] = {}
    extra: list[Floats] = []
    for chain, ring in zip(chains, corners):
        for (_, edge), a, b in zip(chain, ring, ring[1:] + ring[:1]):
            # two edges between the same vertices, where a body touches itself: a vertex on one tells them apart
            if first.setdefault((min(a, b), max(a, b)), edge) != edge and edge not in middle:
                middle[edge] = len(points) + len(extra)
                extra.append((points[a] + points[b]) / 2)
    rings: list[list[int]] = []
    owner: list[int] = []
    for chain, ring in zip(chains, corners):
        full = [v for (_, edge), corner in zip(chain, ring) for v in (corner, middle.get(edge, -1)) if v >= 0]
        for part in _simple(full):
            rings.append(part)
            owner.append(chain[0][0])
    return np.concatenate([points, extra]) if extra else points, rings, np.array(owner, dtype=np.int64)


def _chains(start: int, borders: _Borders, kept: Flags) -> list[tuple[int, int]]:
    """The straight edges of a loop: first half-edge of each, and a number that the same edge has in its other face."""
    walk = [start]
    while (following := int(borders.following[walk[-1]])) != start:
        walk.append(following)
    turn = next((k for k, h in enumerate(walk) if kept[h]), 0)
    walk = walk[turn:] + walk[:turn]
    heads = [k for k, h in enumerate(walk) if kept[h]]
    return [
        (walk[k], min(walk[k], int(borders.twin[walk[after - 1]]))) for k, after in zip(heads, [*heads[1:], len(walk)])
    ]


def _simple(ring: list[int]) -> list[list[int]]:
    """A loop cut at vertices that it visits more than once."""
    parts, path = [], list[int]()
    for vertex in ring:
        if vertex in path:
            start = path.index(vertex)
            parts.append(path[start:])
            path = path[:start]
        path.append(vertex)
    return [part for part in (*parts, path) if len(part) > 2]


def _shells(borders: _Borders, loops: Ints, face: Ints) -> Ints:
    """(h,) number of the shell that a half-edge's face belongs to."""
    first = int(loops.max(initial=0)) + 1
    pairs = np.concatenate([np.column_stack([loops, loops[borders.twin]]), np.column_stack([loops, first + face])])
    return linked(pairs, int(pairs.max(initial=0)) + 1)[loops]


def _bodies(cells: Cells, alike: Flags) -> Ints:
    """(n_cells,) number of the body, or the void, that each cell among those alike belongs to."""
    both = alike[cells.of_side].all(axis=1)
    return linked(cells.of_side[both], cells.n_cells)


def _polyhedron(points: Floats, rings: Sequence[list[int]], normals: Floats, owners: Ints) -> Polyhedron:
    """Loops gathered into faces, shells and bodies; rows of owners are body, shell, face."""
    area = np.array([_area(points[ring], n) for ring, n in zip(rings, normals)])
    faces: list[PlanarFace] = []
    bodies: dict[int, dict[int, list[int]]] = {}
    volume: dict[int, float] = {}
    order = np.lexsort([-area, owners[:, 2], owners[:, 1], owners[:, 0]])
    for k in order.tolist():
        body, shell, _ = owners[k].tolist()
        if area[k] > 0:
            bodies.setdefault(body, {}).setdefault(shell, []).append(len(faces))
            faces.append(PlanarFace(tuple(rings[k])))
        else:
            faces[-1] = PlanarFace(faces[-1].outer, (*faces[-1].holes, tuple(rings[k])))
        volume[shell] = volume.get(shell, 0.0) + area[k] * float(normals[k] @ points[rings[k][0]])
    shells = [sorted(group, key=lambda s: -volume[s]) for group in bodies.values()]
    numbered = [tuple(tuple(group[s]) for s in names) for group, names in zip(bodies.values(), shells)]
    used = np.unique(np.concatenate([np.array(ring) for ring in rings]))
    rank = {int(v): k for k, v in enumerate(used)}
    renamed = tuple(
        PlanarFace(tuple(rank[v] for v in f.outer), tuple(tuple(rank[v] for v in hole) for hole in f.holes))
        for f in faces
    )
    return Polyhedron(points[used], renamed, tuple(numbered))


def _area(loop: Floats, normal: Floats) -> float:
    rest = loop - loop[0]
    return float(np.cross(rest, np.roll(rest, -1, axis=0)).sum(axis=0) @ normal) / 2

"""Faces of a control mesh cut in four, in three or in two, so that quadrilaterals come out and no corner hangs.

Which edges are halved decides all. A quadrilateral with an even number of halved sides, a triangle with an odd one,
is cut into quadrilaterals:

    4 sides            2 beside each other     2 opposite         triangle, 1 side      triangle, 3 sides
    o---o---o          o-------o               o-------o               o                       o
    |   |   |          |     / |               |       |              / \\                    /   \\
    o---o---o          |   o---o               o-------o             /   \\                  o     o
    |   |   |          | /   | |               |       |            o--o--o                / ` o ' \\
    o---o---o          o-----o-o               o-------o                                  o----o----o

So the faces chosen for 1-to-4 are halved all around. Their neighbours then have an odd number, and so have triangles
that are to go with none of their sides halved: such odd faces are joined in pairs by the shortest paths over edges
that are halved too, a path through a face makes two sides more. A border ends a path as well.

Paper  [maekawa2009], refinement that conforms; [edmonds1973], joining odd nodes in pairs by paths.
"""

from collections import deque

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from recon.errors import BadGeometry
from recon.geometry.control_mesh import ControlMesh

__all__ = ["cut_around", "inset", "refine_quads", "split_rows", "with_quads_only"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


def refine_quads(mesh: ControlMesh, worst_first: Ints, n_new: int) -> ControlMesh:
    """The given faces of a quadrilateral mesh cut in four, as many as `n_new` further points allow.

    worst_first  (m,) faces
    Promises     quadrilaterals only, no corner in the middle of a side; old vertices keep their numbers, creases stay.
                 The mesh as it is where there is no room for one face.
    """
    parts = _Faces(mesh)
    fewest, most = 0, min(n_new // 5, len(worst_first)) + 1
    best = np.zeros(parts.n_edges, dtype=np.bool_)
    while most - fewest > 1:
        count = (fewest + most) // 2
        halved = parts.joined(worst_first[:count])
        if halved is not None and parts.n_new(halved) <= n_new:
            fewest, best = count, halved
        else:
            most = count
    return parts.cut(best) if fewest else mesh


def split_rows(mesh: ControlMesh, squares: Floats, n_new: int) -> ControlMesh:
    """Whole rows of quadrilaterals cut along their middles where the errors are, with at most `n_new` points more.

    squares   (F,) sum of squared errors of each face
    Promises  as of `refine_quads`; all new vertices have four faces, two on a border.
    """
    parts = _Faces(mesh)
    row = parts.rows()
    size = np.bincount(row)
    gain = np.bincount(row[parts.sides()].ravel(), np.repeat(squares, 4)) / size
    halved = np.zeros(parts.n_edges, dtype=np.bool_)
    for each in np.argsort(-gain, kind="stable").tolist():
        with_row = halved | (row == each)
        if parts.n_new(with_row) <= n_new:
            halved = with_row
    return parts.cut(halved)


def with_quads_only(mesh: ControlMesh) -> ControlMesh:
    """A mesh of quadrilaterals and triangles with every triangle made one, or three, by strips cut through the others.

    Raises  BadGeometry where a closed part has an odd number of triangles, as no surface does.
    """
    parts = _Faces(mesh)
    halved = parts.joined(np.empty(0, dtype=np.int64))
    if halved is None:
        raise BadGeometry("control mesh", "a closed part has an odd number of triangles")
    return parts.cut(halved)


def cut_around(mesh: ControlMesh, vertices: Ints) -> ControlMesh:
    """The quadrilaterals around the given vertices cut in three, through the middles of all edges at these.

    Promises  quadrilaterals only, no corner in the middle of a side; old vertices keep their numbers, creases stay.
              Inside the surface the middles of edges have four faces. The mesh as it is where no cut conforms.
    """
    parts = _Faces(mesh)
    halved = parts.evened(parts.edges_at(vertices), np.empty(0, dtype=np.int64))
    return mesh if halved is None else parts.cut(halved)


def inset(mesh: ControlMesh, chosen: Ints) -> ControlMesh:
    """A smaller quadrilateral put into each of the given ones: every corner gets a face more, and neighbours stay.

    chosen    (m,) faces
    Promises  the old vertices keep their numbers.
    """
    faces = mesh.faces_of(4)
    outer = faces[chosen]
    corners = mesh.vertices[outer]
    points = (2.0 * corners + corners.mean(axis=1, keepdims=True)) / 3.0
    inner = mesh.n_vertices + np.arange(outer.size).reshape(outer.shape)
    around = np.stack([outer, np.roll(outer, -1, axis=1), np.roll(inner, -1, axis=1), inner], axis=2).reshape(-1, 4)
    grown = np.concatenate([np.delete(faces, chosen, axis=0), inner, around])
    vertices = np.concatenate([mesh.vertices, points.reshape(-1, 3)])
    creases, marked = mesh.crease_edges, mesh.corner_vertices
    return ControlMesh.from_faces(vertices, grown, crease_edges=creases, corner_vertices=marked)


class _Faces:
    """The faces of a mesh of triangles and quadrilaterals, a triangle's fourth side being none."""

    def __init__(self, mesh: ControlMesh) -> None:
        self._mesh = mesh
        sizes = np.diff(mesh.face_starts)
        self._triangle = sizes == 3
        self._corners = np.full((mesh.n_faces, 4), -1)
        self._corners[np.arange(4) < sizes[:, None]] = mesh.face_corners
        sides = _sides(mesh)
        keys, number, uses = np.unique(sides, return_inverse=True, return_counts=True)
        self.n_edges = len(keys)
        self._ends = np.stack(np.divmod(keys, mesh.n_vertices), axis=1)
        self._on = np.full((mesh.n_faces, 4), -1)
        self._on[np.arange(4) < sizes[:, None]] = number.ravel()
        creases = np.sort(mesh.crease_edges, axis=1)
        self._sharp = np.isin(keys, creases[:, 0] * mesh.n_vertices + creases[:, 1])
        self._free = uses == 1
        order = np.argsort(number.ravel(), kind="stable")
        owner = np.repeat(np.arange(mesh.n_faces), sizes)[order]
        last = np.cumsum(uses) - 1
        self._beside = np.stack([owner[last - uses + 1], np.where(self._free, -1, owner[last])], axis=1)

    def sides(self) -> Ints:
        """(F, 4) the edge under each side of a mesh of quadrilaterals."""
        return self._on

    def rows(self) -> Ints:
        """(E,) for each edge the row of quadrilaterals that it crosses: edges opposite to each other are in one."""
        one, two = np.concatenate([self._on[:, [0, 2]], self._on[:, [1, 3]]]).T
        graph = sparse.coo_array((np.ones(len(one), dtype=np.int8), (one, two)), shape=(self.n_edges, self.n_edges))
        return csgraph.connected_components(graph, directed=False)[1].astype(np.int64)

    def joined(self, chosen: Ints) -> Bools | None:
        """(E,) the edges to halve so that the chosen faces are cut in four, or None where no set of edges does it."""
        halved = np.zeros(self.n_edges, dtype=np.bool_)
        halved[self._on[chosen].ravel()] = True
        return self.evened(halved, chosen)

    def edges_at(self, vertices: Ints) -> Bools:
        """(E,) the edges with one of these vertices for an end."""
        return np.asarray(np.isin(self._ends, vertices).any(axis=1))

    def evened(self, halved: Bools, chosen: Ints) -> Bools | None:
        """(E,) these edges (E,) and those to halve beside them so that all faces can be cut, or None.

        chosen  (m,) faces that are to stay as they are
        """
        kept = np.zeros(len(self._corners), dtype=np.bool_)
        kept[chosen] = True
        halved = halved.copy()
        count = np.where(self._on >= 0, halved[self._on], False).sum(axis=1)
        odd = set(np.flatnonzero(~kept & ((count % 2 == 1) != self._triangle)).tolist())
        for face in sorted(odd):
            if face in odd:
                path = self._path(face, odd, kept)
                if path is None:
                    return None
                edges, end = path
                halved[edges] ^= True
                odd -= {face, end}
        return halved

    def _path(self, start: int, odd: set[int], kept: Bools) -> tuple[list[int], int] | None:
        """Edges of a shortest path from an odd face to another, or to the border (-1), through faces not kept."""
        before: dict[int, tuple[int, int]] = {start: (-1, -1)}
        queue = deque([start])
        while queue:
            face = queue.popleft()
            for edge in self._on[face].tolist():
                if edge < 0:
                    continue
                one, two = self._beside[edge].tolist()
                to = two if one == face else one
                if to in before or (to >= 0 and kept[to]):
                    continue
                before[to] = (face, edge)
                if to < 0 or to in odd:
                    return _back(before, to), to
                queue.append(to)
        return None

    def n_new(self, halved: Bools) -> int:
        """Points that a cut adds: one a halved edge, one in every face with corners cut off."""
        return int(halved.sum() + self._has_middle(halved).sum())

    def _has_middle(self, halved: Bools) -> Bools:
        on = (self._on >= 0) & halved[self._on]
        opposite = (on[:, 0] & on[:, 2]) ^ (on[:, 1] & on[:, 3])
        return np.asarray((on.sum(axis=1) > 2) | ((on.sum(axis=1) == 2) & ~opposite))

    def cut(self, halved: Bools) -> ControlMesh:
        """The mesh with these edges halved; every face has a fitting number of them."""
        mesh, n = self._mesh, self._mesh.n_vertices
        middle_of_edge = np.full(self.n_edges + 1, -1)
        middle_of_edge[:-1][halved] = n + np.arange(halved.sum())
        has_middle = self._has_middle(halved)
        centre = np.full(len(self._corners), -1)
        centre[has_middle] = n + halved.sum() + np.arange(has_middle.sum())
        quads = _pieces(self._corners, middle_of_edge[self._on], centre)
        means = np.stack([mesh.vertices[row[row >= 0]].mean(axis=0) for row in self._corners])
        points = np.concatenate([mesh.vertices, self._edge_points(means)[halved], means[has_middle]])
        sharp = self._sharp & halved
        halves = [np.stack([self._ends[sharp][:, i], middle_of_edge[:-1][sharp]], axis=1) for i in (0, 1)]
        creases = np.concatenate([self._ends[self._sharp & ~halved], *halves])
        return ControlMesh.from_faces(points, quads, crease_edges=creases, corner_vertices=mesh.corner_vertices)

    def _edge_points(self, means: Floats) -> Floats:
        """(E, 3) Catmull-Clark's edge mask: the mean of both ends and the middles of both faces; sharp, of the ends."""
        middles = self._mesh.vertices[self._ends].mean(axis=1)
        beside = means[self._beside].mean(axis=1)
        return np.where((self._sharp | self._free)[:, None], middles, 0.5 * (middles + beside))


def _sides(mesh: ControlMesh) -> Ints:
    """(H,) one number an edge, for every side."""
    end = mesh.face_corners[mesh.next_corners()]
    return np.minimum(mesh.face_corners, end) * mesh.n_vertices + np.maximum(mesh.face_corners, end)


def _back(before: dict[int, tuple[int, int]], end: int) -> list[int]:
    edges = []
    while before[end][0] >= 0:
        end, edge = before[end]
        edges.append(edge)
    return edges


def _pieces(corners: Ints, on: Ints, centre: Ints) -> Ints:
    """(Q, 4) the quadrilaterals of all faces (F, 4), given the points on their sides (F, 4) and inside (F,), or -1."""
    pieces = []
    for (a, b, c, d), sides, x in zip(corners.tolist(), on.tolist(), centre.tolist()):
        ring = [a, b, c] if d < 0 else [a, b, c, d]
        halved = [i for i in range(len(ring)) if sides[i] >= 0]
        if x < 0 and len(halved) == 2:
            i = halved[0]
            p, q, r, s = ring[i:] + ring[:i]
            m, k = sides[i], sides[(i + 2) % 4]
            pieces += [(p, m, k, s), (m, q, r, k)]
        elif x < 0:
            at = halved[0] + 1 if halved else len(ring)
            pieces.append((*ring[:at], *[sides[i] for i in halved], *ring[at:]))
        else:
            pieces += _around(ring, sides, x)
    return np.array(pieces, dtype=np.int64)


def _around(ring: list[int], sides: list[int], x: int) -> list[tuple[int, int, int, int]]:
    """The quadrilaterals around the middle x of a face: one at each corner between two halved sides, and the rest."""
    whole = []
    for i, corner in enumerate(ring):
        before, after = sides[i - 1 if i else len(ring) - 1], sides[i]
        beyond, last = ring[(i + 1) % len(ring)], ring[i - 1]
        if before >= 0 and after >= 0:
            whole.append((corner, after, x, before))
        elif after >= 0:
            whole.append((corner, after, x, last))
        elif before >= 0:
            whole.append((corner, beyond, x, before))
    return whole

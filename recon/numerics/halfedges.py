"""What a list of triangles says about its own connections: edges, borders, pieces, rings.

Every face has three sides; side i runs from corner i to corner i + 1. Two sides over the same pair of
vertices are one edge, and an edge is used as often as it has sides:

          2            used once: free edge, on the border of the surface
         / \\           used twice, in opposite directions: an inner edge of an oriented surface
   side 2   side 1     used twice, in the same direction: the two faces disagree about what is outside
       /     \\         used three times or more: no surface there
      0-->----1
        side 0

V, E, F    numbers of vertices, edges, faces
faces      (F, 3) vertex numbers
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from recon.numerics.rows import added_at, unit_vectors

__all__ = [
    "EdgeTable",
    "edge_table",
    "opposite_sides",
    "free_edges",
    "overused_edges",
    "misoriented_edges",
    "boundary_loops",
    "connected_components",
    "vertex_adjacency",
    "euler_number",
    "vertex_normals",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


class EdgeTable(NamedTuple):
    """Edges of a triangle list, each once.

    edges       (E, 2) vertex numbers, the lower first, in lexical order
    face_edges  (F, 3) edge along each side of each face
    forward     (F, 3) whether the side runs from the lower to the higher vertex
    uses        (E,) number of sides on each edge
    """

    edges: Ints
    face_edges: Ints
    forward: Bools
    uses: Ints

    def overused(self) -> Ints:
        """(K, 2) edges with three faces or more."""
        return self.edges[self.uses > 2]

    def misoriented(self) -> Ints:
        """(K, 2) edges whose two faces run along them in the same direction, so that one of the two is inside out."""
        forward = np.bincount(self.face_edges.ravel(), weights=self.forward.ravel(), minlength=len(self.edges))
        return self.edges[(self.uses == 2) & (forward != 1)]

    def sides(self, wanted: Bools) -> Ints:
        """(B, 2) directed vertex pairs of all sides that lie on the wanted edges, a mask (E,)."""
        on = wanted[self.face_edges]
        pairs = self.edges[self.face_edges[on]]
        return np.where(self.forward[on][:, None], pairs, pairs[:, ::-1])

    def edge_faces(self) -> tuple[Ints, Ints]:
        """(S,) edge numbers in rising order and (S,) the faces on them, one entry a side."""
        order = np.argsort(self.face_edges, axis=None, kind="stable")
        return self.face_edges.ravel()[order], order // 3

    def face_pairs(self) -> tuple[Ints, Ints, Ints]:
        """(m,) edge numbers in rising order, (m,) one face on each and (m,) the other.

        An edge with k faces stands there k - 1 times, each face paired with the next: free edges are left out.
        """
        edge, face = self.edge_faces()
        first = np.flatnonzero(edge[1:] == edge[:-1])
        return edge[first], face[first], face[first + 1]


def edge_table(faces: Ints) -> EdgeTable:
    """All edges of a triangle list with the sides that lie on them."""
    start, end = faces, np.roll(faces, -1, axis=1)
    low, high = np.minimum(start, end), np.maximum(start, end)
    span = int(faces.max(initial=-1)) + 1
    # One number a pair sorts four times faster than the pairs; span squared fits 63 bits for any mesh in memory.
    keys, inverse, uses = np.unique(low * span + high, return_inverse=True, return_counts=True)
    edges = np.stack(np.divmod(keys, max(span, 1)), axis=1)
    return EdgeTable(edges, inverse.reshape(faces.shape), start < end, uses)


def opposite_sides(faces: Ints) -> Ints:
    """(F, k) the side across each side, as k times its face plus its number there; -1 on the border.

    faces (F, k) may be triangles or quadrilaterals. Where more than two sides lie on an edge, or two of the same
    direction, each of them is a border: nothing says which belongs to which.
    """
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    span = int(faces.max(initial=-1)) + 1
    keys = np.minimum(start, end) * span + np.maximum(start, end)
    order = np.argsort(keys, kind="stable")
    ranked = keys[order]
    same = np.concatenate([[False], ranked[1:] == ranked[:-1], [False]])
    lone_pair = np.flatnonzero(~same[:-2] & same[1:-1] & ~same[2:]) if len(keys) > 1 else np.empty(0, dtype=np.int64)
    one, two = order[lone_pair], order[lone_pair + 1]
    opposed = start[one] == end[two]
    one, two = one[opposed], two[opposed]
    across = np.full(len(keys), -1)
    across[one], across[two] = two, one
    return across.reshape(faces.shape)


def free_edges(faces: Ints) -> Ints:
    """(B, 2) edges with one face only, each in the direction of its face, so the surface lies to its left."""
    table = edge_table(faces)
    return table.sides(table.uses == 1)


def overused_edges(faces: Ints) -> Ints:
    """(K, 2) edges with three faces or more."""
    return edge_table(faces).overused()


def misoriented_edges(faces: Ints) -> Ints:
    """(K, 2) edges whose two faces run along them in the same direction, so that one of the two is inside out."""
    return edge_table(faces).misoriented()


def boundary_loops(faces: Ints) -> list[Ints]:
    """Border of the surface as closed rows of vertex numbers, each vertex once in its row, the surface to the left.

    Borders that touch at a vertex come apart there into separate loops. Faces of mixed orientation are allowed; a loop
    then runs the way of its first edge. Free edges that close no loop, which needs an overused edge beside them, are
    left out.
    """
    ways = _ways_on(free_edges(faces))
    loops = []
    while ways:
        path = [next(iter(ways))]
        place = {path[0]: 0}
        while (end := _step(ways, path[-1])) is not None:
            if end in place:
                loops.append(np.array(path[place[end] :], dtype=np.int64))
                for vertex in path[place[end] + 1 :]:
                    del place[vertex]
                del path[place[end] + 1 :]
            else:
                place[end] = len(path)
                path.append(end)
    return loops


def _ways_on(edges: Ints) -> dict[int, list[tuple[int, bool]]]:
    """For every vertex the free edges that leave it; those against their own direction first, so popped last."""
    ways: dict[int, list[tuple[int, bool]]] = {}
    for start, end in edges.tolist():
        ways.setdefault(start, []).append((end, True))
        ways.setdefault(end, []).insert(0, (start, False))
    return ways


def _step(ways: dict[int, list[tuple[int, bool]]], vertex: int) -> int | None:
    """Leave `vertex` by one of its free edges and use that edge up; None when none is left."""
    if not ways.get(vertex):
        ways.pop(vertex, None)
        return None
    end, own = ways[vertex].pop()
    ways[end].remove((vertex, not own))
    return end


def connected_components(faces: Ints, table: EdgeTable | None = None) -> Ints:
    """(F,) number of the piece each face belongs to; pieces hang together by edges, not by single vertices.

    table  the edge table of the faces, where it is there already
    """
    _, one, two = (table or edge_table(faces)).face_pairs()
    links = (np.ones(len(one), dtype=np.int8), (one, two))
    graph = sparse.coo_array(links, shape=(len(faces), len(faces)))
    return csgraph.connected_components(graph, directed=False)[1].astype(np.int64)


def vertex_adjacency(faces: Ints, n_vertices: int) -> sparse.csr_array:
    """(V, V) symmetric matrix with a one for every pair of vertices that share an edge: row i is the one-ring of i."""
    a, b = edge_table(faces).edges.T
    rows, columns = np.concatenate([a, b]), np.concatenate([b, a])
    ones = np.ones(len(rows))
    return sparse.csr_array(sparse.coo_array((ones, (rows, columns)), shape=(n_vertices, n_vertices)))


def euler_number(faces: Ints) -> int:
    """V - E + F over the vertices that faces use: 2 for a sphere, 0 for a torus, 1 for a disk."""
    return len(np.unique(faces)) - len(edge_table(faces).edges) + len(faces)


def vertex_normals(vertices: Floats, faces: Ints) -> Floats:
    """(V, 3) unit normals, the faces around weighted with their areas; zero where no face, or no area, is around."""
    a, b, c = vertices[faces].transpose(1, 0, 2)
    area = np.cross(b - a, c - a)
    return unit_vectors(added_at(np.repeat(area, 3, axis=0), faces.ravel(), len(vertices)))

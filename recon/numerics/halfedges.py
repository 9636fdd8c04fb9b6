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
from numba import njit
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from recon.numerics.face_loops import normal_sums
from recon.numerics.rows import unit_vectors

__all__ = [
    "EdgeTable",
    "edge_table",
    "numbered_edges",
    "opposite_sides",
    "paired_sides",
    "FREE",
    "TANGLED",
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
SmallInts = NDArray[np.int32]

FREE, TANGLED = -1, -2  # sides on an edge of one face; on one of three or more, or of two that disagree
CROWDED = 32  # sides from a vertex from where on they are sorted by a faster way for many


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
    """All edges of a list of triangles, or of quadrilaterals, with the sides that lie on them."""
    flat = np.ascontiguousarray(faces).ravel()
    face_edges = np.empty(len(flat), dtype=np.int64)
    ends, uses = _numbered(flat, faces.shape[1], int(flat.max(initial=-1)) + 1, face_edges)
    return EdgeTable(ends, face_edges.reshape(faces.shape), faces < np.roll(faces, -1, axis=1), uses)


def numbered_edges(faces: Ints) -> tuple[SmallInts, SmallInts]:
    """(E, 2) ends of all edges and (F, k) the edge along each side: of an edge table what scans of millions need."""
    flat = np.ascontiguousarray(faces).ravel()
    face_edges = np.empty(len(flat), dtype=np.int32)
    ends, _ = _numbered(flat, faces.shape[1], int(flat.max(initial=-1)) + 1, face_edges)
    return ends.astype(np.int32, copy=False), face_edges.reshape(faces.shape)


@njit(cache=True)
def _buckets(corners: Ints, k: int, n: int) -> tuple[SmallInts, SmallInts]:  # pragma: no cover - compiled
    """Sides by their lower vertex: where those of each of n vertices begin, (n + 1,), and the sides in that order."""
    starts = np.zeros(n + 2, dtype=np.int32)
    for side in range(len(corners)):
        starts[min(corners[side], corners[_end(side, k)]) + 2] += 1
    for vertex in range(n):
        starts[vertex + 2] += starts[vertex + 1]
    sides = np.empty(len(corners), dtype=np.int32)
    for side in range(len(corners)):
        low = min(corners[side], corners[_end(side, k)])
        sides[starts[low + 1]] = side
        starts[low + 1] += 1
    return starts[: n + 1], sides


@njit(cache=True)
def _end(side: int, k: int) -> int:  # pragma: no cover - compiled
    """The side that begins where this one ends, of faces with k."""
    return side + 1 if (side + 1) % k else side + 1 - k


@njit(cache=True)
def _sort_by_end(corners: Ints, k: int, sides: SmallInts) -> None:  # pragma: no cover - compiled
    """Sides with the same lower vertex in the order of the higher one, in place and stable."""
    high = np.empty(len(sides), dtype=np.int64)
    for i in range(len(sides)):
        high[i] = max(corners[sides[i]], corners[_end(sides[i], k)])
    if len(sides) > CROWDED:
        sides[:] = sides[np.argsort(high, kind="mergesort")]
        return
    for i in range(1, len(sides)):
        side, key, j = sides[i], high[i], i
        while j > 0 and high[j - 1] > key:
            sides[j], high[j] = sides[j - 1], high[j - 1]
            j -= 1
        sides[j], high[j] = side, key


@njit(cache=True)
def _numbered(
    corners: Ints, k: int, n: int, number: Ints | SmallInts
) -> tuple[Ints, Ints]:  # pragma: no cover - compiled
    """The ends (E, 2) and the sides (E,) of every edge of faces with k; into `number` the edge of every side."""
    starts, sides = _buckets(corners, k, n)
    # counted first: room for as many edges as sides is twice what there are
    n_edges = 0
    for low in range(n):
        bucket = sides[starts[low] : starts[low + 1]]
        _sort_by_end(corners, k, bucket)
        last = -1
        for side in bucket:
            high = max(corners[side], corners[_end(side, k)])
            n_edges, last = n_edges + (high != last), high
    ends, uses = np.empty((n_edges, 2), dtype=number.dtype), np.zeros(n_edges, dtype=number.dtype)
    edge = -1
    for low in range(n):
        last = -1
        for side in sides[starts[low] : starts[low + 1]]:
            high = max(corners[side], corners[_end(side, k)])
            if high != last:
                edge, last = edge + 1, high
                ends[edge, 0], ends[edge, 1] = low, high
            number[side] = edge
            uses[edge] += 1
    return ends, uses


def opposite_sides(faces: Ints) -> Ints:
    """(F, k) the side across each side, as k times its face plus its number there; -1 on the border.

    faces (F, k) may be triangles or quadrilaterals. Where more than two sides lie on an edge, or two of the same
    direction, each of them is a border: nothing says which belongs to which.
    """
    return np.maximum(paired_sides(faces), FREE).astype(np.int64)


def paired_sides(faces: Ints) -> SmallInts:
    """(F, k) the side across each side, as k times its face plus its number there; FREE or TANGLED where there is none.

    For scans of millions of faces: three times faster than an edge table, and a quarter of its memory.
    """
    flat = np.ascontiguousarray(faces).ravel()
    return _paired(flat, faces.shape[1], int(flat.max(initial=-1)) + 1).reshape(faces.shape)


@njit(cache=True)
def _paired(corners: Ints, k: int, n: int) -> SmallInts:  # pragma: no cover - compiled
    starts, sides = _buckets(corners, k, n)
    across = np.full(len(corners), FREE, dtype=np.int32)
    for low in range(n):
        bucket = sides[starts[low] : starts[low + 1]]
        _sort_by_end(corners, k, bucket)
        first = 0
        while first < len(bucket):
            high, after = max(corners[bucket[first]], corners[_end(bucket[first], k)]), first + 1
            while after < len(bucket) and max(corners[bucket[after]], corners[_end(bucket[after], k)]) == high:
                after += 1
            one, two = bucket[first], bucket[after - 1]
            if after - first == 2 and corners[one] != corners[two]:
                across[one], across[two] = two, one
            elif after - first > 1:
                for i in range(first, after):
                    across[bucket[i]] = TANGLED
            first = after
    return across


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
    return unit_vectors(normal_sums(vertices, faces))

"""Seams that cut a tube or a torus open: over them a neighbour is seen a period further on.

        faces crossed, from one rim to the other             jumps  (F, 3) a side run from start to end:
     ___/____                                                       x_end + jump is where its end is seen from its start
     |  /    |                                                      -1 where the far side lies to the right, +1 back
     |_/_____|

Paper  [gortler2006]; [eppstein2003] the two seams of a torus.
"""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from recon.numerics.halfedges import edge_table

__all__ = ["jumps_around", "jumps_between"]

Ints = NDArray[np.int64]


def jumps_between(faces: Ints, across: Ints, rims: tuple[Ints, ...]) -> Ints:
    """(F, 3) jumps over a seam: the sides crossed on the shortest way over faces from one rim to the other."""
    side_of = {}
    for face, side in np.argwhere(across < 0).tolist():
        side_of[int(faces[face, side])] = (face, side)
    first, last = ([side_of[int(v)] for v in rim if int(v) in side_of] for rim in rims)
    graph = _face_graph(across)
    starts = np.unique([face for face, _ in first])
    _, before, _ = csgraph.dijkstra(graph, unweighted=True, indices=starts, min_only=True, return_predecessors=True)
    distance = csgraph.dijkstra(graph, unweighted=True, indices=starts, min_only=True)
    end, end_side = min(last, key=lambda pair: distance[pair[0]])
    row = [end]
    while before[row[-1]] >= 0:
        row.append(int(before[row[-1]]))
    row.reverse()
    jumps = np.zeros(faces.shape, dtype=np.int64)
    _cross_row(jumps, across, row)
    jumps[row[0], next(side for face, side in first if face == row[0])] += 1
    jumps[end, end_side] -= 1
    return jumps


def jumps_around(faces: Ints, across: Ints, n_vertices: int) -> Ints:
    """(F, 3, 2) jumps over two seams that cut a torus open.

    A tree of edges through all vertices, a tree of faces over other edges: two edges are in neither [eppstein2003].
    """
    table = edge_table(faces)
    a, b = table.edges.T
    graph = sparse.coo_array((np.ones(len(a)), (a, b)), shape=(n_vertices, n_vertices)).tocsr()
    tree = csgraph.breadth_first_tree(graph, 0, directed=False).tocoo()
    in_tree = np.isin(a * n_vertices + b, np.minimum(tree.row, tree.col) * n_vertices + np.maximum(tree.row, tree.col))
    face, side = np.nonzero(across >= 0)
    open_sides = ~in_tree[table.face_edges[face, side]]
    face, side = face[open_sides], side[open_sides]
    shape = (len(faces), len(faces))
    dual = sparse.coo_array((np.ones(len(face)), (face, across[face, side] // 3)), shape=shape).tocsr()
    before = csgraph.breadth_first_order(dual, 0, directed=False)[1]
    joined = before[face] == across[face, side] // 3
    joined |= before[across[face, side] // 3] == face
    left = np.flatnonzero(~joined)
    jumps = np.zeros((*faces.shape, 2), dtype=np.int64)
    edges = table.face_edges[face[left], side[left]]
    for k, edge in enumerate(np.unique(edges).tolist()):
        i = left[int(np.flatnonzero(edges == edge)[0])]
        start, end = int(face[i]), int(across[face[i], side[i]] // 3)
        to_start, to_end = _way_up(before, start), _way_up(before, end)
        shared = set(to_start)
        meet = next(f for f in to_end if f in shared)
        row = to_end[: to_end.index(meet)] + to_start[: to_start.index(meet) + 1][::-1]
        layer = np.zeros(faces.shape, dtype=np.int64)
        _cross_row(layer, across, row)
        layer[start, side[i]] -= 1
        layer.reshape(-1)[across[start, side[i]]] += 1
        jumps[..., k] = layer
    return jumps


def _cross_row(jumps: Ints, across: Ints, row: list[int]) -> None:
    """Mark the sides between faces that follow each other: to their right the far side is a period back."""
    for one, two in pairwise(row):
        side = next(s for s in range(3) if across[one, s] // 3 == two and across[one, s] >= 0)
        jumps[one, side] -= 1
        jumps.reshape(-1)[across[one, side]] += 1


def _face_graph(across: Ints) -> sparse.csr_array:
    face, side = np.nonzero(across >= 0)
    other = across[face, side] // 3
    return sparse.coo_array((np.ones(len(face)), (face, other)), shape=(len(across), len(across))).tocsr()


def _way_up(before: Ints, face: int) -> list[int]:
    row = [face]
    while before[row[-1]] >= 0:
        row.append(int(before[row[-1]]))
    return row

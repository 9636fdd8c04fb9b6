"""Edges that hang together."""

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

__all__ = ["chain_lengths", "chains_of"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def chains_of(edges: Ints, n_vertices: int) -> Ints:
    """(m,) for every edge (m, 2) the number of the chain it is in: the edges that can be reached from it."""
    if len(edges) == 0:
        return np.empty(0, dtype=np.int64)
    ones = np.ones(len(edges), dtype=np.int8)
    graph = sparse.coo_array((ones, (edges[:, 0], edges[:, 1])), shape=(n_vertices, n_vertices))
    return np.unique(csgraph.connected_components(graph, directed=False)[1][edges[:, 0]], return_inverse=True)[1]


def chain_lengths(edges: Ints, vertices: Floats) -> Floats:
    """(m,) for every edge (m, 2) the length of the chain it is in."""
    chain = chains_of(edges, len(vertices))
    length = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
    return np.asarray(np.bincount(chain, length)[chain], dtype=np.float64)

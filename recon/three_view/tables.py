"""Joins of tables of numbers: what meets what is told by equal numbers, never by distance."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

__all__ = ["linked", "ranges", "self_joined"]

Ints = NDArray[np.int64]


def linked(pairs: NDArray[np.int64], n: int) -> Ints:
    """(n,) number of the connected component of every node of a graph."""
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def ranges(first: Ints, last: Ints) -> tuple[Ints, Ints]:
    """All pairs of a row and a number from `first` up to, but not with, `last` of that row."""
    count = last - first
    row = np.repeat(np.arange(len(first)), count)
    return row, np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count) + np.repeat(first, count)


def self_joined(group: Ints) -> tuple[Ints, Ints]:
    """All pairs of two rows of one group, both ways."""
    order = np.argsort(group, kind="stable")
    row, slot = ranges(*np.searchsorted(group[order], [group, group + 1]))
    mate = order[slot]
    return row[row != mate], mate[row != mate]

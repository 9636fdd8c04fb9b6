"""A heap of edges by cost in which an edge's cost may change and an edge may leave: each edge knows its place.

     0            heap[place]  edge number           the children of place s are 4 s + 1 ... 4 s + 4
1  2  3  4        cost[place]  what it costs: in the order of the heap, so that four children are read at once
...               slot[edge]   its place, -1 outside
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["EdgeHeap", "edge_heap", "heap_append", "heap_arrange", "heap_put", "heap_drop"]

Floats = NDArray[np.float64]


class EdgeHeap(NamedTuple):
    """heap (E,), slot (E,), cost (E,), size (1,) number of edges within."""

    heap: NDArray[np.int32]
    slot: NDArray[np.int32]
    cost: Floats
    size: NDArray[np.int64]


def edge_heap(n_edges: int) -> EdgeHeap:
    """An empty heap for edges 0 to n_edges - 1."""
    return EdgeHeap(
        np.zeros(n_edges, dtype=np.int32),
        np.full(n_edges, -1, dtype=np.int32),
        np.zeros(n_edges),
        np.zeros(1, dtype=np.int64),
    )


@njit(cache=True)
def heap_append(h: EdgeHeap, edge: int, cost: float) -> None:  # pragma: no cover - compiled
    """Put an edge at the end, where it may not belong until all is arranged."""
    at = h.size[0]
    h.heap[at], h.cost[at], h.slot[edge] = edge, cost, at
    h.size[0] += 1


@njit(cache=True)
def heap_arrange(h: EdgeHeap) -> None:  # pragma: no cover - compiled
    """Put appended edges in order, the last with children first."""
    for at in range((h.size[0] - 2) // 4, -1, -1):
        _sink(h, at)


@njit(cache=True)
def heap_put(h: EdgeHeap, edge: int, cost: float) -> None:  # pragma: no cover - compiled
    """Put an edge in, or give it another cost."""
    at = h.slot[edge]
    if at < 0:
        at = h.size[0]
        h.size[0] += 1
        h.heap[at], h.cost[at] = edge, np.inf
    sinks = cost > h.cost[at]
    h.cost[at] = cost
    if sinks:
        _sink(h, at)
    else:
        _rise(h, at)


@njit(cache=True)
def heap_drop(h: EdgeHeap, edge: int) -> None:  # pragma: no cover - compiled
    """Take an edge out, where it is in."""
    at = h.slot[edge]
    if at < 0:
        return
    h.slot[edge] = -1
    h.size[0] -= 1
    end = h.size[0]
    if at == end:
        return
    sinks = h.cost[end] > h.cost[at]
    h.heap[at], h.cost[at] = h.heap[end], h.cost[end]
    if sinks:
        _sink(h, at)
    else:
        _rise(h, at)


@njit(cache=True)
def _rise(h: EdgeHeap, at: int) -> None:  # pragma: no cover - compiled
    edge, cost = h.heap[at], h.cost[at]
    while at > 0:
        above = (at - 1) >> 2
        if h.cost[above] <= cost:
            break
        h.heap[at], h.cost[at] = h.heap[above], h.cost[above]
        h.slot[h.heap[at]] = at
        at = above
    h.heap[at], h.cost[at], h.slot[edge] = edge, cost, at


@njit(cache=True)
def _sink(h: EdgeHeap, at: int) -> None:  # pragma: no cover - compiled
    edge, cost = h.heap[at], h.cost[at]
    n = h.size[0]
    while True:
        first = 4 * at + 1
        if first >= n:
            break
        least = first
        for child in range(first + 1, min(first + 4, n)):
            if h.cost[child] < h.cost[least]:
                least = child
        if h.cost[least] >= cost:
            break
        h.heap[at], h.cost[at] = h.heap[least], h.cost[least]
        h.slot[h.heap[at]] = at
        at = least
    h.heap[at], h.cost[at], h.slot[edge] = edge, cost, at

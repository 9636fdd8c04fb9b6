"""A heap of edges by cost in which an edge's cost may change and an edge may leave: each edge knows its place.

     0            heap[slot]   edge number           the children of slot s are 4 s + 1 ... 4 s + 4
1  2  3  4        slot[edge]   its place, -1 outside
...               cost[edge]
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["EdgeHeap", "edge_heap", "heap_put", "heap_drop"]

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
def heap_put(h: EdgeHeap, edge: int, cost: float) -> None:  # pragma: no cover - compiled
    """Put an edge in, or give it another cost."""
    if h.slot[edge] < 0:
        h.slot[edge] = h.size[0]
        h.heap[h.size[0]] = edge
        h.size[0] += 1
        h.cost[edge] = cost
        _rise(h, h.slot[edge])
    elif cost < h.cost[edge]:
        h.cost[edge] = cost
        _rise(h, h.slot[edge])
    else:
        h.cost[edge] = cost
        _sink(h, h.slot[edge])


@njit(cache=True)
def heap_drop(h: EdgeHeap, edge: int) -> None:  # pragma: no cover - compiled
    """Take an edge out, where it is in."""
    at = h.slot[edge]
    if at < 0:
        return
    h.slot[edge] = -1
    h.size[0] -= 1
    last = h.heap[h.size[0]]
    if last == edge:
        return
    h.heap[at] = last
    h.slot[last] = at
    _rise(h, at)
    _sink(h, h.slot[last])


@njit(cache=True)
def _rise(h: EdgeHeap, at: int) -> None:  # pragma: no cover - compiled
    edge = h.heap[at]
    cost = h.cost[edge]
    while at > 0:
        above = (at - 1) >> 2
        other = h.heap[above]
        if h.cost[other] <= cost:
            break
        h.heap[at] = other
        h.slot[other] = at
        at = above
    h.heap[at] = edge
    h.slot[edge] = at


@njit(cache=True)
def _sink(h: EdgeHeap, at: int) -> None:  # pragma: no cover - compiled
    edge = h.heap[at]
    cost = h.cost[edge]
    n = h.size[0]
    while True:
        first = 4 * at + 1
        if first >= n:
            break
        least = first
        for child in range(first + 1, min(first + 4, n)):
            if h.cost[h.heap[child]] < h.cost[h.heap[least]]:
                least = child
        other = h.heap[least]
        if h.cost[other] >= cost:
            break
        h.heap[at] = other
        h.slot[other] = at
        at = least
    h.heap[at] = edge
    h.slot[edge] = at

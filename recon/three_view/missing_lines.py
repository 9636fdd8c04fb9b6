"""Lines that a view may lack: where the two other views show an edge, and its ends fall on what the view has drawn.

top    o-----o           front     o     o            the edge is drawn in top and side; in the front view both
side   o-----o                     |     |            its ends are there, but nothing joins them: a line may be
                                   +-----+            missing between them
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from recon.three_view.edges import RunTable, elementary
from recon.three_view.view_graph import ViewGraph

__all__ = ["missing_lines"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

PARALLEL = 1e-3  # radians
MOST = 1200  # vertices that two views support, beyond which no pairs are tried


def missing_lines(
    values: Sequence[Floats], graphs: Sequence[ViewGraph], lacking: int, snap: float, *, slanted: bool = True
) -> Floats:
    """(n, 2, 2) lines that the view of number `lacking` may lack; pieces that it has drawn are among them.

    slanted  whether slanted ones are, too
    """
    view = graphs[lacking]
    others = [graph for k, graph in enumerate(graphs) if k != lacking]
    coordinates, points = _vertices(others, view)
    at = np.column_stack([values[axis][coordinates[:, axis]] for axis in range(3)])
    kept = _drawn_at(view, at[:, view.projection.axes], snap)
    at, points = at[kept], points[kept]
    if not 1 < len(at) <= MOST:
        return np.empty((0, 2, 2))
    i, j = np.triu_indices(len(at), 1)
    for graph, shown in zip(others, points.T):
        joined = RunTable.of(graph).joined(shown[i], shown[j])
        i, j = i[joined], j[joined]
    flat = at[:, view.projection.axes]
    gap = np.abs(flat[i] - flat[j])
    corner = cKDTree(view.positions).query(flat)[0] <= 2 * snap
    going_on = np.any([_meets_slanted(graph)[shown] for graph, shown in zip(others, points.T)], axis=0)
    # In a plane across the sight any two vertices are joined. Of slanted lines those are likely that run between points
    # of the view, or along another line of it, or go on as slanted lines in another view.
    likely = (gap <= snap).any(axis=1)
    if slanted:
        likely |= (corner[i] & corner[j]) | (going_on[i] & going_on[j])
        likely |= _parallel_to_some(flat[j] - flat[i], view.directions())
    likely &= (gap > snap).any(axis=1)
    pairs = np.column_stack([i, j])[likely]
    pairs = pairs[elementary(at, pairs, snap)] if len(pairs) else pairs
    return _each_once(flat[pairs])


def _parallel_to_some(ways: Floats, given: Floats) -> Flags:
    """(n,) whether directions (n, 2) are those of lines of the view, (m, 2)."""
    known, wanted = (np.arctan2(way[:, 1], way[:, 0]) % np.pi for way in (given, ways))
    known = np.sort(np.concatenate([known - np.pi, known, known + np.pi]))
    slot = np.clip(np.searchsorted(known, wanted), 1, len(known) - 1)
    return np.asarray(np.minimum(np.abs(known[slot] - wanted), np.abs(known[slot - 1] - wanted)) <= PARALLEL)


def _meets_slanted(graph: ViewGraph) -> Flags:
    """Whether a slanted line ends in, or passes, each point of a view."""
    way = graph.directions()
    found = np.zeros(len(graph.points), dtype=bool)
    found[graph.edges[(way != 0).all(axis=1)]] = True
    return found


def _each_once(segments: Floats) -> Floats:
    """The segments without repetition, whichever way they run."""
    turned = (segments[:, 0, 0] > segments[:, 1, 0]) | (
        (segments[:, 0, 0] == segments[:, 1, 0]) & (segments[:, 0, 1] > segments[:, 1, 1])
    )
    ordered = np.where(turned[:, None, None], segments[:, ::-1], segments)
    return np.unique(ordered.reshape(-1, 4), axis=0).reshape(-1, 2, 2)


def _vertices(others: Sequence[ViewGraph], view: ViewGraph) -> tuple[Ints, Ints]:
    """Coordinate numbers (n, 3) on which corners of the two other views agree, and the points (n, 2) that show them."""
    depth = view.projection.depth
    shown = [np.flatnonzero(graph.corners) for graph in others]
    column = [graph.projection.axes.index(depth) for graph in others]
    first, second = (graph.points[rows, c] for graph, rows, c in zip(others, shown, column))
    a, b = np.nonzero(first[:, None] == second)
    points = np.column_stack([shown[0][a], shown[1][b]])
    coordinates = np.zeros((len(points), 3), dtype=np.int64)
    for graph, rows in zip(others, points.T):
        coordinates[:, graph.projection.axes] = graph.points[rows]
    return coordinates, points


def _drawn_at(view: ViewGraph, at: Floats, snap: float) -> Flags:
    """Whether the view shows a line, or the end of one, at each of some places."""
    start, way = view.positions[view.edges[:, 0]], view.directions()
    found = np.zeros(len(at), dtype=bool)
    for k in range(len(view.edges)):
        share = np.clip(((at - start[k]) @ way[k]) / (way[k] @ way[k]), 0, 1)
        found |= np.linalg.norm(start[k] + share[:, None] * way[k] - at, axis=1) <= 2 * snap
    return found

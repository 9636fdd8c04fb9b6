"""2D points and edges of the three views, their coordinates made one (paper, 4.1).

    a-----------b            segments a-b, c-d and e-f become points a b c d e f x t and edges between neighbours:
    |     e                  x where two cross, t where one ends on another.
    c-----x-----d            A run is a straight row of edges, whatever their line types: c-x-d is one.
          f=t
    ------+------

Coordinates that differ by no more than `snap` are one; afterwards a coordinate is a number in a list, the same list for
the two views that share the axis, and points are pairs of such numbers, compared exactly.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from recon.geometry.views import PROJECTIONS, DrawnView, Projection, ThreeViews

__all__ = ["ViewGraph", "linked", "view_graphs"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

SLACK = 2.0  # snaps that a point may be off a slanted line: the ends of the line and the point have moved by one


@dataclass(frozen=True, eq=False)
class ViewGraph:
    """One view as a graph.

    projection  direction of sight
    points      (n, 2) numbers of the coordinates along the view's two axes
    positions   (n, 2) the coordinates themselves
    edges       (m, 2) points; no two edges join the same points
    hidden      (m,) dashed
    runs        (m,) number of the run that an edge belongs to
    sources     (m,) the first segment of the drawing that the edge is part of, of those drawn through if there are any
    """

    projection: Projection
    points: Ints
    positions: Floats
    edges: Ints
    hidden: Flags
    runs: Ints
    sources: Ints

    def directions(self) -> Floats:
        """(m, 2) from the first to the second point of each edge."""
        return self.positions[self.edges[:, 1]] - self.positions[self.edges[:, 0]]

    def corners(self) -> Flags:
        """(n,) whether edges of more than one run meet in a point: only there can a vertex of a solid be seen."""
        pairs = np.unique(np.column_stack([self.edges.ravel(), np.repeat(self.runs, 2)]), axis=0)
        return np.bincount(pairs[:, 0], minlength=len(self.points)) > 1


@dataclass(eq=False)
class _Segments:
    """Segments of one view while they are cut: ends as coordinate numbers, and the points found on each."""

    ends: Ints  # (n, 2, 2)
    hidden: Flags
    source: Ints


def view_graphs(drawing: ThreeViews, snap: float) -> tuple[list[Floats], list[ViewGraph]]:
    """The coordinates along x, y and z, and the three views as graphs.

    snap      length: coordinates, and points and lines, that lie closer are one
    Promises  a coordinate has the same number in both views that show it.
    """
    values = [_clustered(_axis_values(drawing, axis), snap) for axis in range(3)]
    segments = [_numbered(projection, view, values) for projection, view in drawing]
    crossings = [_crossings(p.axes, s, values, snap) for p, s in zip(PROJECTIONS, segments)]
    for axis in range(3):
        found = [at[:, p.axes.index(axis)] for p, (_, at) in zip(PROJECTIONS, crossings) if axis in p.axes]
        values[axis] = _extended(values[axis], np.concatenate(found), snap)
    graphs = [
        _graph(p, s, (pairs, _nearest_points(p.axes, at, values)), values, snap)
        for p, s, (pairs, at) in zip(PROJECTIONS, segments, crossings)
    ]
    return values, graphs


def linked(pairs: NDArray[np.int64], n: int) -> Ints:
    """(n,) number of the connected component of every node of a graph."""
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def _axis_values(drawing: ThreeViews, axis: int) -> Floats:
    return np.concatenate([v.segments[:, :, p.axes.index(axis)].ravel() for p, v in drawing if axis in p.axes])


def _clustered(values: Floats, snap: float) -> Floats:
    """One value for each group of values without a gap above `snap`: its median, which is exact when most agree."""
    ordered = np.sort(values)
    cuts = np.flatnonzero(np.diff(ordered) > snap) + 1
    return np.array([np.median(group) for group in np.split(ordered, cuts)]) if len(ordered) else ordered


def _extended(values: Floats, found: Floats, snap: float) -> Floats:
    """The values, first as they are, then groups of those found further than `snap` from all of them."""
    if not len(found):
        return values
    away = np.abs(values[_nearest(values, found)] - found) > snap
    return np.concatenate([values, _clustered(found[away], snap)])


def _nearest(values: Floats, wanted: Floats) -> Ints:
    order = np.argsort(values, kind="stable")
    right = np.clip(np.searchsorted(values[order], wanted), 1, max(len(values) - 1, 1))
    right = np.minimum(right, len(values) - 1)
    left = np.maximum(right - 1, 0)
    nearer_left = np.abs(values[order[left]] - wanted) <= np.abs(values[order[right]] - wanted)
    return np.asarray(order[np.where(nearer_left, left, right)], dtype=np.int64)


def _nearest_points(axes: tuple[int, int], at: Floats, values: Sequence[Floats]) -> Ints:
    return np.column_stack([_nearest(values[axis], at[:, k]) for k, axis in enumerate(axes)])


def _numbered(projection: Projection, view: DrawnView, values: Sequence[Floats]) -> _Segments:
    ends = np.stack([_nearest(values[axis], view.segments[:, :, k].ravel()) for k, axis in enumerate(projection.axes)])
    ends = ends.reshape(2, -1, 2).transpose(1, 2, 0)
    keep = (ends[:, 0] != ends[:, 1]).any(axis=1)
    return _Segments(ends[keep], view.hidden[keep], np.flatnonzero(keep))


def _place(axes: tuple[int, int], points: Ints, values: Sequence[Floats]) -> Floats:
    return np.stack([values[axis][points[..., k]] for k, axis in enumerate(axes)], axis=-1)


def _crossings(
    axes: tuple[int, int], segments: _Segments, values: Sequence[Floats], snap: float
) -> tuple[Ints, Floats]:
    """Pairs (k, 2) of segments that cross inside both, and the places (k, 2)."""
    ends = _place(axes, segments.ends, values)
    start, way = ends[:, 0], ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(way, axis=1)
    low, high = ends.min(axis=1) - snap, ends.max(axis=1) + snap
    pairs, places = [np.empty((0, 2), dtype=np.int64)], [np.empty((0, 2))]
    for i in range(len(ends) - 1):
        others = np.arange(i + 1, len(ends))
        others = others[(low[others] <= high[i]).all(axis=1) & (high[others] >= low[i]).all(axis=1)]
        turn = way[i, 0] * way[others, 1] - way[i, 1] * way[others, 0]
        # where two lines stay within snap all along the shorter one, their crossing is anywhere
        apart = np.abs(turn) > snap * np.maximum(length[i], length[others])
        others, turn = others[apart], turn[apart]
        gap = start[others] - start[i]
        along = (gap[:, 0] * way[others, 1] - gap[:, 1] * way[others, 0]) / turn
        across = (gap[:, 0] * way[i, 1] - gap[:, 1] * way[i, 0]) / turn
        inside = (np.minimum(along, 1 - along) * length[i] > 0) & (np.minimum(across, 1 - across) * length[others] > 0)
        others, along = others[inside], along[inside]
        at = start[i] + along[:, None] * way[i]
        # an upright or level segment keeps its own coordinate to the last bit
        at = np.where(way[i] == 0, start[i], np.where(way[others] == 0, start[others], at))
        pairs.append(np.column_stack([np.full(len(others), i), others]))
        places.append(at)
    return np.concatenate(pairs), np.concatenate(places)


def _graph(
    projection: Projection,
    segments: _Segments,
    crossings: tuple[Ints, Ints],
    values: Sequence[Floats],
    snap: float,
) -> ViewGraph:
    pairs, met = crossings
    points, number = np.unique(np.concatenate([segments.ends.reshape(-1, 2), met]), axis=0, return_inverse=True)
    number = number.ravel()
    positions = _place(projection.axes, points, values)
    ends = number[: 2 * len(segments.ends)].reshape(-1, 2)
    touching = _points_on(positions, ends, snap)
    crossing = np.column_stack([pairs.ravel(), np.repeat(number[2 * len(segments.ends) :], 2)])
    own = np.column_stack([np.repeat(np.arange(len(ends)), 2), ends.ravel()])
    on = np.unique(np.concatenate([own, touching, crossing]), axis=0)
    way = positions[ends[:, 1]] - positions[ends[:, 0]]
    along = ((positions[on[:, 1]] - positions[ends[on[:, 0], 0]]) * way[on[:, 0]]).sum(axis=1)
    on = on[np.lexsort([along, on[:, 0]])]
    follow = on[1:, 0] == on[:-1, 0]
    pieces, owner = np.column_stack([on[:-1, 1], on[1:, 1]])[follow], on[:-1, 0][follow]
    edges, slot = np.unique(np.sort(pieces, axis=1), axis=0, return_inverse=True)
    slot = slot.ravel()
    # a line drawn through hides a dashed one beneath it
    hidden = np.bincount(slot, ~segments.hidden[owner], minlength=len(edges)) == 0
    source = np.zeros(len(edges), dtype=np.int64)
    # written last, and kept: the first segment that is drawn through, or else the first one
    ranked = np.lexsort([segments.source[owner], segments.hidden[owner]])[::-1]
    source[slot[ranked]] = segments.source[owner[ranked]]
    runs = _runs(positions, edges, (slot, owner), snap)
    return ViewGraph(projection, points, positions, edges, hidden, runs, source)


def _points_on(positions: Floats, ends: Ints, snap: float) -> Ints:
    """Pairs (segment, point) of points inside a segment, none of its ends."""
    found = [np.empty((0, 2), dtype=np.int64)]
    start, way = positions[ends[:, 0]], positions[ends[:, 1]] - positions[ends[:, 0]]
    length = np.linalg.norm(way, axis=1)
    for s in range(len(ends)):
        gap = positions - start[s]
        along = gap @ way[s] / length[s]
        away = np.abs(gap[:, 0] * way[s, 1] - gap[:, 1] * way[s, 0]) / length[s]
        near = (away <= (SLACK * snap if way[s].all() else 0.0)) & (along > 0) & (along < length[s])
        near[ends[s]] = False
        rows = np.flatnonzero(near)
        found.append(np.column_stack([np.full(len(rows), s), rows]))
    return np.concatenate(found)


def _runs(positions: Floats, edges: Ints, pieces: tuple[Ints, Ints], snap: float) -> Ints:
    """Run of every edge: pieces of one segment belong together, and edges that go straight on through a point."""
    slot, owner = pieces
    order = np.argsort(owner, kind="stable")
    same = np.flatnonzero(owner[order][1:] == owner[order][:-1])
    links = [np.column_stack([slot[order[same]], slot[order[same + 1]]])]
    ends = np.concatenate([edges, edges[:, ::-1]])
    edge = np.tile(np.arange(len(edges)), 2)
    by_point = np.argsort(ends[:, 0], kind="stable")
    ends, edge = ends[by_point], edge[by_point]
    starts = np.searchsorted(ends[:, 0], np.arange(len(positions) + 1))
    count = np.diff(starts)
    for valence in np.unique(count[count > 1]).tolist():
        i, j = np.triu_indices(valence, 1)
        rows = starts[:-1][count == valence][:, None]
        first, second = (rows + i).ravel(), (rows + j).ravel()
        straight = _straight_on(positions, np.column_stack([ends[first], ends[second, 1]]), snap)
        links.append(np.column_stack([edge[first], edge[second]])[straight])
    return linked(np.concatenate(links), len(edges))


def _straight_on(positions: Floats, triples: Ints, snap: float) -> Flags:
    """Whether two edges at a point continue each other; rows (point, far end of one, far end of the other)."""
    at, one, other = (positions[column] for column in triples.T)
    a, b, base = one - at, other - at, other - one
    away = np.abs(a[:, 0] * base[:, 1] - a[:, 1] * base[:, 0]) / np.maximum(np.linalg.norm(base, axis=1), 1e-300)
    level = ((a == 0) & (b == 0)).any(axis=1)
    # of a slanted line a short piece may stand level, its ends' coordinates having become one
    slanted = ((a != 0) | (b != 0)).all(axis=1)
    slanted &= np.minimum(np.linalg.norm(a, axis=1), np.linalg.norm(b, axis=1)) > 2 * SLACK * snap
    return np.asarray(((a * b).sum(axis=1) < 0) & (level | (slanted & (away <= SLACK * snap))))

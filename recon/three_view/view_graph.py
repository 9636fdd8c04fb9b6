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
from scipy.sparse import csr_array

from recon.geometry.views import PROJECTIONS, DrawnView, Projection, ThreeViews
from recon.three_view.runs import SLACK, straight_runs
from recon.three_view.stretches import SAME, lone_stretches
from recon.three_view.tables import self_joined

__all__ = ["ViewGraph", "view_graphs"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]


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
    corners     (n,) whether lines of several directions meet in a point: only there can a vertex of a solid be seen
    """

    projection: Projection
    points: Ints
    positions: Floats
    edges: Ints
    hidden: Flags
    runs: Ints
    sources: Ints
    corners: Flags

    def directions(self) -> Floats:
        """(m, 2) from the first to the second point of each edge."""
        return self.positions[self.edges[:, 1]] - self.positions[self.edges[:, 0]]

    def telling(self, snap: float) -> Flags:
        """(m,) whether a drawing can differ in an edge: not if it is short, nor dashed beside a line drawn through."""
        segments = self.positions[self.edges]
        drawn_through = segments[~self.hidden]
        none = np.empty((0, 2, 2))
        told = np.zeros(len(segments), dtype=bool)
        for rows, beside in ((~self.hidden, none), (self.hidden, drawn_through)):
            told[np.flatnonzero(rows)[lone_stretches(segments[rows], beside, SAME * snap)[0]]] = True
        return told


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
    met = _sharing_a_point(axes, segments, values, snap)
    low, high = ends.min(axis=1) - snap, ends.max(axis=1) + snap
    pairs, places = [np.empty((0, 2), dtype=np.int64)], [np.empty((0, 2))]
    for i in range(len(ends) - 1):
        others = np.arange(i + 1, len(ends))
        others = others[(low[others] <= high[i]).all(axis=1) & (high[others] >= low[i]).all(axis=1)]
        # two lines meet once: where one ends on the other, their slight angle would tell another place
        others = np.setdiff1d(others, met.indices[met.indptr[i] : met.indptr[i + 1]], assume_unique=True)
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


def _sharing_a_point(axes: tuple[int, int], segments: _Segments, values: Sequence[Floats], snap: float) -> csr_array:
    """(n, n) not zero where two segments have an end of any segment in common."""
    points, number = np.unique(segments.ends.reshape(-1, 2), axis=0, return_inverse=True)
    ends = number.reshape(-1, 2)
    own = np.column_stack([np.repeat(np.arange(len(ends)), 2), ends.ravel()])
    on = np.concatenate([own, _points_on(_place(axes, points, values), ends, snap)[0]])
    holds = csr_array((np.ones(len(on), dtype=np.int64), (on[:, 0], on[:, 1])), shape=(len(ends), len(points)))
    return csr_array(holds @ holds.T)


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
    crossing = np.column_stack([pairs.ravel(), np.repeat(number[2 * len(segments.ends) :], 2)])
    on = _met_once(positions, ends, crossing, snap)
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
    runs, corners = straight_runs(positions, edges, (slot, owner), snap)
    return ViewGraph(projection, points, positions, edges, hidden, runs, source, corners)


def _met_once(positions: Floats, ends: Ints, crossing: Ints, snap: float) -> Ints:
    """Pairs (segment, point) of all points on each segment: its ends, its crossings, and points that lie near enough.

    Two lines at an angle have but one point in common: of several that are near both, the nearest.
    """
    own = np.column_stack([np.repeat(np.arange(len(ends)), 2), ends.ravel()])
    touching, away = _points_on(positions, ends, snap)
    rows = np.concatenate([own, crossing, touching])
    on, first = np.unique(rows, axis=0, return_index=True)
    away = np.concatenate([np.zeros(len(rows) - len(away)), away])[first]
    one, other = self_joined(on[:, 1])
    far = np.maximum(away[one], away[other])
    order = np.lexsort([far, on[other, 0], on[one, 0]])
    one, other, far = one[order], other[order], far[order]
    pair = on[one, 0] * len(ends) + on[other, 0]
    nearest = np.repeat(far[np.diff(pair, prepend=-1) != 0], np.unique(pair, return_counts=True)[1])
    way = positions[ends[:, 1]] - positions[ends[:, 0]]
    length = np.linalg.norm(way, axis=1)
    a, b = way[on[one, 0]], way[on[other, 0]]
    turn = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    apart = turn > snap * np.maximum(length[on[one, 0]], length[on[other, 0]])
    again = apart & (far > nearest) & (away[one] >= away[other])
    return on[np.bincount(one[again], minlength=len(on)) == 0]


def _points_on(positions: Floats, ends: Ints, snap: float) -> tuple[Ints, Floats]:
    """Pairs (segment, point) of points inside a segment, none of its ends, and how far from it they lie."""
    found, distance = [np.empty((0, 2), dtype=np.int64)], [np.empty(0)]
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
        distance.append(away[rows])
    return np.concatenate(found), np.concatenate(distance)

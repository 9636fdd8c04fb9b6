"""What a viewer meets left and right of every drawn edge (paper, conditions 1, 4 and 5 speak of nothing else).

     left | right             beside a point of a drawn edge, each line of sight passes through a row of fragments,
----------+------- f1         nearest first. Where a fragment ends at an edge of space that projects on the drawn
          |                   one, it covers one side only; otherwise it covers both or neither.
----------+                   The row is the same all along the edge, but for cuts, where nothing changes.
    f2    +------- f3
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.geometry.views import PROJECTIONS, Projection
from recon.numerics.planar_regions import point_in_loops
from recon.three_view.fragments import Fragments
from recon.three_view.tables import ranges
from recon.three_view.view_graph import ViewGraph

__all__ = ["SightLines", "sight_lines"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

# where along a drawn edge one looks: no simple fraction, so that no cut passes through that point
LOOK_AT = 0.4870321
PARALLEL = 0.02


@dataclass(frozen=True, eq=False)
class SightLines:
    """Lines of sight beside the drawn edges of one view.

    beside    (n,) 2 s for the line to the left of drawn edge s, 2 s + 1 to its right; not decreasing
    fragment  (n,) fragments met, nearest first
    facing    (n,) whether the fragment's front looks at the viewer
    behind    drawn edge and edge of space, (k, 2), for every edge of space that projects there
    """

    beside: Ints
    fragment: Ints
    facing: Flags
    behind: Ints


def sight_lines(made: Fragments, graphs: Sequence[ViewGraph], snap: float) -> list[SightLines]:
    """The lines of sight of each view."""
    return [_in_view(made, graph, snap) for graph in graphs]


def _in_view(made: Fragments, graph: ViewGraph, snap: float) -> SightLines:
    projection = graph.projection
    look = graph.positions[graph.edges[:, 0]] + LOOK_AT * graph.directions()
    shown = made.wire.vertices[:, projection.axes]
    ends = np.ascontiguousarray(shown[made.wire.edges].reshape(-1, 4))
    behind, share = _drawn_over(made, graph, look, ends)
    cuts, cut_share = _cuts_over(made, graph, look, ends, snap)
    behind, share = np.concatenate([behind, cuts]), np.concatenate([share, cut_share])
    outlines = _flat_outlines(made, ends, snap)
    tilt = made.planes.normals[made.plane, projection.depth] * projection.toward
    edge_on = outlines[3] | (np.abs(tilt) < 1e-6)
    ending = _ending_at(made, graph, (behind, share, ends), (edge_on, tilt, projection))
    passing = _passing(look, ending[:, :2].astype(np.int64), outlines[:3], edge_on)
    depth = _heights(made, look[passing[:, 0]], passing[:, 1], projection)
    slope = _slopes(made, graph, passing, projection)
    both = np.column_stack([passing, depth, slope])
    table = np.concatenate(
        [
            ending[:, [0, 2, 1, 3, 4]],
            np.insert(both, 1, 0, axis=1),
            np.insert(both * [1, 1, 1, -1], 1, 1, axis=1),
        ]
    )
    beside = (2 * table[:, 0] + table[:, 1]).astype(np.int64)
    order = _nearest_first(beside, table[:, 3], table[:, 4], snap)
    fragment = table[order, 2].astype(np.int64)
    return SightLines(beside[order], fragment, tilt[fragment] > 0, behind)


def _drawn_over(made: Fragments, graph: ViewGraph, look: Floats, ends: Floats) -> tuple[Ints, Floats]:
    """Pairs of a drawn edge and an edge of space in its run, over it, and how far along the latter one looks.

    Told by the runs, not by distance: another line may be drawn so near that both would do.
    """
    run = made.wire.runs[:, PROJECTIONS.index(graph.projection)]
    order = np.argsort(run, kind="stable")
    drawn, slot = ranges(*np.searchsorted(run[order], [graph.runs, graph.runs + 1]))
    edge = order[slot]
    start, way = ends[edge, :2], ends[edge, 2:] - ends[edge, :2]
    share = ((look[drawn] - start) * way).sum(axis=1) / (way**2).sum(axis=1)
    over = (share > 0) & (share < 1)
    return np.column_stack([drawn, edge])[over], share[over]


def _cuts_over(made: Fragments, graph: ViewGraph, look: Floats, ends: Floats, snap: float) -> tuple[Ints, Floats]:
    """The same pairs and shares for cuts, which belong to no run."""
    cuts = np.flatnonzero(made.is_cut)
    pairs, share = _over(look, graph.directions(), ends[cuts], snap)
    return np.column_stack([pairs[:, 0], cuts[pairs[:, 1]]]), share


def _nearest_first(beside: Ints, height: Floats, slope: Floats, snap: float) -> Ints:
    """By line of sight, then nearest first; of fragments that meet in one edge, the one that rises to the viewer."""
    order = np.lexsort([-height, beside])
    step = (np.diff(beside[order], prepend=-1) != 0) | (np.abs(np.diff(height[order], prepend=0.0)) > snap / 2)
    group = np.empty(len(order), dtype=np.int64)
    group[order] = np.cumsum(step)
    return np.lexsort([-slope, group])


def _flat_outlines(made: Fragments, ends: Floats, snap: float) -> tuple[Floats, Ints, Floats, Flags]:
    """Sides of the fragments in the view, where each fragment's begin, their boxes, and which are seen edge-on."""
    half = made.region.ravel()
    rows = np.flatnonzero(half >= 0)
    rows = rows[np.argsort(half[rows], kind="stable")]
    sides = ends[made.use_edge[rows // 2]]
    starts = np.searchsorted(half[rows], np.arange(len(made.plane) + 1))
    box = np.empty((len(made.plane), 4))
    if not len(box):
        return sides, starts, box, np.zeros(0, dtype=bool)
    box[:, :2] = np.minimum(*(np.minimum.reduceat(sides[:, k : k + 2], starts[:-1]) for k in (0, 2)))
    box[:, 2:] = np.maximum(*(np.maximum.reduceat(sides[:, k : k + 2], starts[:-1]) for k in (0, 2)))
    turn = (sides[:, 0] * sides[:, 3] - sides[:, 1] * sides[:, 2]) * np.where(rows % 2 == 0, 1, -1)
    area = np.abs(np.add.reduceat(turn, starts[:-1])) / 2
    reach = np.hypot(box[:, 2] - box[:, 0], box[:, 3] - box[:, 1])
    return sides, starts, box, area <= 2 * snap * reach


def _ending_at(
    made: Fragments,
    graph: ViewGraph,
    over: tuple[Ints, Floats, Floats],
    seen: tuple[Flags, Floats, Projection],
) -> Floats:
    """Rows (drawn edge, fragment, 0 left or 1 right, height, slope) of fragments that end over a drawn edge."""
    behind, share, ends = over
    edge_on, tilt, projection = seen
    row, use = ranges(*np.searchsorted(made.use_edge, [behind[:, 1], behind[:, 1] + 1]))
    drawn, edge = behind[row].T
    way = ends[:, 2:] - ends[:, :2]
    along = (way[edge] * graph.directions()[drawn]).sum(axis=1) > 0
    heights = made.wire.vertices[made.wire.edges[edge]][:, :, projection.depth] * projection.toward
    height = heights[:, 0] + share[row] * (heights[:, 1] - heights[:, 0])
    rows = []
    for side in (0, 1):
        fragment = made.region[use, side]
        keep = (fragment >= 0) & ~edge_on[fragment]
        f = fragment[keep]
        right = (side == 1) ^ ~along[keep] ^ (tilt[f] < 0)
        slope = _slopes(made, graph, np.column_stack([drawn[keep], f]), projection) * np.where(right, -1, 1)
        rows.append(np.column_stack([drawn[keep], f, right, height[keep], slope]))
    return np.concatenate(rows)


def _heights(made: Fragments, at: Floats, fragment: Ints, projection: Projection) -> Floats:
    """How near the viewer the planes of fragments are at points of the view."""
    plane = made.plane[fragment]
    n, d = made.planes.normals[plane], made.planes.offsets[plane]
    return (d - (n[:, projection.axes] * at).sum(axis=1)) / n[:, projection.depth] * projection.toward


def _slopes(made: Fragments, graph: ViewGraph, pairs: Ints, projection: Projection) -> Floats:
    """How fast fragments come nearer to the viewer to the left of a drawn edge; pairs (edge, fragment)."""
    n = made.planes.normals[made.plane[pairs[:, 1]]]
    way = graph.directions()[pairs[:, 0]]
    left = np.column_stack([-way[:, 1], way[:, 0]]) / np.linalg.norm(way, axis=1)[:, None]
    return -(n[:, projection.axes] * left).sum(axis=1) / n[:, projection.depth] * projection.toward


@njit(cache=True)
def _over(look: Floats, way: Floats, ends: Floats, snap: float) -> tuple[Ints, Floats]:  # pragma: no cover - compiled
    """Pairs of a drawn edge and an edge that passes where one looks, and how far along the latter that is."""
    drawn, edge, share = [0 for _ in range(0)], [0 for _ in range(0)], [0.0 for _ in range(0)]
    for s in range(len(look)):
        x, y = look[s]
        size = np.hypot(way[s, 0], way[s, 1])
        for e in range(len(ends)):
            if not (min(ends[e, 0], ends[e, 2]) - snap <= x <= max(ends[e, 0], ends[e, 2]) + snap):
                continue
            if not (min(ends[e, 1], ends[e, 3]) - snap <= y <= max(ends[e, 1], ends[e, 3]) + snap):
                continue
            dx, dy = ends[e, 2] - ends[e, 0], ends[e, 3] - ends[e, 1]
            length = np.hypot(dx, dy)
            if length <= snap:
                continue
            if abs(dx * way[s, 1] - dy * way[s, 0]) > length * size * PARALLEL + 2 * snap * max(length, size):
                continue
            t = ((x - ends[e, 0]) * dx + (y - ends[e, 1]) * dy) / (length * length)
            away = abs((x - ends[e, 0]) * dy - (y - ends[e, 1]) * dx) / length
            if 0 < t < 1 and away <= 2 * snap:
                drawn.append(s)
                edge.append(e)
                share.append(t)
    pairs = np.empty((len(drawn), 2), dtype=np.int64)
    for k in range(len(drawn)):
        pairs[k, 0], pairs[k, 1] = drawn[k], edge[k]
    return pairs, np.array(share, dtype=np.float64)


@njit(cache=True)
def _passing(
    look: Floats, ending: Ints, outlines: tuple[Floats, Ints, Floats], edge_on: Flags
) -> Ints:  # pragma: no cover - compiled
    """Pairs of a drawn edge and a fragment that covers both sides of it."""
    sides, starts, box = outlines
    last = np.full(len(starts) - 1, -1, dtype=np.int64)
    order = np.argsort(ending[:, 0], kind="mergesort")
    at = 0
    drawn, fragment = [0 for _ in range(0)], [0 for _ in range(0)]
    for s in range(len(look)):
        while at < len(order) and ending[order[at], 0] == s:
            last[ending[order[at], 1]] = s
            at += 1
        x, y = look[s]
        for f in range(len(starts) - 1):
            if edge_on[f] or last[f] == s:
                continue
            inside = box[f, 0] < x < box[f, 2] and box[f, 1] < y < box[f, 3]
            if inside and point_in_loops(x, y, sides[starts[f] : starts[f + 1]]):
                drawn.append(s)
                fragment.append(f)
    pairs = np.empty((len(drawn), 2), dtype=np.int64)
    for k in range(len(drawn)):
        pairs[k, 0], pairs[k, 1] = drawn[k], fragment[k]
    return pairs

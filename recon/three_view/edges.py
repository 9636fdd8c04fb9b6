"""Candidate edges: pairs of candidate vertices whose joining line is drawn in every view (paper, 4.3; [wesley1981]).

A view may show an edge as a point. Edges are elementary: no candidate vertex lies inside one; and where two cross, the
crossing becomes a vertex of its own, though one view may not show it as a point.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from recon.three_view.tables import linked
from recon.three_view.vertices import CandidateVertices
from recon.three_view.view_graph import ViewGraph

__all__ = ["RunTable", "Wireframe", "candidate_edges", "elementary", "merge_points", "split_edges"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Wireframe:
    """Vertices in space and the straight edges between them.

    vertices  (n, 3)
    edges     (m, 2) vertex numbers, the smaller first; no two join the same vertices
    runs      (m, 3) run of each view that draws the edge; -1 where the view shows a point, or nothing
    """

    vertices: Floats
    edges: Ints
    runs: Ints

    @classmethod
    def undrawn(cls, vertices: Floats, edges: Ints) -> "Wireframe":
        """Edges that no view draws."""
        return cls(vertices, edges, np.full((len(edges), 3), -1))


def candidate_edges(found: CandidateVertices, graphs: Sequence[ViewGraph], snap: float) -> Wireframe:
    """Every elementary edge between candidate vertices that all three views draw."""
    tables = [RunTable.of(graph) for graph in graphs]
    upright = [_axis_edges(found, graphs, tables, axis) for axis in range(3)]
    slanted = _slanted_edges(found, graphs, tables, snap)
    edges = np.sort(np.concatenate([*upright, slanted]), axis=1)
    runs = [table.run(*found.points[edges, k].T) for k, table in enumerate(tables)]
    return _crossings_split(Wireframe(found.positions, edges, np.column_stack(runs)), snap)


@dataclass(frozen=True, eq=False)
class RunTable:
    """Which runs of a view pass through a point.

    level        (n, 2) run along the view's first and second axis through each point, -1 where there is none
    slanted      sorted keys a * n + b of all pairs of points that one slanted run joins, both ways
    slanted_run  the run that joins each pair
    members      points of each slanted run
    """

    level: Ints
    slanted: Ints
    slanted_run: Ints
    members: list[Ints]

    @classmethod
    def of(cls, graph: ViewGraph) -> "RunTable":
        n = len(graph.points)
        level = np.full((n, 2), -1, dtype=np.int64)
        same = graph.points[graph.edges[:, 0]] == graph.points[graph.edges[:, 1]]
        # a run is as slanted as any of its edges: short ones may stand level where coordinates have become one
        slanted = np.bincount(graph.runs, ~same.any(axis=1))[graph.runs] > 0
        for axis in (0, 1):
            rows = same[:, 1 - axis] & ~slanted
            level[graph.edges[rows].ravel(), axis] = np.repeat(graph.runs[rows], 2)
        rows = slanted
        members = np.unique(np.column_stack([np.repeat(graph.runs[rows], 2), graph.edges[rows].ravel()]), axis=0)
        groups = np.split(members, np.flatnonzero(np.diff(members[:, 0])) + 1) if len(members) else []
        pairs = [(group[:, 1, None] * n + group[:, 1]).ravel() for group in groups]
        runs = [np.full(len(group) ** 2, group[0, 0]) for group in groups]
        keys, run = (np.concatenate([np.empty(0, dtype=np.int64), *rows]) for rows in (pairs, runs))
        order = np.argsort(keys, kind="stable")
        return cls(level, keys[order], run[order], [group[:, 1] for group in groups])

    def run(self, a: Ints, b: Ints) -> Ints:
        """(k,) run that passes through both points; -1 where none does, or they are one."""
        found = np.full(len(a), -1, dtype=np.int64)
        if len(self.slanted):
            keys = a * len(self.level) + b
            slot = np.minimum(np.searchsorted(self.slanted, keys), len(self.slanted) - 1)
            found = np.where(self.slanted[slot] == keys, self.slanted_run[slot], -1)
        for level in self.level.T:
            found = np.where((level[a] == level[b]) & (level[a] >= 0), level[a], found)
        return np.where(a == b, -1, found)

    def joined(self, a: Ints, b: Ints) -> NDArray[np.bool_]:
        """Whether a run passes through both points, or they are one."""
        return np.asarray((a == b) | (self.run(a, b) >= 0))


def _axis_edges(found: CandidateVertices, graphs: Sequence[ViewGraph], tables: list[RunTable], axis: int) -> Ints:
    """Neighbours along a line parallel to a coordinate axis, where both views that show its length draw it."""
    others = [k for k in range(3) if k != axis]
    c = found.coordinates
    order = np.lexsort([found.positions[:, axis], c[:, others[1]], c[:, others[0]]])
    a, b = order[:-1], order[1:]
    keep = (c[a][:, others] == c[b][:, others]).all(axis=1)
    for k, graph in enumerate(graphs):
        if axis in graph.projection.axes:
            level = tables[k].level[:, graph.projection.axes.index(axis)]
            run = level[found.points[a, k]]
            keep &= (run >= 0) & (run == level[found.points[b, k]])
    return np.column_stack([a[keep], b[keep]])


def _slanted_edges(found: CandidateVertices, graphs: Sequence[ViewGraph], tables: list[RunTable], snap: float) -> Ints:
    """Edges along a slanted run of at least one view; every edge that is not parallel to an axis is one."""
    pairs = [np.empty((0, 2), dtype=np.int64)]
    for k in range(3):
        order = np.argsort(found.points[:, k], kind="stable")
        shown = found.points[order, k]
        for members in tables[k].members:
            slots = [np.arange(*np.searchsorted(shown, [p, p + 1])) for p in members]
            above = order[np.concatenate(slots)]
            i, j = np.triu_indices(len(above), 1)
            a, b = above[i], above[j]
            keep = found.points[a, k] != found.points[b, k]
            for other in range(3):
                a, b = a[keep], b[keep]
                keep = tables[other].joined(found.points[a, other], found.points[b, other])
            pairs.append(np.column_stack([a[keep], b[keep]]))
    unique = np.unique(np.sort(np.concatenate(pairs), axis=1), axis=0)
    return unique[elementary(found.positions, unique, snap)] if len(unique) else unique


def elementary(positions: Floats, pairs: Ints, snap: float) -> NDArray[np.bool_]:
    """Pairs with no third vertex between them that a pair joins to the first."""
    both = np.concatenate([pairs, pairs[:, ::-1]])
    way = positions[both[:, 1]] - positions[both[:, 0]]
    order = np.lexsort([np.linalg.norm(way, axis=1), both[:, 0]])
    starts = np.searchsorted(both[order, 0], np.arange(len(positions) + 1))
    keep = np.zeros(len(both), dtype=bool)
    keep[order] = _nearest_ways(way[order], starts, snap)
    return keep[: len(pairs)] & keep[len(pairs) :]


@njit(cache=True)
def _nearest_ways(way: Floats, starts: Ints, snap: float) -> NDArray[np.bool_]:  # pragma: no cover - compiled
    keep = np.ones(len(way), dtype=np.bool_)
    for v in range(len(starts) - 1):
        for j in range(starts[v], starts[v + 1]):
            size = np.sqrt(way[j] @ way[j])
            for i in range(starts[v], j):
                if keep[i]:
                    along = (way[i] @ way[j]) / size
                    away = way[i] - way[j] * (along / size)
                    if 0 < along < size and away @ away <= snap * snap:
                        keep[j] = False
                        break
    return keep


def _crossings_split(wire: Wireframe, snap: float) -> Wireframe:
    """The wireframe with a vertex wherever two edges cross; two that are parallel to axes do so at vertices only."""
    way = wire.vertices[wire.edges[:, 1]] - wire.vertices[wire.edges[:, 0]]
    slanted = np.flatnonzero((way != 0).sum(axis=1) > 1)
    if not len(slanted):
        return wire
    first, second, at = _crossing_pairs(wire.vertices, wire.edges, slanted, snap)
    vertices, number = merge_points(wire.vertices, at, snap)
    return split_edges(replace(wire, vertices=vertices), np.concatenate([first, second]), np.tile(number, 2))


@njit(cache=True)
def _crossing_pairs(
    vertices: Floats, edges: Ints, slanted: Ints, snap: float
) -> tuple[Ints, Ints, Floats]:  # pragma: no cover - compiled
    first, second, places = [0 for _ in range(0)], [0 for _ in range(0)], [np.zeros(3) for _ in range(0)]
    is_slanted = np.zeros(len(edges), dtype=np.bool_)
    is_slanted[slanted] = True
    for i in slanted:
        a, b = vertices[edges[i, 0]], vertices[edges[i, 1]]
        low, high = np.minimum(a, b) - snap, np.maximum(a, b) + snap
        d = b - a
        for j in range(len(edges)):
            if (is_slanted[j] and j <= i) or edges[j, 0] in edges[i] or edges[j, 1] in edges[i]:
                continue
            p, q = vertices[edges[j, 0]], vertices[edges[j, 1]]
            apart = False
            for k in range(3):
                if min(p[k], q[k]) > high[k] or max(p[k], q[k]) < low[k]:
                    apart = True
            if apart:
                continue
            e, w = q - p, p - a
            dd, ee, de = d @ d, e @ e, d @ e
            turn = dd * ee - de * de
            if turn <= 1e-8 * dd * ee:
                continue
            s = ((w @ d) * ee - (w @ e) * de) / turn
            t = ((w @ d) * de - (w @ e) * dd) / turn
            if not (0 < s < 1 and 0 < t < 1):
                continue
            x, y = a + s * d, p + t * e
            if (x - y) @ (x - y) > snap * snap:
                continue
            first.append(i)
            second.append(j)
            places.append(np.where(d == 0, a, np.where(e == 0, p, (x + y) / 2)))
    at = np.empty((len(places), 3))
    for k in range(len(places)):
        at[k] = places[k]
    return np.array(first, dtype=np.int64), np.array(second, dtype=np.int64), at


def merge_points(vertices: Floats, places: Floats, snap: float) -> tuple[Floats, Ints]:
    """Vertices with further places appended, those within `snap` of a vertex or of each other once; their numbers."""
    if not len(places):
        return vertices, np.empty(0, dtype=np.int64)
    distance, number = cKDTree(vertices).query(places, distance_upper_bound=snap)
    fresh = np.flatnonzero(~np.isfinite(distance))
    if len(fresh):
        pairs = cKDTree(places[fresh]).query_pairs(snap, output_type="ndarray").astype(np.int64)
        _, first, group = np.unique(linked(pairs, len(fresh)), return_index=True, return_inverse=True)
        number[fresh] = len(vertices) + group.ravel()
        vertices = np.concatenate([vertices, places[fresh[first]]])
    return vertices, np.asarray(number, dtype=np.int64)


def split_edges(wire: Wireframe, edge: Ints, vertex: Ints) -> Wireframe:
    """The wireframe with edges cut at vertices that lie inside them; pairs (edge, vertex)."""
    rows = np.arange(len(wire.edges))
    on = np.column_stack([np.concatenate([rows, rows, edge]), np.concatenate([*wire.edges.T, vertex])])
    on = np.unique(on, axis=0)
    start = wire.vertices[wire.edges[on[:, 0], 0]]
    way = wire.vertices[wire.edges[on[:, 0], 1]] - start
    on = on[np.lexsort([((wire.vertices[on[:, 1]] - start) * way).sum(axis=1), on[:, 0]])]
    same = on[1:, 0] == on[:-1, 0]
    pieces, first = np.unique(
        np.sort(np.column_stack([on[:-1, 1], on[1:, 1]])[same], axis=1), axis=0, return_index=True
    )
    return Wireframe(wire.vertices, pieces, wire.runs[on[:-1, 0][same][first]])

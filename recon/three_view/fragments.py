"""Fragments: the minimal regions of the candidate planes, cut where they cross (paper, 4.3; units of 5.2.3).

A face of a solid is a union of fragments of one plane, bounded by candidate edges. Two fragments may cross where no
edge is drawn; they are cut there, since space on the two sides of the cut can differ:

        |  Q                      the cut is an edge of the arrangement, but never one of a solid:
    ----+----  P         --->     of P's two halves and Q's two halves, at most one pair is present
        |
"""

from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.numerics.planar_regions import minimal_regions, point_in_loops
from recon.three_view.edges import Wireframe, merge_points, split_edges
from recon.three_view.planes import Planes, edges_in_planes, plane_positions, sides_of

__all__ = ["Fragments", "fragments"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Fragments:
    """An arrangement of planar fragments.

    wire       vertices and edges; of an edge, both half-edges appear in every plane that holds it
    planes     the candidate planes
    is_cut     (m,) edges that are cuts: nothing is drawn there
    use_edge   (k,) edge, and
    use_plane  (k,) plane of each use of an edge by a plane
    region     (k, 2) fragment on the left and on the right of a use, seen from the tip of the plane's normal and
               looking along the edge; -1 where the plane is open
    following  (2k,) of half-edge 2 j + side, on that side of use j, the next one along the fragment's border
    plane      (f,) plane of each fragment
    """

    wire: Wireframe
    planes: Planes
    is_cut: Flags
    use_edge: Ints
    use_plane: Ints
    region: Ints
    following: Ints
    plane: Ints


def fragments(wire: Wireframe, planes: Planes, snap: float) -> Fragments:
    """The fragments of all planes, without edges that could bound no solid, cut along their crossings."""
    whole = _pruned(wire, planes)
    wire, planes = _pierced(whole, whole.wire, snap)
    uses = _in_planes(wire, planes, np.zeros(len(wire.edges), dtype=bool))
    cuts = _cuts(uses)
    if not len(cuts):
        return uses
    cut_wire, planes = _pierced(uses, Wireframe.undrawn(wire.vertices, cuts), snap)
    edges, runs = (np.concatenate(both) for both in ((wire.edges, cut_wire.edges), (wire.runs, cut_wire.runs)))
    is_cut = np.arange(len(edges)) >= len(wire.edges)
    return _in_planes(Wireframe(cut_wire.vertices, edges, runs), planes, is_cut)


def _in_planes(wire: Wireframe, planes: Planes, is_cut: Flags) -> Fragments:
    """The minimal regions of every plane."""
    edge, plane = edges_in_planes(wire.edges, planes.sides)
    across = planes.across()
    upward = planes.normals[np.arange(len(across)), across] > 0
    ends = wire.edges[edge]
    of_end = np.repeat(plane, 2)
    positions = plane_positions(wire.vertices[ends.ravel()], across[of_end], upward[of_end])
    found = minimal_regions(ends, positions, plane)
    region = found.region.reshape(-1, 2)
    owner = np.zeros(len(found.area), dtype=np.int64)
    held = region >= 0
    owner[region[held]] = np.repeat(plane, 2)[held.ravel()]
    return Fragments(wire, planes, is_cut, edge, plane, region, found.following, owner)


def _pruned(wire: Wireframe, planes: Planes) -> Fragments:
    """Drop edges with fragments in fewer than two planes until none is left: a solid turns a corner at each edge."""
    while True:
        found = _in_planes(wire, planes, np.zeros(len(wire.edges), dtype=bool))
        bounding = (found.region >= 0).any(axis=1)
        keep = np.bincount(found.use_edge[bounding], minlength=len(wire.edges)) > 1
        if keep.all():
            return found
        wire = Wireframe(wire.vertices, wire.edges[keep], wire.runs[keep])


@dataclass(frozen=True, eq=False)
class _Outlines:
    """Loops of all fragments in their planes' own maps, for the compiled loops.

    sides   (h, 4) sides of the loops, by fragment; starts (f + 1,)
    box     (f, 4) least and greatest coordinates
    order   fragments by plane; plane_starts (p + 1,)
    frame   (p, 2) the coordinates that a plane's map shows
    """

    sides: Floats
    starts: Ints
    box: Floats
    order: Ints
    plane_starts: Ints
    frame: Ints

    @classmethod
    def of(cls, made: Fragments) -> "_Outlines":
        across = made.planes.across()
        every = np.ones(len(across), dtype=bool)
        frame = plane_positions(np.tile(np.arange(3.0), (len(across), 1)), across, every).astype(np.int64)
        half = made.region.ravel()
        rows = np.flatnonzero(half >= 0)
        rows = rows[np.argsort(half[rows], kind="stable")]
        ends = made.wire.vertices[made.wire.edges[made.use_edge[rows // 2]]]
        shown = np.take_along_axis(ends, frame[made.use_plane[rows // 2]][:, None, :], axis=2)
        sides = shown.reshape(-1, 4)
        starts = np.searchsorted(half[rows], np.arange(len(made.plane) + 1))
        box = np.empty((len(made.plane), 4))
        if len(made.plane):
            box[:, :2] = np.minimum.reduceat(shown.min(axis=1), starts[:-1])
            box[:, 2:] = np.maximum.reduceat(shown.max(axis=1), starts[:-1])
        order = np.argsort(made.plane, kind="stable")
        plane_starts = np.searchsorted(made.plane[order], np.arange(len(across) + 1))
        return cls(sides, starts, box, order, plane_starts, frame)

    def as_tuple(self) -> tuple[Floats, Ints, Floats, Ints, Ints, Ints]:
        return self.sides, self.starts, self.box, self.order, self.plane_starts, self.frame


def _pierced(made: Fragments, wire: Wireframe, snap: float) -> tuple[Wireframe, Planes]:
    """The edges of a wireframe cut where they pass through the inside of a fragment; new vertices know their planes."""
    planes = made.planes
    edge, plane, at = _pierce(
        wire.vertices, wire.edges, (planes.normals, planes.offsets, planes.sides), _Outlines.of(made).as_tuple()
    )
    vertices, number = merge_points(wire.vertices, at, snap)
    fresh = vertices[len(wire.vertices) :]
    sides = np.concatenate([planes.sides, sides_of(fresh, planes.normals, planes.offsets, snap)])
    sides[number, plane] = 0
    of_edge, held = edges_in_planes(wire.edges, planes.sides)
    starts = np.searchsorted(of_edge, np.arange(len(wire.edges) + 1))
    for e, v in zip(edge.tolist(), number.tolist()):
        sides[v, held[starts[e] : starts[e + 1]]] = 0
    return split_edges(replace(wire, vertices=vertices), edge, number), replace(planes, sides=sides)


def _cuts(made: Fragments) -> Ints:
    """Pairs of vertices between which two fragments cross and no edge runs."""
    vertex, plane = np.nonzero(made.planes.sides == 0)
    starts = np.searchsorted(vertex, np.arange(len(made.planes.sides) + 1))
    a, b = _crossing_lines(
        made.wire.vertices, (plane, starts), (made.planes.normals, made.plane), _Outlines.of(made).as_tuple()
    )
    cuts = np.unique(np.sort(np.column_stack([a, b]), axis=1), axis=0)
    n = len(made.wire.vertices)
    return cuts[~np.isin(cuts @ np.array([n, 1]), made.wire.edges @ np.array([n, 1]))]


def _crossing_lines(
    vertices: Floats,
    incidence: tuple[Ints, Ints],
    planes: tuple[Floats, Ints],
    outlines: tuple[Floats, Ints, Floats, Ints, Ints, Ints],
) -> tuple[Ints, Ints]:
    """Neighbouring vertices on the common line of two planes, where the line between them runs inside both."""
    plane, starts = incidence
    normals, used = planes
    has = np.zeros(len(normals), dtype=bool)
    has[used] = True
    rows = []
    count = np.diff(starts)
    for size in np.unique(count[count > 1]):
        at = np.flatnonzero(count == size)
        i, j = np.triu_indices(size, 1)
        near = plane[starts[at][:, None] + np.arange(size)]
        rows.append(np.column_stack([near[:, i].ravel(), near[:, j].ravel(), np.repeat(at, len(i))]))
    table = np.concatenate(rows) if rows else np.empty((0, 3), dtype=np.int64)
    table = table[has[table[:, 0]] & has[table[:, 1]]]
    way = np.cross(normals[table[:, 0]], normals[table[:, 1]])
    turned = np.linalg.norm(way, axis=1) > 1e-6
    table, way = table[turned], way[turned]
    along = (vertices[table[:, 2]] * way).sum(axis=1)
    order = np.lexsort([along, table[:, 1], table[:, 0]])
    table = table[order]
    same = (table[1:, :2] == table[:-1, :2]).all(axis=1)
    p, q, a, b = table[:-1, 0][same], table[:-1, 1][same], table[:-1, 2][same], table[1:, 2][same]
    middle = (vertices[a] + vertices[b]) / 2
    inside = _inside_any(middle, p, outlines) & _inside_any(middle, q, outlines)
    return a[inside], b[inside]


@njit(cache=True)
def _covered(x: Floats, q: int, outlines: tuple[Floats, Ints, Floats, Ints, Ints, Ints]) -> bool:  # pragma: no cover
    sides, starts, box, order, plane_starts, frame = outlines
    u, v = x[frame[q, 0]], x[frame[q, 1]]
    for k in range(plane_starts[q], plane_starts[q + 1]):
        f = order[k]
        inside = box[f, 0] < u < box[f, 2] and box[f, 1] < v < box[f, 3]
        if inside and point_in_loops(u, v, sides[starts[f] : starts[f + 1]]):
            return True
    return False


@njit(cache=True)
def _inside_any(
    points: Floats, planes: Ints, outlines: tuple[Floats, Ints, Floats, Ints, Ints, Ints]
) -> Flags:  # pragma: no cover - compiled
    inside = np.zeros(len(points), dtype=np.bool_)
    for k in range(len(points)):
        inside[k] = _covered(points[k], planes[k], outlines)
    return inside


@njit(cache=True)
def _pierce(
    vertices: Floats,
    edges: Ints,
    planes: tuple[Floats, Floats, NDArray[np.int8]],
    outlines: tuple[Floats, Ints, Floats, Ints, Ints, Ints],
) -> tuple[Ints, Ints, Floats]:  # pragma: no cover - compiled
    """Triples of an edge, a plane that it passes through, and the place, where a fragment of the plane is there."""
    normals, offsets, side = planes
    edge, plane, places = [0 for _ in range(0)], [0 for _ in range(0)], [np.zeros(3) for _ in range(0)]
    for e in range(len(edges)):
        a, b = vertices[edges[e, 0]], vertices[edges[e, 1]]
        for q in range(len(normals)):
            if side[edges[e, 0], q] * side[edges[e, 1], q] >= 0:
                continue
            high = normals[q, 0] * a[0] + normals[q, 1] * a[1] + normals[q, 2] * a[2] - offsets[q]
            low = normals[q, 0] * b[0] + normals[q, 1] * b[1] + normals[q, 2] * b[2] - offsets[q]
            x = a + (b - a) * (high / (high - low))
            if _covered(x, q, outlines):
                edge.append(e)
                plane.append(q)
                places.append(x)
    at = np.empty((len(places), 3))
    for k in range(len(places)):
        at[k] = places[k]
    return np.array(edge, dtype=np.int64), np.array(plane, dtype=np.int64), at

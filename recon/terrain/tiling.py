"""Step 2, tiling: a constrained Delaunay triangulation of the whole map between its contours and its border.

    terminal T   two contour edges        sleeve S   one contour edge        junction J   none

A triangle whose corners all have one height would be a plateau that nobody measured: flat edges get a free vertex at
their middle, the longest first, whose height and gradient are found with the slopes.

Paper  [zhang2006], section 3 (2); free vertices are not in the paper.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pythoncdt
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from recon.errors import BadGeometry
from recon.geometry.contour_map import ContourMap
from recon.numerics.bernstein import bernstein
from recon.terrain.contour_curves import ContourCurves

__all__ = ["ALONG", "CurvesMeet", "Frame", "NO_SEGMENT", "Tiling", "middles", "tile", "with_free_vertices"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

NO_SEGMENT = -1
SPLITS = 4  # times that segments whose chords cross are halved
FREE_ROUNDS, FLAT_ROUNDS = 1, 12
ALONG = 1e-6  # metres that a segment along the border may leave it
ON_BORDER = 1e-8  # metres from a side of the border within which a vertex lies on it


@dataclass(frozen=True, eq=False)
class Frame:
    """What a map has beside the curves of its contours: border, voids, spot heights.

    border_step  metres between free vertices on the border, at most
    border       (n, 2) free vertices on the border that are given, beside those that are put there
    base         height at which no edge but those of contours may join two vertices, since a base lies there: its
                 triangles might have the same edge
    """

    contours: ContourMap
    border_step: float
    border: Floats
    base: float | None = None


@dataclass(frozen=True, eq=False)
class Tiling:
    """Triangles between contours; the first vertices are those of `curves`, the others are free or spot heights.

    points        (V, 2)
    triangles     (F, 3) counter-clockwise; side k of a triangle runs from its vertex k to vertex k + 1
    edges         (E, 2) vertices of every edge, those of a contour edge along its segment
    side_edges    (F, 3) edge on every side
    edge_faces    (E, 2) triangles to the left and right of the edge, -1 where there is none
    edge_segment  (E,) segment of the contour that the edge is, or NO_SEGMENT
    spots         (s, 3) places that are vertices, the last ones, and whose height is known
    """

    curves: ContourCurves
    points: Floats
    triangles: Ints
    edges: Ints
    side_edges: Ints
    edge_faces: Ints
    edge_segment: Ints
    spots: Floats

    @property
    def is_contour(self) -> NDArray[np.bool_]:
        """(E,) whether an edge belongs to a contour."""
        return self.edge_segment != NO_SEGMENT

    def vertex_heights(self) -> Floats:
        """(V,) heights of the contours' vertices and of spot heights, NaN at free vertices."""
        known = self.curves.heights[self.curves.vertex_contours()]
        n_free = len(self.points) - len(known) - len(self.spots)
        return np.r_[known, np.full(n_free, np.nan), self.spots[:, 2]]

    def contour_sides(self) -> Ints:
        """(F,) contour edges of every triangle: 2 a terminal, 1 a sleeve, 0 a junction."""
        return self.is_contour[self.side_edges].sum(axis=1)

    def flat_edges(self) -> NDArray[np.bool_]:
        """(E,) whether an edge joins two vertices of one known height without being a contour edge."""
        z = self.vertex_heights()[self.edges]
        return (z[:, 0] == z[:, 1]) & ~self.is_contour

    def level_edges(self, height: float | None) -> NDArray[np.bool_]:
        """(E,) flat edges at a height; none where that is None."""
        if height is None:
            return np.zeros(len(self.edges), dtype=bool)
        return self.flat_edges() & (self.vertex_heights()[self.edges[:, 0]] == height)

    def flat_triangles(self) -> NDArray[np.bool_]:
        """(F,) whether all three corners have one known height."""
        z = self.vertex_heights()[self.triangles]
        return (z[:, 0] == z[:, 1]) & (z[:, 1] == z[:, 2])


class CurvesMeet(BadGeometry):
    """Curves of contours that cross or touch; `places` (n, 2) says where, in local coordinates."""

    def __init__(self, places: Floats, height: float, origin: Floats | None = None) -> None:
        self.places, self.height = places, height
        x, y = places[0] if origin is None else places[0] + origin
        super().__init__(
            "contours",
            f"the contour of height {height:g} crosses or touches another, or itself, near ({x:.1f}, {y:.1f})",
        )


def tile(curves: ContourCurves, frame: Frame, free: Floats) -> Tiling:
    """Triangles of the map rectangle but its voids, with every contour segment an edge.

    free      (n, 2) free vertices besides those on the border and the spot heights
    Promises  segments whose chords cross are halved until they do not.
    Raises    CurvesMeet with the places at which that does not help.
    """
    free = np.vstack([free, frame.contours.spots[:, :2]])
    border = _border_points(np.vstack([curves.vertices(), free]), frame)
    tiling, lost = _triangulated(curves, np.vstack([border, free]), frame)
    for _ in range(SPLITS):
        if tiling is not None and not lost.any():
            return tiling
        _refuse_meetings(curves, np.flatnonzero(lost))
        curves = curves.split(lost)
        tiling, lost = _triangulated(curves, np.vstack([border, free]), frame)
    if tiling is not None and not lost.any():
        return tiling
    raise CurvesMeet(curves.bezier[lost].mean(axis=1), float(curves.heights[curves.contour[lost][0]]))


def _refuse_meetings(curves: ContourCurves, lost: Ints) -> None:
    """Raise CurvesMeet where some of the segments cross in truth, so that no halving of chords would part them."""
    t = np.linspace(0.0, 1.0, 2**SPLITS + 1)
    lines = bernstein(3, t) @ curves.bezier[lost]
    legs = np.stack([lines[:, :-1], lines[:, 1:]], axis=2).reshape(-1, 2, 2)
    pieces = shapely.linestrings(legs)
    first, second = shapely.STRtree(pieces).query(pieces, predicate="crosses")
    met = np.unique(np.r_[first, second] // 2**SPLITS)
    if len(met):
        raise CurvesMeet(curves.bezier[lost[met]].mean(axis=1), float(curves.heights[curves.contour[lost[met[0]]]]))


def _border_points(taken: Floats, frame: Frame) -> Floats:
    """Free vertices on the border: given ones, its corners, and points between all those and the places taken."""
    sides = frame.contours.sides()
    given = _untaken(frame.border, taken)  # a finer tiling has them among its free vertices
    taken = np.vstack([taken, given])
    corners = _untaken(np.unique(sides[:, 0], axis=0), taken)
    known, added = np.vstack([taken, corners]), [given, corners]
    for side, (_, share) in zip(sides, _along(known, sides)):
        along = np.unique(np.r_[0.0, share, 1.0])
        gap = np.diff(along) * np.linalg.norm(side[1] - side[0])
        parts = np.maximum(np.ceil(gap / frame.border_step).astype(int), 1)
        leg = np.repeat(np.arange(len(gap)), parts)
        step = (np.arange(len(leg)) - np.repeat(np.cumsum(parts) - parts, parts)) / parts[leg]
        new = step > 0
        at = (along[leg] + step * np.diff(along)[leg])[new, None]
        added.append(side[0] + at * (side[1] - side[0]))
    return _each_once(np.vstack(added))


def _untaken(points: Floats, taken: Floats) -> Floats:
    return points[cKDTree(taken).query(points)[0] > 0.0] if len(points) else points


def _along(points: Floats, sides: Floats) -> list[tuple[Ints, Floats]]:
    """For every side (n, 2, 2) of the border the points on it, in order along it, and the shares at which they lie."""
    low, high = sides.min(axis=1) - ON_BORDER, sides.max(axis=1) + ON_BORDER
    boxes = shapely.STRtree(shapely.box(low[:, 0], low[:, 1], high[:, 0], high[:, 1]))
    near = np.flatnonzero(_in_line_with(points, sides))
    point, side = boxes.query(shapely.points(points[near]))
    point = near[point]
    off, way = points[point] - sides[side, 0], sides[side, 1] - sides[side, 0]
    length = np.linalg.norm(way, axis=1)
    near = np.abs(off[:, 0] * way[:, 1] - off[:, 1] * way[:, 0]) <= ON_BORDER * length
    share = np.clip(np.einsum("ij,ij->i", off, way) / length**2, 0.0, 1.0)
    order = np.lexsort((share, side))
    order = order[near[order]]
    ends = np.searchsorted(side[order], np.arange(len(sides) + 1))
    return [(point[order[a:b]], share[order[a:b]]) for a, b in pairwise(ends.tolist())]


def _in_line_with(points: Floats, sides: Floats) -> NDArray[np.bool_]:
    """(n,) points that may lie on a side: level with one along an axis, or anywhere where one runs aslant."""
    level = sides[:, 0] == sides[:, 1]
    if not level.any(axis=1).all():
        return np.ones(len(points), dtype=bool)
    found = np.zeros(len(points), dtype=bool)
    for axis in (0, 1):
        lines = np.r_[-np.inf, np.unique(sides[level[:, axis], 0, axis]), np.inf]
        place = np.searchsorted(lines, points[:, axis])
        found |= np.minimum(points[:, axis] - lines[place - 1], lines[place] - points[:, axis]) <= ON_BORDER
    return found


def _each_once(points: Floats) -> Floats:
    """Points without those that lie on one before them: a void's side may lie on the map's."""
    again = cKDTree(points).query_pairs(ON_BORDER, output_type="ndarray")
    return np.delete(points, np.unique(again.max(axis=1, initial=0)), axis=0) if len(again) else points


def _triangulated(curves: ContourCurves, free: Floats, frame: Frame) -> tuple[Tiling | None, NDArray[np.bool_]]:
    """The triangulation, or None where curves cross; and which segments it lacks, since their chords meet another."""
    points = np.vstack([curves.vertices(), free])
    chords = np.column_stack([curves.start, curves.end])
    rim = _rim(points, frame)
    work = pythoncdt.Triangulation(
        pythoncdt.VertexInsertionOrder.AUTO, pythoncdt.IntersectingConstraintEdges.TRY_RESOLVE, 0.0
    )
    work.insert_vertices(points)
    work.insert_edges(np.vstack([rim, chords]).astype(np.uint32))
    work.erase_super_triangle()
    triangles = work.triangles_array()["vertices"].astype(np.int64)
    rim_chord = np.isin(_key(chords, len(points)), _key(rim, len(points)))
    bulging = rim_chord & (_sagitta(curves.bezier) > ALONG)  # its chord would cut ground off the map
    if triangles.size == 0 or triangles.max() >= len(points):
        held = triangles[(triangles < len(points)).all(axis=1)]
        return None, ~np.isin(_key(chords, len(points)), _key(_sides(held), len(points)))
    triangles = _without_slivers(triangles, points, frame)
    triangles = triangles[frame.contours.holds(points[triangles].mean(axis=1))]
    points, triangles = _used(points, triangles, curves.n_vertices)
    tiling = _tiling(curves, points, triangles, frame.contours.spots)
    lost = np.ones(len(chords), dtype=bool)
    lost[tiling.edge_segment[tiling.is_contour]] = False
    return tiling, (lost & ~rim_chord) | bulging


def _rim(points: Floats, frame: Frame) -> Ints:
    """(n, 2) edges along the border, through all vertices on it."""
    rows = _along(points, frame.contours.sides())
    return np.vstack([np.column_stack([on[:-1], on[1:]]) for on, _ in rows])


def _sagitta(bezier: Floats) -> Floats:
    """(n,) farthest that an inner control point lies from its curve's chord."""
    way = bezier[:, 3] - bezier[:, 0]
    off = bezier[:, 1:3] - bezier[:, :1]
    across = np.abs(off[..., 0] * way[:, None, 1] - off[..., 1] * way[:, None, 0]).max(axis=1)
    return np.asarray(across / np.maximum(np.linalg.norm(way, axis=1), 1e-300))


def _key(pairs: Ints, n: int) -> Ints:
    return pairs.min(axis=1) * n + pairs.max(axis=1)


def _sides(triangles: Ints) -> Ints:
    return np.vstack([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])


def _without_slivers(triangles: Ints, points: Floats, frame: Frame) -> Ints:
    """Triangles with an area: three vertices on one side of the border have none.

    Rounding may give them one where the side lies aslant; with the triangle beyond, if any, they are cut anew from the
    middle one of the three.
    """
    a, b, c = (points[triangles[:, k]] for k in range(3))
    triangles = triangles[_doubled_areas(a, b, c) > 0]
    sides = frame.contours.sides()
    for on, _ in _along(points, sides[(sides[:, 0] != sides[:, 1]).all(axis=1)]):
        triangles = _flipped(triangles, points, on)
    return triangles


def _doubled_areas(a: Floats, b: Floats, c: Floats) -> Floats:
    return np.asarray((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])


def _flipped(triangles: Ints, points: Floats, on: Ints) -> Ints:
    """Triangles without those between three of the points `on` a side, which come in order along it."""
    rank = np.full(len(points), -1)
    rank[on] = np.arange(len(on))
    while (flat := np.flatnonzero((rank[triangles] >= 0).all(axis=1))).size:
        # the widest: none of its kind lies beyond it
        spans = np.ptp(rank[triangles[flat]], axis=1)
        widest = int(flat[np.argmax(spans)])
        first, middle, last = triangles[widest][np.argsort(rank[triangles[widest]])]
        beyond = np.flatnonzero(np.isin(triangles, (first, last)).sum(axis=1) == 2)
        beyond = beyond[beyond != widest]
        kept = np.delete(triangles, [widest, *beyond.tolist()], axis=0)
        made = []
        for row in triangles[beyond]:
            apex = int(row[~np.isin(row, (first, last))][0])
            for p, q in ((first, middle), (middle, last)):
                corner = [p, q, apex]
                area = _doubled_areas(*(points[[k]] for k in corner))[0]
                made.append(corner if area > 0 else [q, p, apex])
        triangles = np.vstack([kept, np.array(made, dtype=np.int64).reshape(-1, 3)])
    return triangles


def _used(points: Floats, triangles: Ints, n_first: int) -> tuple[Floats, Ints]:
    """The first points and those of triangles, renumbered: a void on the map's border leaves points alone there."""
    used = np.zeros(len(points), dtype=bool)
    used[:n_first] = True
    used[triangles] = True
    return points[used], (np.cumsum(used) - 1)[triangles]


def _tiling(curves: ContourCurves, points: Floats, triangles: Ints, spots: Floats) -> Tiling:
    n, n_faces = len(points), len(triangles)
    sides = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    key, first, slot = np.unique(_key(sides, n), return_index=True, return_inverse=True)
    edges = sides[first].copy()
    chords = np.column_stack([curves.start, curves.end])
    chord_key = _key(chords, n)
    place = np.minimum(np.searchsorted(key, chord_key), len(key) - 1)
    found = key[place] == chord_key
    segment = np.full(len(edges), NO_SEGMENT)
    segment[place[found]] = np.flatnonzero(found)
    edges[place[found]] = chords[found]
    faces = np.full((len(edges), 2), -1)
    right = (sides[:, 0] != edges[slot, 0]).astype(np.int64)
    faces[slot, right] = np.arange(3 * n_faces) // 3
    return Tiling(curves, points, triangles, edges, slot.reshape(-1, 3), faces, segment, spots)


def with_free_vertices(curves: ContourCurves, frame: Frame) -> tuple[Tiling, Floats]:
    """The tiling with free vertices wherever it would be flat, and those of them that lie off the border's own (n, 2).

    Promises  no triangle has three contour vertices of one height for its corners; no edge lies level at the base, or
              twelve rounds did not help.
    Raises    CurvesMeet as `tile`; BadGeometry when the map stays flat.
    """
    free = np.empty((0, 2))
    for turn in range(FLAT_ROUNDS):
        tiling = tile(curves, frame, free)
        curves = tiling.curves
        flat, level = tiling.flat_triangles(), tiling.level_edges(frame.base)
        if turn >= FREE_ROUNDS and not flat.any() and not level.any():
            return tiling, free
        new = middles(tiling, tiling.flat_edges() if turn < FREE_ROUNDS else _edges_of(tiling, flat) | level)
        caps = tiling.triangles[flat & (tiling.contour_sides() == 3)]
        new = np.vstack([new, tiling.points[caps].mean(axis=1)])
        if not len(new):
            return tiling, free
        free = np.unique(np.vstack([free, new]), axis=0)
    if not flat.any():
        return tiling, free
    raise BadGeometry("contours", f"{int(flat.sum())} triangles of the map stay flat")


def _edges_of(tiling: Tiling, faces: NDArray[np.bool_]) -> NDArray[np.bool_]:
    chosen = np.zeros(len(tiling.edges), dtype=bool)
    chosen[tiling.side_edges[faces]] = True
    return chosen & tiling.flat_edges()


def middles(tiling: Tiling, chosen: NDArray[np.bool_]) -> Floats:
    """Midpoints of chosen edges, the longest first, at most one for every triangle."""
    ends = tiling.points[tiling.edges]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    taken = np.zeros(len(tiling.triangles) + 1, dtype=bool)  # the last entry stands for the outside
    picked = []
    candidates = np.flatnonzero(chosen)
    pairs = tiling.edge_faces.tolist()
    for e in candidates[np.argsort(-length[candidates], kind="stable")].tolist():
        left, right = pairs[e]
        if not (left >= 0 and taken[left]) and not (right >= 0 and taken[right]):
            taken[left] = taken[right] = True
            picked.append(e)
    return ends[picked].mean(axis=1)

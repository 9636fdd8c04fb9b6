"""Drawing a polyhedron: its three views with hidden lines dashed, from faces alone.

    left | right       a piece of a projected edge is drawn through when the planes nearest to the viewer left and right
    -----+------       of it differ, or one side is background; dashed otherwise. Pieces that continue each other in
                       the same line type are one segment.

Nothing here knows how the polyhedron was found, so that drawing it again proves what was found.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.geometry.polyhedron import Polyhedron
from recon.geometry.views import PROJECTIONS, DrawnView, Projection, ThreeViews
from recon.numerics.planar_regions import point_in_loops
from recon.three_view.tables import linked
from recon.three_view.view_graph import ViewGraph, view_graphs

__all__ = ["LooseFaces", "draw", "draw_front", "hidden_pieces", "projected"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

MIDDLE = 0.4713  # near the middle of a piece, off every symmetry
FINE = 1e-7  # of the solid's size: points of a view that lie closer are one
ASIDE = (4.0, 0.02)


@dataclass(frozen=True, eq=False)
class LooseFaces:
    """Faces as loose sides.

    sides    (h, 2, 3) start and end of each side
    face     (h,) face of each side, not decreasing
    normals  (f, 3) unit normals, outward
    offsets  (f,)
    """

    sides: Floats
    face: Ints
    normals: Floats
    offsets: Floats

    @classmethod
    def of(cls, solid: Polyhedron) -> "LooseFaces":
        sides, face = [], []
        for number, planar in enumerate(solid.faces):
            for loop in planar.loops:
                corners = solid.vertices[list(loop)]
                sides.append(np.stack([corners, np.roll(corners, -1, axis=0)], axis=1))
                face += [number] * len(loop)
        joined, owner = np.concatenate(sides), np.array(face)
        area = np.zeros((len(solid.faces), 3))
        origin = solid.vertices.mean(axis=0)
        np.add.at(area, owner, np.cross(joined[:, 0] - origin, joined[:, 1] - origin))
        normals = area / np.linalg.norm(area, axis=1)[:, None]
        heights = (joined[:, 0] * normals[owner]).sum(axis=1)
        offsets = np.bincount(owner, heights) / np.bincount(owner)
        return cls(joined, owner, normals, offsets)

    def reach(self) -> float:
        """Longest side of the box around the faces."""
        return float(np.ptp(self.sides.reshape(-1, 3), axis=0).max())


def draw(solid: Polyhedron) -> ThreeViews:
    """The three views of a polyhedron.

    Promises  every edge appears in each view that does not look along it, once; where lines of both types lie over each
              other the one drawn through stays.
    """
    faces, graphs = projected(solid)
    return ThreeViews(*(_with_line_types(faces, graph) for graph in graphs))


def draw_front(solid: Polyhedron) -> DrawnView:
    """The front view alone."""
    faces = LooseFaces.of(solid)
    fine = FINE * faces.reach()
    front, *others = (_flat(faces, projection, fine) for projection in PROJECTIONS)
    stubs = (DrawnView(view.segments[:1], view.hidden[:1]) for view in others)
    return _with_line_types(faces, view_graphs(ThreeViews(front, *stubs), fine)[1][0])


def projected(solid: Polyhedron) -> tuple[LooseFaces, list[ViewGraph]]:
    """Faces of a polyhedron, and its edges in each view, cut where they meet and cross, of no line type yet."""
    faces = LooseFaces.of(solid)
    fine = FINE * faces.reach()
    _, graphs = view_graphs(ThreeViews(*(_flat(faces, projection, fine) for projection in PROJECTIONS)), fine)
    return faces, graphs


def _flat(faces: LooseFaces, projection: Projection, fine: float) -> DrawnView:
    flat = faces.sides[:, :, projection.axes]
    flat = flat[np.linalg.norm(flat[:, 1] - flat[:, 0], axis=1) > fine]
    flat = np.unique(np.where((flat[:, :1] <= flat[:, 1:]).all(axis=2)[:, :, None], flat, flat[:, ::-1]), axis=0)
    return DrawnView(flat, np.zeros(len(flat), dtype=bool))


def hidden_pieces(
    faces: LooseFaces, projection: Projection, pieces: Floats, *, snap: float, aside: tuple[float, float] = ASIDE
) -> Flags:
    """(m,) whether each piece (m, 2, 2) of a projected edge is dashed.

    snap   faces are of one plane that are so to a few snaps
    aside  how far beside a piece one looks, in snaps, and at most, as a share of the piece's length
    """
    way = pieces[:, 1] - pieces[:, 0]
    length = np.linalg.norm(way, axis=1)
    look = pieces[:, 0] + MIDDLE * way
    step = np.column_stack([-way[:, 1], way[:, 0]]) * np.minimum(aside[0] * snap / length, aside[1])[:, None]
    left, right = (_nearest(faces, look + offset, projection) for offset in (step, -step))
    return _same_plane(faces, left, right, snap)


def _nearest(faces: LooseFaces, look: Floats, projection: Projection) -> Ints:
    """Face nearest to the viewer at each point of a view, -1 for the background."""
    tilt = faces.normals[:, projection.depth] * projection.toward
    sides = np.ascontiguousarray(faces.sides[:, :, projection.axes].reshape(-1, 4))
    starts = np.searchsorted(faces.face, np.arange(len(tilt) + 1))
    planes = np.column_stack([faces.normals[:, projection.axes], faces.offsets, faces.normals[:, projection.depth]])
    return _first_met(np.ascontiguousarray(look), sides, starts, (planes, tilt > 1e-7, float(projection.toward)))


@njit(cache=True)
def _first_met(
    look: Floats, sides: Floats, starts: Ints, faces: tuple[Floats, Flags, float]
) -> Ints:  # pragma: no cover - compiled
    planes, facing, toward = faces
    nearest = np.full(len(look), -1, dtype=np.int64)
    height = np.full(len(look), -np.inf)
    for f in range(len(facing)):
        if not facing[f]:
            continue
        own = sides[starts[f] : starts[f + 1]]
        low_x, high_x, low_y, high_y = own[:, 0].min(), own[:, 0].max(), own[:, 1].min(), own[:, 1].max()
        for k in range(len(look)):
            x, y = look[k]
            if low_x < x < high_x and low_y < y < high_y and point_in_loops(x, y, own):
                at = (planes[f, 2] - planes[f, 0] * x - planes[f, 1] * y) / planes[f, 3] * toward
                if at > height[k]:
                    height[k], nearest[k] = at, f
    return nearest


def _same_plane(faces: LooseFaces, left: Ints, right: Ints, snap: float) -> Flags:
    turn = np.linalg.norm(faces.normals[left] - faces.normals[right], axis=1)
    step = np.abs(faces.offsets[left] - faces.offsets[right])
    reach = float(np.abs(faces.sides).max())
    both = (left >= 0) & (right >= 0)
    near = (turn <= 1e-6 + 10 * snap / reach) & (step <= 10 * snap + 1e-9 * reach)
    return np.asarray((left == right) | (both & near))


def _with_line_types(faces: LooseFaces, graph: ViewGraph) -> DrawnView:
    pieces = graph.positions[graph.edges]
    return _joined(graph, hidden_pieces(faces, graph.projection, pieces, snap=FINE * faces.reach()))


def _joined(graph: ViewGraph, hidden: Flags) -> DrawnView:
    """Pieces of a run that share a point and a line type as one segment."""
    ends = np.column_stack([graph.edges.ravel(), np.repeat(graph.runs, 2), np.repeat(hidden, 2)])
    order = np.lexsort(ends.T)
    same = (ends[order][1:] == ends[order][:-1]).all(axis=1)
    pieces = np.repeat(np.arange(len(graph.edges)), 2)[order]
    group = linked(np.column_stack([pieces[:-1], pieces[1:]])[same], len(graph.edges))
    segments, dashed = [], []
    for members in np.split(np.argsort(group, kind="stable"), np.flatnonzero(np.diff(np.sort(group))) + 1):
        points = graph.positions[graph.edges[members].ravel()]
        along = points @ graph.directions()[members[0]]
        segments.append(points[[int(np.argmin(along)), int(np.argmax(along))]])
        dashed.append(bool(hidden[members[0]]))
    return DrawnView(np.array(segments), np.array(dashed))

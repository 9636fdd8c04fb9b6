"""Steps 1 and 2 together: curves near the contours whose tiling has neither curves that meet nor triangles that fold.

Where curves meet, they are fitted again with less room there; where triangles fold, their contour sides are halved.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from recon.errors import BadGeometry
from recon.geometry.contour_map import ContourMap
from recon.geometry.patches import COLLAPSED
from recon.numerics.bernstein import bernstein
from recon.terrain.border import Border
from recon.terrain.clean_lines import MOST_NAMED, part_of
from recon.terrain.contour_curves import ContourCurves
from recon.terrain.floor import Floor
from recon.terrain.gregory import gregory_folds, gregory_patches
from recon.terrain.ground import PatchKind, TerrainOptions
from recon.terrain.merging import Folds, PatchLayout, ruled_folds, triangle_layout
from recon.terrain.patch_group import PatchGroup
from recon.terrain.patches import patch_nets
from recon.terrain.resampling import ContourFits, ContourSamples, contour_samples
from recon.terrain.second_derivatives import VertexJets
from recon.terrain.tiling import ALONG, NO_SEGMENT, CurvesMeet, Frame, Tiling, middles, tile, with_free_vertices

__all__ = ["BORDER_STEP", "Fitting", "finer_tiling", "tiled"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

MOST_TURNING = np.radians(90.0)  # of a segment: more would let a contour bulge over the tiling edges beside it
TINY = 0.2  # of the tolerance: segments below it are not split for their turning
BORDER_STEP = 6.0  # spacings of the points between free vertices on the border
SMALL_RING, RING_REACH = 12.0, 2.0  # spacings of the points: length of a ring that noise makes, way to where it meets
PATIENCE = 3  # refits before rings are left out
REFITS, TIGHTENINGS, UNFOLDINGS = 14, 9, 12
LEAVINGS = 5  # fits after which curves that still leave the map are left to the tiling
WAYPOINTS = np.linspace(0.0, 1.0, 17)[1:-1]  # of a segment, whose ends may lie on the border


@dataclass(frozen=True, eq=False)
class Fitting:
    """What the fit of curves, tiling and patches needs beside the contours."""

    tolerance: float
    options: TerrainOptions
    border: Border
    floor: Floor | None

    @property
    def folds(self) -> Folds:
        return gregory_folds if self.options.patches is PatchKind.GREGORY else ruled_folds

    def samples(self, contours: ContourMap) -> ContourSamples:
        return contour_samples(contours, self.border.spacing, self.border.line_ends(contours))

    def frame(self, contours: ContourMap) -> Frame:
        base = None if self.floor is None else self.floor.height
        return Frame(contours, BORDER_STEP * self.border.spacing, self.border.free_points, base)

    def patches(self, tiling: Tiling, layout: PatchLayout) -> Callable[[VertexJets, Ints | None], Sequence[PatchGroup]]:
        if self.options.patches is PatchKind.GREGORY:
            return partial(gregory_patches, tiling, layout, angle=self.options.angle)
        return partial(patch_nets, tiling, layout)


def tiled(contours: ContourMap, fitting: Fitting) -> tuple[Tiling, ContourMap, tuple[str, ...]]:
    """The tiling of curves that do not meet, and its contours; where they met, the fit is repeated with less room.

    Where that does not help, rings that the spacing of the points cannot tell from noise are left out and named.
    """
    tight, tolerance, origin = np.empty((0, 2)), fitting.tolerance, fitting.border.origin
    fits, spacing = ContourFits(fitting.samples(contours)), fitting.border.spacing
    left_out: list[Floats] = []
    for attempt in range(REFITS):
        allowed = tolerance * 0.5 ** max(attempt - TIGHTENINGS, 0)  # crowded maps: tighter everywhere
        curves, tight = _within_border(fits, contours, allowed, tight)
        try:
            frame = fitting.frame(contours)
            tiling, free = with_free_vertices(curves, frame)
            tiling = _unfolded(tiling, frame, free, (TINY * allowed, origin), fitting.folds)
            return tiling, contours, _told_of_rings(left_out, origin)
        except CurvesMeet as meeting:
            if attempt == REFITS - 1:
                raise CurvesMeet(meeting.places, meeting.height, origin) from meeting
            tight = np.vstack([tight, meeting.places])
            small = _small_rings(contours, meeting.places, spacing)
            if attempt >= PATIENCE and small.any() and not small.all():
                left_out += [contours.lines[i][0] for i in np.flatnonzero(small).tolist()]
                contours = part_of(contours, ~small)
                fits = ContourFits(fitting.samples(contours))
    raise AssertionError("the loop returns or raises")


def _within_border(
    fits: ContourFits, contours: ContourMap, allowed: float, tight: Floats
) -> tuple[ContourCurves, Floats]:
    """The curves, fitted again with less room where they leave the map, and all places (n, 2) that had less.

    A tiling would find these out too, after far more work, and only those in its way.
    """
    for _ in range(LEAVINGS):
        curves = _supple(fits.curves(allowed, tight), allowed)
        left = _beyond_border(curves, contours)
        if not len(left):
            break
        tight = np.vstack([tight, left])
    return curves, tight


def _beyond_border(curves: ContourCurves, contours: ContourMap) -> Floats:
    """(n, 2) middles of the segments that lie outside the map, or in a void, by more than rounding."""
    low, high = curves.bezier.min(axis=1), curves.bezier.max(axis=1)
    boxes = shapely.STRtree(shapely.box(low[:, 0], low[:, 1], high[:, 0], high[:, 1]))
    border = shapely.MultiLineString([contours.outline, *contours.voids])
    near = np.unique(boxes.query(shapely.linestrings(contours.sides()), predicate="intersects")[1])
    places = bernstein(3, WAYPOINTS) @ curves.bezier[near]
    outside = ~contours.holds(places.reshape(-1, 2))
    outside[outside] = shapely.distance(border, shapely.points(places.reshape(-1, 2)[outside])) > ALONG
    left = outside.reshape(len(near), len(WAYPOINTS)).any(axis=1)
    return np.asarray(curves.bezier[near[left]].mean(axis=1))


def _small_rings(contours: ContourMap, places: Floats, spacing: float) -> NDArray[np.bool_]:
    """(C,) whether a contour is a ring of a few points' length beside one of the places."""
    small = np.zeros(len(contours.lines), dtype=bool)
    near = cKDTree(places)
    for i, line in enumerate(contours.lines):
        if (line[0] == line[-1]).all() and np.linalg.norm(np.diff(line, axis=0), axis=1).sum() < SMALL_RING * spacing:
            small[i] = near.query(line)[0].min() < RING_REACH * spacing
    return small


def _told_of_rings(places: list[Floats], origin: Floats) -> tuple[str, ...]:
    if not places:
        return ()
    named = ", ".join(f"({x:.1f}, {y:.1f})" for x, y in (place + origin for place in places[:MOST_NAMED]))
    more = f" and {len(places) - MOST_NAMED} more" if len(places) > MOST_NAMED else ""
    return (
        f"{len(places)} rings too small for the spacing of their points touch others and were left out: {named}{more}",
    )


def _supple(curves: ContourCurves, tolerance: float) -> ContourCurves:
    """The curves split until no segment turns by much; kinks that are left when segments get tiny become chords."""
    while (bent := (curves.turning() > MOST_TURNING) & ~curves.straight).any():
        short = np.linalg.norm(curves.bezier[:, 3] - curves.bezier[:, 0], axis=1) < TINY * tolerance
        tiny = bent & short & curves.may_straighten()
        curves = curves.straightened(tiny).split(bent & ~tiny)
    return curves


def _unfolded(tiling: Tiling, frame: Frame, free: Floats, grid: tuple[float, Floats], folds: Folds) -> Tiling:
    """The tiling with contour segments halved, or made chords when tiny, until no triangle's plan map folds.

    grid  length below which a segment is tiny, map origin
    """
    tiny, origin = grid
    for _ in range(UNFOLDINGS):
        layout = triangle_layout(tiling)
        folded = folds(tiling, layout)
        flat, level = tiling.flat_triangles(), tiling.level_edges(frame.base)
        if not folded.any() and not flat.any() and not level.any():
            return tiling
        segments = tiling.edge_segment[layout.side_edges[folded, 0]]
        chosen = np.zeros(len(tiling.curves.bezier), dtype=bool)
        chosen[segments[segments >= 0]] = True
        new = tiling.points[tiling.triangles[flat]].mean(axis=1)
        free = np.vstack([free, new, middles(tiling, level)])
        b = tiling.curves.bezier
        small = chosen & ~tiling.curves.straight & (np.linalg.norm(b[:, 3] - b[:, 0], axis=1) < tiny)
        small &= tiling.curves.may_straighten()
        tiling = tile(tiling.curves.straightened(small).split(chosen & ~small), frame, free)
    if not folded.any() and not flat.any():
        return tiling
    where = tiling.points[layout.corners[folded | flat, 0]][0] + origin
    raise BadGeometry(
        "contours", f"{int(folded.sum())} patches stay folded, the first near ({where[0]:.1f}, {where[1]:.1f})"
    )


def finer_tiling(tiling: Tiling, contours: ContourMap, fitting: Fitting, astray: PatchLayout) -> Tiling:
    """The tiling with the contour sides of patches that go astray halved, and a free vertex in those without one."""
    sides = astray.side_edges
    segments = np.where(sides == COLLAPSED, NO_SEGMENT, tiling.edge_segment[sides])
    chosen = np.zeros(len(tiling.curves.bezier), dtype=bool)
    chosen[segments[segments != NO_SEGMENT]] = True
    bare = astray.corners[(segments == NO_SEGMENT).all(axis=1), :3]
    free = tiling.points[tiling.curves.n_vertices : len(tiling.points) - len(tiling.spots)]
    free = np.vstack([free, tiling.points[bare].mean(axis=1)])
    frame = fitting.frame(contours)
    finer = tile(tiling.curves.split(chosen), frame, free)
    return _unfolded(finer, frame, free, (TINY * fitting.tolerance, fitting.border.origin), fitting.folds)

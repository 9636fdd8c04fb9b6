"""From contour lines to a mountain of patches that meet G1, step by step as in [zhang2006].

1. resampling   every contour a cubic spline with continuous curvature                        (3, step 1)
2. tiling       constrained Delaunay triangles, free vertices where they would be flat        (3, step 2)
3. merging      triangles to quads                                                            (4.1)
4. slopes       tangents across the contours; heights of the free vertices                    (4.2)
5. curve mesh   height and gradient along every edge                                          (4.2)
6. patches      one polynomial surface a patch                                                (5)
7. limiter      no overshoot beyond the contours around
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from functools import partial
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from threadpoolctl import threadpool_limits

from recon.errors import BadGeometry, BadOption
from recon.geometry.contour_map import ContourMap
from recon.geometry.patches import COLLAPSED
from recon.numerics.bernstein import bernstein
from recon.terrain.border import Border, BorderVertices
from recon.terrain.contour_curves import ContourCurves
from recon.terrain.faults import checked_contours
from recon.terrain.floor import Floor, Lifting
from recon.terrain.gregory import gregory_folds, gregory_patches
from recon.terrain.levels import Levels, levels
from recon.terrain.limiter import limited_jets
from recon.terrain.merging import Folds, PatchLayout, merged_layout, ruled_folds, triangle_layout
from recon.terrain.patch_group import PatchGroup
from recon.terrain.patches import patch_nets
from recon.terrain.resampling import ContourFits, ContourSamples, contour_samples, point_spacing
from recon.terrain.second_derivatives import VertexJets, contour_frames, vertex_jets
from recon.terrain.slopes import VertexSlopes, vertex_slopes
from recon.terrain.spot_heights import spots_beside_contours, spots_off_strips
from recon.terrain.tiling import ALONG, NO_SEGMENT, CurvesMeet, Frame, Tiling, middles, tile, with_free_vertices

__all__ = ["PatchKind", "Terrain", "TerrainOptions", "terrain_surface"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SHARE_OF_SPACING = 0.28  # the tolerance, where none is given, as a share of the distance between the given points
MOST_TURNING = np.radians(90.0)  # of a segment: more would let a contour bulge over the tiling edges beside it
TINY = 0.2  # of the tolerance: segments below it are not split for their turning
BORDER_STEP = 6.0  # spacings of the points between free vertices on the border
SPECK = 0.05  # tolerances that a closed contour is long at least
SMALL_RING, RING_REACH = 12.0, 2.0  # spacings of the points: length of a ring that noise makes, way to where it meets
MOST_NAMED = 5
PATIENCE = 3  # refits before rings are left out
REFITS, TIGHTENINGS, UNFOLDINGS = 14, 9, 12
REFINEMENTS = 4  # where patches leave the heights around them all the same
LEAVINGS = 5  # fits after which curves that still leave the map are left to the tiling
WAYPOINTS = np.linspace(0.0, 1.0, 17)[1:-1]  # of a segment, whose ends may lie on the border


class PatchKind(StrEnum):
    """What lies within the curve mesh."""

    POLYNOMIAL = "polynomial"
    GREGORY = "gregory"


@dataclass(frozen=True)
class TerrainOptions:
    """What a user may choose.

    tolerance  metres that a contour's curve may stay from the points given; None: 0.28 of their spacing
    mend       leave out contours that repeat another
    patches    POLYNOMIAL, or the paper's GREGORY patches, which become B-splines
    angle      degrees between the tangent planes of neighbours that the B-splines of Gregory patches keep within
    Raises  BadOption.
    """

    tolerance: float | None = None
    mend: bool = False
    patches: PatchKind = PatchKind.POLYNOMIAL
    angle: float = 0.1

    def __post_init__(self) -> None:
        if self.tolerance is not None and not 0 < self.tolerance < np.inf:
            raise BadOption("--tolerance", f"must be a positive length in metres, not {self.tolerance}")
        if not 0 < self.angle <= 90:
            raise BadOption("--angle", f"must be an angle in degrees, up to 90, not {self.angle}")


@dataclass(frozen=True, eq=False)
class Terrain:
    """A smooth ground over a map rectangle.

    origin   (2,) place of the map at which the patches have their x = y = 0
    tiling, layout, jets   what the patches were made from, in local coordinates
    nets     the patches, in local coordinates: polynomial ones with a contour side and those without, or Gregory's
    extent   (2, 2) corners of the map, in local coordinates
    interval metres of height between neighbouring contours
    tolerance  metres, as used
    strip    (F,) strip of every triangle of the tiling: strips are parted by contours
    crs      name of the coordinate reference system, or an empty text
    notes    what a user should know about how it was made
    """

    origin: Floats
    tiling: Tiling
    layout: PatchLayout
    jets: VertexJets
    nets: tuple[PatchGroup, ...]
    extent: Floats
    interval: float
    tolerance: float
    strip: NDArray[np.int64]
    crs: str = ""
    notes: tuple[str, ...] = field(default=())

    @property
    def n_patches(self) -> int:
        return len(self.layout.corners)


def terrain_surface(
    contours: ContourMap,
    options: TerrainOptions | None = None,
    *,
    floor: float | None = None,
    border: Border | None = None,
    doing: Callable[[str], None] = lambda step: None,
) -> Terrain:
    """A ground through the contours, of polynomial patches whose tangent planes agree along every common edge.

    floor     height of a contour below which no patch above it may dip, since a base lies there
    border    what the map shares with the maps beside it, whose vertices on its border are then all that it has there
    doing     called with the name of each step
    Promises  no patch folds; heights stay near those of their patch's corners, as the limiter says.
    Raises    BadGeometry naming height and place, where contours cross or a patch cannot be unfolded; BadOption.
    Paper     [zhang2006].
    """
    options = options or TerrainOptions()
    border = border or _no_neighbours(contours)
    tolerance, origin = options.tolerance or SHARE_OF_SPACING * border.spacing, border.origin
    sound, told = checked_contours(contours, tolerance, mend=options.mend)
    kept, notes = _without_specks(sound, tolerance)
    kept, spots_told = spots_beside_contours(kept, tolerance, mend=options.mend)
    notes = told + notes + spots_told
    local = border.joined(_ended_on_border(kept.moved(origin), tolerance))
    fitting = _Fitting(tolerance, options, border, None if floor is None else Floor(floor))
    with threadpool_limits(limits=1, user_api="blas"):
        doing("following the contours")
        tiling, local, left_out = _tiled(local, fitting)
        odd = spots_off_strips(tiling, levels(tiling, border.interval), origin, mend=options.mend)
        if odd.any():
            notes += (f"{int(odd.sum())} spot heights that the contours around contradict were left out",)
            tiling, local, left_out = _tiled(local.with_spots(local.spots[~odd]), fitting)
        notes += left_out
        laid = _laid(tiling, fitting, doing)
        for _ in range(REFINEMENTS):
            if not len(laid.astray):
                break
            tiling = _finer(tiling, local, fitting, laid)
            laid = _laid(tiling, fitting, doing)
    rest = local.extent, border.interval, tolerance, laid.strip, contours.crs, notes
    return Terrain(origin, tiling, laid.layout, laid.jets, laid.nets, *rest)


@dataclass(frozen=True, eq=False)
class _Fitting:
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


class _Laid(NamedTuple):
    """Patches over a tiling, the strips of its triangles, and the patches that leave the heights around them."""

    layout: PatchLayout
    jets: VertexJets
    nets: tuple[PatchGroup, ...]
    strip: Ints
    astray: Ints


def _laid(tiling: Tiling, fitting: _Fitting, doing: Callable[[str], None]) -> _Laid:
    """Steps 3 to 7."""
    border, floor = fitting.border, fitting.floor
    layout = merged_layout(tiling, fitting.folds)
    doing("finding the slopes")
    held, told = border.rows(tiling), border.vertices.jets
    limits = levels(tiling, border.interval, border.bands(held))
    slopes, limits = _slopes(tiling, limits, (held, told.slopes()), floor)
    jets = vertex_jets(tiling, slopes).with_rows(held, told)
    doing("making the patches")
    made = fitting.patches(tiling, layout)
    jets, nets, astray = limited_jets(made, layout, jets, limits, border.interval, held)
    if floor is not None:
        lifting = Lifting(floor, tiling, layout, limits, border.interval)
        jets, nets = lifting.lifted(made, jets, nets)
        astray = np.union1d(astray, lifting.dipping(nets))
    return _Laid(layout, jets, nets, limits.strip, astray)


def _finer(tiling: Tiling, contours: ContourMap, fitting: _Fitting, laid: _Laid) -> Tiling:
    """The tiling with the contour sides of patches astray halved, and a free vertex in those without one."""
    sides = laid.layout.side_edges[laid.astray]
    segments = np.where(sides == COLLAPSED, NO_SEGMENT, tiling.edge_segment[sides])
    chosen = np.zeros(len(tiling.curves.bezier), dtype=bool)
    chosen[segments[segments != NO_SEGMENT]] = True
    bare = laid.layout.corners[laid.astray[(segments == NO_SEGMENT).all(axis=1)], :3]
    free = tiling.points[tiling.curves.n_vertices : len(tiling.points) - len(tiling.spots)]
    free = np.vstack([free, tiling.points[bare].mean(axis=1)])
    frame = fitting.frame(contours)
    finer = tile(tiling.curves.split(chosen), frame, free)
    return _unfolded(finer, frame, free, (TINY * fitting.tolerance, fitting.border.origin), fitting.folds)


def _slopes(
    tiling: Tiling, limits: Levels, told: tuple[Ints, VertexSlopes], floor: Floor | None
) -> tuple[VertexSlopes, Levels]:
    """Slopes at all vertices, and the limits of height, of which none spans a floor."""
    normals = contour_frames(tiling.curves)[1]
    if floor is None:
        return vertex_slopes(tiling, normals, limits, told), limits
    limits = floor.settled(limits, tiling)
    slopes = vertex_slopes(tiling, normals, floor.cleared(limits), told)
    if floor.cut_through(limits):
        limits = floor.settled(limits, tiling, slopes.height)
        slopes = vertex_slopes(tiling, normals, floor.cleared(limits), told)
    return slopes, limits


def _no_neighbours(contours: ContourMap) -> Border:
    """The border of a map that stands alone."""
    origin = np.round(contours.extent.mean(axis=0))
    return Border(origin, point_spacing(contours), contours.interval(), BorderVertices.none())


def _without_specks(contours: ContourMap, tolerance: float) -> tuple[ContourMap, tuple[str, ...]]:
    """The contours without closed ones so small that a curve within the tolerance may be one point; they are named."""
    length = np.array([np.linalg.norm(np.diff(line, axis=0), axis=1).sum() for line in contours.lines])
    closed = np.array([bool((line[0] == line[-1]).all()) for line in contours.lines])
    speck = np.where(closed, length < SPECK * tolerance, length == 0)
    if not speck.any():
        return contours, ()
    places = [(i, contours.lines[i][0]) for i in np.flatnonzero(speck).tolist()]
    named = ", ".join(f"{i} near ({x:.1f}, {y:.1f})" for i, (x, y) in places[:MOST_NAMED])
    more = f" and {len(places) - MOST_NAMED} more" if len(places) > MOST_NAMED else ""
    note = f"{len(places)} contours shorter than {SPECK * tolerance:.3g} m vanish in resampling: {named}{more}"
    if speck.all():
        raise BadGeometry("contours", f"all of them are shorter than {SPECK * tolerance:.3g} m at this tolerance")
    return _part(contours, ~speck), (note,)


def _ended_on_border(contours: ContourMap, tolerance: float) -> ContourMap:
    """The contours with ends that miss the border of the map by less than the tolerance put on it."""
    sides = contours.sides()
    way = sides[:, 1] - sides[:, 0]
    square = np.einsum("ij,ij->i", way, way)
    lines = []
    for line in contours.lines:
        moved = np.clip(line, *contours.extent)
        for end in () if (line[0] == line[-1]).all() else (0, -1):
            share = np.clip(np.einsum("ij,ij->i", moved[end] - sides[:, 0], way) / square, 0.0, 1.0)
            foot = sides[:, 0] + share[:, None] * way
            gap = np.linalg.norm(foot - moved[end], axis=1)
            if gap.min() < tolerance:
                moved[end] = foot[int(np.argmin(gap))]
        lines.append(moved)
    return contours.with_lines(lines, contours.heights)


def _tiled(contours: ContourMap, fitting: _Fitting) -> tuple[Tiling, ContourMap, tuple[str, ...]]:
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
                contours = _part(contours, ~small)
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


def _part(contours: ContourMap, keep: NDArray[np.bool_]) -> ContourMap:
    rows = np.flatnonzero(keep).tolist()
    return contours.with_lines([contours.lines[i] for i in rows], contours.heights[rows])


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

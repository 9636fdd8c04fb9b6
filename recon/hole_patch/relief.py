"""The missing piece gets the relief that its neighbours have, so that cords run on across the edge.

The smooth sheet says where the wall is, the rest of the vessel says what is pressed into it: the relief around the hole
is sought all around the wheel (`relief_search`), what is found is laid on the sheet, and in the last millimetres the
sheet gives way to the edge that was measured.

    h ^ / \\ / \\ |                     | / \\ / \\       h   relief as scanned (`relief_map`)
      |/   '   \\|  . . . . . . . . .  |/   '   \\      g   what is foretold for the hole
      |         x--.  / \\ / \\ /  ,---x                x   the measured edge, r = x - g there
      +------------------------------------------>     C   covariance of r, by its correlation along the edge
        new sheet  =  sheet + (g + c' (C + σ²)⁻¹ r) n

Paper  [kinoshita] leaves relief on the patch to future work; [krige1951] for what fades in from the edge.
"""

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.interpolate import make_interp_spline
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial.distance import cdist

from recon.geometry.bspline import BSplineSurface
from recon.geometry.trimmed import TrimmedSurface
from recon.hole_patch.relief_drawing import drawn_relief
from recon.hole_patch.relief_map import ReliefMap, inside_polygon, relief_map
from recon.hole_patch.relief_search import ReliefSearch, foretell, predicted
from recon.hole_patch.sheet import Sheet
from recon.hole_patch.surroundings import Axis, Wall
from recon.hole_patch.trim_loop import even_points, parameter_loop
from recon.hole_patch.wheel_chart import RolledChart, wheel_chart
from recon.hole_patch.wheel_edge import clean_wall
from recon.numerics.bspline_basis import greville, uniform_knots
from recon.numerics.foot_points import foot_points

__all__ = ["ReliefSheet", "ReliefSource", "continue_relief"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

RING = 10.0  # mm: two or three cords, so that a place is known by more than one of them
SECTORS = 6
BEYOND = 3.0  # mm by which the foretold relief goes on beyond the edge, where splines still feel it
LEAST_EXPLAINED = 0.3  # of the variance of left-out sectors; noise stays below 0.25, irregular stamps too
LEAST_DEPTH = (
    0.03  # mm, root mean square on the ring; below it no search is worth its time: noise alone leaves 0.02 to 0.04
)
CHIP = 6.0  # medians above which a height on the ring is a chip
SPANS_A_WAVE = 5.0
SPANS = (0.4, 0.7)  # mm: least and greatest distance of the new knots; the edge of steep cords asks for it, too
MOST_SPANS = 160
MEETINGS = 4  # rounds in which the face is drawn to the edge that it missed
EDGE_STEP = 0.4  # mm between points of the edge, as in the trim loop
NUGGET = 0.02  # share of the edge's variance that is noise
FADING = (0.8, 6.0)  # mm: least and greatest length over which the edge is forgotten
CHIPPED = 0.2  # mm by which a point of the edge may differ from its neighbours


class ReliefSource(StrEnum):
    """Where the relief of the piece comes from."""

    REGULAR = "regular"  # whole views of the wall from elsewhere: the pattern repeats
    EXEMPLAR = "exemplar"  # put together row by row or patch by patch
    DRAWN = "drawn"  # after the pattern of the wall, which foretells nothing: not what was lost
    NONE = "none"


@dataclass(frozen=True, eq=False)
class ReliefSheet:
    """A sheet with relief, or the sheet as it was.

    sheet       its `base` is still the smooth face, on the same parameters
    source      where the relief comes from
    score       correlation of the best single place on the vessel with the ring around the hole
    explained   share of the ring's variance that was foretold where sectors of it were left out; not above 1, and
                below 0 when the guess was worse than none
    depth       root mean square of the relief on the ring, in millimetres
    wavelength  of the relief in the hole in millimetres, or None without relief
    """

    sheet: Sheet
    source: ReliefSource
    score: float = 0.0
    explained: float = 0.0
    depth: float = 0.0
    wavelength: float | None = None


def continue_relief(outer: Sheet, wall: Wall, axis: Axis | None, *, draw: bool = False) -> ReliefSheet:
    """Continue the relief of the wall on a sheet that covers its hole.

    draw      whether a pattern that nothing on the vessel foretells is drawn after that of the wall; a note says so
    Promises  the face gives way to the measured edge, on average to a few hundredths of a millimetre; where sherds or
              steep cords jump along the edge, single points are missed by more. Where the vessel has no relief around
              the hole, or none that the rest of the wall foretells, the sheet is the one given, with a note that
              says why.
    Raises    NoSurface as `wheel_chart` and `parameter_loop` do.
    Paper     [kinoshita], future work.
    """
    chart = None if axis is None else wheel_chart(wall, axis)
    if axis is None or not isinstance(chart, RolledChart):
        reason = "the vessel is not round" if axis is None else "the hole lies over the axis, where nothing repeats"
        return ReliefSheet(_noted(outer, f"No relief was continued: {reason}."), ReliefSource.NONE)
    wall = clean_wall(wall, axis)
    edge = chart.flat(wall.edge.points, wall.edge.normals)[:, :2]
    around = relief_map(wall, chart, edge)
    ring = _Ring.around(around, edge)
    if ring.depth < LEAST_DEPTH:
        note = f"No relief was continued: the wall around the hole is smooth ({ring.depth:.3f} mm root mean square)."
        return ReliefSheet(_noted(outer, note), ReliefSource.NONE, depth=ring.depth)
    search = ReliefSearch(ring.map, hole=ring.hole, sectors=ring.sectors)
    found = foretell(search)
    if found.explained < LEAST_EXPLAINED and draw:
        return _drawn(outer, wall, (chart, edge), ring, found.explained)
    if found.explained < LEAST_EXPLAINED:
        note = (
            f"No relief was continued: nothing on the vessel foretells the {ring.depth:.2f} mm of relief around the"
            f" hole (left-out parts explained to {max(found.explained, 0.0):.0%}, {LEAST_EXPLAINED:.0%} needed)."
            " --relief draw draws a pattern like that of the wall, which is then not the one that was lost."
        )
        return ReliefSheet(_noted(outer, note), ReliefSource.NONE, explained=found.explained, depth=ring.depth)
    taught = range(search.n_sectors)
    filled = ring.distance < BEYOND
    height = np.zeros(filled.shape)
    height[filled] = predicted(search, [found.recipe], taught, np.argwhere(filled))[0]
    height *= found.trust
    wavelength = _wavelength(height, ring.hole, around.cell)
    return ReliefSheet(
        _with_relief(outer, wall, (chart, edge), replace(around, height=height, known=filled), wavelength),
        ReliefSource.REGULAR if found.recipe.regular else ReliefSource.EXEMPLAR,
        float(search.candidates(taught, count=1, apart=0).score[0]),
        found.explained,
        ring.depth,
        wavelength,
    )


def _drawn(outer: Sheet, wall: Wall, flat: tuple[RolledChart, Floats], ring: "_Ring", explained: float) -> ReliefSheet:
    filled = ring.distance < BEYOND
    height = np.where(filled, drawn_relief(ring.map, filled & (ring.hole | ~ring.map.known)), 0.0)
    wavelength = _wavelength(height, ring.hole, ring.map.cell)
    sheet = _with_relief(outer, wall, flat, replace(ring.map, height=height, known=filled), wavelength)
    note = (
        "The relief on the piece was drawn after that of the wall, which does not come back on the vessel: it looks"
        " alike, and is not the one that was lost."
    )
    return ReliefSheet(
        _noted(sheet, note),
        ReliefSource.DRAWN,
        explained=explained,
        depth=ring.depth,
        wavelength=wavelength,
    )


def _noted(sheet: Sheet, note: str) -> Sheet:
    return replace(sheet, notes=(*sheet.notes, note))


@dataclass(frozen=True, eq=False)
class _Ring:
    """The map around the hole: its cells, their distance from the hole in millimetres, the ring cut into sectors."""

    map: ReliefMap
    hole: Bools
    distance: Floats
    sectors: Ints

    @classmethod
    def around(cls, whole: ReliefMap, edge: Floats) -> "_Ring":
        """The ring around a hole with an edge (n, 2) in u and s, and the map without chips."""
        hole = inside_polygon(whole.index(edge), whole.height.shape)
        distance = ndimage.distance_transform_edt(~hole) * float(whole.cell.mean())
        ring = whole.known & ~hole & (distance < RING)
        sectors = np.full(hole.shape, -1)
        away = whole.place(np.argwhere(ring)) - 0.5 * (edge.min(axis=0) + edge.max(axis=0))
        turn = np.arctan2(away[:, 1], away[:, 0])
        # equally many cells each, whatever the hole's outline
        sectors[ring] = np.argsort(np.argsort(turn, kind="stable"), kind="stable") * SECTORS // max(len(turn), 1)
        most = CHIP * float(np.median(np.abs(whole.height[ring]))) / 0.6745 if ring.any() else 0.0
        return cls(replace(whole, height=np.clip(whole.height, -most, most)), hole, distance, sectors)

    @property
    def depth(self) -> float:
        """Root mean square of the relief on the ring, in millimetres; 0 without a ring."""
        return float(np.sqrt((self.map.height[self.sectors >= 0] ** 2).sum() / max((self.sectors >= 0).sum(), 1)))


def _wavelength(height: Floats, hole: Bools, cell: Floats) -> float:
    """2π times the root mean square height over that of its slope: for a wave its length."""
    slope = np.stack([*np.gradient(height)], axis=-1)[hole] / cell
    level = height[hole] - height[hole].mean()
    return float(2 * np.pi * np.sqrt((level**2).mean() / max(float((slope**2).sum(axis=1).mean()), 1e-12)))


def _with_relief(
    sheet: Sheet, wall: Wall, flat: tuple[RolledChart, Floats], relief: ReliefMap, wavelength: float
) -> Sheet:
    """The sheet raised by the relief and drawn to the edge; `flat` is the chart and the edge (n, 2) in it."""
    chart, edge = flat
    smooth = sheet.base if sheet.base is not None and sheet.box_angle_deg is None else sheet.trimmed.surface
    span = float(np.clip(wavelength / SPANS_A_WAVE, *SPANS))
    face = _Face.over(smooth, span=span, turns_back=wall.over_lip)
    place = chart.flat(face.points, face.normals if wall.over_lip else None)[:, :2]
    raised = ndimage.map_coordinates(relief.height, relief.index(place).T, order=3, mode="constant")
    sound = wall.edge.sherds >= 0 if sheet.sound is None else sheet.sound
    start = foot_points(smooth, wall.edge.points, edge if wall.over_lip else None)
    # over a lip the edge on one wall is nearer to that on the other in space than along the face
    unfolded = chart.unfolded(place), chart.unfolded(edge)
    surface, uv, sound = _drawn_to_edge(face, raised, wall.edge.points, (start, sound), unfolded)
    off = np.linalg.norm(surface.point(uv) - wall.edge.points, axis=1)
    loop = parameter_loop(surface, uv, n_curves=len(sheet.trimmed.loops[0].pcurves))
    return replace(sheet, trimmed=TrimmedSurface(surface, (loop,)), edge_distance=off[sound])


def _drawn_to_edge(
    face: "_Face", height: Floats, points: Floats, start: tuple[Floats, Bools], unfolded: tuple[Floats, Floats]
) -> tuple[BSplineSurface, Floats, Bools]:
    """The face at heights (n,) when it has given way to the edge, (m, 2) the edge on it, (m,) where it is no chip.

    points    (m, 3) of the edge
    start     (m, 2) foot points to start from, (m,) where the smooth face found no chip
    unfolded  places of the face's nodes (n, 3) and of the edge (m, 3) between which distances are those along the wall

    A spline cannot follow every turn of the edge at once: what it missed is added again, a few times over.
    """
    surface = face.surface(height)
    uv, left = _missed(surface, points, start[0])
    sound = start[1] & (np.abs(left - _running_median(left)) <= max(CHIPPED, 6.0 * _spread(left[start[1]])))
    for _ in range(MEETINGS):
        height = height + _kriged(unfolded[1][sound], left[sound], unfolded[0])
        surface = face.surface(height)
        uv, left = _missed(surface, points, uv)
    return surface, uv, sound


def _missed(surface: BSplineSurface, points: Floats, uv: Floats) -> tuple[Floats, Floats]:
    """(m, 2) foot points of points (m, 3), found from a guess, and (m,) how far outside the surface they lie."""
    uv = foot_points(surface, points, uv)
    return uv, np.einsum("ij,ij->i", points - surface.point(uv), surface.normal(uv))


@dataclass(frozen=True, eq=False)
class _Face:
    """A surface at the products of the Greville abscissae of finer knots: (n, 3) points and unit normals."""

    knots: tuple[Floats, Floats]
    abscissae: tuple[Floats, Floats]
    points: Floats
    normals: Floats

    @classmethod
    def over(cls, smooth: BSplineSurface, *, span: float, turns_back: bool) -> "_Face":
        """Knots of about the given distance in millimetres over the domain of a surface; where it turns back over a
        lip, its own knots along the profile, and more between them.
        """
        domain = np.array(smooth.domain)
        probe = np.stack(np.meshgrid(*np.linspace(domain[:, 0], domain[:, 1], 9).T, indexing="ij"), -1).reshape(-1, 2)
        speed = [np.linalg.norm(smooth.derivative(probe, 1 - k, k), axis=1).mean() for k in (0, 1)]
        length = speed * np.ptp(domain, 1)
        counts = np.clip(np.ceil(length / span), 4, MOST_SPANS).astype(int)
        knots = [uniform_knots(n + 3, 3, *side) for n, side in zip(counts, domain)]
        if turns_back:
            knots[1] = _refined(smooth.knots_v, span / speed[1])
        # the mean of equal knots may round to a value beyond them, which the interpolation refuses
        u, v = (np.clip(greville(k, 3), k[0], k[-1]) for k in knots)
        uv = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
        return cls((knots[0], knots[1]), (u, v), smooth.grid(u, v).reshape(-1, 3), smooth.normal(uv))

    def surface(self, height: Floats) -> BSplineSurface:
        """The bicubic surface through the points, moved by (n,) heights along their normals."""
        u, v = self.abscissae
        moved = (self.points + height[:, None] * self.normals).reshape(len(u), len(v), 3)
        rows = make_interp_spline(u, moved, k=3, t=self.knots[0]).c
        net = make_interp_spline(v, rows.transpose(1, 0, 2), k=3, t=self.knots[1]).c.transpose(1, 0, 2)
        return BSplineSurface(3, 3, *self.knots, net)


def _refined(knots: Floats, span: float) -> Floats:
    """Clamped knots with as many more between them, evenly, as it takes that none are farther apart than the span."""
    breaks = np.unique(knots)
    many = np.maximum(np.ceil(np.diff(breaks) / span - 0.25), 1).astype(int)
    inner = [np.linspace(a, b, n, endpoint=False) for a, b, n in zip(breaks, breaks[1:], many)]
    return np.concatenate([breaks[[0] * 3], *inner, breaks[[-1] * 4]])


def _running_median(values: Floats, reach: int = 6) -> Floats:
    """(n,) median over `reach` neighbours on either side in a closed row."""
    return np.asarray(np.median([np.roll(values, k) for k in range(-reach, reach + 1)], axis=0))


def _spread(values: Floats) -> float:
    return 1.4826 * float(np.median(np.abs(values - np.median(values)))) if len(values) else 0.0


def _kriged(edge: Floats, left: Floats, points: Floats) -> Floats:
    """(n,) best guess at points (n, 3) of what is left at points of the edge (m, 3), fading into the hole.

    Its covariance has two lengths: the shortest that the face can follow, for chips and what was foretold wrongly, and
    the one over which the edge forgets itself, for sherds out of place.
    """
    row = even_points(np.column_stack([edge, left]), EDGE_STEP)
    place, value = row[:, :3], row[:, 3]
    lengths = FADING[0], _forgotten(value)
    inner = cho_factor(_covariance(cdist(place, place, "sqeuclidean"), lengths) + NUGGET * np.eye(len(place)))
    return np.asarray(_covariance(cdist(points, place, "sqeuclidean"), lengths) @ cho_solve(inner, value))


def _covariance(squared: Floats, lengths: tuple[float, float]) -> Floats:
    return np.asarray(0.5 * sum(np.exp(-squared / length**2) for length in lengths))


def _forgotten(value: Floats) -> float:
    """The length in millimetres along the edge at which its autocorrelation has fallen to 1/e."""
    correlation = np.fft.irfft(np.abs(np.fft.rfft(value)) ** 2, len(value))
    below = np.flatnonzero(correlation[: len(value) // 2] < correlation[0] / np.e)
    return float(np.clip((below[0] if len(below) else len(value) // 2) * EDGE_STEP, *FADING))

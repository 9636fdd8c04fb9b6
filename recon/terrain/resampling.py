"""Step 1, resampling: every contour becomes a cubic spline in plan with continuous curvature.

Contours are fitted one by one, since their splines share nothing (`recon.numerics.smoothing_spline`). Knot spans whose
points lie farther than allowed are halved, spans more than twice as long as a neighbour too; after every solve the
points slide to their feet on the curve. Allowed is the tolerance, or less where another contour, or another bend of the
same one, is so near that the two curves could meet.

Paper  [zhang2006], section 3 (1), where the samples are even; here they follow the tolerance.
"""

from copy import copy
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from recon.geometry.contour_map import ContourMap
from recon.numerics.smoothing_spline import bezier_segments, fitted_coefficients, fitted_knots, worst_misses
from recon.terrain.contour_curves import ContourCurves, segments_of

__all__ = ["ContourFits", "ContourSamples", "contour_samples", "point_spacing"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

STIFFNESS = 0.12  # of the span: the wavelength below which a spline stops to follow its points is 2 pi times this
SHARPEST = np.radians(100.0)  # turning of a span above which it is a kink: it and its neighbours are made stiffer
SLOWEST, STIFFER, SMOOTHINGS = 0.5, 1.4, 4  # length over parameter that is a kink too; the step; how often
OVER = 1.2  # tolerances that a curve may miss its points by once it is stiffer; else it stays as it was
LONGEST = 12.0  # spacings of the given points a knot span covers at most
DENSE = 0.5  # spacings between two given points above which points are put between them
TIGHT_REACH, TIGHTER, MOST_NAMED = 1.5, 0.2, 5  # spacings around a place where curves met; what is allowed there
AT_ONCE = 1 << 14  # samples, which bounds the memory and keeps it near
NEIGHBOURS = 12  # samples among which another strand is looked for
BEND = 4.0  # two samples of one contour are on different strands when the way along it is so many times the way across
APPROACH = (
    4.0  # spacings before an end whose tangent is given: there a curve that keeps to that leaves the border in time
)
ROOM, LEAST = 0.2, 0.02  # share of the way to another strand, and of the tolerance, that a sample may miss
SHORTEST = 1.5  # of what its points may miss: no shorter span is halved
RING_SPANS = 6  # knot spans of a closed contour at least
BOUND_SPANS = 3  # and of one whose tangents and curvatures are given at its ends


@dataclass(frozen=True, eq=False)
class ContourSamples:
    """Points of all contours in one row: place, parameter, length that each stands for, contour, way to another strand.

    first    (C + 1,) place at which the samples of every contour begin
    ends     (C, 2, 2, 2) tangent and curvature vector with which a contour begins and ends, NaN where that is free
    closed   (C,), heights  (C,), spacing  metres between the points given
    """

    points: Floats
    parameter: Floats
    weight: Floats
    contour: Ints
    room: Floats
    first: Ints
    closed: Flags
    heights: Floats
    spacing: float
    ends: Floats


def point_spacing(contours: ContourMap) -> float:
    """Median distance between neighbouring points of the contours, in metres: the detail they were digitised with."""
    steps = np.concatenate([np.linalg.norm(np.diff(line, axis=0), axis=1) for line in contours.lines])
    return float(np.median(steps[steps > 0]))


class ContourFits:
    """Fits of the same contours, one after another: a spline whose points may miss what they might before is kept."""

    def __init__(self, samples: ContourSamples) -> None:
        self._samples = samples
        self._known: dict[int, tuple[Floats, float, _Spline]] = {}

    def curves(self, tolerance: float, tight: Floats | None = None) -> ContourCurves:
        """Splines through the contours, to `tolerance` metres wherever the given points allow it.

        tight     (n, 2) places near which the curves of an earlier fit met: each time that one is named, the points
                  around may miss a fifth of what they might before
        Promises  ends of open contours are kept exactly; closed contours close with continuous curvature.
        Paper     [zhang2006], section 3 (1).
        """
        splines = self._splines(_allowed(self._samples, tolerance, tight))
        return _pliant(splines, self._samples, tolerance)

    def _splines(self, allowed: Floats) -> "list[_Spline]":
        narrow = allowed.max() / 2  # in narrow places the chord length keeps the curve in order
        splines = []
        for c, row in enumerate(slice(a, b) for a, b in pairwise(self._samples.first.tolist())):
            known = self._known.get(c)
            if known is None or known[1] != narrow or not np.array_equal(known[0], allowed[row]):
                known = allowed[row], narrow, _Spline.of(self._samples, c, row, (allowed, narrow))
                self._known[c] = known
            splines.append(known[2].again())
        return splines


def _allowed(samples: ContourSamples, tolerance: float, tight: Floats | None) -> Floats:
    """(m,) metres that a curve may miss each sample by."""
    allowed = np.clip(ROOM * samples.room, LEAST * tolerance, tolerance)
    if tight is not None and len(tight):
        allowed = _tightened(samples, allowed, tight)
    return allowed


def _pliant(splines: "list[_Spline]", samples: ContourSamples, tolerance: float) -> ContourCurves:
    """The segments of splines that are made stiffer, within a tolerance, where they have kinks."""
    curves = _segments(splines, samples)
    for _ in range(SMOOTHINGS - 1):
        kinked = (curves.turning() > SHARPEST) | (curves.lengths() < SLOWEST * curves.span)
        given_way = False
        for c in np.unique(curves.contour[kinked]).tolist():
            given_way |= splines[c].stiffen(kinked[curves.contour == c], tolerance)
        if not given_way:
            break
        curves = _segments(splines, samples)
    return curves


class _Spline:
    """The spline of one contour: knots, stiffness of every span, coefficients."""

    def __init__(self, rows: tuple[Floats, ...], knots: Floats, ring: bool, fixed: Flags, ends: Floats) -> None:
        self.points, self.weight, self.parameter = rows
        self.knots, self.ring, self._fixed, self._ends = knots, ring, fixed, ends
        self._stiffness = np.full(len(knots) - 1, STIFFNESS)
        self._fit()

    @classmethod
    def of(cls, samples: ContourSamples, contour: int, row: slice, misses: tuple[Floats, float]) -> "_Spline":
        ring, ends = bool(samples.closed[contour]), samples.ends[contour]
        points, weight, parameter = samples.points[row], samples.weight[row], samples.parameter[row]
        allowed, narrow = misses[0][row], misses[1]
        length = float(weight.sum())
        least = RING_SPANS if ring else BOUND_SPANS if np.isfinite(ends).any() else 1
        n = max(least, int(np.ceil(length / (LONGEST * samples.spacing))))
        knots = np.linspace(0.0, length, n + 1)
        fixed = allowed < narrow
        rows = points, weight, parameter, allowed, fixed
        knots, parameter = fitted_knots(rows, knots, ring, STIFFNESS, SHORTEST, ends)
        return cls((points, weight, parameter), knots, ring, fixed, ends)

    def again(self) -> "_Spline":
        """The same spline, to be made stiffer on its own."""
        other = copy(self)
        other._stiffness = self._stiffness.copy()
        return other

    def _fit(self) -> None:
        self.coefficients = fitted_coefficients(
            self.points, self.weight, self.parameter, self.knots, self.ring, self._stiffness, self._ends
        )

    def stiffen(self, kinked: Flags, tolerance: float) -> bool:
        """Make kinked spans and those beside them stiffer, as far as the points allow; whether any could be."""
        if len(kinked) <= RING_SPANS:  # shorter curves cannot give way
            return False
        beside, before = _with_neighbours(kinked) & (self.misses() < tolerance), self._stiffness.copy()
        self._stiffness[beside] *= STIFFER
        self._fit()
        astray = _with_neighbours(self.misses() > OVER * tolerance)
        if astray.any():
            self._stiffness[astray] = before[astray]
            self._fit()
        return bool((beside & ~astray).any())

    def misses(self) -> Floats:
        """(n,) the farthest that a point of each span lies from the spline."""
        return worst_misses(self.points, self.parameter, self._fixed, self.knots, self.coefficients, self.ring)


def _with_neighbours(spans: Flags) -> Flags:
    """(n,) the spans, and those on either side of them."""
    wider = spans.copy()
    wider[1:] |= spans[:-1]
    wider[:-1] |= spans[1:]
    return wider


def contour_samples(contours: ContourMap, spacing: float, ends: Floats | None = None) -> ContourSamples:
    """The points that splines are fitted to, made once for all fits.

    spacing  metres between the points given
    ends     (C, 2, 2, 2) as in ContourSamples; None: all are free
    """
    closed = np.array([bool((line[0] == line[-1]).all()) and len(line) > 3 for line in contours.lines])
    points, parameter, weight = zip(*(_densified(*row, DENSE * spacing) for row in zip(contours.lines, closed)))
    first = np.r_[0, np.cumsum([len(p) for p in points])]
    contour = np.repeat(np.arange(len(points)), np.diff(first))
    rows = np.concatenate(points), np.concatenate(parameter), np.concatenate(weight), contour
    ends = np.full((len(closed), 2, 2, 2), np.nan) if ends is None else ends
    approach = np.where(np.isfinite(ends).any(axis=(1, 2, 3)), APPROACH * spacing, 0.0)
    room = np.minimum(_way_to_another_strand(*rows), _way_to_border(rows, closed, approach, contours))
    return ContourSamples(*rows, room, first, closed, contours.heights, spacing, ends)


def _densified(line: Floats, ring: bool, widest: float) -> tuple[Floats, Floats, Floats]:
    """The given points, and points between those that are far apart; parameter, and length that each stands for."""
    step = np.linalg.norm(np.diff(line, axis=0), axis=1)
    line = line[np.r_[True, step > 0]]
    step = step[step > 0]
    parts = np.maximum(np.ceil(step / widest).astype(int), 1)
    leg = np.repeat(np.arange(len(step)), parts)
    share = (np.arange(len(leg)) - np.repeat(np.cumsum(parts) - parts, parts)) / parts[leg]
    s = np.r_[np.r_[0.0, np.cumsum(step)][leg] + share * step[leg], step.sum()]
    dense = np.vstack([line[leg] + share[:, None] * (line[leg + 1] - line[leg]), line[-1]])
    half = np.r_[0.0, np.diff(s), 0.0] / 2
    own = half[:-1] + half[1:]
    if not ring:
        return dense, s, own
    own[0] += own[-1]
    return dense[:-1], s[:-1], own[:-1]


def _way_to_another_strand(points: Floats, parameter: Floats, weight: Floats, contour: Ints) -> Floats:
    """(m,) distance of every sample to the nearest leg of another contour, or of another bend of its own."""
    tree = cKDTree(points)
    length: Floats = np.bincount(contour, weight)[contour].astype(np.float64)
    pieces = [slice(a, a + AT_ONCE) for a in range(0, len(points), AT_ONCE)]
    return np.concatenate([_strange_ways(piece, tree, (points, parameter, length, contour)) for piece in pieces])


def _strange_ways(own: slice, tree: cKDTree, rows: tuple[Floats, Floats, Floats, Ints]) -> Floats:
    """The same for some of the samples."""
    points, parameter, length, contour = rows
    m = len(points)
    _, near = tree.query(points[own], k=min(NEIGHBOURS, m))
    way = np.full(len(near), np.inf)
    for begin, end in ((near, np.minimum(near + 1, m - 1)), (np.maximum(near - 1, 0), near)):
        end = np.where(contour[begin] == contour[end], end, begin)
        leg = points[end] - points[begin]
        off = points[own, None] - points[begin]
        share = np.einsum("mkd,mkd->mk", off, leg) / np.maximum(np.einsum("mkd,mkd->mk", leg, leg), 1e-300)
        share = np.clip(share, 0.0, 1.0)
        distance = np.linalg.norm(off - share[..., None] * leg, axis=2)
        foot = parameter[begin] + share * (parameter[end] - parameter[begin])
        along = np.abs(foot - parameter[own, None])
        along = np.minimum(along, np.abs(length[own, None] - along))  # an open contour's ends come to be own strand
        strange = (contour[begin] != contour[own, None]) | (along > BEND * np.maximum(distance, 1e-12))
        way = np.minimum(way, np.where(strange, distance, np.inf).min(axis=1))
    return way


def _way_to_border(
    rows: tuple[Floats, Floats, Floats, Ints], closed: Flags, approach: Floats, contours: ContourMap
) -> Floats:
    """(m,) distance of every sample to the border of the map or a void, but for where its contour is about to end.

    approach  (C,) way to the end of each contour within which it is, however near the border it runs
    """
    points, parameter, weight, contour = rows
    border = shapely.MultiLineString([contours.outline, *contours.voids])
    shapely.prepare(border)
    way = np.asarray(shapely.distance(border, shapely.points(points)))
    length = np.bincount(contour, weight)[contour]
    to_end = np.where(closed[contour], np.inf, np.minimum(parameter, length - parameter))
    return np.where(to_end > np.maximum(BEND * way, approach[contour]), way, np.inf)


def _tightened(samples: ContourSamples, allowed: Floats, places: Floats) -> Floats:
    named = cKDTree(places).query_ball_point(samples.points, TIGHT_REACH * samples.spacing, return_length=True)
    return np.asarray(allowed * TIGHTER ** np.minimum(named, MOST_NAMED))


def _segments(splines: list[_Spline], samples: ContourSamples) -> ContourCurves:
    bezier = np.concatenate([bezier_segments(s.knots, s.coefficients, s.ring) for s in splines])
    span = np.concatenate([np.diff(s.knots) for s in splines])
    owner = np.repeat(np.arange(len(splines)), [len(s.knots) - 1 for s in splines])
    curves = segments_of(bezier, span, owner, samples.closed, samples.heights)
    return replace(curves, bound=np.asarray(np.isfinite(samples.ends).any(axis=(1, 2, 3))))

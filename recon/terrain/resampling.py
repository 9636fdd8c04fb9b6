"""Step 1, resampling: every contour becomes a cubic spline in plan with continuous curvature.

All contours are fitted in one sparse least-squares solve a round, since their splines share nothing:

    minimise  sum w_i |c(s_i) - p_i|^2 + sum (stiffness * h_j)^4 integral over [t_j, t_j+1] of |c''|^2 ds

Knot spans whose points lie farther than allowed are halved, spans more than twice as long as a neighbour too;
after every solve the points slide to their feet on the curve. Allowed is the tolerance, or less where another contour,
or another bend of the same one, is so near that the two curves could meet.

Paper  [zhang2006], section 3 (1), where the samples are even; here they follow the tolerance.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from recon.geometry.contour_map import ContourMap
from recon.terrain.contour_curves import ContourCurves, segments_of

__all__ = ["fit_contours", "point_spacing"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

ROUNDS = 14
STIFFNESS = 0.12  # of the span: the wavelength below which a spline stops to follow its points is 2 pi times this
SHARPEST = np.radians(100.0)  # turning of a span above which it is a kink: it and its neighbours are made stiffer
SLOWEST, STIFFER, SMOOTHINGS = 0.5, 1.4, 4  # length over parameter that is a kink too; the step; how often
LONGEST = 12.0  # spacings of the given points a knot span covers at most
DENSE = 0.5  # spacings between two given points above which points are put between them
TIGHT_REACH, TIGHTER, MOST_NAMED = 1.5, 0.2, 5  # spacings around a place where curves met; what is allowed there
NEIGHBOURS = 12  # samples among which another strand is looked for
BEND = 4.0  # two samples of one contour are on different strands when the way along it is so many times the way across
ROOM, LEAST = 0.2, 0.02  # share of the way to another strand, and of the tolerance, that a sample may miss
SHORTEST = 1.5  # of what its points may miss: no shorter span is halved
RING_SPANS = 6  # knot spans of a closed contour at least


@dataclass(frozen=True, eq=False)
class _Samples:
    """Points of all contours in one row: place, parameter, length that each stands for, contour, allowed miss."""

    points: Floats
    parameter: Floats
    weight: Floats
    contour: Ints
    allowed: Floats


@dataclass(frozen=True, eq=False)
class _Knots:
    """Knots of all contours in one row, three more on either side of each: `first` is the place of each one's t_0."""

    padded: Floats
    first: Ints
    spans: Ints
    closed: NDArray[np.bool_]

    @property
    def first_coefficient(self) -> Ints:
        return np.r_[0, np.cumsum(self.spans + 3 * ~self.closed)]


def point_spacing(contours: ContourMap) -> float:
    """Median distance between neighbouring points of the contours, in metres: the detail they were digitised with."""
    steps = np.concatenate([np.linalg.norm(np.diff(line, axis=0), axis=1) for line in contours.lines])
    return float(np.median(steps[steps > 0]))


def fit_contours(contours: ContourMap, tolerance: float, tight: Floats | None = None) -> ContourCurves:
    """Splines through the contours, to `tolerance` metres wherever the given points allow it.

    tight     (n, 2) places near which the curves of an earlier fit met: each time that one is named, the points around
              may miss a fifth of what they might before
    Promises  ends of open contours are kept exactly; closed contours close with continuous curvature.
    Paper     [zhang2006], section 3 (1).
    """
    spacing = point_spacing(contours)
    closed = np.array([bool((line[0] == line[-1]).all()) and len(line) > 3 for line in contours.lines])
    samples = _with_room(_samples(contours, closed, DENSE * spacing), tolerance)
    if tight is not None and len(tight):
        samples = _tightened(samples, tight, TIGHT_REACH * spacing)
    lengths = np.bincount(samples.contour, samples.weight, len(closed))
    n_first = np.maximum(np.where(closed, RING_SPANS, 1), np.ceil(lengths / (LONGEST * spacing)).astype(int))
    knots = [np.linspace(0.0, length, n + 1) for length, n in zip(lengths, n_first)]
    for _ in range(ROUNDS):
        flat = _padded(knots, closed)
        coefficients = _fitted(samples, flat)
        samples, distance = _at_feet(samples, flat, coefficients)
        halved = _refined(samples, distance, flat, knots)
        if halved is None:
            break
        knots = halved
    flat = _padded(knots, closed)
    return _without_kinks(samples, flat, contours.heights, tolerance)


def _without_kinks(samples: _Samples, knots: _Knots, heights: Floats, tolerance: float) -> ContourCurves:
    """Segments of the splines, with stiffer spans where they would turn sharply, as far as the points allow."""
    stiffer = np.ones(knots.spans.sum())
    at = np.concatenate([np.arange(f, f + n) for f, n in zip(knots.first, knots.spans)])
    for _ in range(SMOOTHINGS):
        coefficients = _fitted(samples, knots, stiffer)
        curves = _segments(knots, coefficients, heights)
        kinked = (curves.turning() > SHARPEST) | (curves.lengths() < SLOWEST * curves.span)
        kinked &= knots.spans[curves.contour] > RING_SPANS  # shorter curves cannot give way
        if not kinked.any():
            break
        worst = np.zeros(len(knots.padded))
        moved, distance = _at_feet(samples, knots, coefficients)
        np.maximum.at(worst, _span_of(knots, moved.contour, moved.parameter), distance)
        same = curves.contour[1:] == curves.contour[:-1]
        beside = kinked.copy()
        beside[1:] |= kinked[:-1] & same
        beside[:-1] |= kinked[1:] & same
        stiffer[beside & (worst[at] < tolerance)] *= STIFFER
    return curves


def _samples(contours: ContourMap, closed: NDArray[np.bool_], widest: float) -> _Samples:
    """The given points, and points between those that are far apart, with the length of line that each stands for."""
    points, parameter, weight = [], [], []
    for line, ring in zip(contours.lines, closed):
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
        if ring:
            own[0] += own[-1]
            dense, s, own = dense[:-1], s[:-1], own[:-1]
        points.append(dense)
        parameter.append(s)
        weight.append(own)
    contour = np.repeat(np.arange(len(points)), [len(p) for p in points])
    allowed = np.full(len(contour), np.inf)
    return _Samples(np.concatenate(points), np.concatenate(parameter), np.concatenate(weight), contour, allowed)


def _with_room(samples: _Samples, tolerance: float) -> _Samples:
    """The samples with what each may miss: a share of the way to the nearest strand that is not its own."""
    distance, other = cKDTree(samples.points).query(samples.points, k=min(NEIGHBOURS, len(samples.points)))
    along = np.abs(samples.parameter[other] - samples.parameter[:, None])
    length = np.bincount(samples.contour, samples.weight)[samples.contour][:, None]
    along = np.minimum(along, np.abs(length - along))  # wrong for open contours, whose ends only come to be own strand
    strange = (samples.contour[other] != samples.contour[:, None]) | (along > BEND * distance)
    near = np.where(strange, distance, np.inf).min(axis=1)
    floor = LEAST * tolerance
    return replace(samples, allowed=np.clip(ROOM * near, floor, tolerance))


def _tightened(samples: _Samples, places: Floats, reach: float) -> _Samples:
    named = cKDTree(places).query_ball_point(samples.points, reach, return_length=True)
    return replace(samples, allowed=samples.allowed * TIGHTER ** np.minimum(named, MOST_NAMED))


def _padded(knots: list[Floats], closed: NDArray[np.bool_]) -> _Knots:
    padded = [
        np.r_[t[-4:-1] - t[-1], t, t[-1] + t[1:4]] if ring else np.r_[[t[0]] * 3, t, [t[-1]] * 3]
        for t, ring in zip(knots, closed)
    ]
    sizes = np.array([len(t) for t in padded])
    return _Knots(np.concatenate(padded), np.cumsum(sizes) - sizes + 3, sizes - 7, closed)


def _span_of(knots: _Knots, contour: Ints, s: Floats) -> Ints:
    """(m,) place in `padded` of the knot at which the span of every parameter starts."""
    starts = np.concatenate([np.arange(f, f + n) for f, n in zip(knots.first, knots.spans)])
    owner = np.repeat(np.arange(len(knots.spans)), knots.spans)
    far = knots.padded.max() + 1.0
    at = np.searchsorted(knots.padded[starts] + far * owner, s + far * contour, side="right") - 1
    first = np.r_[0, np.cumsum(knots.spans)]
    return starts[np.clip(at, first[contour], first[contour + 1] - 1)]


def _basis(knots: _Knots, contour: Ints, at: Ints, s: Floats, order: int) -> sparse.csr_array:
    """(m, n) cubic B-spline values, or derivatives of the given order, by the recursion of Cox and de Boor."""
    t = knots.padded[at[:, None] + np.arange(-2, 4)]
    values = _local_basis(t, s, order)
    local = at[:, None] - knots.first[contour][:, None] + np.arange(4)
    n_own = (knots.spans + 3 * ~knots.closed)[contour][:, None]
    columns = knots.first_coefficient[contour][:, None] + local % n_own
    pointer = np.arange(0, 4 * len(s) + 1, 4)
    return sparse.csr_array((values.ravel(), columns.ravel(), pointer), shape=(len(s), knots.first_coefficient[-1]))


def _local_basis(t: Floats, s: Floats, order: int) -> Floats:
    """(m, 4) the four cubic basis functions of the span [t_2, t_3], `t` (m, 6); order 0, 1 or 2."""
    degree = 3 - order
    values = np.ones((len(s), 1))
    for p in range(1, degree + 1):
        values = _raised(values, t, s, p)
    for p in range(degree + 1, 4):
        width = np.stack([t[:, 3 + k] - t[:, 3 + k - p] for k in range(p)], axis=1)
        slope = p * values / width
        pad = np.zeros((len(s), 1))
        values = np.hstack([pad, slope]) - np.hstack([slope, pad])
    return values


def _raised(values: Floats, t: Floats, s: Floats, p: int) -> Floats:
    raised = np.zeros((len(s), p + 1))
    for k in range(p):
        left, right = t[:, 3 + k - p], t[:, 3 + k]
        share = values[:, k] / (right - left)
        raised[:, k] += share * (right - s)
        raised[:, k + 1] += share * (s - left)
    return raised


def _fitted(samples: _Samples, knots: _Knots, stiffer: Floats | None = None) -> Floats:
    """(n, 2) coefficients of all splines; the first and last of an open one are its contour's own ends."""
    b = _basis(knots, samples.contour, _span_of(knots, samples.contour, samples.parameter), samples.parameter, 0)
    weighted = b.multiply(samples.weight[:, None]).T
    matrix = weighted @ b + _stiffness(knots, np.ones(knots.spans.sum()) if stiffer is None else stiffer)
    right = weighted @ samples.points
    ends, where = _kept_ends(samples, knots)
    free = np.setdiff1d(np.arange(matrix.shape[0]), ends)
    out = np.empty((matrix.shape[0], 2))
    out[ends] = samples.points[where]
    matrix = sparse.csr_array(matrix)
    rows = matrix[free]
    if len(free):
        out[free] = splu(sparse.csc_array(rows[:, free])).solve(right[free] - rows[:, ends] @ out[ends])
    return out


def _kept_ends(samples: _Samples, knots: _Knots) -> tuple[Ints, Ints]:
    """Coefficients at the ends of open contours, and the samples that they equal."""
    opened = np.flatnonzero(~knots.closed)
    first = np.searchsorted(samples.contour, opened)
    last = np.searchsorted(samples.contour, opened, side="right") - 1
    begin = knots.first_coefficient
    return np.r_[begin[opened], begin[opened + 1] - 1], np.r_[first, last]


def _stiffness(knots: _Knots, stiffer: Floats) -> sparse.csr_array:
    """(n, n) the bending term: the second derivative is linear on a span, so two Gauss points integrate its square."""
    owner = np.repeat(np.arange(len(knots.spans)), knots.spans)
    at = np.concatenate([np.arange(f, f + n) for f, n in zip(knots.first, knots.spans)])
    low, high = knots.padded[at], knots.padded[at + 1]
    total: sparse.csr_array | None = None
    for place in (0.5 - np.sqrt(1 / 12), 0.5 + np.sqrt(1 / 12)):
        b = _basis(knots, owner, at, low + place * (high - low), 2)
        term = b.multiply((stiffer * STIFFNESS * (high - low))[:, None] ** 4 * (high - low)[:, None] / 2).T @ b
        total = term if total is None else total + term
    return total


def _at_feet(samples: _Samples, knots: _Knots, coefficients: Floats) -> tuple[_Samples, Floats]:
    """The samples one Gauss-Newton step nearer to their feet, in order along the contour, and their distance."""
    at = _span_of(knots, samples.contour, samples.parameter)
    miss = samples.points - _basis(knots, samples.contour, at, samples.parameter, 0) @ coefficients
    speed = _basis(knots, samples.contour, at, samples.parameter, 1) @ coefficients
    square = np.maximum(np.einsum("ij,ij->i", speed, speed), 1e-12)
    step = np.einsum("ij,ij->i", miss, speed) / square
    room = np.minimum(np.diff(samples.parameter, prepend=-np.inf), np.diff(samples.parameter, append=np.inf))
    room[np.r_[True, np.diff(samples.contour) > 0]] = 0.0  # first and last points stay
    room[np.r_[np.diff(samples.contour) > 0, True]] = 0.0
    room[samples.allowed < samples.allowed.max() / 2] = (
        0.0  # in narrow places the chord length keeps the curve in order
    )
    step = np.clip(step, -0.4 * np.maximum(room, 0), 0.4 * np.maximum(room, 0))
    distance = np.linalg.norm(miss - step[:, None] * speed, axis=1)
    return replace(samples, parameter=samples.parameter + step), distance


def _refined(samples: _Samples, distance: Floats, flat: _Knots, knots: list[Floats]) -> list[Floats] | None:
    """Knots with spans halved where a point is too far, or a neighbour less than half as long; None when done."""
    worst = np.zeros(len(flat.padded))
    finest = np.full(len(flat.padded), np.inf)
    at = _span_of(flat, samples.contour, samples.parameter)
    np.maximum.at(worst, at, distance / samples.allowed)
    np.minimum.at(finest, at, samples.allowed)
    changed, out = False, []
    for t, first, n, ring in zip(knots, flat.first, flat.spans, flat.closed):
        width = np.diff(t)
        chosen = (worst[first : first + n] > 1.0) & (width > SHORTEST * finest[first : first + n])
        if chosen.any():
            changed = True
            t = _graded(np.sort(np.r_[t, (t[:-1] + t[1:])[chosen] / 2]), bool(ring))
        out.append(t)
    return out if changed else None


def _graded(t: Floats, ring: bool) -> Floats:
    """Knots with every span at most twice as long as its neighbours."""
    while True:
        width = np.diff(t)
        ends = (width[-1], width[0]) if ring else (np.inf, np.inf)
        neighbour = np.minimum(np.r_[ends[0], width[:-1]], np.r_[width[1:], ends[1]])
        chosen = width > 2.001 * neighbour
        if not chosen.any():
            return t
        t = np.sort(np.r_[t, (t[:-1] + t[1:])[chosen] / 2])


def _segments(knots: _Knots, coefficients: Floats, heights: Floats) -> ContourCurves:
    owner = np.repeat(np.arange(len(knots.spans)), knots.spans)
    at = np.concatenate([np.arange(f, f + n) for f, n in zip(knots.first, knots.spans)])
    low, high = knots.padded[at], knots.padded[at + 1]
    ends = [_basis(knots, owner, at, s, 0) @ coefficients for s in (low, high)]
    slopes = [_basis(knots, owner, at, s, 1) @ coefficients for s in (low, high)]
    third = ((high - low) / 3)[:, None]
    bezier = np.stack([ends[0], ends[0] + third * slopes[0], ends[1] - third * slopes[1], ends[1]], axis=1)
    same = owner[1:] == owner[:-1]
    bezier[1:, 0][same] = bezier[:-1, 3][same]  # one point, to the last bit
    begin, opened = knots.first_coefficient, np.flatnonzero(~knots.closed)
    stops = np.cumsum(knots.spans)
    bezier[(stops - knots.spans)[opened], 0] = coefficients[begin[opened]]  # on the border, to the last bit
    bezier[stops[opened] - 1, 3] = coefficients[begin[opened + 1] - 1]
    return _closed_exactly(segments_of(bezier, high - low, owner, knots.closed, heights))


def _closed_exactly(curves: ContourCurves) -> ContourCurves:
    points = curves.vertices()
    bezier = curves.bezier.copy()
    bezier[:, 3] = points[curves.end]
    return ContourCurves(bezier, curves.span, curves.contour, curves.closed, curves.heights, curves.start, curves.end)

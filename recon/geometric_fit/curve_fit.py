"""From a row of points to a B-spline curve, step by step as in [maekawa2009].

    1. characteristic points   kept by Douglas and Peucker; breaks are their lengths along the row
    2. foot points             Newton's method on the curve
    3. move                    control points move by the error vectors, by the rule that `CurveUpdate` names
    4. errors                  mean, root mean square and largest distance
    5. refine                  after some rounds, breaks where the error is, until the tolerance or a number is met

Chaikin's scheme is the quadratic case: its control polygon is cut at equal breaks, and refined everywhere at once. As
many control points as data points interpolate.

    t       parameters of the feet, at first the lengths along the row
    mu      weight of the way along the tangent beside that across
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum
from time import perf_counter

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

from recon.errors import BadGeometry, BadOption
from recon.geometric_fit.characteristic_points import characteristic_points
from recon.geometric_fit.convergence import Norms, Round, StoppedBy, norms
from recon.geometric_fit.curve_feet import curve_lengths, nearest_curve_feet, walk_curve_feet
from recon.geometric_fit.curve_moves import CurveUpdate, curve_move
from recon.geometric_fit.spline_space import SplineSpace
from recon.geometry.bspline import BSplineCurve

__all__ = ["CurveKind", "CurveOptions", "CurveUpdate", "FittedCurve", "fit_curve"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

ROUNDS = 5  # before breaks are added
MOST_CYCLES = 60
SETTLED = 1e-3  # of the root mean square error: a round that gains less is the last of its cycle
GAIN = 0.02  # of the largest error: three cycles that gain less end the fit
GROWTH = 0.5  # most control points added in a cycle, beside those there are
BEGINNING = 0.6  # of the control points that were asked for, at the start; the others go where the error is
ASTRAY = 0.1  # of the length, by which a foot may be ahead of its point
FIRST_POINTS = 8  # at least, at the start of a fit to a tolerance
COARSE = 50.0  # tolerances within which the first polygon keeps the shape
DEFAULT_TOLERANCE = 1e-3  # of the diagonal, where neither a tolerance nor a number was given


class CurveKind(StrEnum):
    """What the curve is made of."""

    BSPLINE = "bspline"
    CHAIKIN = "chaikin"


@dataclass(frozen=True)
class CurveOptions:
    """What a user may choose.

    kind            BSPLINE, or CHAIKIN: quadratic, with equal breaks
    degree          of a B-spline
    closed          whether the last point is followed by the first
    tolerance       length, largest distance of a point from the curve; None leaves it to the other
    control_points  at most so many; as many as there are points, or more, interpolate
    update          the rule by which control points move
    Raises  BadOption.
    """

    kind: CurveKind = CurveKind.BSPLINE
    degree: int = 3
    closed: bool = False
    tolerance: float | None = None
    control_points: int | None = None
    update: CurveUpdate = CurveUpdate.TANGENT

    def __post_init__(self) -> None:
        if not 1 <= self.degree <= 9:
            raise BadOption("--degree", f"must be 1 to 9, not {self.degree}")
        if self.tolerance is not None and not 0.0 < self.tolerance < np.inf:
            raise BadOption("--tolerance", f"must be a positive length, not {self.tolerance}")
        least = self.curve_degree + 1
        if self.control_points is not None and self.control_points < least:
            raise BadOption("--control-points", f"a curve of degree {self.curve_degree} needs at least {least}")

    @property
    def curve_degree(self) -> int:
        return 2 if self.kind is CurveKind.CHAIKIN else self.degree


@dataclass(frozen=True, eq=False)
class FittedCurve:
    """A fitted curve and how it came about.

    curve       clamped; a closed one begins and ends at its seam, where it is as smooth as elsewhere
    polygon     (k, d) control points, of a closed curve without repetition
    distances   (n,) of the points from the curve, exact foot points
    errors      the same in per cent of the diagonal
    rounds      the record
    """

    curve: BSplineCurve
    polygon: Floats
    distances: Floats
    errors: Norms
    rounds: tuple[Round, ...]
    stopped_by: StoppedBy
    diagonal: float


def fit_curve(
    points: ArrayLike, options: CurveOptions | None = None, *, doing: Callable[[str], None] = lambda step: None
) -> FittedCurve:
    """Fit a curve to a row of points.

    points    (n, 2) or (n, 3) in order, in any unit; a point may repeat the one before it, and the last of a closed
              row the first
    doing     called with each round and its error
    Promises  an open curve begins at the first point and ends at the last.
    Raises    BadGeometry when fewer points differ than the degree needs; BadOption.
    Paper     [maekawa2009], paragraphs 0137 to 0147.
    """
    options = options or CurveOptions()
    row = _row(points, options)
    diagonal, middle = float(np.linalg.norm(np.ptp(row, axis=0))), row.mean(axis=0)
    fit = _begun((row - middle) / diagonal, options, diagonal)
    stopped_by = fit.run(doing)
    distances = fit.exact_distances() * diagonal
    if options.tolerance is not None and distances.max() <= options.tolerance:
        stopped_by = StoppedBy.TOLERANCE
    polygon = fit.control * diagonal + middle
    return FittedCurve(
        fit.space.curve(polygon),
        polygon,
        distances,
        norms(distances, diagonal),
        tuple(fit.record),
        stopped_by,
        diagonal,
    )


def _row(points: ArrayLike, options: CurveOptions) -> Floats:
    """The points, each different from the one before it."""
    row = np.asarray(points, dtype=np.float64)
    if row.ndim != 2 or row.shape[1] not in (2, 3) or not np.isfinite(row).all():
        raise BadGeometry("point row", "needs rows of two or three finite numbers")
    row = row[np.concatenate([np.ones(min(len(row), 1), bool), (np.diff(row, axis=0) != 0.0).any(axis=1)])]
    if options.closed and len(row) > 1 and (row[0] == row[-1]).all():
        row = row[:-1]
    needed = _least(options)
    if len(row) < needed:
        raise BadGeometry("point row", f"has {len(row)} different points where this curve needs at least {needed}")
    return row


def _least(options: CurveOptions) -> int:
    """Control points without which there is no curve; a periodic basis must not meet itself."""
    return options.curve_degree + (2 if options.closed else 1)


def _begun(points: Floats, options: CurveOptions, diagonal: float) -> "_CurveFit":
    """The first curve: characteristic points give its breaks, the row at the abscissae its control points."""
    closed, wanted = options.closed, options.control_points
    length = _lengths(points, closed)
    if wanted is not None and wanted >= len(points):
        return _interpolating(points, length, options)
    kept = _first_points(points, options, diagonal)
    if options.kind is CurveKind.CHAIKIN:
        spans = len(kept) if closed else len(kept) - options.curve_degree
        breaks = np.linspace(0.0, length[-1], spans + 1)
    else:
        breaks = _breaks(length[kept], length[-1], options)
    space = SplineSpace(options.curve_degree, breaks, closed)
    around = np.concatenate([points, points[:1]]) if closed else points
    control = np.stack([np.interp(space.abscissae(), length, column) for column in around.T], axis=1)
    places = length[: len(points)]
    return _CurveFit(points, options, diagonal, space, control, places / length[-1], places)


def _first_points(points: Floats, options: CurveOptions, diagonal: float) -> Ints:
    """Characteristic points for the first curve: a share of those asked for, or as many as keep the coarse shape."""
    wanted, least = options.control_points, _least(options)
    if options.tolerance is None and wanted is not None:
        return characteristic_points(points, max(least, round(BEGINNING * wanted)), closed=options.closed)
    tolerance = DEFAULT_TOLERANCE if options.tolerance is None else options.tolerance / diagonal
    most = len(points) if wanted is None else wanted
    kept = characteristic_points(points, most, closed=options.closed, within=COARSE * tolerance)
    if len(kept) >= min(most, FIRST_POINTS):
        return kept
    return characteristic_points(points, max(least, min(most, FIRST_POINTS)), closed=options.closed)


def _lengths(points: Floats, closed: bool) -> Floats:
    """Length along the row at every point; of a closed row once more at its end."""
    row = np.concatenate([points, points[:1]]) if closed else points
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(row, axis=0), axis=1))])


def _breaks(places: Floats, end: float, options: CurveOptions) -> Floats:
    """Breaks for as many control points as there are places: means of them, or around a loop themselves."""
    p = options.curve_degree
    if options.closed:
        around = np.append(places, places[0] + end)
        return around if p % 2 else np.append(0.5 * (around[:-1] + around[1:]), 0.5 * (around[0] + around[1]) + end)
    inner = [places[j : j + p].mean() for j in range(1, len(places) - p)]
    return np.concatenate([[0.0], inner, [end]])


def _interpolating(points: Floats, length: Floats, options: CurveOptions) -> "_CurveFit":
    """The limit case: a curve through every point at its length along the row."""
    feet = length[: len(points)]
    space = SplineSpace(options.curve_degree, _breaks(feet, length[-1], options), options.closed)
    control = np.asarray(splu(csc_array(space.rows(feet))).solve(points))
    return _CurveFit(points, options, 1.0, space, control, feet / length[-1], feet, interpolates=True)


@dataclass(eq=False)
class _CurveFit:
    """A fit on its way, in a box of diagonal 1; lengths that a user gave are in units of `diagonal`.

    shares  (n,) of the length of the row before each point
    feet    (n,) parameters at which the points stand on the curve
    """

    points: Floats
    options: CurveOptions
    diagonal: float
    space: SplineSpace
    control: Floats
    shares: Floats
    feet: Floats
    interpolates: bool = False
    record: list[Round] = field(default_factory=list)
    started: float = field(default_factory=perf_counter)

    @property
    def tolerance(self) -> float | None:
        """Share of the diagonal; None where the number of control points alone ends the fit."""
        if self.options.tolerance is not None:
            return self.options.tolerance / self.diagonal
        return DEFAULT_TOLERANCE if self.options.control_points is None else None

    def run(self, doing: Callable[[str], None]) -> StoppedBy:
        """Rounds and refinements until something ends them."""
        if self.interpolates:
            self._note(doing)
            return StoppedBy.CONTROL_POINTS
        idle, worst = 0, np.inf
        for _ in range(MOST_CYCLES):
            self._move(doing)
            largest = float(self.distances().max())
            if self.tolerance is not None and largest <= self.tolerance:
                return StoppedBy.TOLERANCE
            if self.space.n_control >= self._most():
                return StoppedBy.CONTROL_POINTS if self.options.control_points else StoppedBy.STAGNATION
            idle = idle + 1 if largest > (1.0 - GAIN) * worst else 0
            worst = min(worst, largest)
            if idle >= 3 and self.tolerance is not None:
                return StoppedBy.STAGNATION
            if not self._refine():
                return StoppedBy.STAGNATION
        return StoppedBy.ROUNDS

    def distances(self) -> Floats:
        """(n,) of the points from where they stand on the curve."""
        return np.asarray(np.linalg.norm(self.space.rows(self.feet) @ self.control - self.points, axis=1))

    def exact_distances(self) -> Floats:
        """(n,) of the points from the whole curve."""
        nearest = nearest_curve_feet(self.space, self.control, self.points)
        away = np.linalg.norm(self.space.rows(nearest) @ self.control - self.points, axis=1)
        return np.minimum(away, self.distances())

    def _most(self) -> int:
        limit = self.options.control_points
        return len(self.points) - 1 if limit is None else min(limit, len(self.points) - 1)

    def _move(self, doing: Callable[[str], None]) -> None:
        """Rounds of moving control points and feet, at most as many as the patent's."""
        fixed = np.empty(0, dtype=np.int64) if self.options.closed else np.array([0, self.space.n_control - 1])
        if not self.options.closed:
            self.control[[0, -1]] = self.points[[0, -1]]
        self.feet = self._unstuck()
        before = np.inf
        for _ in range(ROUNDS):
            self.feet = walk_curve_feet(self.space, self.control, self.points, self.feet)
            move = curve_move(self.space, self.control, self.points, self.feet, self.options.update, fixed=fixed)
            self.control = self.control + move
            rms = self._note(doing)
            if rms > (1.0 - SETTLED) * before:
                break
            before = rms
        self.feet = walk_curve_feet(self.space, self.control, self.points, self.feet)

    def _unstuck(self) -> Floats:
        """(n,) feet from where they stand, or the nearest of the curve: while it is coarse some walk to a wrong bend.

        A nearest foot counts only where the curve is about as long up to it as the row is up to its point: another turn
        of a spiral may be nearer.
        """
        walked = walk_curve_feet(self.space, self.control, self.points, self.feet)
        nearest = nearest_curve_feet(self.space, self.control, self.points)
        t, along = curve_lengths(self.space, self.control)
        ahead = np.interp(nearest, t, along) / along[-1] - self.shares
        if self.options.closed:
            ahead -= np.round(ahead)
        off = [np.linalg.norm(self.space.rows(at) @ self.control - self.points, axis=1) for at in (walked, nearest)]
        return np.where((np.abs(ahead) < ASTRAY) & (off[1] < off[0]), nearest, walked)

    def _note(self, doing: Callable[[str], None]) -> float:
        errors = norms(self.distances(), 1.0)
        entry = Round(len(self.record) + 1, self.space.n_control, errors, perf_counter() - self.started)
        self.record.append(entry)
        doing(f"round {entry.number}: {entry.control_points} control points, largest error {errors.maximum:.3g} %")
        return errors.rms

    def _refine(self) -> bool:
        """Add breaks where the errors are largest, in the middle of a span's feet; False where none can be split."""
        room = self._most() - self.space.n_control
        if self.options.kind is CurveKind.CHAIKIN:
            halves = 0.5 * (self.space.breaks[:-1] + self.space.breaks[1:])
            return len(halves) <= room and self._split(halves)
        span, away = self.space.span(self.feet), self.distances()
        worst = np.zeros(len(self.space.breaks) - 1)
        np.maximum.at(worst, span, away)
        order = np.lexsort((self.feet, span))
        held = np.bincount(span, minlength=len(worst))
        middle = np.cumsum(held) - held + held // 2
        wanted = np.flatnonzero((held >= 2) & (worst > (self.tolerance or 0.0)))
        most = min(room, max(1, int(GROWTH * self.space.n_control)))
        wanted = wanted[np.argsort(-worst[wanted], kind="stable")][:most]
        feet = self.space.within(self.feet)[order]
        return self._split(0.5 * (feet[middle[wanted] - 1] + feet[middle[wanted]]))

    def _split(self, more: Floats) -> bool:
        n = self.space.n_control
        apart = 1e-9 * (self.space.breaks[-1] - self.space.breaks[0])
        fresh = [t for t in np.unique(more) if np.abs(self.space.breaks - t).min() > apart]
        if not fresh:
            return False
        self.space, self.control = self.space.with_breaks(np.array(fresh), self.control)
        return self.space.n_control > n

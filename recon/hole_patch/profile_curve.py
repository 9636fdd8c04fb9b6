"""A smoothing spline through a band of samples, robust against what lies beside the band.

    · · ·. ·· · ·  ·· ·      samples, a broad band where the vessel is out of round
    ---------.____________   the curve; it may bend no shorter than the band is broad
     · ·· ·· · ·· · · ·  ·
            x  x x           a handle: no part of the curve

    s        length along the curve
    ℓ        length in millimetres below which the bending energy lets nothing bend; its weight is ℓ⁴
    scale    standard deviation of the samples about the curve, from the median of their distances

Over a lip everything is local: the lip turns within millimetres where its walls are nearly straight, and its band may
be narrow where theirs is broad.

Paper  [wahba1990], smoothing splines.
"""

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.ndimage import gaussian_filter1d, minimum_filter1d
from scipy.sparse.linalg import spsolve
from scipy.spatial import cKDTree

from recon.geometry.bspline import BSplineCurve
from recon.hole_patch.section_samples import SectionSamples
from recon.numerics.bspline_basis import basis_matrix, uniform_knots

__all__ = ["curve_normals", "fit_curve", "fit_lip_curve", "is_limp", "nearest_facing"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SPAN = 2.0  # mm between knots: a foot or a shoulder turns within a few millimetres, relief is finer
LIP_SPAN = 0.5  # mm between knots over a lip: half of the radius of all but the thinnest
LEAST_RADIUS = 1.0  # mm; nearer to the axis the chart is drawn together to a point
EXTENDED = 6.0  # mm: the margin of a face beyond its hole
STIFF, LIMP = 11.25, 0.356  # mm, greatest and least ℓ
LIP_LIMP = 0.15  # mm, least ℓ over a lip, in which a lip a millimetre thick loses a hundredth of its radius
LIMP_SIDES = 0.35  # least ℓ over a lip in edges of the mesh
BREADTHS = 3.0  # of the band of samples, by which the profile may not bend
NORMAL_LENGTH = 3.0  # mm for which a unit of normal counts where the nearest point faces the other way
TURN = 0.3  # of the radius of a bend, is ℓ there at most: the bend then loses a hundredth of its radius
WINDOW = 2.0  # mm of a lip's curve over which scale and turn are taken
ABSOLUTE_ROUNDS, BIWEIGHT_ROUNDS = 8, 3  # of projecting, weighting and fitting; the length settles after three


def fit_curve(samples: SectionSamples, s: Floats, *, start: BSplineCurve | None = None) -> BSplineCurve:
    """The curve, its parameter its length; least absolute distances, then Tukey's biweight.

    s      (m,) rough lengths of the samples
    start  the curve of nearly the same samples: it is improved then, in a third of the time
    Least squares would start halfway to a handle, and the biweight would stay there. Stiff at first: where the vessel
    is out of round the turned wall is a broad band, and a limp curve would wander in it.
    Promises  runs straight on by `EXTENDED` beyond the samples, but not over the axis.
    """
    s = s - s.min()
    curve = start or _weighted_spline(samples.place, samples.weight, s, reach=STIFF)
    for k in _rounds(start):
        s, away = _foot_lengths(curve, samples)
        if curve is start:
            s = s - s.min()  # it runs on beyond the samples
        scale = max(_weighted_median(away, samples.weight) / 0.6745, 1e-6)
        # the samples are a band about twice as broad as this: no bend may be shorter than the band is broad
        reach = max(BREADTHS * scale, LIMP)
        if k < ABSOLUTE_ROUNDS:
            trust = scale / np.maximum(away, 0.5 * scale)
            reach = max(reach, STIFF * (LIMP / STIFF) ** ((k + 1) / ABSOLUTE_ROUNDS))
        else:
            trust = np.clip(1.0 - (away / (4.685 * scale)) ** 2, 0.0, None) ** 2
        curve = _weighted_spline(samples.place, samples.weight * trust, s, reach=reach)
    before = float(np.clip(curve.control_points[0, 0] - LEAST_RADIUS, 0.0, EXTENDED))
    weight = samples.weight * trust
    return _weighted_spline(samples.place, weight, s + before, reach=reach, beyond=(before, EXTENDED))


def fit_lip_curve(
    samples: SectionSamples,
    s: Floats,
    *,
    side: float,
    start: BSplineCurve | None = None,
    beyond: tuple[float, float] = (EXTENDED, EXTENDED),
) -> BSplineCurve:
    """The same for a curve that turns back over a lip: scale and stiffness are those of each part of the curve.

    side      length of the mesh's edges: between rows of vertices so far apart nothing may bend
    beyond    lengths by which it runs straight on beyond the samples
    """
    span, limp = max(LIP_SPAN, 0.5 * side), max(LIP_LIMP, LIMP_SIDES * side)
    s = s - s.min()
    turning = _turning_reach(samples, s, limp)
    curve = start or _weighted_spline(samples.place, samples.weight, s, reach=turning, span=span)
    for k in _rounds(start):
        s, away = _foot_lengths(curve, samples)
        if curve is start:
            s = s - s.min()
        at, stiff = _turning_reach(samples, s, limp)
        scale = np.interp(at, *_local_scale(s, away, samples.weight))
        own = np.interp(s, at, scale)
        # where the normals turn the curve must turn with them, however broad the band is
        reach = np.clip(BREADTHS * scale, limp, np.maximum(stiff, limp))
        if k < ABSOLUTE_ROUNDS:
            trust = own / np.maximum(away, 0.5 * own)
            reach = np.maximum(reach, stiff * (limp / stiff) ** ((k + 1) / ABSOLUTE_ROUNDS))
        else:
            trust = np.clip(1.0 - (away / (4.685 * own)) ** 2, 0.0, None) ** 2
        curve = _weighted_spline(samples.place, samples.weight * trust, s, reach=(at, reach), span=span)
    everywhere = at + beyond[0], reach
    return _weighted_spline(
        samples.place, samples.weight * trust, s + beyond[0], reach=everywhere, span=span, beyond=beyond
    )


def is_limp(curve: BSplineCurve) -> bool:
    """Whether a curve came from `fit_lip_curve`, with knots that `fit_curve` has not."""
    return float(np.ptp(curve.knots)) / (len(curve.knots) - 1) < 0.5 * SPAN


def _rounds(start: BSplineCurve | None) -> range:
    """Of projecting, weighting and fitting; after a start the last of the absolute ones and those that follow."""
    return range(0 if start is None else ABSOLUTE_ROUNDS - 1, ABSOLUTE_ROUNDS + BIWEIGHT_ROUNDS)


def _turning_reach(samples: SectionSamples, s: Floats, limp: float) -> tuple[Floats, Floats]:
    """Places along the curve and ℓ there: a share of the radius in which the wall's normals turn, at most `STIFF`."""
    step = 0.25 * WINDOW
    bin_ = (s / step).astype(np.int64)
    turned = np.stack([np.bincount(bin_, samples.weight * x) for x in samples.normal.T], axis=1)
    turned = gaussian_filter1d(turned, 1.0 / step, axis=0, mode="nearest")
    angle = np.unwrap(np.arctan2(turned[:, 1], turned[:, 0]))
    reach = np.clip(TURN * step / np.maximum(np.abs(np.gradient(angle)), 1e-9), limp, STIFF)
    at = step * np.arange(0.5, len(reach), dtype=np.float64)
    return at, np.asarray(minimum_filter1d(reach, 2 * round(WINDOW / step) + 1))


def _local_scale(s: Floats, away: Floats, weight: Floats) -> tuple[Floats, Floats]:
    """Places along the curve and the scale of the samples within `WINDOW` of each."""
    order = np.argsort(s)
    s, away, weight = s[order], away[order], weight[order]
    at = np.arange(0.0, s[-1] + WINDOW, WINDOW)
    first, last = np.searchsorted(s, at - WINDOW), np.searchsorted(s, at + WINDOW)
    filled = np.flatnonzero(last > first)
    scale = [_weighted_median(away[i:j], weight[i:j]) / 0.6745 for i, j in zip(first[filled], last[filled])]
    return at[filled], np.maximum(scale, 1e-6)


def _weighted_spline(
    place: Floats,
    weight: Floats,
    s: Floats,
    *,
    reach: float | tuple[Floats, Floats],
    span: float = SPAN,
    beyond: tuple[float, float] = (0.0, 0.0),
) -> BSplineCurve:
    """Least squares with an energy that lets nothing bend within less than a length ℓ.

    reach    ℓ in millimetres; for a lip, places along the curve and ℓ there
    span     millimetres between knots
    beyond   lengths without samples before s[0] = beyond[0] and after the last, where the energy alone runs on straight
    """
    length = float(s.max()) + beyond[1]
    knots = uniform_knots(max(4, round(length / span)) + 3, 3, 0.0, length)
    basis = basis_matrix(knots, 3, s)
    at = np.linspace(0.0, length, 4 * len(knots))
    square = np.square(np.interp(at, *reach) if isinstance(reach, tuple) else np.full(len(at), reach))
    bend = basis_matrix(knots, 3, at, 2) * (square * np.sqrt(weight.sum() / len(at)))[:, None]
    equations = sparse.csc_array(basis.T @ (basis * weight[:, None]) + bend.T @ bend)
    return BSplineCurve(3, knots, np.asarray(spsolve(equations, basis.T @ (place * weight[:, None]))))


def _foot_lengths(curve: BSplineCurve, samples: SectionSamples) -> tuple[Floats, Floats]:
    """(m,) length along the curve to every sample's foot point, and (m,) the distance from it."""
    t = np.linspace(*curve.domain, 16 * len(curve.knots))
    line, place = curve.point(t), samples.place
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    foot = np.clip(nearest_facing(line, curve_normals(curve, t), place, samples.normal), 1, len(line) - 2)
    along = line[foot + 1] - line[foot - 1]
    off = place - line[foot]
    share = np.clip(np.einsum("ij,ij->i", off, along) / np.einsum("ij,ij->i", along, along), -1.0, 1.0)
    s = length[foot] + share * (length[foot + 1] - length[foot - 1])
    return np.clip(s, 0.0, length[-1]), np.linalg.norm(off - share[:, None] * along, axis=1)


def curve_normals(curve: BSplineCurve, s: Floats) -> Floats:
    """(m, 2) unit normals: the tangents turned clockwise."""
    tangent = curve.derivative(s)
    normal = np.stack([tangent[:, 1], -tangent[:, 0]], axis=1)
    return normal / np.linalg.norm(normal, axis=1, keepdims=True)


def nearest_facing(line: Floats, line_normals: Floats, place: Floats, facing: Floats | None) -> Ints:
    """(m,) nearest of the points (k, 2) of a line; where that faces the other way than the place does, the nearest that
    faces alike.
    """
    nearest = np.asarray(cKDTree(line).query(place)[1], dtype=np.int64)
    if facing is None:
        return nearest
    against = np.flatnonzero(np.einsum("ij,ij->i", line_normals[nearest], facing) < 0.0)
    if len(against):
        tree = cKDTree(np.concatenate([line, NORMAL_LENGTH * line_normals], axis=1))
        nearest[against] = tree.query(np.concatenate([place, NORMAL_LENGTH * facing], axis=1)[against])[1]
    return nearest


def _weighted_median(values: Floats, weight: Floats) -> float:
    order = np.argsort(values)
    total = np.cumsum(weight[order])
    return float(values[order][np.searchsorted(total, 0.5 * total[-1])])

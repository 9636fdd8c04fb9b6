"""The profile of one wall, down a foot ring and up again where the vessel stands on one.

A curve that is stiff enough for any wall cuts a foot ring off: it cannot turn within so few millimetres. A limp one
follows the ring, but also a swelling, a lump or a handle beside it, and ties itself in loops there. What comes back
round the axis tells them apart, before any curve is laid:

      |      |  outer wall           x   samples that the stiff curve leaves, and that come back all round the turn:
     _|      |                           the curve is to turn as sharply as they do
    ___.    _|   x    stiff curve    o   samples that come back nowhere: a swelling; left out before the limp curve is
       x'--'x   o                        laid
       x    x   o
        'xx'

    s        rough length along the wall, as the shortest way through its samples gives it
    missed   greatest median distance, over stretches of s, of recurring samples from a curve
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from recon.geometry.bspline import BSplineCurve
from recon.hole_patch.axis import coverage
from recon.hole_patch.edge_cleaning import crossings
from recon.hole_patch.profile_curve import EXTENDED, LEAST_RADIUS, fit_curve, fit_lip_curve, is_limp
from recon.hole_patch.section_samples import (
    SectionSamples,
    edge_length,
    lengths_along_mesh,
    mirrored,
    vertex_areas_and_normals,
)
from recon.hole_patch.surroundings import Axis, Wall

__all__ = ["fit_foot_curve", "recurring"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

# lengths in units of the vessel (`recon.hole_patch.unit_length`)
STEP = 1.5  # within which radii and heights are alike
STRETCH = 2.0  # of s: shorter than the side of any foot ring
COMES_BACK = 0.5  # of the turn round which the most usual samples of a stretch come back
LEAST_BACK = 0.4  # of what is usual along the whole wall
MISSED = 1.5  # relief leaves less, and a bend that is cut
BEYOND = 5.0  # of s past the hole: the margin of its face
BETTER = 0.5  # of what the stiff curve missed, at most
FEW = 20  # samples in a stretch that say nothing
DENSE, LOOPED = 16, 4  # points of a curve between two knots, to measure distances from it and to see it cross itself


def fit_foot_curve(
    wall: Wall,
    axis: Axis,
    samples: SectionSamples,
    s: Floats,
    *,
    over: bool,
    start: BSplineCurve | None = None,
) -> BSplineCurve:
    """The curve of `fit_curve`, or one that turns as sharply as the wall does, where that one misses what recurs.

    samples, s  of the wall, and their rough lengths
    over        whether the curve goes on beyond the axis as its own mirror image
    start       as of `fit_curve`; whether it turns sharply is taken over from it
    Promises    as of `fit_curve`; it does not cross itself where it turns sharply.
    """
    if start is not None and not is_limp(start):
        return fit_curve(*_both_ways(samples, s, over), start=start)
    recurs = recurring(wall, axis, samples, s)
    edge = axis.cylindrical(wall.edge.points)[:, 1:]
    if start is not None:
        again, _, _ = _limp(wall, samples.of(recurs), edge, over=over, start=start)
        if not _crosses_itself(again):
            return again
    stiff = fit_curve(*_both_ways(samples, s, over))
    beside = _beside_hole(samples, s, edge)[recurs]
    left = _missed(stiff, samples.of(recurs).of(beside), s[recurs][beside])
    if left < MISSED:
        return stiff
    limp, known, s = _limp(wall, samples.of(recurs), edge, over=over)
    return stiff if _missed(limp, known, s) > BETTER * left or _crosses_itself(limp) else limp


def _limp(
    wall: Wall, known: SectionSamples, edge: Floats, *, over: bool, start: BSplineCurve | None = None
) -> tuple[BSplineCurve, SectionSamples, Floats]:
    """A curve that turns as sharply as the samples do, with those that it goes by and their lengths."""
    s = lengths_along_mesh(known, edge, wall=wall.measured)
    together = np.isfinite(s)
    known, s = known.of(together), s[together]
    before = EXTENDED if over else float(np.clip(_first_radius(known, s) - LEAST_RADIUS, 0.0, EXTENDED))
    both, lengths = _both_ways(known, s, over)
    side = edge_length(wall.measured)
    return fit_lip_curve(both, lengths, side=side, beyond=(before, EXTENDED), start=start), known, s


def _both_ways(samples: SectionSamples, s: Floats, over: bool) -> tuple[SectionSamples, Floats]:
    return mirrored(samples, s) if over else (samples, s)


def recurring(wall: Wall, axis: Axis, samples: SectionSamples, s: Floats) -> Bools:
    """(m,) samples that come back round the axis as often as most of those of like s do."""
    areas, normals = vertex_areas_and_normals(wall.measured)
    around = coverage(axis, wall.measured.vertices, normals, step=STEP, among=areas > 0.0)[samples.vertex]
    stretch = _stretches(s)
    most = np.zeros(stretch.max() + 1, dtype=np.int64)
    np.maximum.at(most, stretch, around)
    # where the samples end, a swelling goes on a little longer than the wall beside it
    asked = np.maximum(COMES_BACK * most, LEAST_BACK * np.median(most[most > 0]))
    return np.asarray(around >= asked[stretch])


def _beside_hole(samples: SectionSamples, s: Floats, edge: Floats) -> Bools:
    """(m,) samples as far along the wall as the hole reaches, and a little farther: a ring beyond does not matter."""
    at = s[cKDTree(samples.place).query(edge)[1]]
    return np.asarray((s > at.min() - BEYOND) & (s < at.max() + BEYOND))


def _stretches(s: Floats) -> Ints:
    return ((s - s.min()) / STRETCH).astype(np.int64)


def _first_radius(samples: SectionSamples, s: Floats) -> float:
    return float(samples.place[_stretches(s) == 0, 0].min())


def _missed(curve: BSplineCurve, samples: SectionSamples, s: Floats) -> float:
    """Greatest median distance of the samples of a stretch from the curve."""
    line = curve.point(np.linspace(*curve.domain, DENSE * len(curve.knots)))
    away, stretch = cKDTree(line).query(samples.place)[0], _stretches(s)
    order = np.argsort(stretch, kind="stable")
    rows = np.split(away[order], np.flatnonzero(np.diff(stretch[order])) + 1)
    return max((float(np.median(row)) for row in rows if len(row) > FEW), default=0.0)


def _crosses_itself(curve: BSplineCurve) -> bool:
    line = curve.point(np.linspace(*curve.domain, LOOPED * len(curve.knots)))
    pairs = crossings(line)
    # the line is open: what would close it crosses nothing
    return bool((pairs.max(axis=1, initial=-1) < len(line) - 1).any()) if len(pairs) else False

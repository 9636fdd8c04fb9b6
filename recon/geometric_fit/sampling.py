"""Data points that stand for others: a dense scan says the same many times over in every patch of the surface.

        patch                        patch
    . . . . . . .                .           .        as many in a patch as fix it, far from each other; each counts
    . . . . . . .      -->             o              for those nearest to it
    . . . . . . .                .         .   o      o   all that are far off, each for itself

Rounds are on these. Between them all points are asked how far off they are, and those far off join.

Paper  [gonzalez1985], points chosen each farthest from those before.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.geometric_fit.foot_points import patch_order
from recon.geometric_fit.scan_data import ScanData

__all__ = ["Sample", "all_points", "joined_by", "sample_of"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
SmallInts = NDArray[np.int32]

IN_PATCH = 3  # points that fix a patch, of which a control point has about twelve
MOST = 0.6  # of all points: a sample of more saves nothing


class Sample(NamedTuple):
    """Some of the data points.

    at       (n,) their numbers among all, rising
    points   (n, 3)
    counts   (n,) for how many measured points each stands
    weights  (n,) how much each counts, with those it stands for
    nearest  (N,) for every data point the one that stands for it, by its place in the sample
    """

    at: Ints
    points: Floats
    counts: Floats
    weights: Floats
    nearest: SmallInts

    @property
    def is_whole(self) -> bool:
        """Whether it is all points."""
        return len(self.at) == len(self.nearest)


def all_points(scan: ScanData) -> Sample:
    """All data points, each for itself."""
    n = len(scan.points)
    return Sample(np.arange(n), scan.points, scan.counts, scan.weights, np.arange(n, dtype=np.int32))


def sample_of(scan: ScanData, patch: Ints | SmallInts, n_patches: int) -> Sample:
    """Some measured points of every patch, given the patch (N,) of each point, and all that were not measured."""
    n = len(scan.points)
    patch = patch[: scan.n_measured].astype(np.int64)
    if np.minimum(np.bincount(patch, minlength=n_patches), IN_PATCH).sum() > MOST * scan.n_measured:
        return all_points(scan)
    nearest = np.arange(n, dtype=np.int32)
    _stand_for(scan.points, *patch_order(patch, n_patches), IN_PATCH, nearest)
    return _sample(scan, np.flatnonzero(nearest == np.arange(n)), nearest)


def joined_by(sample: Sample, scan: ScanData, others: Ints) -> Sample:
    """The sample with more points, each of which stands for itself."""
    stands_for = sample.at[sample.nearest].astype(np.int32)
    stands_for[others] = others
    return _sample(scan, np.union1d(sample.at, others), stands_for)


def _sample(scan: ScanData, at: Ints, stands_for: SmallInts) -> Sample:
    """Points of these numbers; and (N,) the number of the one that stands for each."""
    place = np.full(len(scan.points), -1, dtype=np.int32)
    place[at] = np.arange(len(at))
    nearest = place[stands_for]
    stood_for = np.bincount(nearest, minlength=len(at))
    return Sample(at, scan.points[at], scan.counts[at] * stood_for, scan.weights[at] * stood_for, nearest)


@njit(cache=True)
def _stand_for(
    x: Floats, order: SmallInts, starts: Ints, most: int, stands_for: SmallInts
) -> None:  # pragma: no cover - compiled
    """For the points of each patch, `order` from `starts`, which of at most so many among them is nearest."""
    nearest = np.empty(len(order))
    for patch in range(len(starts) - 1):
        first, last = starts[patch], starts[patch + 1]
        if last - first <= most:
            continue
        nearest[first:last] = np.inf
        chosen = order[first]
        for _ in range(most):
            farthest = -1.0
            following = chosen
            for k in range(first, last):
                i, square = order[k], 0.0
                for axis in range(3):
                    square += (x[i, axis] - x[chosen, axis]) ** 2
                if square < nearest[k]:
                    nearest[k], stands_for[i] = square, chosen
                if nearest[k] > farthest:
                    farthest, following = nearest[k], i
            chosen = following

"""How far all points are from the surface, piece by piece: from one start each, or from several, the least counts.

A walk ends at a point that is nearest among its neighbours. That is the nearest of all for nearly every start that is
a nearby sample, or the foot of the last round; where it is not, the point seems far off, so the farthest are asked
again from more samples.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from recon.geometric_fit.borders import Borders
from recon.geometric_fit.foot_points import (
    EXACT,
    ROUGH,
    Feet,
    Places,
    Samples,
    patch_order,
    seed_feet,
    surface_samples,
    walk_feet,
)
from recon.numerics.rows import row_distances
from recon.subdivision.limit_surface import LimitPatches

__all__ = ["Seen", "exact_distances", "seen"]

Floats = NDArray[np.float64]
SmallInts = NDArray[np.int32]

FAR = 3.0  # root mean squares from where on a distance is doubted
PIECE = 1 << 14  # points looked at together
MORE_STARTS = 12  # samples nearest to such a point
SOME_STARTS = 3  # the same between rounds


class Seen(NamedTuple):
    """Where the feet of all points are, and how far off these are, (N,) each."""

    places: Places
    distances: Floats


class _Surface(NamedTuple):
    """A limit surface for the moment: its patches, their borders, and the points (R, 3) that they depend on."""

    patches: LimitPatches
    borders: Borders
    points: Floats

    def walked(self, data: Floats, start: Feet | Places, *, step: float) -> tuple[Feet, Floats]:
        """The feet that walks from these starts lead to, and how far they are."""
        feet = walk_feet(self.patches, self.points, data, start, step=step)
        feet = self.borders.hopped(self.points, data, feet, step=step)
        return feet, row_distances(feet.positions, data)


def _pieces(patches: LimitPatches, start: Places) -> list[SmallInts]:
    """Numbers of the data points, (n,) together: those that start in the same patches, whose nets are at hand then."""
    order, _ = patch_order(start.patch.astype(np.int64), len(patches.arrays.tables))
    return [order[first : first + PIECE] for first in range(0, len(order), PIECE)]


def _size(data: Floats) -> float:
    """What a step is a share of."""
    return max(float(np.linalg.norm(np.ptp(data, axis=0))), 1e-300)


def seen(patches: LimitPatches, borders: Borders, points: Floats, data: Floats, start: Places) -> Seen:
    """Where the feet of all points (N, 3) are; start  a place near each."""
    surface, whole = _Surface(patches, borders, points), _size(data)
    n = len(data)
    places = Places(np.empty(n, dtype=np.int32), np.empty(n, dtype=np.float32), np.empty(n, dtype=np.float32))
    found = np.empty(n)
    for piece in _pieces(patches, start):
        step = ROUGH * whole / _size(data[piece])
        feet, found[piece] = surface.walked(data[piece], start.chosen(piece), step=step)
        for all_of, of_piece in zip(places, feet.places()):
            all_of[piece] = of_piece
    far = np.flatnonzero(found > FAR * np.sqrt(np.mean(found**2)))
    if len(far):
        starts = seed_feet(surface_samples(patches, points), data[far], n_nearest=SOME_STARTS)
        feet, away = surface.walked(np.tile(data[far], (SOME_STARTS, 1)), starts, step=ROUGH)
        best = away.reshape(SOME_STARTS, -1).argmin(axis=0) * len(far) + np.arange(len(far))
        nearer = away[best] < found[far]
        far, best = far[nearer], best[nearer]
        found[far] = away[best]
        for all_of, again in zip(places, feet.chosen(best).places()):
            all_of[far] = again
    return Seen(places, found)


def exact_distances(patches: LimitPatches, borders: Borders, points: Floats, data: Floats, warm: Places) -> Floats:
    """(N,) distances of the data (N, 3) from the limit surface.

    points  (R, 3) the points the patches depend on
    warm    places to start from, beside the nearest samples
    """
    surface, samples, whole = _Surface(patches, borders, points), surface_samples(patches, points), _size(data)
    found = np.empty(len(data))
    for piece in _pieces(patches, warm):
        to = data[piece]
        # a step is a share of the size of what is walked for, which is one piece after the other
        step = EXACT * whole / _size(to)
        feet, found[piece] = surface.walked(to, warm.chosen(piece), step=step)
        # a walk from the patch where the foot is leads to the foot
        seeds = seed_feet(samples, to)
        elsewhere = np.flatnonzero(seeds.patch != feet.patch)
        again = surface.walked(to[elsewhere], seeds.chosen(elsewhere), step=step)[1]
        found[piece[elsewhere]] = np.minimum(found[piece[elsewhere]], again)
    far = np.flatnonzero(found > FAR * np.sqrt(np.mean(found**2)))
    if len(far):
        found[far] = np.minimum(found[far], _from_more(surface, samples, data[far]))
    return found


def _from_more(surface: _Surface, samples: Samples, data: Floats) -> Floats:
    """(n,) the least distances from several starts each."""
    starts = seed_feet(samples, data, n_nearest=MORE_STARTS)
    _, away = surface.walked(np.tile(data, (MORE_STARTS, 1)), starts, step=EXACT)
    return np.asarray(away.reshape(MORE_STARTS, -1).min(axis=0))

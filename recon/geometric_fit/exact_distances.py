"""How far points are from the surface, in the end: each from several starts, the least counts.

A walk ends at a point that is nearest among its neighbours. That is the nearest of all for nearly every start that is
a nearby sample, or the foot of the last round; where it is not, the point seems far off, so the farthest are asked
again from more samples.
"""

import numpy as np
from numpy.typing import NDArray

from recon.geometric_fit.borders import Borders
from recon.geometric_fit.foot_points import EXACT, Feet, seed_feet, surface_samples, walk_feet
from recon.numerics.rows import row_distances
from recon.subdivision.limit_surface import LimitPatches

__all__ = ["exact_distances"]

Floats = NDArray[np.float64]

FAR = 3.0  # root mean squares from where on a distance is doubted
PIECE = 1 << 16  # points looked at together
MORE_STARTS = 12  # samples nearest to such a point


def exact_distances(patches: LimitPatches, borders: Borders, points: Floats, data: Floats, warm: Feet) -> Floats:
    """(N,) distances of the data (N, 3) from the limit surface.

    points  (R, 3) the points the patches depend on
    warm    feet to start from, beside the nearest samples
    """

    def distances(to: Floats, start: Feet, step: float) -> Floats:
        feet = borders.hopped(points, to, walk_feet(patches, points, to, start, step=step), step=step)
        return row_distances(feet.positions, to)

    samples = surface_samples(patches, points)
    # a step is a share of the size of what is walked for, which is one piece after the other
    whole = float(np.linalg.norm(np.ptp(data, axis=0)))
    found = np.empty(len(data))
    for first in range(0, len(data), PIECE):
        piece = np.arange(first, min(first + PIECE, len(data)))
        to = data[piece]
        step = EXACT * whole / max(float(np.linalg.norm(np.ptp(to, axis=0))), 1e-300)
        at, seeds = warm.chosen(piece), seed_feet(samples, to)
        found[piece] = distances(to, at, step)
        # a walk from the patch where the foot is leads to the foot
        elsewhere = np.flatnonzero(seeds.patch != at.patch)
        again = distances(to[elsewhere], seeds.chosen(elsewhere), step)
        found[piece[elsewhere]] = np.minimum(found[piece[elsewhere]], again)
    far = np.flatnonzero(found > FAR * np.sqrt(np.mean(found**2)))
    if len(far):
        to = np.tile(data[far], (MORE_STARTS, 1))
        starts = seed_feet(samples, data[far], n_nearest=MORE_STARTS)
        found[far] = np.minimum(found[far], distances(to, starts, EXACT).reshape(MORE_STARTS, -1).min(axis=0))
    return found

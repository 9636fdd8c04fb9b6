"""Step 7, limiter: no patch leaves the heights of the contours around its strip by more than a share of the interval.

Where one does, gradient and Hessian of its corners are scaled down and the patches are made again; scaled jets still
agree around every vertex, so the surface stays G1, and contours stay contours. So are those of patches that fold since
they are steep.
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from recon.terrain.levels import Levels
from recon.terrain.merging import PatchLayout
from recon.terrain.patch_group import PatchGroup
from recon.terrain.second_derivatives import VertexJets

__all__ = ["limited_jets", "excess"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

ROUNDS = 20
FACTORS = 0.3, 0.8  # a round scales the jets of a patch by at least and at most so much
BEYOND, BEYOND_ENDED = 0.04, 0.25  # shares of the interval between contours, and on summits, in pits, beside the border
SAMPLES = np.linspace(0.0, 1.0, 9)


def limited_jets(
    made: Callable[[VertexJets, Ints | None], Sequence[PatchGroup]],
    layout: PatchLayout,
    jets: VertexJets,
    limits: Levels,
    interval: float,
    held: Ints | None = None,
) -> tuple[VertexJets, tuple[PatchGroup, ...], Ints]:
    """Jets scaled down where needed, the patches made from them, and those (n,) that go too far, or fold, all the same.

    made  makes the patches of some rows of the layout, or of all, always in the same groups
    held  vertices whose jets stay as they are, whatever the patches do
    """
    strip = limits.strip[layout.face]
    allowed = np.where(limits.ended[strip], BEYOND_ENDED, BEYOND) * interval
    low, high = limits.low[strip], limits.high[strip]
    nets = tuple(made(jets, None))
    parts: Sequence[PatchGroup] = nets
    for _ in range(ROUNDS):
        over = excess(low, high, parts)
        folded = _folded(parts, len(low))
        too_high = (over > allowed) | folded
        if not too_high.any():
            break
        factor = np.ones(len(jets.height))
        share = np.clip(allowed[too_high] / np.where(folded, np.inf, over)[too_high], *FACTORS)
        np.minimum.at(factor, layout.corners[too_high].ravel(), np.repeat(share, 4))
        if held is not None:
            factor[held] = 1.0
        jets = jets.scaled(factor)
        changed = np.flatnonzero((factor < 1)[layout.corners].any(axis=1))
        if not len(changed):
            break
        parts = made(jets, changed)
        nets = tuple(group.replaced(new) for group, new in zip(nets, parts))
    return jets, nets, np.flatnonzero((excess(low, high, nets) > allowed) | _folded(nets, len(low)))


def _folded(parts: Sequence[PatchGroup], n_patches: int) -> NDArray[np.bool_]:
    """(P,) those of the given patches that fold."""
    out = np.zeros(n_patches, dtype=bool)
    for part in parts:
        out[part.rows] = part.folded()
    return out


def excess(low: Floats, high: Floats, parts: Sequence[PatchGroup]) -> Floats:
    """(P,) metres by which the given patches leave the heights low to high (P,), on a grid of samples; others 0."""
    out = np.zeros(len(low))
    for part in parts:
        values = part.heights(SAMPLES)
        top, bottom = values.max(axis=(1, 2)), values.min(axis=(1, 2))
        out[part.rows] = np.maximum(top - high[part.rows], low[part.rows] - bottom)
    return out

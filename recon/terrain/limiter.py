"""Step 7, limiter: no patch leaves the heights of the contours around its strip by more than a share of the interval.

Where one does, gradient and Hessian of its corners are scaled down and the patches are made again; scaled jets still
agree around every vertex, so the surface stays G1, and contours stay contours.
"""

import numpy as np
from numpy.typing import NDArray

from recon.numerics.bernstein import bernstein
from recon.terrain.levels import Levels
from recon.terrain.merging import PatchLayout
from recon.terrain.patches import PatchNets, patch_nets
from recon.terrain.second_derivatives import VertexJets
from recon.terrain.tiling import Tiling

__all__ = ["limited_jets", "excess"]

Floats = NDArray[np.float64]

ROUNDS = 20
FACTORS = 0.3, 0.8  # a round scales the jets of a patch by at least and at most so much
BEYOND, BEYOND_ENDED = 0.04, 0.25  # shares of the interval between contours, and on summits, in pits, beside the border
SAMPLES = np.linspace(0.0, 1.0, 9)


def limited_jets(
    tiling: Tiling, layout: PatchLayout, jets: VertexJets, limits: Levels, interval: float
) -> tuple[VertexJets, tuple[PatchNets, PatchNets]]:
    """Jets scaled down where needed, and the patches made from them."""
    strip = limits.strip[layout.face]
    allowed = np.where(limits.ended[strip], BEYOND_ENDED, BEYOND) * interval
    low, high = limits.low[strip], limits.high[strip]
    nets = patch_nets(tiling, layout, jets)
    changed, parts = np.arange(len(allowed)), nets
    for _ in range(ROUNDS):
        over = excess(low, high, parts)
        too_high = over > allowed
        if not too_high.any():
            break
        factor = np.ones(len(jets.height))
        share = np.clip(allowed[too_high] / over[too_high], *FACTORS)
        np.minimum.at(factor, layout.corners[too_high].ravel(), np.repeat(share, 4))
        jets = jets.scaled(factor)
        changed = np.flatnonzero((factor < 1)[layout.corners].any(axis=1))
        parts = patch_nets(tiling, layout, jets, changed)
        nets = _replaced(nets[0], parts[0]), _replaced(nets[1], parts[1])
    return jets, nets


def _replaced(nets: PatchNets, new: PatchNets) -> PatchNets:
    """The nets with some made anew."""
    out = nets.nets.copy()
    out[np.searchsorted(nets.rows, new.rows)] = new.nets
    return PatchNets(nets.rows, out)


def excess(low: Floats, high: Floats, parts: tuple[PatchNets, PatchNets]) -> Floats:
    """(P,) metres by which the given patches leave the heights low to high (P,), on a grid of samples; others 0."""
    out = np.zeros(len(low))
    for part in parts:
        values = bernstein(part.degree, SAMPLES) @ part.nets[..., 2] @ bernstein(5, SAMPLES).T
        top, bottom = values.max(axis=(1, 2)), values.min(axis=(1, 2))
        out[part.rows] = np.maximum(top - high[part.rows], low[part.rows] - bottom)
    return out

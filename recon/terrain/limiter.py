"""Step 7, limiter: no patch rises or falls beyond its corners by more than a share of the contour interval.

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

ROUNDS = 14
FACTORS = 0.3, 0.8  # a round scales the jets of a patch by at least and at most so much
BEYOND, BEYOND_ENDED = 0.04, 0.25  # shares of the interval between contours, and on summits, in pits, beside the border
SAMPLES = np.linspace(0.0, 1.0, 9)


def limited_jets(
    tiling: Tiling, layout: PatchLayout, jets: VertexJets, limits: Levels, interval: float
) -> tuple[VertexJets, tuple[PatchNets, PatchNets]]:
    """Jets scaled down where needed, and the patches made from them."""
    allowed = np.where(_ended(tiling, layout, limits), BEYOND_ENDED, BEYOND) * interval
    for _ in range(ROUNDS):
        nets = patch_nets(tiling, layout, jets)
        over = excess(layout, jets, nets)
        high = over > allowed
        if not high.any():
            break
        factor = np.ones(len(jets.height))
        share = np.clip(allowed[high] / over[high], *FACTORS)
        np.minimum.at(factor, layout.corners[high].ravel(), np.repeat(share, 4))
        jets = jets.scaled(factor)
    return jets, nets


def excess(layout: PatchLayout, jets: VertexJets, nets: tuple[PatchNets, PatchNets]) -> Floats:
    """(P,) metres by which every patch leaves the heights of its corners, on a grid of samples."""
    z = jets.height[layout.corners]
    out = np.empty(len(z))
    for part in nets:
        values = np.einsum(
            "iu,nuv,jv->nij", bernstein(part.degree, SAMPLES), part.nets[..., 2], bernstein(5, SAMPLES), optimize=True
        ).reshape(len(part.rows), -1)
        corners = z[part.rows]
        out[part.rows] = np.maximum(values.max(axis=1) - corners.max(axis=1), corners.min(axis=1) - values.min(axis=1))
    return out


def _ended(tiling: Tiling, layout: PatchLayout, limits: Levels) -> NDArray[np.bool_]:
    """(P,) whether a patch lies in a strip with one contour height only."""
    vertex_ended = np.ones(len(tiling.points), dtype=bool)
    vertex_ended[tiling.triangles[~limits.ended[limits.strip]]] = False
    contour = np.arange(len(tiling.points)) < tiling.curves.n_vertices
    return np.asarray((vertex_ended & ~contour)[layout.corners].any(axis=1))

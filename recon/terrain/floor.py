"""A base that cuts the ground along one of its contours: nothing that lies above it may dip below.

    contour of the base o---------o          the patches above it touch the base along the contour alone: free vertices
                        |  above  |          keep clear of it, and where a patch dips all the same the ground rises from
                    o---o         o--        the contour as steeply as to the patch's other corners

Jets that are scaled to nothing, as the limiter does, do not help here: beside a level contour a patch whose other sides
run aslant then rises with the third power of the way from it, and dips with the second.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from recon.terrain.contour_curves import ContourCurves
from recon.terrain.levels import Levels
from recon.terrain.merging import PatchLayout
from recon.terrain.patch_group import PatchGroup
from recon.terrain.second_derivatives import VertexJets, contour_frames
from recon.terrain.tiling import Tiling

__all__ = ["Floor", "Lifting"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Made = Callable[[VertexJets, Ints | None], Sequence[PatchGroup]]

CLEAR = 0.02  # of a strip's own height: how far above the base its free vertices lie at least
ROUNDS = 30
STEEPER, FLATTER = 1.25, 0.6  # a round's factors on slopes at the base, and on jets above it
STEEPEST = 4.0  # times the mean slope of a patch: steeper it is not made
LEAST = 1e-9  # of the interval: what may be rounding
SAMPLES = np.linspace(0.0, 1.0, 17)


@dataclass(frozen=True)
class Floor:
    """The base at a height in metres that one or more contours of the ground have."""

    height: float

    def settled(self, limits: Levels, tiling: Tiling, heights: Floats | None = None) -> Levels:
        """Limits of strips that may lie on both sides of the base narrowed to one side.

        A terrace that a contour of the base bounds is taken to lie below it, since the solid would else touch its base
        along that contour; others, whose own contours of the base were too small to keep, lie where they mostly are.

        heights  (V,) of a first solution, where there is one
        """
        across = (limits.low < self.height) & (limits.high > self.height)
        beside = np.zeros(len(limits.low), dtype=bool)
        at_floor = tiling.vertex_heights()[tiling.triangles] == self.height
        beside[limits.strip[at_floor.any(axis=1)]] = True
        below = across & beside
        above = np.zeros_like(below)
        if heights is not None:
            rise = np.bincount(limits.strip, (heights - self.height)[tiling.triangles].mean(axis=1), len(limits.low))
            above, below = across & ~beside & (rise > 0), below | (across & ~beside & (rise <= 0))
        low, high = np.where(above, self.height, limits.low), np.where(below, self.height, limits.high)
        return replace(limits, low=low, high=high)

    def cut_through(self, limits: Levels) -> bool:
        """Whether the base still lies between the limits of a strip."""
        return bool(((limits.low < self.height) & (limits.high > self.height)).any())

    def cleared(self, limits: Levels) -> Levels:
        """The limits for free vertices: those above the base keep clear of it."""
        room = np.where(limits.low == self.height, CLEAR * (limits.high - limits.low), 0.0)
        return replace(limits, low=limits.low + room)


@dataclass(frozen=True, eq=False)
class Lifting:
    """What lies above a floor, patch by patch.

    limits    settled
    interval  metres of height between neighbouring contours
    """

    floor: Floor
    tiling: Tiling
    layout: PatchLayout
    limits: Levels
    interval: float

    def dipping(self, parts: Sequence[PatchGroup]) -> Ints:
        """(n,) those of the given patches that lie above the floor and dip below it."""
        above = self.limits.low[self.limits.strip[self.layout.face]] >= self.floor.height
        depth = _depths(self.floor.height, parts, len(above))
        return np.flatnonzero(above & (depth > LEAST * self.interval))

    def lifted(
        self, made: Made, jets: VertexJets, nets: tuple[PatchGroup, ...]
    ) -> tuple[VertexJets, tuple[PatchGroup, ...]]:
        """Jets and patches with slopes raised at the floor, and flattened above it, where patches dip.

        made  makes the patches of some rows of the layout, or of all
        """
        rising = _unit_jets(self.tiling.curves, self.limits.uphill, len(jets.height))
        at_floor = (jets.height == self.floor.height) & rising.gradient.any(axis=1)
        parts: Sequence[PatchGroup] = nets
        for _ in range(ROUNDS):
            corners = self.layout.corners[self.dipping(parts)]
            if not len(corners):
                break
            jets, moved = _lifted(jets, corners, (self.tiling.points, self.floor.height), (rising, at_floor))
            changed = np.flatnonzero(moved[self.layout.corners].any(axis=1))
            parts = made(jets, changed)
            nets = tuple(group.replaced(new) for group, new in zip(nets, parts))
        return jets, nets


def _depths(height: float, parts: Sequence[PatchGroup], n_patches: int) -> Floats:
    """(P,) metres by which the given patches dip below a height, on a grid of samples; others 0."""
    out = np.zeros(n_patches)
    for part in parts:
        out[part.rows] = height - part.heights(SAMPLES).min(axis=(1, 2))
    return out


def _unit_jets(curves: ContourCurves, uphill: Floats, n: int) -> VertexJets:
    """(n,) jets with a slope of 1 uphill across the contours, 0 where that is unknown; heights 0."""
    tangent, normal, curvature = contour_frames(curves)
    sign = np.where(curves.kinks(), 0.0, uphill)
    gradient, hessian = np.zeros((n, 2)), np.zeros((n, 2, 2))
    gradient[: len(sign)] = sign[:, None] * normal
    bend = -(sign * curvature)[:, None, None]
    hessian[: len(sign)] = bend * tangent[:, :, None] * tangent[:, None, :]
    return VertexJets(np.zeros(n), gradient, hessian)


def _lifted(
    jets: VertexJets, corners: Ints, places: tuple[Floats, float], lift: tuple[VertexJets, NDArray[np.bool_]]
) -> tuple[VertexJets, NDArray[np.bool_]]:
    """Jets that rise from the floor as steeply as the patches with these corners (n, 4) do, and which ones changed."""
    (points, height), (rising, at_floor) = places, lift
    slope = np.einsum("ij,ij->i", jets.gradient, rising.gradient)
    ramp, helps = _ramps(jets, corners, points, height, rising)
    touching = at_floor[corners] & helps
    raised = np.where(at_floor, slope, 0.0)
    vertex, ramp = corners[touching], ramp[touching]
    np.maximum.at(raised, vertex, np.clip(STEEPER * slope[vertex], ramp, STEEPEST * ramp))
    factor = np.ones(len(slope))
    factor[corners[~touching]] = FLATTER
    more = np.where(at_floor & (raised > slope), raised - slope, 0.0)
    factor[more > 0.0] = 1.0
    scaled = jets.scaled(factor)
    lifted = VertexJets(
        jets.height,
        scaled.gradient + more[:, None] * rising.gradient,
        scaled.hessian + more[:, None, None] * rising.hessian,
    )
    return lifted, (factor < 1.0) | (more > 0.0)


def _ramps(
    jets: VertexJets, corners: Ints, points: Floats, height: float, rising: VertexJets
) -> tuple[Floats, NDArray[np.bool_]]:
    """(n, 4) mean slope from each corner of a patch to those that lie above the floor, and whether one there helps.

    It does not where the contour bends so much that its slope, carried on, comes down again before them.
    """
    way = points[corners][:, None, :] - points[corners][:, :, None]
    rise = jets.height[corners] - height
    high = (rise > 0)[:, None, :]
    run = (np.linalg.norm(way, axis=3) * high).sum(axis=2)
    ahead = np.einsum("nijk,nik->nij", way, rising.gradient[corners])
    ahead += np.einsum("nijk,nikl,nijl->nij", way, rising.hessian[corners], way) / 2
    return rise.sum(axis=1, keepdims=True) / np.maximum(run, 1e-9), (ahead * high).sum(axis=2) > 0

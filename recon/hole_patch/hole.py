"""A hole between sherds, as it is listed: its edges, its size and place, and what keeps it from being patched."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.hole_patch.surroundings import HoleEdge, HoleKind

__all__ = ["Hole"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Hole:
    """A hole between the sherds.

    outer     its edge on the outer wall; where it runs over the lip, on both walls
    inner     its edge on the inner wall, or None
    problem   why it cannot be patched, or an empty text
    kind      what surrounds it
    over_lip  whether its edge runs over the lip
    """

    outer: HoleEdge
    inner: HoleEdge | None
    problem: str = ""
    kind: HoleKind = HoleKind.WALL
    over_lip: bool = False

    @property
    def n_walls(self) -> int:
        return 1 if self.inner is None and not self.over_lip else 2

    @property
    def length(self) -> float:
        p = self.outer.points
        return float(np.linalg.norm(np.roll(p, -1, axis=0) - p, axis=1).sum())

    @property
    def place(self) -> Floats:
        return np.asarray(self.outer.points.mean(axis=0))

    @property
    def size(self) -> Floats:
        """(2,) extent of the edge along its longest direction, and across it within the wall."""
        p = self.outer.points - self.place
        return np.asarray(np.ptp(p @ np.linalg.svd(p, full_matrices=False)[2][:2].T, axis=0))

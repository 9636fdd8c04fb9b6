"""What evaluation, contours, limiter and kernel door ask of patches, of whichever kind they are."""

from abc import ABC, abstractmethod
from typing import Self

import numpy as np
from numpy.typing import NDArray

from recon.geometry.bspline import BSplineSurface

__all__ = ["PatchGroup"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]


class PatchGroup(ABC):
    """Patches of one kind; `rows` (n,) are their places in the layout, in growing order."""

    rows: Ints

    @abstractmethod
    def points(self, index: Ints, uv: Floats) -> tuple[Floats, Floats, Floats]:
        """(m, 3) points of the patches `index` (m,) of the group at (m, 2) parameters, and both derivatives."""

    def plan(self, index: Ints, uv: Floats) -> tuple[Floats, Floats, Floats]:
        """The same in plan: (m, 2) each."""
        point, along_u, along_v = self.points(index, uv)
        return point[:, :2], along_u[:, :2], along_v[:, :2]

    @abstractmethod
    def grid(self, t: Floats) -> Floats:
        """(n, k, k, 3) points of every patch at the parameters t (k,) in u and v."""

    def heights(self, t: Floats) -> Floats:
        """(n, k, k) heights of the same points."""
        return self.grid(t)[..., 2]

    @abstractmethod
    def normals(self, u: Floats, v: Floats) -> Floats:
        """(n, m, 3) unit normals of every patch at m parameters."""

    @abstractmethod
    def boxes(self) -> tuple[Floats, Floats]:
        """(n, 2) lower and upper corners in plan that hold the patches."""

    @abstractmethod
    def surfaces(self) -> list[BSplineSurface]:
        """The n patches as the kernel takes them."""

    def stray(self) -> float:
        """Radians between the tangent planes of the patches and of their `surfaces` along the sides, at most."""
        return 0.0

    def folded(self) -> Flags:
        """(n,) whether a plan map turns over that depends on the heights; none does where it does not."""
        return np.zeros(len(self.rows), dtype=bool)

    @abstractmethod
    def part(self, kept: Flags, rows: Ints) -> Self:
        """Some of the patches (n,), with their new places in the layout."""

    @abstractmethod
    def replaced(self, new: Self) -> Self:
        """The patches with some made anew."""

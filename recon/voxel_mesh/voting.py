"""Which cells between surfaces are solid: the voxel centres in a cell vote.

A cell is known by the side of every surface that it lies on; so is a voxel centre.  The voters of a cell are the
centres with the same sides within the cell's box; where a cell is too thin to hold any, the voxel around its point.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from recon.geometry.analytic import AnalyticSurface
from recon.geometry.voxel_grid import VoxelGrid

__all__ = ["Vote"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


SPARSE = 3  # of the whole box every third centre along each axis votes; cells without one ask all of their own box
MOST = 300_000  # centres of a cell's box that are asked at most


class Vote:
    """Voxel centres of a grid with their sides; surfaces (at most 62) in model units."""

    def __init__(self, grid: VoxelGrid, surfaces: Sequence[AnalyticSurface], low: Ints, high: Ints) -> None:
        """low, high: first voxel, and one past the last, of the box that votes."""
        self._grid, self._surfaces = grid, surfaces
        self._low, self._high = np.maximum(low, 0), np.minimum(high, grid.solid.shape)
        centres, solid = self._voters(self._low, self._high, SPARSE)
        sides = self._sides(centres)
        order = np.argsort(sides, kind="stable")
        self._codes, self._starts = np.unique(sides[order], return_index=True)
        self._starts = np.append(self._starts, len(order))
        self._centres, self._solid = centres[order], solid[order]

    def _voters(self, low: Ints, high: Ints, step: int) -> tuple[Floats, NDArray[np.bool_]]:
        """Centres from one voxel up to another, and whether they are solid."""
        spans = [np.arange(a, b, step) for a, b in zip(low.tolist(), high.tolist())]
        index = np.stack(np.meshgrid(*spans, indexing="ij"), axis=-1).reshape(-1, 3)
        return self._grid.place(index * self._grid.proportions), self._grid.solid[tuple(index.T)]

    def _sides(self, points: Floats) -> Ints:
        code = np.zeros(len(points), dtype=np.int64)
        for k, surface in enumerate(self._surfaces):
            code |= (surface.distance(points) > 0).astype(np.int64) << k
        return code

    def __call__(self, point: Floats, low: Floats, high: Floats) -> bool:
        """Whether the cell around a point, with a box from low to high, is solid."""
        code = self._sides(point[None])[0]
        at = int(np.searchsorted(self._codes, code))
        if at < len(self._codes) and self._codes[at] == code:
            rows = slice(self._starts[at], self._starts[at + 1])
            inside = ((self._centres[rows] >= low) & (self._centres[rows] <= high)).all(axis=1)
            if inside.any():
                return bool(self._solid[rows][inside].mean() > 0.5)
        corners = np.stack(np.meshgrid(*np.stack([low, high], axis=1), indexing="ij"), axis=-1).reshape(-1, 3)
        index = self._index(corners)
        first = np.clip(np.floor(index.min(axis=0)).astype(np.int64), self._low, self._high)
        last = np.clip(np.ceil(index.max(axis=0)).astype(np.int64) + 1, self._low, self._high)
        if 0 < np.prod(last - first) <= MOST:
            centres, solid = self._voters(first, last, 1)
            same = self._sides(centres) == code
            if same.any():
                return bool(solid[same].mean() > 0.5)
        return self._around(point)

    def _index(self, points: Floats) -> Floats:
        return np.asarray((points - self._grid.origin) @ self._grid.direction / self._grid.spacing)

    def _around(self, point: Floats) -> bool:
        index = np.round(self._index(point[None])[0]).astype(np.int64)
        if (index < 0).any() or (index >= self._grid.solid.shape).any():
            return False
        return bool(self._grid.solid[tuple(index)])

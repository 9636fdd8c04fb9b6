"""A height grid that need not be in memory: its axes are known, its heights are read by windows."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.geometry.contour_map import HeightGrid, grid_axis

__all__ = ["HeightSource"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class HeightSource:
    """Where the heights of a rectangular grid come from.

    x, y   (nx,), (ny,) increasing coordinates of the grid's columns and rows, in metres
    crs    name of the coordinate reference system, or an empty text
    read   gives the heights of some rows, counted from the south, and some columns; NaN where nothing was measured
    Raises  BadGeometry.
    """

    x: Floats
    y: Floats
    crs: str
    read: Callable[[slice, slice], Floats]

    def __post_init__(self) -> None:
        for name in ("x", "y"):
            object.__setattr__(self, name, grid_axis(getattr(self, name), name))

    @classmethod
    def of(cls, grid: HeightGrid) -> "HeightSource":
        """A grid that is in memory."""
        return cls(grid.x, grid.y, grid.crs, lambda rows, columns: grid.heights[rows, columns])

    def window(self, rows: slice, columns: slice) -> HeightGrid:
        """The grid of some rows and columns; BadGeometry where it holds no height at all."""
        return HeightGrid(self.x[columns], self.y[rows], self.read(rows, columns), self.crs)

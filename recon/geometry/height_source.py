"""A height grid that need not be in memory: its axes are known, its heights are read by windows."""

from collections.abc import Callable
from dataclasses import dataclass, replace

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
        return cls(grid.x, grid.y, grid.crs, _Held(grid.heights))

    def window(self, rows: slice, columns: slice) -> HeightGrid:
        """The grid of some rows and columns; BadGeometry where it holds no height at all."""
        return HeightGrid(self.x[columns], self.y[rows], self.read(rows, columns), self.crs)

    def part(self, rows: slice, columns: slice) -> "HeightSource":
        """The grid of some rows and columns, whose heights are read when they are asked for."""
        n_rows, n_columns = len(self.y[rows]), len(self.x[columns])
        ends = slice(rows.start, rows.start + n_rows), slice(columns.start, columns.start + n_columns)
        return HeightSource(self.x[columns], self.y[rows], self.crs, _Part(self.read, *ends))

    def held(self, rows: slice, columns: slice) -> "HeightSource":
        """The grid with the heights of some rows and columns in memory, and no others."""
        return replace(self, read=_Held(self.read(rows, columns), rows.start, columns.start))


@dataclass(frozen=True, eq=False)
class _Part:
    """Reads within some rows and columns of a larger grid, and nothing beyond."""

    read: Callable[[slice, slice], Floats]
    rows: slice
    columns: slice

    def __call__(self, rows: slice, columns: slice) -> Floats:
        within = [
            slice(*asked.indices(whole.stop - whole.start)[:2])
            for asked, whole in ((rows, self.rows), (columns, self.columns))
        ]
        return self.read(_moved(within[0], self.rows.start), _moved(within[1], self.columns.start))


@dataclass(frozen=True, eq=False)
class _Held:
    """Heights in memory, and the row and column at which they begin."""

    heights: Floats
    south: int = 0
    west: int = 0

    def __call__(self, rows: slice, columns: slice) -> Floats:
        return self.heights[_moved(rows, -self.south), _moved(columns, -self.west)]


def _moved(part: slice, by: int) -> slice:
    """A slice of what begins elsewhere; an end that it leaves open stays so."""
    return slice(*(None if end is None else end + by for end in (part.start, part.stop)))

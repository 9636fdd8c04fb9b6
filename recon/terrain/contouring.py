"""A height grid to the contour map that a terrain is made from."""

from collections.abc import Sequence

import contourpy
import numpy as np
from numpy.typing import NDArray

from recon.errors import BadGeometry, BadOption
from recon.geometry.contour_map import ContourMap, HeightGrid

__all__ = ["contour_grid", "contour_levels"]

Floats = NDArray[np.float64]

CLEAR = 0.1  # of the steepest step to a neighbour: no nearer to a level may a height be, or contours meet at the place


def contour_grid(grid: HeightGrid, interval: float) -> ContourMap:
    """Contours of a grid at whole multiples of `interval` metres.

    Raises  BadOption when the interval is not positive or no contour results; BadGeometry when the grid has voids.
    """
    if not 0 < interval < np.inf:
        raise BadOption("--interval", f"must be a positive height in metres, not {interval}")
    z = grid.heights
    if np.isnan(z).any():
        j, i = (int(k) for k in np.argwhere(np.isnan(z))[0])
        raise BadGeometry(
            "grid", f"{int(np.isnan(z).sum())} cells hold no height, the first at ({grid.x[i]:.1f}, {grid.y[j]:.1f})"
        )
    first, last = np.floor(np.nanmin(z) / interval) + 1, np.ceil(np.nanmax(z) / interval) - 1
    contours = contour_levels(grid, (interval * np.arange(first, last + 1)).tolist())
    if contours is None:
        raise BadOption(
            "--interval", f"{interval:g} m gives no contour between {np.nanmin(z):g} and {np.nanmax(z):g} m"
        )
    return contours


def contour_levels(grid: HeightGrid, levels: Sequence[float]) -> ContourMap | None:
    """Contours of a grid at the given heights, None where it has none; cells beside a void have none.

    Heights near a level, or on it, would make contours touch at grid points: they are moved away from it, which moves
    no contour by more than a tenth of a cell.
    """
    masked = np.ma.masked_invalid(_off_levels(grid.heights, np.asarray(levels, dtype=np.float64)))
    maker = contourpy.contour_generator(grid.x, grid.y, masked, line_type=contourpy.LineType.Separate)
    lines, heights = [], []
    for level in levels:
        for line in maker.lines(level):
            lines.append(np.asarray(line))
            heights.append(level)
    if not lines:
        return None
    return ContourMap(lines, heights, [[grid.x[0], grid.y[0]], [grid.x[-1], grid.y[-1]]], grid.crs)


def _off_levels(z: Floats, levels: Floats) -> Floats:
    """The heights, those too near to a level moved off it: up from it, or down where they lie below."""
    if not len(levels):
        return z
    padded = np.pad(z, 1, constant_values=np.nan)
    beside = [padded[1:-1, 2:], padded[1:-1, :-2], padded[2:, 1:-1], padded[:-2, 1:-1]]
    clear = CLEAR * np.nanmax([np.zeros_like(z), *(np.abs(other - z) for other in beside)], axis=0)
    steps = np.diff(np.unique(z[np.isfinite(z)]))
    clear = np.maximum(clear, CLEAR * (float(steps.min()) if len(steps) else 1.0))  # on plateaus
    middles = (levels[1:] + levels[:-1]) / 2
    nearest = levels[np.searchsorted(middles, z)]
    near = np.abs(z - nearest) < clear
    return np.where(near, nearest + np.where(z >= nearest, clear, -clear), z)

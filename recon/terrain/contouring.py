"""A height grid to the contour map that a terrain is made from."""

import contourpy
import numpy as np

from recon.errors import BadGeometry, BadOption
from recon.geometry.contour_map import ContourMap, HeightGrid

__all__ = ["contour_grid"]

NUDGE = 0.1  # of the smallest step between two heights that occur: how far a height equal to a level is lifted


def contour_grid(grid: HeightGrid, interval: float) -> ContourMap:
    """Contours of a grid at whole multiples of `interval` metres.

    A height that equals a level would make contours touch at grid points: it is lifted by a share of the grid's step.
    Raises  BadOption when the interval is not positive or no contour results; BadGeometry when the grid has voids.
    """
    if not 0 < interval < np.inf:
        raise BadOption("--interval", f"must be a positive height in metres, not {interval}")
    z = grid.heights.copy()
    if np.isnan(z).any():
        j, i = (int(k) for k in np.argwhere(np.isnan(z))[0])
        raise BadGeometry(
            "grid", f"{int(np.isnan(z).sum())} cells hold no height, the first at ({grid.x[i]:.1f}, {grid.y[j]:.1f})"
        )
    first, last = np.floor(z.min() / interval) + 1, np.ceil(z.max() / interval) - 1
    values = interval * np.arange(first, last + 1)
    steps = np.diff(np.unique(z))
    lift = NUDGE * (float(steps.min()) if len(steps) else 1.0)
    z[np.isin(z, values)] += lift
    maker = contourpy.contour_generator(grid.x, grid.y, z, line_type=contourpy.LineType.Separate)
    lines, heights = [], []
    for value in values.tolist():
        for line in maker.lines(value):
            lines.append(np.asarray(line))
            heights.append(value)
    if not lines:
        raise BadOption("--interval", f"{interval:g} m gives no contour between {z.min():g} and {z.max():g} m")
    extent = [[grid.x[0], grid.y[0]], [grid.x[-1], grid.y[-1]]]
    return ContourMap(lines, heights, extent, grid.crs)

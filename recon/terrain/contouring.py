"""A height grid to the contour map that a terrain is made from."""

from collections.abc import Sequence

import contourpy
import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import label

from recon.errors import BadGeometry, BadOption
from recon.geometry.contour_map import ContourMap, HeightGrid

__all__ = ["clear_of_multiples", "contour_grid", "contour_levels", "contours_through", "largest_piece", "least_step"]

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

MOST_CLEAR = 0.25  # of the interval: farther a height is not moved
CLEAR = 0.1  # of the steepest step to a neighbour: no nearer to a level may a height be, or contours meet at the place


def contour_grid(grid: HeightGrid, interval: float) -> ContourMap:
    """Contours of a grid at whole multiples of `interval` metres.

    Raises  BadOption when the interval is not positive or no contour results; BadGeometry when voids cut the grid in
            pieces (see `largest_piece`).
    """
    if not 0 < interval < np.inf:
        raise BadOption("--interval", f"must be a positive height in metres, not {interval}")
    grid = _cropped(_without_pinches(grid))
    z, known = grid.heights, grid.known_cells()
    n_pieces = label(known)[1]
    if n_pieces != 1:
        raise BadGeometry("grid", f"voids cut it in {n_pieces} pieces: give one of them")
    first, last = np.floor(np.nanmin(z) / interval) + 1, np.ceil(np.nanmax(z) / interval) - 1
    contours = contour_levels(grid, (interval * np.arange(first, last + 1)).tolist())
    if contours is None:
        raise BadOption(
            "--interval", f"{interval:g} m gives no contour between {np.nanmin(z):g} and {np.nanmax(z):g} m"
        )
    return ContourMap(contours.lines, contours.heights, contours.extent, contours.crs, voids=_void_rings(grid, ~known))


def largest_piece(grid: HeightGrid) -> tuple[HeightGrid, int]:
    """The grid without what voids cut off from its largest piece, and how many heights are lost so.

    Raises  BadGeometry when no four neighbouring heights are known.
    """
    before, grid = grid, _without_pinches(grid)
    known = grid.known_cells()
    if not known.any():
        raise BadGeometry("grid", "has no cell with a height at all four corners")
    pieces, n_pieces = label(known)
    kept = pieces == 1 + np.argmax(np.bincount(pieces[known], minlength=n_pieces + 1)[1:])
    corner = np.zeros(grid.heights.shape, dtype=bool)
    for rows in (slice(None, -1), slice(1, None)):
        for columns in (slice(None, -1), slice(1, None)):
            corner[rows, columns] |= kept
    heights = np.where(corner, grid.heights, np.nan)
    lost = int((np.isfinite(before.heights) & np.isnan(heights)).sum())
    return HeightGrid(grid.x, grid.y, heights, grid.crs), lost


def _cropped(grid: HeightGrid) -> HeightGrid:
    """The grid without rows and columns at its sides where no cell has heights at all corners: no void surrounds it."""
    cells = grid.known_cells()
    if cells.all() or not cells.any():
        return grid
    rows, columns = (np.flatnonzero(cells.any(axis=axis)) for axis in (1, 0))
    j, i = slice(rows[0], rows[-1] + 2), slice(columns[0], columns[-1] + 2)
    return HeightGrid(grid.x[i], grid.y[j], grid.heights[j, i], grid.crs)


def _without_pinches(grid: HeightGrid) -> HeightGrid:
    """The grid without heights at which two known cells meet in a corner alone: there two borders would touch."""
    heights = grid.heights.copy()
    while True:
        known = HeightGrid(grid.x, grid.y, heights).known_cells()
        a, b, c, d = known[:-1, :-1], known[:-1, 1:], known[1:, :-1], known[1:, 1:]
        pinched = (a & d & ~b & ~c) | (b & c & ~a & ~d)
        if not pinched.any():
            return HeightGrid(grid.x, grid.y, heights, grid.crs)
        heights[1:-1, 1:-1][pinched] = np.nan


def _void_rings(grid: HeightGrid, void: Flags) -> list[Floats]:
    """Rings round the void cells, along grid lines."""
    rows, columns = np.nonzero(void)
    cells = shapely.box(grid.x[columns], grid.y[rows], grid.x[columns + 1], grid.y[rows + 1])
    parts = shapely.get_parts(shapely.union_all(cells))
    return [shapely.get_coordinates(shapely.simplify(part, 0.0).exterior) for part in parts]


def contour_levels(grid: HeightGrid, levels: Sequence[float]) -> ContourMap | None:
    """Contours of a grid at the given heights, None where it has none; cells beside a void have none.

    Heights near a level, or on it, would make contours touch at grid points: they are moved away from it, which moves
    no contour by more than a tenth of a cell.
    """
    if len(levels):
        at = np.asarray(levels, dtype=np.float64)
        nearest = at[np.searchsorted((at[1:] + at[:-1]) / 2, grid.heights)]
        grid = HeightGrid(grid.x, grid.y, _off_levels(grid.heights, nearest, least_step(grid.heights)), grid.crs)
    return contours_through(grid, levels)


def clear_of_multiples(grid: HeightGrid, interval: float, step: float) -> HeightGrid:
    """The grid with heights near a multiple of the interval moved away from it, as `contour_levels` moves them.

    step  as `least_step` of the whole grid; heights but the outermost ones come out alike in every window of that
    """
    nearest = interval * np.round(grid.heights / interval)
    return HeightGrid(grid.x, grid.y, _off_levels(grid.heights, nearest, step, MOST_CLEAR * interval), grid.crs)


def contours_through(grid: HeightGrid, levels: Sequence[float]) -> ContourMap | None:
    """Contours of a grid that has no height at any of the levels, the higher ground on their left; None without one."""
    masked = np.ma.masked_invalid(grid.heights)
    maker = contourpy.contour_generator(
        grid.x, grid.y, masked, line_type=contourpy.LineType.Separate, corner_mask=False
    )
    lines, heights = [], []
    for level in levels:
        for line in maker.lines(level):
            lines.append(np.asarray(line))
            heights.append(level)
    if not lines:
        return None
    return ContourMap(lines, heights, [[grid.x[0], grid.y[0]], [grid.x[-1], grid.y[-1]]], grid.crs)


def least_step(z: Floats) -> float:
    """The smallest difference between two heights that occur; 1 where only one does."""
    steps = np.diff(np.unique(z[np.isfinite(z)]))
    return float(steps.min()) if len(steps) else 1.0


def _off_levels(z: Floats, nearest: Floats, step: float, most: float = np.inf) -> Floats:
    """The heights, those too near to their nearest level moved off it: up from it, or down where they lie below."""
    padded = np.pad(z, 1, constant_values=np.nan)
    beside = [padded[1:-1, 2:], padded[1:-1, :-2], padded[2:, 1:-1], padded[:-2, 1:-1]]
    clear = CLEAR * np.nanmax([np.zeros_like(z), *(np.abs(other - z) for other in beside)], axis=0)
    clear = np.minimum(np.maximum(clear, CLEAR * step), most)  # a step tells on plateaus
    near = np.abs(z - nearest) < clear
    return np.where(near, nearest + np.where(z >= nearest, clear, -clear), z)

"""The map of a ground: relief under the contours, kinds of patches, and how far it is off what was given."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import LightSource
from matplotlib.figure import Figure
from numpy.typing import NDArray

from recon.geometry.contour_map import ContourMap, HeightGrid
from recon.terrain.evaluation import contour_distances, elevations
from recon.terrain.pipeline import Terrain
from recon.terrain.sections import contours_at

__all__ = ["draw_map"]

Floats = NDArray[np.float64]

PIXELS = 360  # of the relief, along the longer side of the map
SIDE, POINTS = 6.0, 72.0  # inches of a panel, along the longer side, and points of an inch
POINT = 2.0  # square points of a contour's vertex
KINDS = ("junction", "sleeve", "terminal", "quad")
COLOURS = ("#d8b26e", "#9fb7a5", "#b9695c", "#dfe3e0")
GIVEN, OURS = "#7a4b22", "#1f6f8b"
MOST_SHOWN = 40_000  # heights of a grid
HALF = 0.5  # of the interval: the ground's own contours are drawn between those given


def draw_map(path: Path, contours: ContourMap, ground: Terrain, against: HeightGrid | None) -> None:
    """Draw into a PNG file; against is the grid that the ground is measured by, if any."""
    width, height = (contours.extent[1] - contours.extent[0]) * SIDE / np.ptp(contours.extent, axis=0).max()
    figure = Figure(figsize=(3.0 * width + 2.5, height + 1.2), layout="constrained")
    relief, kinds, errors = figure.subplots(1, 3)
    _draw_relief(relief, contours, ground)
    _draw_kinds(kinds, ground)
    places, off, what = _misses(contours, ground, against)
    room = SIDE * POINTS / np.ptp(contours.extent, axis=0).max()  # of a metre on paper
    dot = POINT if against is None else max(POINT, (room * float(against.x[1] - against.x[0])) ** 2)
    shown = errors.scatter(*places.T, c=off, s=dot, marker="s", cmap="viridis", linewidths=0.0, vmin=0.0)
    figure.colorbar(shown, ax=errors, shrink=0.8, label=what)
    errors.set_title("errors")
    for panel in (relief, kinds, errors):
        panel.set_xlim(*contours.extent[:, 0])
        panel.set_ylim(*contours.extent[:, 1])
        panel.set_aspect("equal")
        panel.tick_params(labelsize=7)
    figure.savefig(path, dpi=110, format="png")


def _draw_relief(panel: Axes, contours: ContourMap, ground: Terrain) -> None:
    (x0, y0), (x1, y1) = contours.extent
    cell = max(x1 - x0, y1 - y0) / PIXELS
    x, y = np.arange(x0 + cell / 2, x1, cell), np.arange(y0 + cell / 2, y1, cell)
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    heights = elevations(ground, places)[0].reshape(len(y), len(x))
    shade = LightSource(315, 45).hillshade(heights, vert_exag=1.5, dx=cell, dy=cell)
    panel.imshow(shade, cmap="gray", origin="lower", extent=(x0, x1, y0, y1), vmin=-0.3, vmax=1.0)
    levels = np.unique(contours.heights)
    between = levels[0] + HALF * contours.interval() + contours.interval() * np.arange(len(levels))
    own = contours_at(ground, between.tolist())
    made = () if own is None else own.lines
    for lines, colour, label in ((contours.lines, GIVEN, "given"), (made, OURS, "of the ground, halfway")):
        panel.add_collection(LineCollection(list(lines), colors=colour, linewidths=0.5, label=label))
    panel.legend(loc="upper right", fontsize=7)
    panel.set_title("relief and contours")


def _draw_kinds(panel: Axes, ground: Terrain) -> None:
    layout, is_contour = ground.layout, ground.tiling.is_contour
    used = np.where(layout.side_edges >= 0, layout.side_edges, 0)
    sides = (is_contour[used] & (layout.side_edges >= 0)).sum(axis=1)
    kind = np.where(layout.is_triangle, np.minimum(sides, 2), 3)
    corners = ground.tiling.points[layout.corners] + ground.origin
    for number, (name, colour) in enumerate(zip(KINDS, COLOURS)):
        rows = kind == number
        label = f"{name}: {int(rows.sum())}"
        patches = PolyCollection(corners[rows], facecolors=colour, edgecolors="#555555", linewidths=0.2, label=label)
        panel.add_collection(patches)
    panel.legend(loc="upper right", fontsize=7)
    panel.set_title("patches")


def _misses(contours: ContourMap, ground: Terrain, against: HeightGrid | None) -> tuple[Floats, Floats, str]:
    """Places, how far the ground is off there, and what that is."""
    if against is None:
        order = np.argsort(contours.heights, kind="stable")  # that of contour_distances
        places: Sequence[Floats] = [contours.lines[k] for k in order]
        return np.concatenate(places), contour_distances(ground, contours), "contours off those given, in plan, m"
    grid, heights = against.places()
    some = np.arange(len(grid))[:: max(1, len(grid) // MOST_SHOWN)]
    miss = np.abs(elevations(ground, grid[some])[0] - heights[some])
    inside = np.isfinite(miss)
    return grid[some][inside], miss[inside], "height off the grid, m"

"""A map too large for memory, tile by tile: its lattice of borders, and the ground of every tile.

    o-------o-------o      o  node: the jet there comes from the ground around it
    |  r0   |  r0   |      |  seam: the vertices on it, and their jets, come from the ground on both sides of it and the
    |  c0   |  c1   |         nodes at its ends
    o-------o-------o      tiles: the ground within, held to the seams and nodes around it
    |  r1   |  r1   |
    |  c0   |  c1   |      Each looks at heights within a margin of itself alone. So a tile does not depend on which
    o-------o-------o      others are made, nor in which order, and it meets its neighbours exactly.

Tiles are counted as sheets of a map are: rows from the north, columns from the west.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from recon.errors import BadGeometry, BadOption
from recon.geometry.contour_map import ContourMap, HeightGrid
from recon.geometry.height_source import HeightSource
from recon.terrain.border import Border, BorderVertices
from recon.terrain.contouring import clear_of_multiples, contours_through, least_step
from recon.terrain.pipeline import SHARE_OF_SPACING, PatchKind, Terrain, TerrainOptions, terrain_surface
from recon.terrain.seams import Stretch, node_vertex, seam_vertices

__all__ = ["MapTiles", "Place", "TiledMap", "cells_within", "lattice", "plan_tiles"]

Floats = NDArray[np.float64]
Place = tuple[int, int]

POINTS_A_CELL = 0.94  # of a cell: the usual way between two points of a contour, which follows the grid's cells
MARGIN = 48  # cells around a seam or a node whose ground tells its jets
REACH = MARGIN + 1  # cells beyond a tile within which it looks at heights: one more keeps them off the contours' levels
FEWEST = 16  # cells of a tile along its shorter side
HAIR = 1e-6  # of a cell, by which a side of a box may miss the grid line that it was meant to be
BLOCK = 256  # rows that are looked through at once


@dataclass(frozen=True, eq=False)
class TiledMap:
    """A grid, how it is contoured, and where it is cut.

    rows, columns  places in the grid's rows and columns at which the lattice lies, its ends included
    interval       metres of height between contours
    step           metres, the smallest difference between two heights of the grid
    lowest, highest  heights of the grid
    options        of every tile's ground; the tolerance is given
    """

    source: HeightSource
    rows: tuple[int, ...]
    columns: tuple[int, ...]
    interval: float
    step: float
    lowest: float
    highest: float
    options: TerrainOptions

    @property
    def shape(self) -> Place:
        """Rows and columns of tiles."""
        return len(self.rows) - 1, len(self.columns) - 1

    @cached_property
    def origin(self) -> Floats:
        """(2,) place of the map at which all tiles have their x = y = 0."""
        x, y = self.source.x, self.source.y
        return np.round([(x[0] + x[-1]) / 2, (y[0] + y[-1]) / 2])

    @property
    def seam_options(self) -> TerrainOptions:
        """Of the ground across borders, whose jets are wanted and no patches."""
        return replace(self.options, patches=PatchKind.POLYNOMIAL)

    @property
    def spacing(self) -> float:
        return point_spacing_of(self.source)

    def extent(self, tile: Place) -> tuple[slice, slice]:
        """Rows and columns of the grid that a tile covers, those of its borders included."""
        south = self.shape[0] - 1 - tile[0]
        return (
            slice(self.rows[south], self.rows[south + 1] + 1),
            slice(self.columns[tile[1]], self.columns[tile[1] + 1] + 1),
        )

    def near(self, tile: Place) -> "TiledMap":
        """The same map for whoever makes that tile alone: of its heights it holds those that the tile depends on."""
        rows, columns = (slice(max(part.start - REACH, 0), part.stop + REACH) for part in self.extent(tile))
        return replace(self, source=self.source.held(rows, columns))


def point_spacing_of(source: HeightSource) -> float:
    """Metres between neighbouring points of a grid's contours, by the size of its cells."""
    cells = [(axis[-1] - axis[0]) / (len(axis) - 1) for axis in (source.x, source.y)]
    return POINTS_A_CELL * float(np.sqrt(cells[0] * cells[1]))


def plan_tiles(source: HeightSource, interval: float, size: float, options: TerrainOptions | None = None) -> TiledMap:
    """Look through a grid, block by block, and lay the lattice: tiles of about `size` metres, none below half of it.

    Raises  BadOption when the interval is not positive, a tile would be too small, or no height lies beyond a contour;
            BadGeometry when no height is known.
    """
    if not 0 < interval < np.inf:
        raise BadOption("--interval", f"must be a positive height in metres, not {interval}")
    rows, columns = lattice(source, size)
    lowest, highest, step = _looked_through(source)
    if np.floor(lowest / interval) == np.floor(highest / interval):
        raise BadOption("--interval", f"{interval:g} m gives no contour between {lowest:g} and {highest:g} m")
    options = options or TerrainOptions()
    options = replace(options, tolerance=options.tolerance or SHARE_OF_SPACING * point_spacing_of(source))
    return TiledMap(source, rows, columns, interval, step, lowest, highest, options)


def cells_within(source: HeightSource, box: Floats) -> HeightSource:
    """The part of a grid whose cells lie wholly in a box (2, 2) of lower left and upper right corner.

    Raises  BadOption when that is nothing, or too little for a tile.
    """
    parts = []
    for axis, (low, high) in zip((source.x, source.y), box.T.tolist()):
        if not max(low, axis[0]) < min(high, axis[-1]):
            raise BadOption("--clip", "the box and the map have no place in common")
        hair = HAIR * (axis[1] - axis[0])
        parts.append(slice(*np.searchsorted(axis, (low - hair, high + hair)).tolist()))
    columns, rows = parts
    cells = [max(0, part.stop - part.start - 1) for part in parts]
    if min(cells) < FEWEST:
        raise BadOption("--clip", f"the box holds {cells[0]} by {cells[1]} cells, where a tile has {FEWEST} or more")
    return source.part(rows, columns)


def lattice(source: HeightSource, size: float) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Rows and columns of a grid between which tiles of about `size` metres lie; no height is looked at.

    Raises  BadOption when a tile would be too small.
    """
    return _cut(source.y, size), _cut(source.x, size)


def _cut(axis: Floats, size: float) -> tuple[int, ...]:
    cell = (axis[-1] - axis[0]) / (len(axis) - 1)
    n = round(size / cell)
    if n < FEWEST:
        raise BadOption("--tile", f"must be {FEWEST * cell / 1000:g} km or more, {FEWEST} cells of the grid")
    count = max(1, round((len(axis) - 1) / n))
    return (*(n * k for k in range(count)), len(axis) - 1)


def _looked_through(source: HeightSource) -> tuple[float, float, float]:
    """Lowest and highest height, and the smallest step between heights of one block."""
    ranges = []
    for first in range(0, len(source.y), BLOCK):
        z = source.read(slice(first, first + BLOCK), slice(None))
        known = z[np.isfinite(z)]
        if len(known):
            ranges.append((known.min(), known.max(), least_step(z)))
    if not ranges:
        raise BadGeometry("grid", "holds no height at all")
    low, high, step = np.array(ranges).T
    return float(low.min()), float(high.max()), float(step.min())


@dataclass(frozen=True, eq=False)
class MapTiles:
    """Makes tiles of a map; what two of them share is found once."""

    plan: TiledMap
    _known: dict[tuple[Place, Place], BorderVertices] = field(default_factory=dict)

    def tile(self, tile: Place, doing: Callable[[str], None] = lambda step: None) -> Terrain:
        """The ground of one tile, which is (row from the north, column from the west).

        Raises  BadGeometry naming a place, as `terrain_surface` does, and where a height is not known in the tile or
                within the margin of its borders.
        """
        rows, columns = self.plan.extent(tile)
        doing("finding the borders")
        border = self._border(self.around(tile))
        contours = self._contours(rows, columns)
        if contours is None:
            x, y = self.plan.source.x[columns.start], self.plan.source.y[rows.start]
            raise BadGeometry(
                "tile", f"r{tile[0]} c{tile[1]} from ({x:.0f}, {y:.0f}) holds no contour; take a smaller --interval"
            )
        return terrain_surface(contours, self.plan.options, border=border, doing=doing)

    def around(self, tile: Place) -> BorderVertices:
        """The vertices of the nodes and seams that a tile shares with others."""
        rows, columns = self.plan.extent(tile)
        south, north, west, east = rows.start, rows.stop - 1, columns.start, columns.stop - 1
        sides = [((south, west), (south, east)), ((south, east), (north, east)),
                 ((north, west), (north, east)), ((south, west), (north, west))]  # fmt: skip
        shared = [side for side in sides if not self._is_outer(*side)]
        corners = sorted({corner for side in shared for corner in side})
        parts = [*(self._node(corner) for corner in corners), *(self._seam(*side) for side in shared)]
        return BorderVertices.joined([BorderVertices.none(), *parts])

    def _is_outer(self, start: Place, end: Place) -> bool:
        """Whether a side lies on the border of the whole map."""
        ny, nx = len(self.plan.source.y), len(self.plan.source.x)
        return start[0] == end[0] in (0, ny - 1) or start[1] == end[1] in (0, nx - 1)

    def _node(self, place: Place) -> BorderVertices:
        key = place, place
        if key not in self._known:
            self._known[key] = node_vertex(self._stretch(place, place))
        return self._known[key]

    def _seam(self, start: Place, end: Place) -> BorderVertices:
        if (start, end) not in self._known:
            ends = self._node(start), self._node(end)
            self._known[start, end] = seam_vertices(self._stretch(start, end), *ends)
        return self._known[start, end]

    def _stretch(self, start: Place, end: Place) -> Stretch:
        """A seam, or a node, with the ground within the margin around it."""
        ny, nx = len(self.plan.source.y), len(self.plan.source.x)
        rows = slice(max(start[0] - MARGIN, 0), min(end[0] + MARGIN, ny - 1) + 1)
        columns = slice(max(start[1] - MARGIN, 0), min(end[1] + MARGIN, nx - 1) + 1)
        grid = self._heights(rows, columns)
        contours = contours_through(grid, self._levels(grid))
        border = self._border(BorderVertices.none())
        told = contours is not None and np.ptp(contours.heights) > 0  # one level tells no slope
        ground = terrain_surface(contours, self.plan.seam_options, border=border) if told and contours else None
        offset = rows.start, columns.start
        places = [(j - offset[0], i - offset[1]) for j, i in (start, end)]
        return Stretch(grid, places[0], places[1], ground, self.plan.origin, self.plan.spacing, self.plan.interval)

    def _border(self, vertices: BorderVertices) -> Border:
        return Border(self.plan.origin, self.plan.spacing, self.plan.interval, vertices)

    def _contours(self, rows: slice, columns: slice) -> ContourMap | None:
        grid = self._heights(rows, columns)
        return contours_through(grid, self._levels(grid))

    def _levels(self, grid: HeightGrid) -> list[float]:
        first = np.floor(grid.heights.min() / self.plan.interval) + 1
        last = np.floor(grid.heights.max() / self.plan.interval)
        return [float(self.plan.interval * k) for k in np.arange(first, last + 1)]

    def _heights(self, rows: slice, columns: slice) -> HeightGrid:
        """Heights off the contours' levels, the same in every window: so one row more is read on every side."""
        more = [slice(max(part.start - 1, 0), part.stop + 1) for part in (rows, columns)]
        given = self.plan.source.window(*more)
        unknown = np.argwhere(~np.isfinite(given.heights))
        if len(unknown):
            y, x = given.y[unknown[0][0]], given.x[unknown[0][1]]
            raise BadGeometry(
                "tile",
                f"no height is known at ({x:.1f}, {y:.1f}), in the tile or within {MARGIN} cells of it; fill voids"
                " first, or make the map as a whole (without --tile), which leaves them out",
            )
        grid = clear_of_multiples(given, self.plan.interval, self.plan.step)
        j, i = (slice(part.start - wide.start, part.stop - wide.start) for part, wide in zip((rows, columns), more))
        return HeightGrid(grid.x[i], grid.y[j], grid.heights[j, i], grid.crs)

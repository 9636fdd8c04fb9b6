"""Contour maps and height grids: what a terrain is measured as."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from recon.errors import BadGeometry
from recon.geometry.arrays import frozen_floats

__all__ = ["ContourMap", "HeightGrid"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ContourMap:
    """Contour lines with a height each, in one plane coordinate system.

    lines    C polylines (n, 2), n >= 2, in metres; closed where the last point repeats the first
    heights  (C,) in metres
    extent   (2, 2) lower left and upper right corner of the map; the lines' own bounding box when None
    crs      name of the coordinate reference system, as the file gives it, or an empty text
    spots    (s, 3) places between the contours whose height is known
    voids    rings (n, 2), n >= 5, their first point repeated at the end, within which nothing was measured; their
             sides lie along x or y, as those of a grid's cells
    Raises  BadGeometry.
    """

    lines: tuple[Floats, ...]
    heights: Floats
    extent: Floats
    spots: Floats
    crs: str = ""
    voids: tuple[Floats, ...] = ()

    def __init__(
        self,
        lines: Sequence[ArrayLike],
        heights: ArrayLike,
        extent: ArrayLike | None = None,
        crs: str = "",
        spots: ArrayLike | None = None,
        voids: Sequence[ArrayLike] = (),
    ) -> None:
        frozen = tuple(frozen_floats(line, (None, 2), f"contour {i}") for i, line in enumerate(lines))
        if not frozen:
            raise BadGeometry("contour map", "has no contours")
        short = next((i for i, line in enumerate(frozen) if len(line) < 2), None)
        if short is not None:
            raise BadGeometry("contour map", f"contour {short} has one vertex only")
        if extent is None:
            points = np.concatenate(frozen)
            extent = np.array([points.min(axis=0), points.max(axis=0)])
        object.__setattr__(self, "lines", frozen)
        object.__setattr__(self, "heights", frozen_floats(heights, (len(frozen),), "contour map: heights"))
        object.__setattr__(self, "extent", frozen_floats(extent, (2, 2), "contour map: extent"))
        object.__setattr__(self, "crs", crs)
        spots = np.empty((0, 3)) if spots is None else spots
        object.__setattr__(self, "spots", frozen_floats(spots, (None, 3), "contour map: spots"))
        rings = tuple(frozen_floats(ring, (None, 2), f"void {i}") for i, ring in enumerate(voids))
        for i, ring in enumerate(rings):
            if len(ring) < 5 or (ring[0] != ring[-1]).any() or ((ring[1:] != ring[:-1]).sum(axis=1) != 1).any():
                raise BadGeometry(f"void {i}", "is no closed ring whose sides lie along x or y")
        object.__setattr__(self, "voids", rings)

    @property
    def n_points(self) -> int:
        """Vertices of all lines; the repeated one of a closed line counts once."""
        return sum(len(line) - bool((line[0] == line[-1]).all()) for line in self.lines)

    def interval(self) -> float:
        """Height between neighbouring contours: the median step between the levels that occur; 1 for one level."""
        steps = np.diff(np.unique(self.heights))
        return float(np.median(steps)) if len(steps) else 1.0

    def moved(self, origin: ArrayLike) -> "ContourMap":
        """The same map with `origin` (2,) at (0, 0)."""
        to = np.asarray(origin, dtype=np.float64)
        spots, voids = self.spots - np.r_[to, 0.0], [ring - to for ring in self.voids]
        return ContourMap([line - to for line in self.lines], self.heights, self.extent - to, self.crs, spots, voids)

    def sides(self) -> list[tuple[int, float, float, float]]:
        """Straight pieces of the border, those of voids too: the axis that stays, its value, the range of the other."""
        (x0, y0), (x1, y1) = self.extent.tolist()
        found = [(1, y0, x0, x1), (1, y1, x0, x1), (0, x0, y0, y1), (0, x1, y0, y1)]
        for ring in self.voids:
            for a, b in pairwise(ring.tolist()):
                axis = 0 if a[0] == b[0] else 1
                found.append((axis, a[axis], *sorted((a[1 - axis], b[1 - axis]))))
        return found

    def corners(self) -> Floats:
        """(n, 2) points where the border turns, those of voids too."""
        (x0, y0), (x1, y1) = self.extent
        return np.vstack([[[x0, y0], [x1, y0], [x1, y1], [x0, y1]], *(ring[:-1] for ring in self.voids)])

    def in_void(self, places: Floats) -> NDArray[np.bool_]:
        """(m,) whether places (m, 2) lie inside a void."""
        inside = np.zeros(len(places), dtype=bool)
        for ring in self.voids:
            inside |= shapely.contains_xy(shapely.Polygon(ring), places[:, 0], places[:, 1])
        return inside

    def with_lines(self, lines: Sequence[ArrayLike], heights: ArrayLike) -> "ContourMap":
        """The same map with other contours."""
        return ContourMap(lines, heights, self.extent, self.crs, self.spots, self.voids)

    def with_spots(self, spots: ArrayLike) -> "ContourMap":
        """The same map with other spot heights."""
        return ContourMap(self.lines, self.heights, self.extent, self.crs, spots, self.voids)


@dataclass(frozen=True, eq=False)
class HeightGrid:
    """Heights on a rectangular grid; NaN where nothing was measured.

    x, y     (nx,), (ny,) increasing coordinates of the grid's columns and rows, in metres
    heights  (ny, nx), row j at y[j]
    crs      name of the coordinate reference system, or an empty text
    Raises  BadGeometry.
    """

    x: Floats
    y: Floats
    heights: Floats
    crs: str = ""

    def __post_init__(self) -> None:
        for name in ("x", "y"):
            axis = frozen_floats(getattr(self, name), (None,), f"grid: {name}")
            if len(axis) < 2 or (np.diff(axis) <= 0).any():
                raise BadGeometry("grid", f"its {name} coordinates are not two or more increasing numbers")
            object.__setattr__(self, name, axis)
        heights = np.array(self.heights, dtype=np.float64)
        if heights.shape != (len(self.y), len(self.x)):
            raise BadGeometry("grid", f"has {heights.shape} heights where {len(self.y)} x {len(self.x)} are needed")
        if not np.isfinite(heights).any():
            raise BadGeometry("grid", "holds no height at all")
        heights.setflags(write=False)
        object.__setattr__(self, "heights", heights)

    def known_cells(self) -> NDArray[np.bool_]:
        """(ny - 1, nx - 1) cells whose four corners hold a height."""
        known = np.isfinite(self.heights)
        return np.asarray(known[1:, 1:] & known[:-1, 1:] & known[1:, :-1] & known[:-1, :-1])

    def places(self) -> tuple[Floats, Floats]:
        """(m, 2) places at which a height was measured, and the (m,) heights."""
        x, y = np.meshgrid(self.x, self.y)
        known = np.isfinite(self.heights)
        return np.column_stack([x[known], y[known]]), self.heights[known]

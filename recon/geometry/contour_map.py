"""Contour maps and height grids: what a terrain is measured as."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
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
    Raises  BadGeometry.
    """

    lines: tuple[Floats, ...]
    heights: Floats
    extent: Floats
    crs: str = ""

    def __init__(
        self, lines: Sequence[ArrayLike], heights: ArrayLike, extent: ArrayLike | None = None, crs: str = ""
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
        return ContourMap([line - to for line in self.lines], self.heights, self.extent - to, self.crs)


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

    def places(self) -> tuple[Floats, Floats]:
        """(m, 2) places at which a height was measured, and the (m,) heights."""
        x, y = np.meshgrid(self.x, self.y)
        known = np.isfinite(self.heights)
        return np.column_stack([x[known], y[known]]), self.heights[known]

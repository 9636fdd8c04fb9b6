"""Contour maps and height grids: what a terrain is measured as."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from recon.errors import BadGeometry
from recon.geometry.arrays import frozen_floats

__all__ = ["ContourMap", "HeightGrid", "grid_axis"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ContourMap:
    """Contour lines with a height each, in one plane coordinate system.

    lines    C polylines (n, 2), n >= 2, in metres; closed where the last point repeats the first
    heights  (C,) in metres
    extent   (2, 2) lower left and upper right corner of the map; when None the lines' own bounding box, wider by the
             way between two points on sides that no line ends on: a contour that only touches a side needs room there
    crs      name of the coordinate reference system, as the file gives it, or an empty text
    spots    (s, 3) places between the contours whose height is known
    voids    rings (n, 2), n >= 4, their first point repeated at the end, within which nothing was measured
    outline  the ring round the map; the rectangle of its extent when None
    Raises  BadGeometry.
    """

    lines: tuple[Floats, ...]
    heights: Floats
    extent: Floats
    crs: str
    spots: Floats
    voids: tuple[Floats, ...]
    outline: Floats

    def __init__(
        self,
        lines: Sequence[ArrayLike],
        heights: ArrayLike,
        extent: ArrayLike | None = None,
        crs: str = "",
        spots: ArrayLike | None = None,
        voids: Sequence[ArrayLike] = (),
        outline: ArrayLike | None = None,
    ) -> None:
        frozen = tuple(frozen_floats(line, (None, 2), f"contour {i}") for i, line in enumerate(lines))
        if not frozen:
            raise BadGeometry("contour map", "has no contours")
        short = next((i for i, line in enumerate(frozen) if len(line) < 2), None)
        if short is not None:
            raise BadGeometry("contour map", f"contour {short} has fewer than two vertices")
        around = None if outline is None else _ring(outline, "outline")
        if extent is None:
            extent = _roomy_box(frozen) if around is None else np.array([around.min(axis=0), around.max(axis=0)])
        object.__setattr__(self, "lines", frozen)
        object.__setattr__(self, "heights", frozen_floats(heights, (len(frozen),), "contour map: heights"))
        object.__setattr__(self, "extent", frozen_floats(extent, (2, 2), "contour map: extent"))
        if not (self.extent[0] < self.extent[1]).all():
            raise BadGeometry("contour map", "its extent does not run from a lower left to an upper right corner")
        object.__setattr__(self, "crs", crs)
        spots = np.empty((0, 3)) if spots is None else spots
        object.__setattr__(self, "spots", frozen_floats(spots, (None, 3), "contour map: spots"))
        object.__setattr__(self, "voids", tuple(_ring(ring, f"void {i}") for i, ring in enumerate(voids)))
        object.__setattr__(self, "outline", _rectangle(*self.extent) if around is None else around)

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
        return ContourMap(
            [line - to for line in self.lines],
            self.heights,
            self.extent - to,
            self.crs,
            self.spots - np.r_[to, 0.0],
            [ring - to for ring in self.voids],
            self.outline - to,
        )

    def with_lines(self, lines: Sequence[ArrayLike], heights: ArrayLike) -> "ContourMap":
        """The same map with other contours."""
        return ContourMap(lines, heights, self.extent, self.crs, self.spots, self.voids, self.outline)

    def with_spots(self, spots: ArrayLike) -> "ContourMap":
        """The same map with other spot heights."""
        return ContourMap(self.lines, self.heights, self.extent, self.crs, spots, self.voids, self.outline)

    def sides(self) -> Floats:
        """(n, 2, 2) straight pieces of the border, those of voids too."""
        return np.concatenate([np.stack([ring[:-1], ring[1:]], axis=1) for ring in (self.outline, *self.voids)])

    def holds(self, places: Floats) -> NDArray[np.bool_]:
        """(m,) whether places (m, 2) lie inside the map, and in no void."""
        inside = shapely.contains_xy(shapely.Polygon(self.outline), places[:, 0], places[:, 1])
        for ring in self.voids:
            inside &= ~shapely.contains_xy(shapely.Polygon(ring), places[:, 0], places[:, 1])
        return np.asarray(inside)


def _roomy_box(lines: Sequence[Floats]) -> Floats:
    """(2, 2) the box around the lines, with room on the sides that they touch and do not end on.

    An end in a corner of the box lies on the other side: a contour may run along a side from corner to corner.
    """
    points = np.concatenate(lines)
    box = np.array([points.min(axis=0), points.max(axis=0)])
    ends = np.array([line[[0, -1]] for line in lines if (line[0] != line[-1]).any()]).reshape(-1, 2)
    steps = np.concatenate([np.linalg.norm(np.diff(line, axis=0), axis=1) for line in lines])
    room = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    on_side = ends == box[:, None]  # (2, n, 2): low and high side, end, axis
    beside = on_side & ~on_side.any(axis=0)[:, ::-1]
    return box + np.where(beside.any(axis=1), 0.0, [[-room], [room]])


def _ring(points: ArrayLike, what: str) -> Floats:
    ring = frozen_floats(points, (None, 2), what)
    if len(ring) < 4 or (ring[0] != ring[-1]).any() or not shapely.Polygon(ring).is_valid:
        raise BadGeometry(what, "is no closed ring that keeps clear of itself")
    return ring


def _rectangle(low: Floats, high: Floats) -> Floats:
    (x0, y0), (x1, y1) = low, high
    return frozen_floats([[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]], (5, 2), "contour map: extent")


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
            object.__setattr__(self, name, grid_axis(getattr(self, name), name))
        heights = frozen_floats(self.heights, (len(self.y), len(self.x)), "grid: heights", also=np.nan)
        if not np.isfinite(heights).any():
            raise BadGeometry("grid", "holds no height at all")
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


def grid_axis(values: ArrayLike, name: str) -> Floats:
    """The coordinates of a grid's columns or rows, locked; raises BadGeometry unless two or more increase."""
    axis = frozen_floats(values, (None,), f"grid: {name}")
    if len(axis) < 2 or (np.diff(axis) <= 0).any():
        raise BadGeometry("grid", f"its {name} coordinates are not two or more increasing numbers")
    return axis

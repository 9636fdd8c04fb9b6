"""A part of a contour map: what lies in a box or a polygon, its lines cut at the sides."""

import numpy as np
import shapely
from numpy.typing import NDArray

from recon.errors import BadOption
from recon.geometry.contour_map import ContourMap

__all__ = ["clip_to_box", "clip_to_polygon"]

Floats = NDArray[np.float64]


def clip_to_box(contours: ContourMap, box: Floats) -> ContourMap:
    """The contours inside a box (2, 2) of lower left and upper right corner, ended exactly on its sides.

    Raises  BadOption when the box is empty, or holds no contour.
    """
    low, high = np.maximum(box[0], contours.extent[0]), np.minimum(box[1], contours.extent[1])
    if (low >= high).any():
        raise BadOption("--clip", "the box and the map have no place in common")
    return _clipped(contours, shapely.box(*low, *high), "the box")


def clip_to_polygon(contours: ContourMap, ring: Floats) -> ContourMap:
    """The contours inside a polygon, whose ring (n, 2) repeats its first point at the end.

    Raises  BadOption when the polygon cuts itself, has no one piece in common with the map, or holds no contour.
    """
    area = shapely.Polygon(ring)
    if not area.is_valid:
        raise BadOption("--clip", f"the polygon is none ({shapely.is_valid_reason(area)})")
    area = area.intersection(shapely.Polygon(contours.outline))
    if area.geom_type != "Polygon" or area.is_empty:
        raise BadOption("--clip", "the polygon and the map have no place in common, or several pieces")
    return _clipped(contours, area, "the polygon")


def _clipped(contours: ContourMap, area: shapely.Polygon, what: str) -> ContourMap:
    for ring in contours.voids:
        area = area.difference(shapely.Polygon(ring))
    if area.geom_type != "Polygon" or area.is_empty:
        raise BadOption("--clip", f"voids leave {what} nothing, or cut it in pieces")
    area = shapely.normalize(shapely.simplify(area, 0.0))
    lines, heights = [], []
    for line, height in zip(contours.lines, contours.heights.tolist()):
        for points in _inside(line, area):
            lines.append(points)
            heights.append(height)
    if not lines:
        raise BadOption("--clip", f"{what} holds no contour")
    x0, y0, x1, y1 = area.bounds
    spots = contours.spots[shapely.contains_xy(area, contours.spots[:, 0], contours.spots[:, 1])]
    voids = [shapely.get_coordinates(hole) for hole in area.interiors]
    around = shapely.get_coordinates(area.exterior)
    return ContourMap(lines, heights, [[x0, y0], [x1, y1]], contours.crs, spots, voids, around)


def _inside(line: Floats, area: shapely.Polygon) -> list[Floats]:
    """The parts of a line within an area; a ring that stays whole keeps its beginning."""
    whole = shapely.LineString(line)
    if area.contains_properly(whole):
        return [line]
    parts = shapely.get_parts(shapely.line_merge(shapely.intersection(whole, area)))
    return [shapely.get_coordinates(part) for part in parts if part.geom_type == "LineString" and part.length > 0.0]

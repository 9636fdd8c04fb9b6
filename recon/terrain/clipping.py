"""A part of a contour map: what lies in a box, its lines cut at the box's sides."""

import numpy as np
import shapely
from numpy.typing import NDArray

from recon.errors import BadOption
from recon.geometry.contour_map import ContourMap

__all__ = ["clip_to_box"]

Floats = NDArray[np.float64]


def clip_to_box(contours: ContourMap, box: Floats) -> ContourMap:
    """The contours inside a box (2, 2) of lower left and upper right corner, ended exactly on its sides.

    Raises  BadOption when the box is empty, or holds no contour.
    """
    low, high = np.maximum(box[0], contours.extent[0]), np.minimum(box[1], contours.extent[1])
    if (low >= high).any():
        raise BadOption("--clip", "the box and the map have no place in common")
    lines, heights = [], []
    for line, height in zip(contours.lines, contours.heights.tolist()):
        if ((line >= low) & (line <= high)).all():
            lines.append(line)
            heights.append(height)
            continue
        inside = shapely.line_merge(shapely.clip_by_rect(shapely.LineString(line), *low, *high))
        for part in shapely.get_parts(inside):
            points = shapely.get_coordinates(part)
            if shapely.get_type_id(part) == 1 and len(points) > 1:
                lines.append(points)
                heights.append(height)
    if not lines:
        raise BadOption("--clip", "the box holds no contour")
    spots = contours.spots[((contours.spots[:, :2] > low) & (contours.spots[:, :2] < high)).all(axis=1)]
    return ContourMap(lines, heights, [low, high], contours.crs, spots)

"""Spot heights against the contours around them: those that say the same, and those that contradict."""

import numpy as np
import shapely
from numpy.typing import NDArray

from recon.errors import BadGeometry
from recon.geometry.contour_map import ContourMap
from recon.terrain.levels import Levels
from recon.terrain.tiling import Tiling

__all__ = ["spots_beside_contours", "spots_off_strips"]

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

MOST_NAMED = 5
NEAR = 2.0  # tolerances from a contour within which its curve may pass on either side of a spot


def spots_beside_contours(contours: ContourMap, tolerance: float, *, mend: bool) -> tuple[ContourMap, tuple[str, ...]]:
    """The map without spot heights on a contour, in a void or off the map, and what a user should know of them.

    tolerance  metres that a contour's curve may stay from its points
    mend       leave out spots whose height is not their contour's, where they are refused else
    Raises     BadGeometry naming numbers and places.
    """
    spots = contours.spots
    if not len(spots):
        return contours, ()
    tree = shapely.STRtree(shapely.linestrings(np.concatenate(contours.lines), indices=_owners(contours)))
    places = shapely.points(spots[:, :2])
    (spot, line), _ = tree.query_nearest(places, max_distance=NEAR * tolerance, return_distance=True, all_matches=False)
    off = np.abs(spots[spot, 2] - contours.heights[line])
    _refuse(spots, spot[off > 0.5 * contours.interval()], "lies on a contour of another height", mend=mend)
    border = shapely.MultiLineString([contours.outline, *contours.voids])
    kept = contours.holds(spots[:, :2]) & (shapely.distance(border, places) > tolerance)
    kept[spot] = False
    if kept.all():
        return contours, ()
    note = f"{int((~kept).sum())} spot heights lie on contours, in voids or off the map and say nothing more"
    return contours.with_spots(spots[kept]), (note,)


def spots_off_strips(tiling: Tiling, limits: Levels, origin: Floats, *, mend: bool) -> Flags:
    """(s,) spot heights that lie beyond the heights of the contours on either side of their strip.

    Raises  BadGeometry naming numbers and places, unless they are to be mended.
    """
    first = len(tiling.points) - len(tiling.spots)
    odd = np.zeros(len(tiling.points), dtype=bool)
    corners, strip = tiling.triangles, limits.strip[:, None]
    height = tiling.vertex_heights()[corners]
    beyond = ((height < limits.low[strip]) | (height > limits.high[strip])) & (corners >= first)
    odd[corners[beyond & ~limits.ended[strip]]] = True
    spots = tiling.spots + np.r_[origin, 0.0]
    _refuse(spots, np.flatnonzero(odd[first:]), "is not between the contours around it", mend=mend)
    return odd[first:]


def _refuse(spots: Floats, numbers: NDArray[np.int64], fault: str, *, mend: bool) -> None:
    if mend or not len(numbers):
        return
    named = ", ".join(f"{z:g} m at ({x:.1f}, {y:.1f})" for x, y, z in spots[numbers[:MOST_NAMED]].tolist())
    more = f" and {len(numbers) - MOST_NAMED} more" if len(numbers) > MOST_NAMED else ""
    raise BadGeometry("spot heights", f"{named}{more}: the height {fault}; leave such spots out with --mend")


def _owners(contours: ContourMap) -> NDArray[np.int64]:
    return np.repeat(np.arange(len(contours.lines)), [len(line) for line in contours.lines])

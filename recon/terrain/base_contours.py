"""Contours for a base that cuts the ground: its own at the base's height, and the given ones clear of that.

contour of the base   exact: where the ground has that height
given contour         off the ground by up to the tolerance, so that it may cross the new one; then it gives way to
                      the curve that the ground has in its place, which cannot, but for the stretches where the two
                      run side by side, as in a wall: there it has a gap
"""

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.ops import substring

from recon.geometry.contour_map import ContourMap
from recon.numerics.bernstein import bernstein
from recon.terrain.contour_curves import ContourCurves
from recon.terrain.ground import Terrain
from recon.terrain.sections import CELLS, contours_at

__all__ = ["contours_with"]

Floats = NDArray[np.float64]

SAME = 0.01  # of the interval: contours so near to a height are taken to lie at it
BESIDE = 0.25  # of the tolerance: nearer to the border a new contour does not run, it ends there
ASTRAY = 4.0  # times that way: a contour that reaches the border within so much runs to it, others run along it
CLEAR = 0.1  # of the tolerance: other contours keep so far from the new one
OWN = 2.0  # tolerances within which all of a curve of the ground lies from the contour that it follows


def contours_with(contours: ContourMap, ground: Terrain, height: float) -> tuple[ContourMap, tuple[str, ...]]:
    """The contours that a ground was made from, and its own at one more height; and what was done to them.

    Given contours lie off the ground's own by its tolerance, so that some may cross the new ones: those give way to the
    curves that the ground has in their place, but for the stretches of these beside which the new ones run.
    """
    nearest = contours.heights[np.argmin(np.abs(contours.heights - height))]
    if abs(nearest - height) <= SAME * contours.interval():
        moved = contours.with_lines(contours.lines, np.where(contours.heights == nearest, height, contours.heights))
        return moved, () if nearest == height else (f"The contours at {nearest:g} m are taken to lie at {height:g} m.",)
    found = contours_at(ground, [height])
    added = None if found is None else _off_border(contours, found, BESIDE * ground.tolerance)
    if added is None:
        return contours, ()
    lines, heights, told = _clear_of(contours, added, ground)
    return contours.with_lines([*lines, *added.lines], [*heights, *added.heights.tolist()]), told


def _off_border(contours: ContourMap, found: ContourMap, reach: float) -> ContourMap | None:
    """Contours without the parts that run within reach of the border, the rest ended there; None where nothing is left.

    A contour that makes for the border keeps its way: those beside it do so too.
    """
    border = shapely.MultiLineString([contours.outline, *contours.voids])
    beside = border.buffer(reach)
    lines, heights = [], []
    for line, height in zip(found.lines, found.heights.tolist()):
        whole = shapely.LineString(line)
        away = shapely.line_merge(shapely.difference(whole, beside))
        for part in shapely.get_parts(away):
            points = _to_border(shapely.get_coordinates(part), whole, border, ASTRAY * reach)
            if len(points) > 2:
                lines.append(points)
                heights.append(height)
    return found.with_lines(lines, heights) if lines else None


def _to_border(points: Floats, whole: shapely.LineString, border: shapely.MultiLineString, most: float) -> Floats:
    """A part (n, 2) of a line, carried on to the border: along the line where it ends within `most`, else straight."""
    if (points[0] == points[-1]).all():
        return points
    feet = shapely.get_coordinates(shapely.shortest_line(border, shapely.points(points[[0, -1]])))[::2]
    first, last = shapely.line_locate_point(whole, shapely.points(points[[0, -1]]))
    ends = [feet[:1], feet[1:]]
    if first <= most and not whole.is_closed:
        ends[0] = shapely.get_coordinates(substring(whole, 0.0, first))[:-1]
    if whole.length - last <= most and not whole.is_closed:
        ends[1] = shapely.get_coordinates(substring(whole, last, whole.length))[1:]
    return np.vstack([ends[0], points, ends[1]])


def _clear_of(
    contours: ContourMap, added: ContourMap, ground: Terrain
) -> tuple[list[Floats], list[float], tuple[str, ...]]:
    """Lines and heights of contours that keep clear of added ones, and what was done to them.

    Those that do not are replaced by the curves that the ground has, and so are those that meet such a curve in turn.
    """
    given = np.array([shapely.LineString(line) for line in contours.lines], dtype=object)
    new = shapely.MultiLineString([shapely.LineString(line) for line in added.lines])
    reach = CLEAR * ground.tolerance
    met = set(shapely.STRtree(given).query(new, predicate="dwithin", distance=reach).tolist())
    if not met:
        return list(contours.lines), contours.heights.tolist(), ()
    curves, own = _own_lines(ground)
    follows: list[set[int]] = []
    for _ in range(len(given)):
        follows = [_followed(line, z, met, contours, ground) for line, z in zip(own, curves.heights.tolist())]
        taken = [line for line, some in zip(own, follows) if some]
        again = set(shapely.STRtree(given).query(taken, predicate="intersects")[1].tolist())
        if again <= met:
            break
        met |= again
    lines = [line for i, line in enumerate(contours.lines) if i not in met]
    heights = [z for i, z in enumerate(contours.heights.tolist()) if i not in met]
    beside, shortened = new.buffer(reach), 0
    for c in (c for c, some in enumerate(follows) if some):
        rest = shapely.line_merge(shapely.difference(own[c], beside))
        parts = [shapely.get_coordinates(part) for part in shapely.get_parts(rest)]
        shortened += rest.length < own[c].length - reach
        lines += [part for part in parts if len(part) > 2]
        heights += [float(curves.heights[c])] * sum(len(part) > 2 for part in parts)
    kept = len(met & set().union(*follows))
    counts = {
        "as the ground has them": kept,
        f"without what lies within {reach:.2g} m of the base": shortened,
        "not at all": len(met) - kept,
    }
    told = (f"Near the base {n} of {len(given)} contours are taken {how}." for how, n in counts.items() if n)
    return lines, heights, tuple(told)


def _own_lines(ground: Terrain) -> tuple[ContourCurves, list[shapely.LineString]]:
    """The curves of the ground's contours, and as lines whose vertices are those of `welded_triangles`."""
    curves = ground.tiling.curves
    points = np.einsum("tk,mkd->mtd", bernstein(3, np.linspace(0.0, 1.0, CELLS + 1)), curves.bezier) + ground.origin
    rows = [points[curves.contour == c] for c in range(len(curves.heights))]
    return curves, [shapely.LineString(np.vstack([own[:, :-1].reshape(-1, 2), own[-1, -1:]])) for own in rows]


def _followed(
    line: shapely.LineString, height: float, among: set[int], contours: ContourMap, ground: Terrain
) -> set[int]:
    """Those of some given contours that a line of the ground follows, all the way along."""
    reach, points = OWN * ground.tolerance, shapely.points(shapely.get_coordinates(line))
    level = [i for i in among if contours.heights[i] == height]
    return {i for i in level if (shapely.distance(shapely.LineString(contours.lines[i]), points) <= reach).all()}

"""Contours made ready: those that would vanish left out, ends that miss the border of the map put on it."""

import numpy as np
from numpy.typing import NDArray

from recon.errors import BadGeometry
from recon.geometry.contour_map import ContourMap

__all__ = ["MOST_NAMED", "ended_on_border", "part_of", "without_specks"]

SPECK = 0.05  # tolerances that a closed contour is long at least
MOST_NAMED = 5


def without_specks(contours: ContourMap, tolerance: float) -> tuple[ContourMap, tuple[str, ...]]:
    """The contours without closed ones so small that a curve within the tolerance may be one point; they are named."""
    length = np.array([np.linalg.norm(np.diff(line, axis=0), axis=1).sum() for line in contours.lines])
    closed = np.array([bool((line[0] == line[-1]).all()) for line in contours.lines])
    speck = np.where(closed, length < SPECK * tolerance, length == 0)
    if not speck.any():
        return contours, ()
    places = [(i, contours.lines[i][0]) for i in np.flatnonzero(speck).tolist()]
    named = ", ".join(f"{i} near ({x:.1f}, {y:.1f})" for i, (x, y) in places[:MOST_NAMED])
    more = f" and {len(places) - MOST_NAMED} more" if len(places) > MOST_NAMED else ""
    note = f"{len(places)} contours shorter than {SPECK * tolerance:.3g} m vanish in resampling: {named}{more}"
    if speck.all():
        raise BadGeometry("contours", f"all of them are shorter than {SPECK * tolerance:.3g} m at this tolerance")
    return part_of(contours, ~speck), (note,)


def ended_on_border(contours: ContourMap, tolerance: float) -> ContourMap:
    """The contours with ends that miss the border of the map by less than the tolerance put on it."""
    sides = contours.sides()
    way = sides[:, 1] - sides[:, 0]
    square = np.einsum("ij,ij->i", way, way)
    lines = []
    for line in contours.lines:
        moved = np.clip(line, *contours.extent)
        for end in () if (line[0] == line[-1]).all() else (0, -1):
            share = np.clip(np.einsum("ij,ij->i", moved[end] - sides[:, 0], way) / square, 0.0, 1.0)
            foot = sides[:, 0] + share[:, None] * way
            gap = np.linalg.norm(foot - moved[end], axis=1)
            if gap.min() < tolerance:
                moved[end] = foot[int(np.argmin(gap))]
        lines.append(moved)
    return contours.with_lines(lines, contours.heights)


def part_of(contours: ContourMap, keep: NDArray[np.bool_]) -> ContourMap:
    """Some of the contours, chosen by a mask (C,)."""
    rows = np.flatnonzero(keep).tolist()
    return contours.with_lines([contours.lines[i] for i in rows], contours.heights[rows])

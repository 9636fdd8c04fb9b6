"""What is wrong with a contour map, contour by contour: lines that cross, repeat or break off."""

import numpy as np
import shapely
from numpy.typing import NDArray

from recon.errors import BadGeometry
from recon.geometry.contour_map import ContourMap

__all__ = ["checked_contours"]

Floats = NDArray[np.float64]
MOST_NAMED = 5


def checked_contours(contours: ContourMap, tolerance: float, *, mend: bool) -> tuple[ContourMap, tuple[str, ...]]:
    """The contours, and what a user should know of them: which break off inside the map, which were left out.

    tolerance  metres within which an end counts as being on the border
    mend       leave out contours that repeat another one, where they are refused else
    Raises     BadGeometry naming numbers and places, where contours cross, touch or repeat.
    """
    lines = shapely.linestrings(np.concatenate(contours.lines), indices=_owners(contours))
    repeats = _repeats(contours)
    notes = []
    if repeats:
        told = _listed([f"{b} repeats {a} near {_at(contours.lines[b][0])}" for a, b in repeats])
        if not mend:
            raise BadGeometry("contours", f"{told}; leave them out with --mend")
        notes.append(f"left out: {told}")
    kept = np.setdiff1d(np.arange(len(lines)), [b for _, b in repeats])
    _refuse_crossings(lines, kept)
    ends = [f"{i} near {_at(end)}" for i in kept.tolist() for end in _loose_ends(contours, i, tolerance)]
    if ends:
        notes.append(f"{len(ends)} ends of contours break off inside the map: {_listed(ends)}")
    part = [contours.lines[i] for i in kept.tolist()]
    return contours.with_lines(part, contours.heights[kept]), tuple(notes)


def _owners(contours: ContourMap) -> NDArray[np.int64]:
    return np.repeat(np.arange(len(contours.lines)), [len(line) for line in contours.lines])


def _repeats(contours: ContourMap) -> list[tuple[int, int]]:
    """Pairs of contours with the same points, in whatever order and from whatever start; the second can go."""
    seen: dict[bytes, int] = {}
    pairs = []
    for i, line in enumerate(contours.lines):
        key = np.unique(line, axis=0).tobytes()
        if key in seen:
            pairs.append((seen[key], i))
        seen.setdefault(key, i)
    return pairs


def _refuse_crossings(lines: NDArray[np.object_], kept: NDArray[np.int64]) -> None:
    told = []
    for i in kept[~shapely.is_simple(lines[kept])].tolist():
        told.append(f"{i} crosses itself near {_at(shapely.get_coordinates(lines[i])[0])}")
    first, second = shapely.STRtree(lines[kept]).query(lines[kept], predicate="intersects")
    for a, b in zip(kept[first].tolist(), kept[second].tolist()):
        if a < b and len(told) <= MOST_NAMED:
            place = shapely.get_coordinates(shapely.intersection(lines[a], lines[b]))[0]
            told.append(f"{a} crosses or touches {b} near {_at(place)}")
    if told:
        raise BadGeometry("contours", f"{_listed(told)}. Mend the map where they do")


def _loose_ends(contours: ContourMap, number: int, tolerance: float) -> list[Floats]:
    line = contours.lines[number]
    if (line[0] == line[-1]).all():
        return []
    border = shapely.MultiLineString([contours.outline, *contours.voids])
    return [end for end in (line[0], line[-1]) if border.distance(shapely.Point(end)) > tolerance]


def _at(place: Floats) -> str:
    return f"({place[0]:.1f}, {place[1]:.1f})"


def _listed(told: list[str]) -> str:
    more = f" and {len(told) - MOST_NAMED} more" if len(told) > MOST_NAMED else ""
    return ", ".join(told[:MOST_NAMED]) + more

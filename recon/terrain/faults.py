"""What is wrong with a contour map, contour by contour: lines that cross, repeat or break off."""

from collections import defaultdict

import numpy as np
import shapely
from numpy.typing import NDArray

from recon.errors import BadGeometry
from recon.geometry.contour_map import ContourMap

__all__ = ["checked_contours"]

Floats = NDArray[np.float64]
MOST_NAMED = 5


def checked_contours(contours: ContourMap, tolerance: float, *, mend: bool) -> tuple[ContourMap, tuple[str, ...]]:
    """The contours, and what a user should know of them: pieces joined, ends inside the map, what is left out.

    tolerance  metres within which an end counts as being on the border
    mend       leave out contours that repeat another one, where they are refused else
    Promises   contours that go on where another of their height ends, and no third, are one.
    Raises     BadGeometry naming numbers and places, where contours cross, touch or repeat.
    """
    repeats = _repeats(contours)
    notes = []
    if repeats:
        told = _listed([f"{b} repeats {a} near {_at(contours.lines[b][0])}" for a, b in repeats])
        if not mend:
            raise BadGeometry("contours", f"{told}; leave them out with --mend")
        notes.append(f"left out: {told}")
    kept = np.setdiff1d(np.arange(len(contours.lines)), [b for _, b in repeats])
    runs = _runs(contours, kept.tolist())
    lines = [_run_together(contours, run) for run in runs]
    numbers = [run[0][0] if len(run) == 1 else min(piece for piece, _ in run) for run in runs]
    if len(runs) < len(kept):
        parts = [f"{number} near {_at(line[0])}" for number, run, line in zip(numbers, runs, lines) if len(run) > 1]
        notes.append(f"{len(parts)} contours come in pieces, which were joined: {_listed(parts)}")
    whole = contours.with_lines(lines, contours.heights[numbers])
    _refuse_crossings(whole, numbers)
    ends = [f"{number} near {_at(end)}" for i, number in enumerate(numbers) for end in _loose_ends(whole, i, tolerance)]
    if ends:
        notes.append(f"{len(ends)} ends of contours break off inside the map: {_listed(ends)}")
    return whole, tuple(notes)


def _runs(contours: ContourMap, kept: list[int]) -> list[list[tuple[int, bool]]]:
    """The pieces of every contour in a row, each with whether it runs backwards."""
    meeting = defaultdict(list)
    for i in kept:
        line = contours.lines[i]
        for end in () if (line[0] == line[-1]).all() else (0, 1):
            meeting[(*line[-end].tolist(), float(contours.heights[i]))].append((i, end))
    beyond = {}
    for ends in meeting.values():
        if len(ends) == 2 and ends[0][0] != ends[1][0]:
            beyond[ends[0]], beyond[ends[1]] = ends[1], ends[0]
    runs, used = [], set()
    for i in kept:
        if i in used:
            continue
        piece, entered = _begin(i, beyond)
        run = []
        while piece not in used:
            used.add(piece)
            run.append((piece, entered == 1))
            piece, entered = beyond.get((piece, 1 - entered), (piece, entered))
        runs.append(run)
    return runs


def _begin(piece: int, beyond: dict[tuple[int, int], tuple[int, int]]) -> tuple[int, int]:
    """The first piece of a run, and the end at which it begins; any piece of a ring."""
    at = (piece, 0)
    while (before := beyond.get(at, at))[0] not in (piece, at[0]):
        at = (before[0], 1 - before[1])
    return at


def _run_together(contours: ContourMap, run: list[tuple[int, bool]]) -> Floats:
    pieces = [contours.lines[i][::-1] if backwards else contours.lines[i] for i, backwards in run]
    return np.vstack([pieces[0], *(piece[1:] for piece in pieces[1:])])


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


def _refuse_crossings(contours: ContourMap, numbers: list[int]) -> None:
    lines = shapely.linestrings(np.concatenate(contours.lines), indices=_owners(contours))
    told = []
    for i in np.flatnonzero(~shapely.is_simple(lines)).tolist():
        told.append(f"{numbers[i]} crosses itself near {_at(shapely.get_coordinates(lines[i])[0])}")
    first, second = shapely.STRtree(lines).query(lines, predicate="intersects")
    for a, b in zip(first.tolist(), second.tolist()):
        if a < b and len(told) <= MOST_NAMED:
            place = shapely.get_coordinates(shapely.intersection(lines[a], lines[b]))[0]
            told.append(f"{numbers[a]} crosses or touches {numbers[b]} near {_at(place)}")
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

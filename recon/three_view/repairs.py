"""What would mend a drawing without a solid: one line changed, so that solids appear.

    retyped    a line drawn through should be dashed, or the other way round
    moved      a line stands off its place, or one end of it does
    added      a line is missing
    dropped    a line should not be there

Retyped and dropped lines are asked of the clauses of the drawing as it is. For the others one view after the other gets
every line that the two other views support, each switched to be drawn or absent: a solid that needs one of them, and
none of the rest, tells what is missing; a solid that needs one of them in place of a line drawn tells what has moved.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from enum import StrEnum
from itertools import chain, zip_longest

import numpy as np
from numpy.typing import NDArray

from recon.geometry.views import PROJECTIONS, DrawnView, ThreeViews
from recon.three_view.conditions import Conditions
from recon.three_view.conflicts import DrawnLine, State, SwitchedLines
from recon.three_view.missing_lines import missing_lines
from recon.three_view.view_graph import ViewGraph, view_graphs

__all__ = ["Change", "Repair", "Stroke", "likely_repairs", "repaired"]

Floats = NDArray[np.float64]
Point = tuple[float, float]
Asked = tuple[Conditions, Sequence[ViewGraph]]

FAR = 0.2  # of the drawing's size: no line is moved further


class Change(StrEnum):
    """What a repair does."""

    RETYPED = "retyped"
    MOVED = "moved"
    ADDED = "added"
    DROPPED = "dropped"


@dataclass(frozen=True)
class Stroke:
    """A line to draw: its ends, and whether it is dashed."""

    ends: tuple[Point, Point]
    hidden: bool

    def __str__(self) -> str:
        (a, b), (c, d) = self.ends
        kind = "dashed" if self.hidden else "drawn-through"
        return f"a {kind} line from ({a:.6g}, {b:.6g}) to ({c:.6g}, {d:.6g})"


@dataclass(frozen=True)
class Repair:
    """One line changed.

    change   what is done
    view     number of the view
    line     the line that is changed; None where one is added
    strokes  what is drawn in its place
    """

    change: Change
    view: int
    line: DrawnLine | None
    strokes: tuple[Stroke, ...] = ()

    def described(self, drawing: ThreeViews) -> str:
        """The repair in words."""
        if self.line is None:
            return f"{' and '.join(map(str, self.strokes))} is missing in the {PROJECTIONS[self.view].name} view"
        what = self.line.described(drawing)
        if self.change is Change.RETYPED:
            return f"{what} should be {'dashed' if self.strokes[0].hidden else 'drawn through'}"
        if self.change is Change.DROPPED:
            return f"{what} should not be there"
        (a, b), (c, d) = self.strokes[0].ends
        off = _offsets(_ends(drawing, self.line), self.strokes[0].ends)
        which = "" if min(off) > 0.02 * max(off) else f": one end is off by {max(off):.3g}"
        return f"{what} should run from ({a:.6g}, {b:.6g}) to ({c:.6g}, {d:.6g}){which}"


def repaired(drawing: ThreeViews, repair: Repair) -> ThreeViews:
    """The drawing with one line changed."""
    views = [view for _, view in drawing]
    view = views[repair.view]
    keep = np.ones(view.n_segments, dtype=bool)
    if repair.line is not None:
        keep[repair.line.segment] = False
    added = np.array([stroke.ends for stroke in repair.strokes], dtype=np.float64).reshape(-1, 2, 2)
    hidden = np.array([stroke.hidden for stroke in repair.strokes], dtype=bool)
    views[repair.view] = DrawnView(
        np.concatenate([view.segments[keep], added]), np.concatenate([view.hidden[keep], hidden])
    )
    return ThreeViews(*views)


def likely_repairs(
    drawing: ThreeViews, conflict: Sequence[DrawnLine], snap: float, ask: Callable[[ThreeViews], Asked]
) -> Iterator[Repair]:
    """Single changes that may mend a drawing: the best of each kind, the second best, and so on; dropping comes last.

    conflict  lines that contradict each other
    ask       the conditions of a drawing, alternatives included
    """
    given = ask(drawing)
    found = [_moved_and_added(drawing, view, snap, ask) for view in range(3)]
    moved = _by_distance(drawing, chain.from_iterable(moves for moves, _ in found))
    added = _by_weight(chain.from_iterable(additions for _, additions in found))
    for ranks in zip_longest(moved, _changed(drawing, given, conflict, State.RETYPED), added):
        yield from (repair for repair in ranks if repair is not None)
    yield from _changed(drawing, given, conflict, State.ABSENT)


def _moved_and_added(
    drawing: ThreeViews, view: int, snap: float, ask: Callable[[ThreeViews], Asked]
) -> tuple[list[Repair], list[Repair]]:
    """Repairs by lines that a view may lack. Slanted ones, where there are very many, cut each other so near their ends
    that none fits; upright ones alone are tried then.
    """
    for slanted in (True, False):
        lacking = missing_lines(*view_graphs(drawing, snap), view, snap, slanted=slanted)
        with closing(_Fuller(drawing, view, lacking, snap, ask)) as fuller:
            moved, added = list(fuller.moved()), list(fuller.added())
        if moved or added:
            break
    return moved, added


def _changed(drawing: ThreeViews, given: Asked, among: Sequence[DrawnLine], state: State) -> Iterator[Repair]:
    """Lines of a conflict in their other line type, or absent, where that makes the drawing consistent."""
    with SwitchedLines(*given) as switched:
        for line in among:
            rest = [other for other in switched.lines if other != line]
            if state is State.RETYPED and switched.holds(rest, retyped=[line]):
                view = (drawing.front, drawing.top, drawing.side)[line.view]
                stroke = Stroke(_ends(drawing, line), not view.hidden[line.segment])
                yield Repair(Change.RETYPED, line.view, line, (stroke,))
            elif state is State.ABSENT and switched.holds(rest, absent=[line]):
                yield Repair(Change.DROPPED, line.view, line)


def _ends(drawing: ThreeViews, line: DrawnLine) -> tuple[Point, Point]:
    (a, b), (c, d) = (drawing.front, drawing.top, drawing.side)[line.view].segments[line.segment].tolist()
    return (a, b), (c, d)


def _offsets(one: tuple[Point, Point], other: tuple[Point, Point]) -> tuple[float, float]:
    """How far the ends of two lines are apart, paired as they lie nearer."""
    ends = np.array(one)
    pairs = [np.linalg.norm(ends - np.array(turned), axis=1) for turned in (other, other[::-1])]
    first, second = min(pairs, key=lambda away: float(away.max())).tolist()
    return first, second


def _by_distance(drawing: ThreeViews, moves: Iterable[Repair]) -> list[Repair]:
    def far(repair: Repair) -> float:
        assert repair.line is not None
        return max(_offsets(_ends(drawing, repair.line), repair.strokes[0].ends))

    return sorted((move for move in moves if far(move) <= FAR * drawing.extent()), key=far)


def _by_weight(additions: Iterable[Repair]) -> list[Repair]:
    """Fewer strokes first, then the shorter ones."""

    def weight(repair: Repair) -> tuple[int, float]:
        lengths = [float(np.linalg.norm(np.subtract(*stroke.ends))) for stroke in repair.strokes]
        return len(lengths), sum(lengths)

    return sorted(additions, key=weight)


def _with_dashed(drawing: ThreeViews, view: int, segments: Floats) -> ThreeViews:
    """The drawing with dashed segments (n, 2, 2) after those that a view has."""
    views = [drawn for _, drawn in drawing]
    hidden = np.concatenate([views[view].hidden, np.ones(len(segments), dtype=bool)])
    views[view] = DrawnView(np.concatenate([views[view].segments, segments]), hidden)
    return ThreeViews(*views)


class _Fuller:
    """A drawing, one view of which has got the lines that it lacks, in pieces that are there or not one by one."""

    def __init__(
        self, drawing: ThreeViews, view: int, lacking: Floats, snap: float, ask: Callable[[ThreeViews], Asked]
    ) -> None:
        self._view = view
        self._n = [drawn for _, drawn in drawing][view].n_segments
        graph = view_graphs(_with_dashed(drawing, view, lacking), snap)[1][view]
        self._drawing = _with_dashed(drawing, view, graph.positions[graph.edges[graph.sources >= self._n]])
        conditions, self._graphs = ask(self._drawing)
        self._switched = SwitchedLines(conditions, self._graphs)
        self._given = [line for line in self._switched.lines if not self._is_spare(line)]
        self._groups = self._spare_by_run()
        self._spare = [line for group in self._groups for line in group]
        self._switched.left_open(self._spare)

    def close(self) -> None:
        self._switched.solver.delete()

    def _is_spare(self, line: DrawnLine) -> bool:
        return line.view == self._view and line.segment >= self._n

    def _spare_by_run(self) -> list[list[DrawnLine]]:
        graph = self._graphs[self._view]
        groups: dict[int, dict[DrawnLine, None]] = {}
        for run, source in zip(graph.runs.tolist(), graph.sources.tolist()):
            line = DrawnLine(self._view, source)
            if self._is_spare(line):
                groups.setdefault(run, {})[line] = None
        return [list(group) for group in groups.values()]

    def added(self) -> Iterator[Repair]:
        """One line more."""
        if self._switched.holds(self._given):
            for strokes in self._found(self._given, (), None):
                yield Repair(Change.ADDED, self._view, None, strokes)

    def moved(self) -> Iterator[Repair]:
        """One line in place of another, of the same line type."""
        for line in self._given:
            if line.view != self._view:
                continue
            rest = [other for other in self._given if other != line]
            if self._switched.holds(rest, absent=[line]):
                hidden = bool([view for _, view in self._drawing][self._view].hidden[line.segment])
                for strokes in self._found(rest, (line,), State.RETYPED if hidden else State.DRAWN):
                    if len(strokes) == 1:
                        yield Repair(Change.MOVED, self._view, line, strokes)

    def _found(
        self, drawn: Sequence[DrawnLine], absent: Sequence[DrawnLine], never: State | None
    ) -> Iterator[tuple[Stroke, ...]]:
        """Lines to spare, along one run each and none of them too much, that some solid shows besides what is drawn.

        never  a state, drawn is dashed, that none of them may have
        """
        for group in self._groups:
            barred = [(line, never) for line in group] if never else []
            off = [*absent, *(line for line in self._spare if line not in group)]
            if not self._switched.holds(drawn, absent=off, never=barred):
                continue
            on = self._states(group)
            for line in group:
                if line in on and self._switched.holds(drawn, absent=[*off, line], never=barred):
                    off.append(line)
                    on = self._states(group)
            if on:
                types = ((State.DRAWN, True), (State.RETYPED, False))
                yield tuple(
                    stroke
                    for state, hidden in types
                    for stroke in self._strokes([line for line in group if on.get(line) is state], hidden)
                )

    def _states(self, group: Sequence[DrawnLine]) -> dict[DrawnLine, State]:
        """The lines of a group that the solid found last shows, and how."""
        states = {line: self._switched.state(line) for line in group}
        return {line: state for line, state in states.items() if state is not State.ABSENT}

    def _strokes(self, lines: Sequence[DrawnLine], hidden: bool) -> tuple[Stroke, ...]:
        """Lines of one run, joined where they touch."""
        if not lines:
            return ()
        graph = self._graphs[self._view]
        rows = np.isin(graph.sources, [line.segment for line in lines])
        ends = graph.positions[graph.edges[rows]]
        way = ends[0, 1] - ends[0, 0]
        along = np.sort(ends @ way, axis=1)
        order = np.argsort(along[:, 0])
        strokes: list[tuple[float, float]] = []
        for low, high in along[order].tolist():
            if strokes and low <= strokes[-1][1] + 1e-9 * abs(high - low):
                strokes[-1] = strokes[-1][0], max(high, strokes[-1][1])
            else:
                strokes.append((low, high))
        points, places = ends.reshape(-1, 2), (ends @ way).ravel()
        found = []
        for stroke in strokes:
            (a, b), (c, d) = (points[int(np.argmin(np.abs(places - at)))].tolist() for at in stroke)
            found.append(Stroke(((a, b), (c, d)), hidden))
        return tuple(found)

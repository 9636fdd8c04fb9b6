"""Why a drawing has no solid: the fewest lines that contradict each other, and what would mend it.

Each line of the drawing switches its own clauses on. Lines that cannot all be on, while any but one of them can, are a
minimal conflict. A repair changes a single line so that solids appear:

    retyped    a line drawn through should be dashed, or the other way round      asked of the same clauses
    dropped    a line should not be there
    moved      a line stands where the other views show nothing, but do close by   asked of a new drawing

Paper  minimal unsatisfiable sets by deletion [marquessilva2010].
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray
from pysat.solvers import Solver

from recon.geometry.views import PROJECTIONS, DrawnView, ThreeViews
from recon.three_view.conditions import Clause, Conditions
from recon.three_view.labeling import SOLVER
from recon.three_view.view_graph import ViewGraph

__all__ = ["Change", "DrawnLine", "Repair", "minimal_conflict", "moved_lines", "repaired", "retyped_lines"]

Floats = NDArray[np.float64]


class Change(StrEnum):
    """What a repair does to a line."""

    RETYPED = "retyped"
    DROPPED = "dropped"
    MOVED = "moved"


@dataclass(frozen=True)
class DrawnLine:
    """A segment of the drawing: its view, and its number in it."""

    view: int
    segment: int

    def described(self, drawing: ThreeViews) -> str:
        """The line in words, with its ends."""
        view = (drawing.front, drawing.top, drawing.side)[self.view]
        (a, b), (c, d) = view.segments[self.segment].tolist()
        kind = "dashed" if view.hidden[self.segment] else "drawn-through"
        return (
            f"the {kind} line of the {PROJECTIONS[self.view].name} view from ({a:.6g}, {b:.6g}) to ({c:.6g}, {d:.6g})"
        )


@dataclass(frozen=True)
class Repair:
    """One line changed.

    ends  where a moved line goes, ((u, v), (u, v)); None otherwise
    """

    line: DrawnLine
    change: Change
    ends: tuple[tuple[float, float], tuple[float, float]] | None = None

    def described(self, drawing: ThreeViews) -> str:
        """The repair in words."""
        what = self.line.described(drawing)
        if self.change is Change.RETYPED:
            return f"{what} should be {'drawn through' if 'dashed' in what else 'dashed'}"
        if self.ends is None:
            return f"{what} should not be there"
        (a, b), (c, d) = self.ends
        return f"{what} should run from ({a:.6g}, {b:.6g}) to ({c:.6g}, {d:.6g})"


class _Switched:
    """Conditions whose clauses are switched on line by line."""

    def __init__(self, given: Conditions, graphs: Sequence[ViewGraph]) -> None:
        self.switch: dict[DrawnLine, int] = {}
        self.other: dict[DrawnLine, int] = {}
        self._n = given.n_variables
        self.solver = Solver(name=SOLVER, bootstrap_with=given.hard)
        for (view, edge), group in given.drawn.items():
            line = DrawnLine(view, int(graphs[view].sources[edge]))
            self._add(self.switch, line, group)
            self._add(self.other, line, given.otherwise.get((view, edge), []))

    def _add(self, switches: dict[DrawnLine, int], line: DrawnLine, group: list[Clause]) -> None:
        if line not in switches:
            self._n += 1
            switches[line] = self._n
        for clause in group:
            self.solver.add_clause([*clause, -switches[line]])

    def holds(self, lines: Sequence[DrawnLine], turned: Sequence[DrawnLine] = ()) -> bool:
        """Whether some solid shows these lines as drawn, and the turned ones in the other line type."""
        return bool(self.solver.solve([self.switch[x] for x in lines] + [self.other[x] for x in turned]))


def minimal_conflict(given: Conditions, graphs: Sequence[ViewGraph]) -> list[DrawnLine]:
    """Lines that contradict each other, none to spare; empty when the drawing has a solid."""
    switched = _Switched(given, graphs)
    with switched.solver:
        if switched.holds(list(switched.switch)):
            return []
        core = set(switched.solver.get_core() or [])
        kept = [line for line, literal in switched.switch.items() if literal in core]
        for line in list(kept):
            fewer = [other for other in kept if other != line]
            if not switched.holds(fewer):
                kept = fewer
        return kept


def retyped_lines(given: Conditions, graphs: Sequence[ViewGraph], among: Sequence[DrawnLine]) -> Iterator[Repair]:
    """Lines of a conflict whose other line type, or whose absence, makes the drawing consistent; retyped ones first."""
    switched = _Switched(given, graphs)
    with switched.solver:
        for change in (Change.RETYPED, Change.DROPPED):
            for line in among:
                rest = [other for other in switched.switch if other != line]
                if switched.holds(rest, [line] if change is Change.RETYPED else []):
                    yield Repair(line, change)


def moved_lines(drawing: ThreeViews, snap: float) -> Iterator[Repair]:
    """Lines with a coordinate that the other view lacks, each moved to the coordinates nearest to it that it has."""
    found: list[tuple[float, Repair]] = []
    for k, (projection, view) in enumerate(drawing):
        for column, axis in enumerate(projection.axes):
            known = _coordinates(drawing, axis, k)
            for segment, ends in enumerate(view.segments):
                for value in np.unique(ends[:, column]).tolist():
                    away = np.abs(known - value)
                    if away.min() > snap:
                        for target in known[np.argsort(away)[:2]].tolist():
                            moved = ends.copy()
                            moved[moved[:, column] == value, column] = target
                            (a, b), (c, d) = moved.tolist()
                            repair = Repair(DrawnLine(k, segment), Change.MOVED, ((a, b), (c, d)))
                            found.append((abs(target - value), repair))
    yield from (repair for _, repair in sorted(found, key=lambda pair: pair[0]))


def _coordinates(drawing: ThreeViews, axis: int, but: int) -> Floats:
    """Coordinates along an axis that the views but one show."""
    shown = [
        view.segments[:, :, projection.axes.index(axis)].ravel()
        for k, (projection, view) in enumerate(drawing)
        if k != but and axis in projection.axes
    ]
    return np.unique(np.concatenate(shown))


def repaired(drawing: ThreeViews, repair: Repair) -> ThreeViews:
    """The drawing with one line changed."""
    views = [view for _, view in drawing]
    view = views[repair.line.view]
    segments, hidden = view.segments.copy(), view.hidden.copy()
    if repair.change is Change.RETYPED:
        hidden[repair.line.segment] ^= True
    elif repair.ends is not None:
        segments[repair.line.segment] = repair.ends
    else:
        keep = np.arange(len(segments)) != repair.line.segment
        segments, hidden = segments[keep], hidden[keep]
    views[repair.line.view] = DrawnView(segments, hidden)
    return ThreeViews(*views)

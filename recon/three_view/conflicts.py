"""Why a drawing has no solid: the fewest lines that contradict each other.

Each line of the drawing switches its own clauses on. Lines that cannot all be on, while any but one of them can, are a
minimal conflict. A line may also be switched to the other line type, or to absence: then no solid turns a corner where
it was.

Paper  minimal unsatisfiable sets by deletion [marquessilva2010].
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import Enum, auto

from pysat.solvers import Solver

from recon.geometry.views import PROJECTIONS, ThreeViews
from recon.three_view.conditions import Clause, Conditions
from recon.three_view.simplest import SOLVER
from recon.three_view.view_graph import ViewGraph

__all__ = ["DrawnLine", "State", "SwitchedLines", "minimal_conflict"]


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


class State(Enum):
    """How a line is taken."""

    DRAWN = auto()
    RETYPED = auto()
    ABSENT = auto()


class SwitchedLines:
    """Conditions whose clauses are switched on line by line. To be closed, as a context."""

    def __init__(self, given: Conditions, graphs: Sequence[ViewGraph]) -> None:
        self.lines: dict[DrawnLine, dict[State, int]] = {}
        self.solver = Solver(name=SOLVER, bootstrap_with=[*given.hard, [given.n_variables, -given.n_variables]])
        self._n = given.n_variables
        self._model: list[int] = []
        groups = {State.DRAWN: given.drawn, State.RETYPED: given.otherwise, State.ABSENT: given.absent}
        for view, edge in given.drawn:
            line = DrawnLine(view, int(graphs[view].sources[edge]))
            for state, group in groups.items():
                self._add(line, state, group.get((view, edge)))

    def __enter__(self) -> "SwitchedLines":
        return self

    def __exit__(self, *what: object) -> None:
        self.solver.delete()

    def _add(self, line: DrawnLine, state: State, clauses: list[Clause] | None) -> None:
        if clauses is None:
            return
        states = self.lines.setdefault(line, {})
        if state not in states:
            self._n += 1
            states[state] = self._n
        for clause in clauses:
            self.solver.add_clause([*clause, -states[state]])

    def holds(
        self,
        lines: Iterable[DrawnLine],
        *,
        never: Iterable[tuple[DrawnLine, State]] = (),
        **others: Iterable[DrawnLine],
    ) -> bool:
        """Whether some solid shows lines as drawn, those of `retyped` in the other line type, those of `absent` not.

        never  states in which lines must not be
        """
        states = {State.DRAWN: lines} | {State[name.upper()]: group for name, group in others.items()}
        wanted = [self.lines[line].get(state) for state, group in states.items() for line in group]
        unwanted = [-literal for line, state in never if (literal := self.lines[line].get(state))]
        if None in wanted or not self.solver.solve([*(literal for literal in wanted if literal), *unwanted]):
            return False
        self._model = self.solver.get_model()
        return True

    def left_open(self, lines: Iterable[DrawnLine]) -> None:
        """From now on each of these lines is in one of its states at least, whichever."""
        for line in lines:
            self.solver.add_clause(list(self.lines[line].values()))

    def state(self, line: DrawnLine) -> State:
        """A state of a line in the solid that the last answer, a yes, found; absent when that will do."""
        true = set(self._model)
        return next(s for s in (State.ABSENT, State.DRAWN, State.RETYPED) if self.lines[line].get(s) in true)

    def core(self) -> list[DrawnLine]:
        """The lines as drawn that the last answer, a no, rests on."""
        literals = set(self.solver.get_core() or [])
        return [line for line, states in self.lines.items() if states[State.DRAWN] in literals]


def minimal_conflict(given: Conditions, graphs: Sequence[ViewGraph]) -> list[DrawnLine]:
    """Lines that contradict each other, none to spare; empty when the drawing has a solid."""
    with SwitchedLines(given, graphs) as switched:
        if switched.holds(switched.lines):
            return []
        kept = switched.core()
        for line in list(kept):
            fewer = [other for other in kept if other != line]
            if line in kept and not switched.holds(fewer):
                core = set(switched.core())
                kept = [other for other in fewer if other in core]
        return kept

"""All consistent labelings: which cells are solid, by a SAT solver over the cells that are not forced (paper, 5).

Cells that no clause links, once the forced ones are known, are chosen independently of each other:

    this pocket through or blind       2 choices  \\
    that boss round the back or not    3 choices   >   2 x 3 = 6 solids, counted without listing them
    all else                           forced     /
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import prod

import numpy as np
from numpy.typing import NDArray
from pysat.solvers import Solver

from recon.three_view.conditions import Clause, Conditions
from recon.three_view.view_graph import linked

__all__ = ["FreeChoice", "Labelings", "consistent_labelings"]

Flags = NDArray[np.bool_]
SOLVER = "cadical195"
EFFORT = 400_000  # literals of listed options, beyond which a choice is called incomplete
LEAST = 200


@dataclass(frozen=True)
class FreeChoice:
    """Cells that are chosen together, independently of all others.

    cells     numbers of the cells
    options   for each possible choice the cells among them that are solid
    complete  whether these are all options
    """

    cells: tuple[int, ...]
    options: tuple[frozenset[int], ...]
    complete: bool


@dataclass(frozen=True)
class Labelings:
    """Every consistent labeling, as a product of free choices.

    n_cells   cells of the arrangement
    forced    cells that are solid in all of them
    choices   what is free
    order     option of each choice for one labeling after the other; None counts through the options, last choice first
    """

    n_cells: int
    forced: frozenset[int]
    choices: tuple[FreeChoice, ...]
    order: tuple[tuple[int, ...], ...] | None = None

    @property
    def count(self) -> int:
        """How many there are; a lower bound unless `complete`."""
        return prod(len(choice.options) for choice in self.choices)

    @property
    def complete(self) -> bool:
        return all(choice.complete for choice in self.choices)

    def labeling(self, number: int) -> Flags:
        """(n_cells,) which cells are solid, in the labeling of that number from 0."""
        picked = self.order[number] if self.order is not None else self._digits(number)
        solid = np.zeros(self.n_cells, dtype=bool)
        solid[list(self.forced.union(*(choice.options[i] for choice, i in zip(self.choices, picked))))] = True
        return solid

    def _digits(self, number: int) -> list[int]:
        digits = []
        for choice in reversed(self.choices):
            number, digit = divmod(number, len(choice.options))
            digits.append(digit)
        return digits[::-1]

    def __iter__(self) -> Iterator[Flags]:
        """The labelings by number."""
        return (self.labeling(number) for number in range(self.count))


def consistent_labelings(given: Conditions, *, limit: int = 100_000) -> Labelings | None:
    """All labelings that keep the conditions; None when there is none.

    limit  options listed for one free choice before it is called incomplete; fewer where a choice has many cells
    """
    clauses = given.clauses()
    if not all(clauses):
        return None
    with Solver(name=SOLVER, bootstrap_with=clauses) as solver:
        if not solver.solve():
            return None
        backbone = _backbone(solver, given.n_cells)
    rest, fixed = _simplified(clauses, backbone, given.n_variables)
    forced = frozenset(v - 1 for v in range(1, given.n_cells + 1) if fixed[v] > 0)
    choices = _free_choices(rest, given.n_cells, given.n_variables, fixed, limit)
    return Labelings(given.n_cells, forced, tuple(choices))


def _backbone(solver: Solver, n_cells: int) -> list[int]:
    """Literals of cells that are the same in every model."""
    candidates = set(solver.get_model()[:n_cells])
    fixed = []
    while candidates:
        literal = candidates.pop()
        if solver.solve(assumptions=[-literal]):
            candidates &= set(solver.get_model()[:n_cells])
        else:
            fixed.append(literal)
    return fixed


def _simplified(clauses: Sequence[Clause], literals: Sequence[int], n: int) -> tuple[list[Clause], list[int]]:
    """Clauses that are still open once the literals and what follows from them by unit clauses hold."""
    value = [0] * (n + 1)
    for literal in literals:
        value[abs(literal)] = 1 if literal > 0 else -1
    rest = list(clauses)
    while True:
        open_clauses, units = [], False
        for clause in rest:
            if any(value[abs(x)] * x > 0 for x in clause):
                continue
            short = [x for x in clause if not value[abs(x)]]
            if len(short) == 1:
                value[abs(short[0])] = 1 if short[0] > 0 else -1
                units = True
            else:
                open_clauses.append(short)
        rest = open_clauses
        if not units:
            return rest, value


def _free_choices(
    clauses: Sequence[Clause], n_cells: int, n_variables: int, fixed: Sequence[int], limit: int
) -> Iterator[FreeChoice]:
    pairs = np.array([(abs(c[0]), abs(x)) for c in clauses for x in c[1:]], dtype=np.int64).reshape(-1, 2)
    group = linked(pairs, n_variables + 1)
    free = [v for v in range(1, n_cells + 1) if not fixed[v]]
    for part in sorted({int(group[v]) for v in free}):
        members = [v for v in free if group[v] == part]
        own = [clause for clause in clauses if group[abs(clause[0])] == part]
        options, complete = _models(own, members, limit) if own else ([[-members[0]], members], True)
        yield FreeChoice(
            tuple(v - 1 for v in members),
            tuple(frozenset(x - 1 for x in option if x > 0) for option in options),
            complete,
        )


def _models(clauses: Sequence[Clause], members: Sequence[int], limit: int) -> tuple[list[list[int]], bool]:
    """Assignments of the members that some model extends, at most `limit`, and whether these are all."""
    # members first, so that a model begins with them
    names = dict.fromkeys([*members, *(abs(x) for clause in clauses for x in clause)])
    number = {name: k + 1 for k, name in enumerate(names)}
    renamed = [[number[abs(x)] * (1 if x > 0 else -1) for x in clause] for clause in clauses]
    limit = min(limit, max(LEAST, EFFORT // len(members)))
    found: list[list[int]] = []
    with Solver(name="glucose4", bootstrap_with=renamed) as solver:
        while solver.solve():
            if len(found) == limit:
                return found, False
            model = solver.get_model()[: len(members)]
            found.append([name if x > 0 else -name for name, x in zip(members, model)])
            solver.add_clause([-x for x in model])
    return found, True

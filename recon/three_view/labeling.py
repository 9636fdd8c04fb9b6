"""All consistent labelings: which cells are solid, by a SAT solver over the cells that are not forced (paper, 5).

Cells that no clause links, once the forced ones are known, are chosen independently of each other:

    this pocket through or blind       2 choices  \\
    that boss round the back or not    3 choices   >   2 x 3 = 6 solids, counted without listing them
    all else                           forced     /
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from math import prod

import numpy as np
from numpy.typing import NDArray
from pysat.solvers import Solver

from recon.three_view.conditions import Clause, Conditions
from recon.three_view.counting import exact_count
from recon.three_view.simplest import SOLVER, Surroundings, simplest
from recon.three_view.tables import linked

__all__ = ["FreeChoice", "Labelings", "consistent_labelings", "is_consistent"]

Flags = NDArray[np.bool_]
Ints = NDArray[np.int64]

EFFORT = 200_000  # literals of listed options, beyond which a choice is only counted
LEAST = 100

Cost = Callable[[Flags], Ints]


@dataclass(frozen=True)
class FreeChoice:
    """Cells that are chosen together, independently of all others.

    cells    numbers of the cells
    options  for each possible choice the cells among them that are solid; not all when there are very many
    count    how many options there are
    exact    whether the count is; a lower bound otherwise
    """

    cells: tuple[int, ...]
    options: tuple[frozenset[int], ...]
    count: int
    exact: bool


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
        """How many there are; a lower bound unless `exact`."""
        return prod(choice.count for choice in self.choices)

    @property
    def exact(self) -> bool:
        return all(choice.exact for choice in self.choices)

    @property
    def listed(self) -> int:
        """How many have a number."""
        return prod(len(choice.options) for choice in self.choices)

    def labeling(self, number: int) -> Flags:
        """(n_cells,) which cells are solid, in the labeling of that number from 0."""
        solid = np.zeros(self.n_cells, dtype=bool)
        solid[list(self.forced.union(*(choice.options[i] for choice, i in zip(self.choices, self.picks(number)))))] = (
            True
        )
        return solid

    def picks(self, number: int) -> list[int]:
        """Which option of each choice the labeling of a number takes."""
        if self.order is not None:
            return list(self.order[number])
        digits = []
        for choice in reversed(self.choices):
            number, digit = divmod(number, len(choice.options))
            digits.append(digit)
        return digits[::-1]

    def __iter__(self) -> Iterator[Flags]:
        """The labelings by number."""
        return (self.labeling(number) for number in range(self.listed))


def is_consistent(given: Conditions) -> bool:
    """Whether some labeling keeps the conditions."""
    clauses = given.clauses()
    if not all(clauses):
        return False
    with Solver(name=SOLVER, bootstrap_with=clauses) as solver:
        return bool(solver.solve())


def consistent_labelings(
    given: Conditions, walls: Ints, cost: Cost, *, limit: int = 100_000, seconds: float = 0.0
) -> Labelings | None:
    """All labelings that keep the conditions; None when there is none.

    walls    (f, 2) cells on the two sides of every fragment
    cost     of solids, each a row of (k, n_cells) flags, rows of figures: less is simpler, the first figure first
    limit    options listed for one free choice; fewer where a choice has many cells
    seconds  time for counting the options of a choice that has more
    """
    clauses = given.clauses()
    if not all(clauses):
        return None
    with Solver(name=SOLVER, bootstrap_with=clauses) as solver:
        if not solver.solve():
            return None
        value = _forced(solver, given)
    rest = _open_clauses(clauses, value)
    forced = frozenset(v - 1 for v in range(1, given.n_cells + 1) if value[v] > 0)
    choices = _free_choices(rest, given, value, (walls, cost, limit, seconds))
    return Labelings(given.n_cells, forced, tuple(choices))


def _forced(solver: Solver, given: Conditions) -> list[int]:
    """(n_variables + 1,) +1 or -1 for a variable that is the same in every model, 0 for the others.

    Each round asks for a model in which some cell differs from all models before, and guesses that all do.
    """
    alike = set(solver.get_model()[: given.n_cells])
    ask = given.n_variables
    while alike:
        ask += 1
        solver.add_clause([-ask, *(-literal for literal in alike)])
        solver.set_phases([-literal for literal in alike])
        if not solver.solve(assumptions=[ask]):
            break
        alike &= set(solver.get_model()[: given.n_cells])
        solver.add_clause([-ask])
    value = [0] * (ask + 1)
    _, implied = solver.propagate(assumptions=list(alike))
    for literal in {*alike, *implied}:
        value[abs(literal)] = 1 if literal > 0 else -1
    return value[: given.n_variables + 1]


def _open_clauses(clauses: Sequence[Clause], value: Sequence[int]) -> list[Clause]:
    """Clauses that do not hold yet, without the literals that are known to be false."""
    return [
        [x for x in clause if not value[abs(x)]] for clause in clauses if not any(value[abs(x)] * x > 0 for x in clause)
    ]


def _free_choices(
    clauses: Sequence[Clause], given: Conditions, value: Sequence[int], asked: tuple[Ints, Cost, int, float]
) -> Iterator[FreeChoice]:
    pairs = np.array([(abs(c[0]), abs(x)) for c in clauses for x in c[1:]], dtype=np.int64).reshape(-1, 2)
    group = linked(pairs, given.n_variables + 1)
    members: dict[int, list[int]] = {}
    for v in range(1, given.n_cells + 1):
        if not value[v]:
            members.setdefault(int(group[v]), []).append(v)
    own: dict[int, list[Clause]] = {part: [] for part in members}
    for clause in clauses:
        own.get(int(group[abs(clause[0])]), []).append(clause)
    walls, cost, limit, seconds = asked
    known = np.array(value[1 : given.n_cells + 1])
    for part, cells in members.items():
        within = Surroundings(walls, known, np.array(cells) - 1)
        yield _free_choice(own[part], cells, (within, partial(_cost_beside, cost, within)), limit, seconds)


def _cost_beside(cost: Cost, within: Surroundings, model: Sequence[int]) -> tuple[int, ...]:
    """Cost of a choice's model, all other choices left empty."""
    return tuple(cost(within.flags(model)[None])[0].tolist())


def _free_choice(
    clauses: Sequence[Clause],
    cells: Sequence[int],
    simplicity: tuple[Surroundings, Callable[[Sequence[int]], tuple[int, ...]]],
    limit: int,
    seconds: float,
) -> FreeChoice:
    # members first, so that a model begins with them
    names = dict.fromkeys([*cells, *(abs(x) for clause in clauses for x in clause)])
    number = {name: k + 1 for k, name in enumerate(names)}
    renamed = [[number[abs(x)] * (1 if x > 0 else -1) for x in clause] for clause in clauses]
    models, complete = _models(renamed, len(cells), min(limit, max(LEAST, EFFORT // len(cells))))
    if not complete:
        models = [simplest(renamed, *simplicity, models), *models]
    options = tuple(dict.fromkeys(frozenset(cells[x - 1] - 1 for x in model if x > 0) for model in models))
    count = None if complete or not seconds else exact_count(renamed, len(cells), seconds=seconds)
    return FreeChoice(tuple(v - 1 for v in cells), options, count or len(options), complete or count is not None)


def _models(clauses: Sequence[Clause], n: int, limit: int) -> tuple[list[list[int]], bool]:
    """Assignments of the first n variables that some model extends, at most `limit`, and whether these are all."""
    found: list[list[int]] = []
    with Solver(name=SOLVER, bootstrap_with=[*clauses, [n, -n]]) as solver:
        solver.set_phases([-v for v in range(n + 1, solver.nof_vars() + 1)])  # rather fewer corners
        while solver.solve():
            if len(found) == limit:
                return found, False
            model = solver.get_model()[:n]
            found.append(model)
            solver.add_clause([-x for x in model])
    return found, True

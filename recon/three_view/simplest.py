"""A simple solid among very many, where they cannot all be listed and compared.

First in as few pieces as can be. A body is joined to the one that stays or left out, a void is opened or filled:

    +---+ n +---+       the body c is cut off by the empty cells n around it, so either no cell of c is solid,
    | c | n |   |       or one of n is; voids the other way round; asked again of whatever piece is then alone
    +---+ n +---+

Then one cell after the other is turned, and one of its neighbours with it, while that makes the solid simpler.

Each clause of the first step holds for every solid of one body that fills a cell known to be solid, so that none is
passed over. The second step ends at a solid that is simpler than its neighbours, not always than all others.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import cycle

import numpy as np
from numpy.typing import NDArray
from pysat.solvers import Solver

from recon.three_view.tables import linked

__all__ = ["SOLVER", "Surroundings", "simplest"]

Ints = NDArray[np.int64]
Model = Sequence[int]
Clauses = Sequence[Sequence[int]]
Cost = Callable[[Model], tuple[int, ...]]

SOLVER = "glucose4"  # the fastest of those whose guesses can be steered
ROUNDS = 200  # of joining pieces; a plate of 3,000 faces took 17
EFFORT = 1_000_000  # fragments looked at to compare solids
STARTS = 5  # of the second step, at most: what the first found, and the simplest
LEAST = 100  # of the first models that are given


@dataclass(frozen=True)
class _Piece:
    """A body, or a void."""

    solid: bool
    cells: frozenset[int]


class Surroundings:
    """The cells of a choice among all others.

    walls  (f, 2) cells on the two sides of every fragment
    known  (n_cells,) +1 for a cell that is solid, anything else for one that is empty, whatever is chosen
    cells  (n,) the cells to choose, each the variable of its place in this row, from 1
    """

    def __init__(self, walls: Ints, known: Ints, cells: Ints) -> None:
        self.walls = walls[walls[:, 0] != walls[:, 1]]
        self.solid = known > 0
        self.cells = cells
        self._always = frozenset(np.flatnonzero(self.solid).tolist())
        self._variable = {cell: k + 1 for k, cell in enumerate(cells.tolist())}
        self._beside: dict[int, set[int]] = {}
        for a, b in self.walls.tolist():
            self._beside.setdefault(a, set()).add(b)
            self._beside.setdefault(b, set()).add(a)

    def flags(self, model: Model) -> NDArray[np.bool_]:
        """(n_cells,) which cells are solid."""
        solid = self.solid.copy()
        solid[self.cells] = np.array(model[: len(self.cells)]) > 0
        return solid

    def variables(self, cells: frozenset[int] | set[int]) -> list[int]:
        """Variables of those among some cells that are to choose."""
        return sorted(self._variable[cell] for cell in cells if cell in self._variable)

    def around(self, cells: frozenset[int]) -> set[int]:
        """Cells on the other side of walls of these."""
        return set().union(*(self._beside.get(cell, set()) for cell in cells)) - cells

    def spare_pieces(self, model: Model) -> list[_Piece]:
        """Bodies and voids, but for one body: one that fills a cell known to be solid, or else the largest."""
        solid = self.flags(model)
        group = linked(self.walls[solid[self.walls[:, 0]] == solid[self.walls[:, 1]]], len(solid))
        members: dict[int, list[int]] = {}
        for cell, number in enumerate(group.tolist()):
            members.setdefault(number, []).append(cell)
        pieces = [_Piece(bool(solid[cells[0]]), frozenset(cells)) for cells in members.values()]
        bodies = [piece for piece in pieces if piece.solid]
        stays = max(bodies, key=lambda body: (bool(body.cells & self._always), len(body.cells)), default=None)
        return [piece for piece in pieces if piece is not stays and 0 not in piece.cells]


def simplest(clauses: Clauses, within: Surroundings, cost: Cost, models: Sequence[list[int]]) -> list[int]:
    """A model that is simpler than its neighbours, by its values of the first variables.

    cost    of a model: less is simpler, the first figure first
    models  some of very many, not none
    """
    starts = [_in_one_piece(clauses, within, models[0]), *sorted(models[:LEAST], key=cost)[: STARTS - 1]]
    tries = EFFORT // len(starts) // max(1, len(within.walls))
    return min([_simpler_nearby(clauses, within, cost, (start, tries)) for start in starts], key=cost)


def _in_one_piece(clauses: Clauses, within: Surroundings, model: list[int]) -> list[int]:
    """From a model to one without pieces to spare, as far as there is one."""
    n = len(within.cells)
    top = max(n, *(abs(x) for clause in clauses for x in clause))
    asked: dict[_Piece, int] = {}
    kept: set[int] = set()
    with Solver(name=SOLVER, bootstrap_with=clauses) as solver:
        for _ in range(ROUNDS):
            lone = [piece for piece in within.spare_pieces(model) if piece not in asked]
            if not lone:
                break
            for piece in lone:
                top += 1
                asked[piece] = top
                _join(solver, within, piece, top)
            solver.set_phases(model[:n])
            # pieces that cannot all go: the last of those that contradict each other stays
            while not solver.solve(assumptions=[ask for ask in asked.values() if ask not in kept]):
                kept.add(max(solver.get_core()))
            model = solver.get_model()
    return model[:n]


def _join(solver: Solver, within: Surroundings, piece: _Piece, ask: int) -> None:
    """Clauses that hold once `ask` does: no cell of the piece is what it is, or one of those around it is as well."""
    sign = 1 if piece.solid else -1
    beyond = [sign * x for x in within.variables(within.around(piece.cells))]
    inside = within.variables(piece.cells)
    if len(inside) < len(piece.cells):
        solver.add_clause([-ask, *beyond])
    for x in inside:
        solver.add_clause([-ask, -sign * x, *beyond])


def _simpler_nearby(clauses: Clauses, within: Surroundings, cost: Cost, start: tuple[list[int], int]) -> list[int]:
    """From a model on, again and again, to a simpler one near it; `start` tells it, and how many may be compared."""
    model, tries = start
    n = len(model)
    least, unchanged = cost(model), 0
    with Solver(name=SOLVER, bootstrap_with=clauses) as solver:
        solver.solve(assumptions=model)
        model = solver.get_model()
        for variable in cycle(range(1, n + 1)):
            unchanged += 1
            for other in _turned(solver, within, model, variable):
                tries -= 1
                if cost(other) < least:
                    least, model, unchanged = cost(other), other, 0
                    break
            if unchanged == n or tries <= 0:
                return model[:n]
    return model[:n]


def _turned(solver: Solver, within: Surroundings, model: list[int], variable: int) -> Iterator[list[int]]:
    """Models with a cell the other way and little else changed, then with one of its neighbours the other way, too."""
    turn = -model[variable - 1]
    solver.set_phases(model)
    if not solver.solve(assumptions=[turn]):
        return
    first = solver.get_model()
    yield first
    for other in within.variables(within.around(frozenset([int(within.cells[variable - 1])]))):
        solver.set_phases(model)
        if solver.solve(assumptions=[turn, -first[other - 1]]):
            yield solver.get_model()

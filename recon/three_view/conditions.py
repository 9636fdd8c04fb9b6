"""The paper's conditions on the choice of faces, as clauses on the cells (4.4 and 5.2.3).

A cell has one variable: true when solid. The label of a fragment follows from the cells in front of it and behind it:

    front empty, behind solid    present, facing front         alike    absent
    front solid, behind empty    present, facing back

    (1)  the nearest fragment of a line of sight faces the viewer         the unbounded cell is empty, so it does
    (2)  of coplanar neighbours facing alike at most one is a face        they are merged, their common edge is none
    (3)  an edge touches an even number of faces                          cells alternate around the edge
    (4)  lines of sight meet an even number of faces, and of two          cells alternate along the line; the drawing's
         neighbouring regions at least one shows a face                   own clauses, below
    (5)  no dashed line bounds the nearest face                           the drawing's own clauses

The drawing itself: a line drawn through has different planes nearest on its two sides, or a plane and the background. A
dashed line has one and the same plane nearest on both sides, and behind it an edge where the solid turns a corner.
Cuts are drawn nowhere, so no solid turns a corner there.

Rows of cells behind the fragments of a line of sight are kept in a tree, since neighbouring lines begin alike: the
variable of a node says that all cells down to it are empty.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import chain, combinations

import numpy as np
from numpy.typing import NDArray

from recon.three_view.cells import Cells
from recon.three_view.fragments import Fragments
from recon.three_view.sight_lines import SightLines

__all__ = ["Conditions", "conditions"]

Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

Row = list[tuple[int, int]]
Clause = list[int]


@dataclass(eq=False)
class Conditions:
    """Clauses in the variables 1 ... n_variables, of which the first n_cells say that cells are solid.

    hard       clauses that hold for any drawing
    drawn      for each drawn edge, as (view, edge), the clauses that it adds
    otherwise  the clauses that it would add in the other line type, and
    absent     those that it would add if it were not drawn, where these were asked for
    """

    n_cells: int
    n_variables: int
    hard: list[Clause] = field(default_factory=list)
    drawn: dict[tuple[int, int], list[Clause]] = field(default_factory=dict)
    otherwise: dict[tuple[int, int], list[Clause]] = field(default_factory=dict)
    absent: dict[tuple[int, int], list[Clause]] = field(default_factory=dict)

    def clauses(self) -> list[Clause]:
        """All clauses."""
        return self.hard + [clause for group in self.drawn.values() for clause in group]


def conditions(
    made: Fragments,
    cells: Cells,
    sights: Sequence[SightLines],
    lines: Sequence[tuple[Flags, Flags | None]],
    *,
    alternatives: bool = False,
) -> Conditions:
    """The clauses that a solid obeys exactly when it is drawn as given.

    lines         for each view, for each drawn edge, whether it tells anything, and whether it is dashed; None when the
                  drawing does not tell the types apart
    alternatives  also write what each edge would demand in the other line type, and if it were not drawn
    """
    maker = _Maker(made, cells)
    maker.out.hard.append([-1])
    for edge in np.flatnonzero(made.is_cut).tolist():
        maker.out.hard += maker.no_corner(edge)
    for view, (sight, (telling, dashed)) in enumerate(zip(sights, lines)):
        rows = maker.rows(sight)
        behind = _grouped(sight.behind)
        for s, tells in enumerate(telling.tolist()):
            seen = rows.get(2 * s, []), rows.get(2 * s + 1, []), behind.get(s, [])
            given = None if dashed is None else bool(dashed[s])
            maker.out.drawn[view, s] = maker.demanded(seen, given) if tells else []
            if alternatives:
                if dashed is not None:
                    maker.out.otherwise[view, s] = maker.demanded(seen, not dashed[s])
                flat = [maker.no_corner(edge) for edge in seen[2] if not made.is_cut[edge]]
                maker.out.absent[view, s] = list(chain.from_iterable(flat))
    return maker.out


def _grouped(pairs: Ints) -> dict[int, list[int]]:
    found: dict[int, list[int]] = {}
    for key, value in pairs.tolist():
        found.setdefault(key, []).append(value)
    return found


class _Maker:
    """Writes clauses; hands out variables for corners at edges and for rows of empty cells."""

    def __init__(self, made: Fragments, cells: Cells) -> None:
        self.out = Conditions(cells.n_cells, cells.n_cells)
        self._made = made
        self._cells = cells
        self._starts = np.searchsorted(cells.edge, np.arange(len(made.wire.edges) + 1)).tolist()
        self._sector = cells.sectors().tolist()
        self._plane = made.plane[cells.fragment].tolist()
        front, back = cells.of_side[cells.fragment].T
        self._wall = (front != back).tolist()
        self._corner: dict[int, int] = {}
        self._empty: dict[tuple[int, int], int] = {}

    def _variable(self) -> int:
        self.out.n_variables += 1
        return self.out.n_variables

    def rows(self, sight: SightLines) -> dict[int, Row]:
        """For each line of sight the cells behind the fragments that it meets, with their planes."""
        sides = self._cells.of_side[sight.fragment]
        far = np.where(sight.facing, sides[:, 1], sides[:, 0])
        wall = sides[:, 0] != sides[:, 1]
        found: dict[int, Row] = {}
        planes = self._made.plane[sight.fragment]
        for beside, cell, plane in zip(sight.beside[wall].tolist(), far[wall].tolist(), planes[wall].tolist()):
            found.setdefault(beside, []).append((cell, plane))
        return found

    def _around(self, edge: int) -> tuple[list[int], list[int]]:
        """The cells around an edge, each after the wall before it, and the planes of those walls."""
        rows = [k for k in range(self._starts[edge], self._starts[edge + 1]) if self._wall[k]]
        return [self._sector[k] + 1 for k in rows], [self._plane[k] for k in rows]

    def no_corner(self, edge: int) -> list[Clause]:
        """At most two fragments of one plane are present: the edge lies inside a face, or nowhere."""
        cells, planes = self._around(edge)
        clauses: list[Clause] = []
        for i, j in combinations(range(len(cells)), 2):
            if planes[i] == planes[j]:
                continue
            a, b, c, d = cells[i - 1], cells[i], cells[j - 1], cells[j]
            for p in ((a, -b), (-a, b)):
                clauses += [[*p, c, -d], [*p, -c, d]]
        for i, plane in enumerate(planes):
            if planes.count(plane) == 1:
                a, b = cells[i - 1], cells[i]
                clauses += [[a, -b], [-a, b]]
        return clauses

    def corner(self, edge: int) -> int | None:
        """Variable that implies: the solid turns a corner at the edge; None where it never does."""
        if edge not in self._corner:
            cells, planes = self._around(edge)
            if self._made.is_cut[edge] or not cells:
                return None
            turns = self._corner[edge] = self._variable()
            self.out.hard += [[-turns, *cells], [-turns, *(-c for c in cells)]]
            for i, j in combinations(range(len(cells)), 2):
                if planes[i] == planes[j]:
                    one, other = cells[i:j], cells[j:] + cells[:i]
                    self.out.hard += [
                        [-turns, *one, *(-c for c in other)],
                        [-turns, *(-c for c in one), *other],
                    ]
        return self._corner[edge]

    def demanded(self, seen: tuple[Row, Row, list[int]], dashed: bool | None) -> list[Clause]:
        """What a drawn edge demands of the rows on its left and right and the edges behind it."""
        left, right, behind = seen
        if dashed is None:
            return self.some_edge(behind)
        if dashed:
            return self.same_plane(left, right) + self.some_edge(behind)
        return self.other_plane(left, right)

    def some_edge(self, edges: list[int]) -> list[Clause]:
        """At one of the edges the solid turns a corner."""
        return [[turns for edge in edges if (turns := self.corner(edge)) is not None]]

    def _prefixes(self, row: Row) -> list[Clause]:
        """For each place in a row the literals that are false when all cells before it are empty."""
        node, found = 0, []
        for cell, _ in row:
            found.append([-node] if node else [])
            solid = cell + 1
            if (node, solid) not in self._empty:
                deeper = self._empty[node, solid] = self._variable()
                self.out.hard += [[-deeper, -solid], [deeper, solid, *([-node] if node else [])]]
                if node:
                    self.out.hard.append([-deeper, node])
            node = self._empty[node, solid]
        found.append([-node] if node else [])
        return found

    def other_plane(self, left: Row, right: Row) -> list[Clause]:
        """The nearest faces left and right lie in different planes, or one side is background."""
        before_left, before_right = self._prefixes(left), self._prefixes(right)
        group = [before_left[-1] + before_right[-1]]
        for i, (a, plane) in enumerate(left):
            for j, (b, other) in enumerate(right):
                if plane == other:
                    group.append([*before_left[i], -(a + 1), *before_right[j], -(b + 1)])
        return group

    def same_plane(self, left: Row, right: Row) -> list[Clause]:
        """The nearest faces left and right lie in one plane, or both sides are background."""
        sides = (left, self._prefixes(left)), (right, self._prefixes(right))
        group = []
        for (one, before_one), (other, before_other) in (sides, sides[::-1]):
            for (cell, plane), before in zip(one, before_one):
                first = [*before, -(cell + 1)]
                match = next((j for j, (_, p) in enumerate(other) if p == plane), None)
                if match is None:
                    group.append(first)
                else:
                    group.append([*first, other[match][0] + 1])
                    group += [[*first, -literal] for literal in before_other[match]]
        return group

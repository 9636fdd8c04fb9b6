"""From three views to every solid they can mean, step by step as in [watanabe].

1. points and edges of the views        (4.1)        `view_graph`
2. candidate vertices                   (4.2)        `vertices`
3. candidate edges, planes, fragments   (4.3)        `edges`, `planes`, `fragments`
4. cells, and what each view meets      (in place of unions of minimal regions)    `cells`, `sight_lines`
5. consistent labelings                 (4.4, 5)     `conditions`, `labeling`
6. polyhedra, drawn again               (output)     `assembly`, `verification`
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from recon.errors import BadOption, NoSolid
from recon.geometry.polyhedron import Polyhedron
from recon.geometry.views import ThreeViews
from recon.three_view.assembly import assemble
from recon.three_view.cells import Cells, space_cells
from recon.three_view.conditions import Conditions, conditions
from recon.three_view.conflicts import DrawnLine, minimal_conflict
from recon.three_view.edges import candidate_edges
from recon.three_view.fragments import Fragments, fragments
from recon.three_view.labeling import Labelings, consistent_labelings, is_consistent
from recon.three_view.planes import candidate_planes
from recon.three_view.plausibility import plausibility, ranked
from recon.three_view.repairs import Repair, likely_repairs, repaired
from recon.three_view.sight_lines import sight_lines
from recon.three_view.snapping import snap_lengths, unequal_spans
from recon.three_view.verification import Difference, differences
from recon.three_view.vertices import candidate_vertices
from recon.three_view.view_graph import ViewGraph, view_graphs

__all__ = ["Diagnosis", "Interpretation", "ViewsOptions", "all_polyhedra", "diagnose", "interpret"]

Flags = NDArray[np.bool_]

TRIED = 12  # repairs that are proved by solving the repaired drawing


@dataclass(frozen=True)
class ViewsOptions:
    """What a user may choose.

    snap        length: ends of lines that lie closer are one; None lets the drawing tell
    line_types  whether dashed means hidden and drawn through visible; False when the drawing does not tell them apart
    limit       options listed for one free choice; when there are more, they are counted
    seconds     time for counting; the count is a lower bound when it does not suffice
    Raises      BadOption.
    """

    snap: float | None = None
    line_types: bool = True
    limit: int = 100_000
    seconds: float = 10.0

    def __post_init__(self) -> None:
        if self.snap is not None and not 0 < self.snap < np.inf:
            raise BadOption("--snap", f"must be a positive length, not {self.snap}")
        if self.limit < 1:
            raise BadOption("--limit", f"must be at least 1, not {self.limit}")


@dataclass(frozen=True, eq=False)
class Arrangement:
    """Space as the drawing divides it, and what the drawing demands of it."""

    graphs: Sequence[ViewGraph]
    fragments: Fragments
    cells: Cells
    conditions: Conditions


@dataclass(frozen=True, eq=False)
class Interpretation:
    """Every solid that a drawing can mean, most plausible first.

    drawing      as given
    snap         length below which two places of it were one
    arrangement  fragments and cells
    labelings    which cells are solid, as a product of free choices
    line_types   whether line types had a say
    """

    drawing: ThreeViews
    snap: float
    arrangement: Arrangement
    labelings: Labelings
    line_types: bool

    @property
    def count(self) -> int:
        """Number of solids; a lower bound unless `exact`."""
        return self.labelings.count

    @property
    def exact(self) -> bool:
        return self.labelings.exact

    @property
    def complete(self) -> bool:
        """Whether every solid has a number."""
        return self.exact and self.labelings.listed == self.count

    def polyhedra(self) -> Iterator[Polyhedron]:
        """One solid after the other."""
        for solid in self.labelings:
            yield assemble(self.arrangement.fragments, self.arrangement.cells, solid)

    def polyhedron(self, number: int) -> Polyhedron:
        """The solid of a number, 0 the most plausible; raises BadOption when there are not so many."""
        if not 0 <= number < self.labelings.listed:
            listed = f"{self.labelings.listed} are" + ("" if self.complete else f" listed of {self.count}, and are")
            raise BadOption("--solution", f"{listed} numbered from 1; {number + 1} is none of them")
        return assemble(self.arrangement.fragments, self.arrangement.cells, self.labelings.labeling(number))

    def differences(self, solid: Polyhedron) -> list[Difference]:
        """Where a solid, drawn again, differs from the drawing; none for a solution."""
        return differences(self.drawing, solid, self.snap, line_types=self.line_types)


def all_polyhedra(drawing: ThreeViews, options: ViewsOptions | None = None) -> Iterator[Polyhedron]:
    """Every solid that a drawing can mean, most plausible first, each drawn again and compared before it is shown.

    Very many are not all listed (`Interpretation.complete`), and not counted here.
    Raises  NoSolid when there is none.
    """
    found = interpret(drawing, replace(options or ViewsOptions(), seconds=0.0))
    return (solid for solid in found.polyhedra() if not found.differences(solid))


def interpret(
    drawing: ThreeViews, options: ViewsOptions | None = None, *, doing: Callable[[str], None] = lambda text: None
) -> Interpretation:
    """What a drawing can mean.

    Raises  NoSolid when no solid is drawn like that.
    """
    options = options or ViewsOptions()
    for snap in snap_lengths(drawing) if options.snap is None else [options.snap]:
        doing("dividing space")
        arranged = arrange(drawing, snap, line_types=options.line_types)
        doing("choosing solid cells")
        cost = partial(plausibility, arranged.fragments, arranged.cells)
        labelings = consistent_labelings(
            arranged.conditions, arranged.cells.of_side, cost, limit=options.limit, seconds=options.seconds
        )
        if labelings is not None:
            doing("ranking the solids")
            order = ranked(arranged.fragments, arranged.cells, labelings)
            return Interpretation(drawing, snap, arranged, order, options.line_types)
    raise NoSolid("no solid is drawn like this")


@dataclass(frozen=True)
class Diagnosis:
    """Why a drawing has no solid.

    conflict  lines that contradict each other, none to spare
    repairs   single changes after which there is a solid, the most likely first
    spans     in words, axes along which two views do not reach equally far
    """

    conflict: tuple[DrawnLine, ...]
    repairs: tuple[Repair, ...]
    spans: tuple[str, ...] = ()


def diagnose(drawing: ThreeViews, options: ViewsOptions | None = None, *, limit: int = 3) -> Diagnosis:
    """The lines of a drawing without a solid that contradict each other, and at most `limit` repairs of one line."""
    options = options or ViewsOptions()
    snap = snap_lengths(drawing)[0] if options.snap is None else options.snap

    def ask(given: ThreeViews) -> tuple[Conditions, Sequence[ViewGraph]]:
        arranged = arrange(given, snap, line_types=options.line_types, alternatives=True)
        return arranged.conditions, arranged.graphs

    conflict = minimal_conflict(*ask(drawing))
    if not conflict:
        return Diagnosis((), ())
    tried = islice(likely_repairs(drawing, conflict, snap, ask), TRIED)
    repairs = islice((repair for repair in tried if _mends(drawing, repair, snap, options)), limit)
    return Diagnosis(tuple(conflict), tuple(repairs), tuple(unequal_spans(drawing, snap)))


def _mends(drawing: ThreeViews, repair: Repair, snap: float, options: ViewsOptions) -> bool:
    """Whether a solid draws as the repaired drawing."""
    again = arrange(repaired(drawing, repair), snap, line_types=options.line_types)
    return is_consistent(again.conditions)


def arrange(drawing: ThreeViews, snap: float, *, line_types: bool = True, alternatives: bool = False) -> Arrangement:
    """Steps 1 to 4, and the clauses of step 5.

    alternatives  also the clauses of each line in the other line type, and of its absence
    """
    values, graphs = view_graphs(drawing, snap)
    wire = candidate_edges(candidate_vertices(values, graphs), graphs, snap)
    made = fragments(wire, candidate_planes(wire, snap), snap)
    sights = sight_lines(made, graphs, snap)
    cells = space_cells(made, sights)
    lines = [(graph.telling(snap), graph.hidden if line_types else None) for graph in graphs]
    return Arrangement(graphs, made, cells, conditions(made, cells, sights, lines, alternatives=alternatives))

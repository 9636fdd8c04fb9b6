"""Proof of a solution: it is drawn again, and compared with the drawing line by line (paper, end of METHODS 4).

given     ------+- - - -          wherever one of the drawings shows a line, the other must show one of the same type,
again     ------+-------          a few snaps away at most; a dashed line may lie under one drawn through
                   ^ differs

The solid is drawn as exactly as it is made, and only the comparison has a tolerance: lines that lie over each other in
the drawing are a hair apart in a solid that was made of it, and cutting them at each other would move them.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from recon.geometry.polyhedron import Polyhedron
from recon.geometry.views import ThreeViews
from recon.three_view.hidden_lines import hidden_pieces, projected
from recon.three_view.stretches import SAME, cut_beside, lone_stretches

BESIDE = ((4.0, 0.02), (1.0, 0.02), (1.0, 0.5), (4.0, 0.5))  # how far beside a line one looks what is nearest

__all__ = ["Difference", "Line", "differences"]

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


class Line(StrEnum):
    """What a drawing shows at a place."""

    NONE = "nothing"
    VISIBLE = "a line drawn through"
    HIDDEN = "a dashed line"


@dataclass(frozen=True)
class Difference:
    """A piece of a line that two drawings show differently.

    view   name of the view
    ends   both ends, in the view's own coordinates
    given  what the drawing shows
    again  what the solid shows when it is drawn
    """

    view: str
    ends: tuple[tuple[float, float], tuple[float, float]]
    given: Line
    again: Line

    def __str__(self) -> str:
        (a, b), (c, d) = self.ends
        return (
            f"{self.view}: {self.given} from ({a:.4g}, {b:.4g}) to ({c:.4g}, {d:.4g}), where the solid has {self.again}"
        )


@dataclass(frozen=True, eq=False)
class _Shown:
    """Lines of a view, (n, 2, 2) each: those drawn through, those dashed, and those that may be either."""

    visible: Floats
    hidden: Floats
    either: Floats

    def all(self) -> Floats:
        return np.concatenate([self.visible, self.hidden, self.either])


def differences(drawing: ThreeViews, solid: Polyhedron, snap: float, *, line_types: bool = True) -> list[Difference]:
    """Where the views of a solid differ from a drawing; none when it is a solution.

    snap        length by which lines may be apart
    line_types  whether drawn-through and dashed lines must agree too
    """
    faces, graphs = projected(solid)
    found: list[Difference] = []
    for (projection, view), graph in zip(drawing, graphs):
        given = _typed(view.segments, view.hidden[None], line_types)
        pieces = cut_beside(graph.positions[graph.edges], graph.positions, BESIDE[0][0] * snap)
        told: list[Flags] = []
        here: list[Difference] = []
        for aside in BESIDE:
            # a type that depends on how near one looks is that of lines over each other: either is right
            told.append(hidden_pieces(faces, projection, pieces, snap=snap, aside=aside))
            again = _typed(pieces, np.array(told), line_types)
            here = list(_compared(projection.name, given, again, SAME * snap))
            if not here:
                break
        found += here
    return found


def _typed(segments: Floats, told: Flags, line_types: bool) -> _Shown:
    """Segments by what each row of `told` says of them, dashed or not; as drawn through where types do not matter."""
    dashed = told & line_types
    always, ever = dashed.all(axis=0), dashed.any(axis=0)
    return _Shown(segments[~ever], segments[always], segments[ever & ~always])


def _compared(name: str, given: _Shown, again: _Shown, tolerance: float) -> Iterator[Difference]:
    """A dashed line under one drawn through tells nothing; every other line must be met by one of its type."""

    def lone(lines: Floats, *others: Floats) -> Floats:
        return lone_stretches(lines, np.concatenate(others), tolerance)[1]

    def other_type(stretch: Floats, others: Floats) -> Line:
        return Line.NONE if len(lone(stretch[None], others)) else Line.HIDDEN

    for stretch in lone(given.visible, again.visible, again.either):
        yield _difference(name, stretch, Line.VISIBLE, other_type(stretch, again.all()))
    for stretch in lone(again.visible, given.visible):
        yield _difference(name, stretch, other_type(stretch, given.all()), Line.VISIBLE)
    for stretch in lone(given.hidden, given.visible, again.all()):
        yield _difference(name, stretch, Line.HIDDEN, Line.NONE)
    for stretch in lone(np.concatenate([again.hidden, again.either]), again.visible, given.all()):
        yield _difference(name, stretch, Line.NONE, Line.HIDDEN)


def _difference(name: str, ends: Floats, given: Line, again: Line) -> Difference:
    (a, b), (c, d) = ends.tolist()
    return Difference(name, ((a, b), (c, d)), given, again)

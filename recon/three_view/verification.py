"""Proof of a solution: it is drawn again, and compared with the drawing segment by segment (paper, end of METHODS 4).

given     ------+- - - -          at a point of every piece of either drawing both must show the same:
again     ------+-------          nothing, a line drawn through, or a dashed line
                   ^ differs
"""

from dataclasses import dataclass
from enum import StrEnum
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from recon.geometry.polyhedron import Polyhedron
from recon.geometry.views import ThreeViews
from recon.three_view.hidden_lines import draw
from recon.three_view.view_graph import ViewGraph, view_graphs

BESIDE = ((4.0, 0.02), (1.0, 0.02), (1.0, 0.5), (4.0, 0.5))  # how far beside a line one looks what is nearest
SLACK = 3.0  # snaps that a line may be off: the ends of both have moved

__all__ = ["Difference", "Line", "differences"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


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

    def overlaps(self, other: "Difference") -> bool:
        """Whether both tell of the same place: the middle of one lies within the box around the other."""
        if (self.view, self.given) != (other.view, other.given):
            return False
        one, two = np.array(self.ends), np.array(other.ends)
        return any(
            bool(((middle >= box.min(axis=0) - 1e-9) & (middle <= box.max(axis=0) + 1e-9)).all())
            for middle, box in ((one.mean(axis=0), two), (two.mean(axis=0), one))
        )

    def __str__(self) -> str:
        (a, b), (c, d) = self.ends
        return (
            f"{self.view}: {self.given} from ({a:.4g}, {b:.4g}) to ({c:.4g}, {d:.4g}), where the solid has {self.again}"
        )


def differences(drawing: ThreeViews, solid: Polyhedron, snap: float, *, line_types: bool = True) -> list[Difference]:
    """Where the views of a solid differ from a drawing; none when it is a solution.

    snap        length by which lines may be apart
    line_types  whether drawn-through and dashed lines must agree too
    """
    _, given = view_graphs(drawing, snap)
    found: list[Difference] = []
    for aside in BESIDE:
        _, again = view_graphs(draw(solid, snap, aside=aside), snap)
        told = list(chain.from_iterable(_both_ways(one, other, snap, line_types) for one, other in zip(given, again)))
        # what differs must differ however near one looks: lines closer than that may have changed their order
        found = told if aside == BESIDE[0] else [d for d in found if any(d.overlaps(t) for t in told)]
        if not found:
            break
    return found


def _both_ways(one: ViewGraph, other: ViewGraph, snap: float, line_types: bool) -> list[Difference]:
    missing = (d for d in _compared(other, one, snap, line_types) if d.again is Line.NONE)
    added = [Difference(d.view, d.ends, d.again, d.given) for d in missing]
    return _compared(one, other, snap, line_types) + added


def _compared(one: ViewGraph, other: ViewGraph, snap: float, line_types: bool) -> list[Difference]:
    way = one.directions()
    look = one.positions[one.edges[:, 0]] + 0.4837 * way
    mine = np.where(one.hidden, 2, 1)
    theirs = _shown(other, look, way, snap)
    # where a line changes its type is known to a few snaps only
    long = np.linalg.norm(way, axis=1) > SLACK * snap
    wrong = (theirs == 0) | ((mine != theirs) & line_types & long)
    kinds = list(Line)
    ends = one.positions[one.edges]
    return [
        Difference(
            one.projection.name,
            (tuple(ends[k, 0].tolist()), tuple(ends[k, 1].tolist())),
            kinds[mine[k]],
            kinds[theirs[k]],
        )
        for k in np.flatnonzero(wrong).tolist()
    ]


def _shown(graph: ViewGraph, look: Floats, way: Floats, snap: float) -> Ints:
    """0 nothing, 1 drawn through, 2 dashed: what a view shows at points, along a direction."""
    start, along = graph.positions[graph.edges[:, 0]], graph.directions()
    length = np.linalg.norm(along, axis=1)
    shown = np.zeros(len(look), dtype=np.int64)
    for k in range(len(look)):
        gap = look[k] - start
        share = (gap * along).sum(axis=1) / length**2
        away = np.abs(gap[:, 0] * along[:, 1] - gap[:, 1] * along[:, 0]) / length
        size = np.hypot(*way[k])
        turn = np.abs(along[:, 0] * way[k, 1] - along[:, 1] * way[k, 0])
        near = (share > 0) & (share < 1) & (away <= SLACK * snap)
        near &= turn <= 0.02 * length * size + 4 * snap * np.maximum(length, size)
        if near.any():
            near &= away <= away[near].min() + snap
            shown[k] = 2 if graph.hidden[near].all() else 1
    return shown

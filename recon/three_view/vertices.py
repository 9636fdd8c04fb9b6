"""Candidate vertices: points of the three views that agree on the coordinates they share (paper, 4.2 and 5.2.1).

    front (x, z), top (x, y), side (y, z)    --->    (x, y, z)

As a consistent labeling problem: the units are the views, the labels their points, and two labels go together when the
coordinate that both views show is the same number. A joined table finds all of them at once.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.three_view.tables import ranges
from recon.three_view.view_graph import ViewGraph

__all__ = ["CandidateVertices", "candidate_vertices"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class CandidateVertices:
    """Points in space that every view shows as a point.

    coordinates  (n, 3) numbers of the coordinates
    positions    (n, 3)
    points       (n, 3) the point that each view shows it as
    """

    coordinates: Ints
    positions: Floats
    points: Ints


def candidate_vertices(values: Sequence[Floats], graphs: Sequence[ViewGraph]) -> CandidateVertices:
    """Every triple of points, one a view, that agree; points where no two runs meet show no vertex and are left out."""
    front, top, side = graphs
    shown = [np.flatnonzero(graph.corners) for graph in graphs]
    f, t = _joined(front.points[shown[0], 0], top.points[shown[1], 0])
    f, t = shown[0][f], shown[1][t]
    n_z = len(values[2])
    keys = side.points[shown[2]] @ np.array([n_z, 1])
    order = np.argsort(keys)
    wanted = top.points[t, 1] * n_z + front.points[f, 1]
    slot = np.minimum(np.searchsorted(keys[order], wanted), max(len(keys) - 1, 0))
    found = keys[order][slot] == wanted if len(keys) else np.zeros(len(wanted), dtype=bool)
    f, t, s = f[found], t[found], shown[2][order[slot[found]]] if len(keys) else f[found]
    coordinates = np.column_stack([front.points[f, 0], top.points[t, 1], front.points[f, 1]])
    positions = np.column_stack([values[axis][coordinates[:, axis]] for axis in range(3)])
    return CandidateVertices(coordinates, positions, np.column_stack([f, t, s]))


def _joined(left: Ints, right: Ints) -> tuple[Ints, Ints]:
    """All pairs (row of left, row of right) with equal values."""
    order = np.argsort(right, kind="stable")
    rows, slot = ranges(*(np.searchsorted(right[order], left, side=side) for side in ("left", "right")))
    return rows, order[slot]

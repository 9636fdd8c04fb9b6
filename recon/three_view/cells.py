"""Cells: the parts of space between fragments, each of which is solid or empty as a whole.

        b                around an edge the fragments a, b, c follow each other by angle; the side of a that looks
  cell  |  cell          at b and the side of b that looks at a belong to one cell. Sides that are linked around
a ------+                edges make up a cell; surfaces that no edge links are linked along lines of sight.
  cell   \\ cell
          c
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.three_view.fragments import Fragments
from recon.three_view.sight_lines import SightLines
from recon.three_view.tables import linked

__all__ = ["Cells", "next_in_group", "space_cells"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Cells:
    """The cells of an arrangement; cell 0 is the unbounded one, which is empty.

    of_side    (f, 2) cell in front of and behind each fragment
    n_cells    with the unbounded one
    edge       (k,) an edge, not decreasing,
    fragment   (k,) a fragment that ends there, turning about the edge,
    after      (k,) the side of the fragment, 0 front or 1 back, that looks at the one that follows; it is also the
               side of the edge, 0 left or 1 right, on which the fragment lies in its plane
    use        (k,) use of the edge by the fragment's plane
    """

    of_side: Ints
    n_cells: int
    edge: Ints
    fragment: Ints
    after: Ints
    use: Ints

    def sectors(self) -> Ints:
        """(k,) the cell that follows each fragment around its edge."""
        return self.of_side[self.fragment, self.after]


def space_cells(made: Fragments, sights: Sequence[SightLines]) -> Cells:
    """The cells between the fragments; every surface that a line of sight meets knows what it lies in."""
    edge, fragment, after, use = _around_edges(made)
    following = next_in_group(edge)
    links = np.column_stack([2 * fragment + after, 2 * fragment[following] + 1 - after[following]])
    n = len(made.plane)
    surface = linked(np.column_stack([fragment, fragment[following]]), n)
    outside = 2 * n
    links = np.concatenate([links, *(_along_sight(sight, surface, outside) for sight in sights)])
    number = linked(links, 2 * n + 1)
    number = np.where(number == number[outside], 0, np.where(number < number[outside], number + 1, number))
    return Cells(number[: 2 * n].reshape(n, 2), int(number.max()) + 1, edge, fragment, after, use)


def _around_edges(made: Fragments) -> tuple[Ints, Ints, Ints, Ints]:
    """Fragments at each edge in the order of their angle about it, and the side that looks along the turn."""
    ends = made.wire.vertices[made.wire.edges[made.use_edge]]
    way = ends[:, 1] - ends[:, 0]
    normal = made.planes.normals[made.use_plane]
    left = np.cross(normal, way)
    helper = np.eye(3)[np.argmin(np.abs(way), axis=1)]
    first = np.cross(way, helper)
    second = np.cross(way, first) / np.linalg.norm(way, axis=1)[:, None]
    x, y = (left * first).sum(axis=1), (left * second).sum(axis=1)
    angle = np.concatenate([np.arctan2(y, x), np.arctan2(-y, -x)])
    edge = np.tile(made.use_edge, 2)
    fragment = made.region.T.ravel()
    after = np.repeat([0, 1], len(left))
    rows = np.flatnonzero(fragment >= 0)
    rows = rows[np.lexsort([angle[rows], edge[rows]])]
    use = np.tile(np.arange(len(left)), 2)
    return edge[rows], fragment[rows], after[rows], use[rows]


def next_in_group(group: Ints) -> Ints:
    """Row of the next member of a group, of the last member the first; groups stand together."""
    following = np.arange(1, len(group) + 1)
    heads = np.flatnonzero(np.diff(group, prepend=-1))
    if len(heads):
        following[np.append(heads[1:], len(group)) - 1] = heads
    return following


def _along_sight(sight: SightLines, surface: Ints, outside: int) -> Ints:
    """Pairs of sides that face each other along a line of sight and belong to surfaces that no edge links."""
    near = 2 * sight.fragment + np.where(sight.facing, 0, 1)
    far = 2 * sight.fragment + np.where(sight.facing, 1, 0)
    first = np.diff(sight.beside, prepend=-1) != 0
    apart = ~first[1:] & (surface[sight.fragment[1:]] != surface[sight.fragment[:-1]])
    return np.concatenate(
        [
            np.column_stack([near[first], np.full(first.sum(), outside)]),
            np.column_stack([far[:-1], near[1:]])[apart],
        ]
    )

"""Which of many solids a draughtsman would rather have meant: the simplest one.

Fewer bodies first, then fewer voids, then fewer faces, then fewer edges; of equals the one that leaves fewer cells
empty: a cube rather than a cube with a corner turned in. Counted on the cells, for many labelings at once, since an
ambiguous drawing has thousands of them.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.three_view.cells import Cells
from recon.three_view.fragments import Fragments
from recon.three_view.labeling import FreeChoice, Labelings

__all__ = ["plausibility", "ranked"]

Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

TOGETHER = 2000  # solids whose common order is found; beyond it every choice is ranked on its own


def ranked(made: Fragments, cells: Cells, labelings: Labelings) -> Labelings:
    """The same labelings, the most plausible first: each choice's options beside the first of all others."""
    choices = list(labelings.choices)
    for k, choice in enumerate(choices):
        if len(choice.options) > 1:
            order = _order(plausibility(made, cells, _beside_the_first(labelings, choices, k)))
            choices[k] = replace(choice, options=tuple(choice.options[i] for i in order.tolist()))
    better = replace(labelings, choices=tuple(choices))
    if sum(len(choice.options) > 1 for choice in choices) < 2 or labelings.listed > TOGETHER:
        return better
    picks = list(product(*(range(len(choice.options)) for choice in choices)))
    order = _order(plausibility(made, cells, np.array(list(better))))
    return replace(better, order=tuple(picks[i] for i in order.tolist()))


def _beside_the_first(labelings: Labelings, choices: Sequence[FreeChoice], k: int) -> Flags:
    """One row of flags for every option of a choice."""
    options = choices[k].options
    others = [choice.options[0] for choice in (*choices[:k], *choices[k + 1 :])]
    solids = np.zeros((len(options), labelings.n_cells), dtype=bool)
    solids[:, list(labelings.forced.union(*others))] = True
    for row, option in enumerate(options):
        solids[row, list(option)] = True
    return solids


def plausibility(made: Fragments, cells: Cells, solids: Flags) -> Ints:
    """(k, 5) numbers of bodies, voids, faces, edge pieces, empty cells of solids, each a row of (k, n_cells) flags."""
    return _counted(cells.of_side, made.plane, (cells.edge, cells.fragment, cells.after), np.atleast_2d(solids))


def _order(costs: Ints) -> Ints:
    """Rows of `plausibility`, the most plausible first; equals keep their order."""
    return np.lexsort(costs.T[::-1])


@njit(cache=True)
def _root(parent: Ints, k: int) -> int:  # pragma: no cover - compiled
    while parent[k] != k:
        parent[k] = parent[parent[k]]
        k = parent[k]
    return k


@njit(cache=True)
def _counted(of_side: Ints, plane: Ints, around: tuple[Ints, Ints, Ints], solids: Flags) -> Ints:  # pragma: no cover
    edge, fragment, after = around
    found = np.zeros((len(solids), 5), dtype=np.int64)
    for row in range(len(solids)):
        solid = solids[row]
        lump, face = np.arange(len(solid)), np.arange(len(plane))
        for f in range(len(plane)):
            a, b = of_side[f, 0], of_side[f, 1]
            if solid[a] == solid[b]:
                lump[_root(lump, a)] = _root(lump, b)
        first = 0
        while first < len(edge):
            last = first
            while last < len(edge) and edge[last] == edge[first]:
                last += 1
            found[row, 3] += _turn(of_side, plane, (fragment, after), (first, last), solid, face)
            first = last
        for c in range(len(solid)):
            if lump[c] == c:
                found[row, 0 if solid[c] else 1] += 1
        found[row, 1] -= 1  # the space around is no void
        found[row, 4] = len(solid) - solid.sum()
        for f in range(len(plane)):
            if face[f] == f and solid[of_side[f, 0]] != solid[of_side[f, 1]]:
                found[row, 2] += 1
    return found


@njit(cache=True)
def _turn(
    of_side: Ints, plane: Ints, around: tuple[Ints, Ints], rows: tuple[int, int], solid: Flags, face: Ints
) -> int:  # pragma: no cover - compiled
    """Solid sectors with a corner at one edge; faces that go on across it are linked."""
    fragment, after = around
    first, last = rows
    corners = 0
    for k in range(first, last):
        f = fragment[k]
        if solid[of_side[f, 0]] == solid[of_side[f, 1]] or not solid[of_side[f, after[k]]]:
            continue
        mate = k
        while True:
            mate = mate + 1 if mate + 1 < last else first
            g = fragment[mate]
            if solid[of_side[g, 0]] != solid[of_side[g, 1]]:
                break
        if plane[f] == plane[fragment[mate]]:
            face[_root(face, f)] = _root(face, fragment[mate])
        else:
            corners += 1
    return corners

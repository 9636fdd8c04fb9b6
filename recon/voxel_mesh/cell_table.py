"""The 256 cases of a cell, made rather than listed, so that no two cells ever disagree.

        6-------7           corner c = x + 2 y + 4 z of the cell, bit c of a case set when that corner is solid
       /|      /|           cell edge e joins CELL_EDGES[e]; a surface vertex lies on it when its ends differ
      4-------5 |
      | 2-----|-3           On a face of the cell the vertices are joined in pairs: two solid corners across a face's
      |/      |/            diagonal are kept apart.  Both cells at the face see the same corners and join alike, so
      0-------1             no hole opens between them.

The joins close to loops.  A loop is triangulated without any diagonal between two vertices of one face of the cell: the
neighbour could draw the same diagonal, and that edge would have four triangles.

Paper  [lorensen1987] for marching cubes; the rule for faces is that of 6-connected solids.
"""

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["CELL_EDGES", "CellTable", "cell_table"]

CORNERS = tuple((c & 1, c >> 1 & 1, c >> 2 & 1) for c in range(8))
CELL_EDGES = tuple((a, a | 1 << axis) for axis in range(3) for a in range(8) if not a >> axis & 1)
_EDGE_NUMBER = {frozenset(ends): e for e, ends in enumerate(CELL_EDGES)}
# corners around each face, counter-clockwise seen from outside the cell
_FACES = ((0, 4, 6, 2), (1, 3, 7, 5), (0, 1, 5, 4), (2, 6, 7, 3), (0, 2, 3, 1), (4, 5, 7, 6))
_FACES_OF_EDGE = tuple(frozenset(f for f, face in enumerate(_FACES) if set(ends) <= set(face)) for ends in CELL_EDGES)

Triangle = tuple[int, int, int]


class CellTable(NamedTuple):
    """Triangles of every case.

    counts     (256,) triangles
    triangles  (256, 5, 3) cell edges whose vertices they join, counter-clockwise seen from outside the solid
    """

    counts: NDArray[np.int8]
    triangles: NDArray[np.int8]


@cache
def cell_table() -> CellTable:
    """The table; made once."""
    counts, triangles = np.zeros(256, dtype=np.int8), np.zeros((256, 5, 3), dtype=np.int8)
    for case in range(256):
        found = [t for loop in loops_of_case(case) for t in _triangulated(loop)]
        counts[case] = len(found)
        triangles[case, : len(found)] = np.array(found, dtype=np.int8).reshape(-1, 3)
    return CellTable(counts, triangles)


def loops_of_case(case: int) -> list[tuple[int, ...]]:
    """Loops of cell edges that the surface runs through, counter-clockwise seen from outside the solid."""
    following = dict(join for face in _FACES for join in _joins(face, case))
    loops = []
    while following:
        loop = [next(iter(following))]
        while (step := following.pop(loop[-1])) != loop[0]:
            loop.append(step)
        loops.append(tuple(loop))
    return loops


def _joins(face: tuple[int, ...], case: int) -> list[tuple[int, int]]:
    """Directed joins on one face: each run of solid corners around it is cut off by one."""
    solid = [bool(case >> corner & 1) for corner in face]
    enters = [k for k in range(4) if not solid[k - 1] and solid[k]]
    joins = []
    for k in enters:
        stop = next(k + n for n in range(1, 5) if not solid[(k + n) % 4])
        first = frozenset((face[k - 1], face[k]))
        last = frozenset((face[(stop - 1) % 4], face[stop % 4]))
        joins.append((_EDGE_NUMBER[first], _EDGE_NUMBER[last]))
    return joins


def _triangulated(loop: tuple[int, ...]) -> list[Triangle]:
    """Triangles of a loop, from its first possible corner."""
    for turn in range(len(loop)):
        found = _ears(loop[turn:] + loop[:turn])
        if found is not None:
            return found
    raise AssertionError(f"the loop {loop} cannot be triangulated")


def _ears(loop: tuple[int, ...]) -> list[Triangle] | None:
    """A triangulation whose diagonals each leave the faces of the cell, or None."""
    if len(loop) == 3:
        return [(loop[0], loop[1], loop[2])]
    for k in range(len(loop)):
        before, here, after = loop[k - 1], loop[k], loop[(k + 1) % len(loop)]
        if not _FACES_OF_EDGE[before] & _FACES_OF_EDGE[after]:
            rest = _ears(tuple(e for e in loop if e != here))
            if rest is not None:
                return [(before, here, after), *rest]
    return None

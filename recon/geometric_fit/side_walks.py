"""Walks from side to side of a mesh that is edited in place, for triangles and quadrilaterals alike.

   c                  faces   (k F,) corners, face after face: side s runs from faces[s] to the start of the next
  / \\                 across  (k F,) the side on the other side of its edge; -1 on a border
 /   \\   next         k       corners a face
a--s--b
  side
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["cosine", "join", "next_side", "previous_side", "share_a_face"]

Ints = NDArray[np.int64]
Vector = tuple[float, float, float]


@njit(cache=True)
def next_side(side: int, k: int) -> int:  # pragma: no cover - compiled
    """The side that begins where this one ends."""
    return side - side % k + (side + 1) % k


@njit(cache=True)
def previous_side(side: int, k: int) -> int:  # pragma: no cover - compiled
    """The side that ends where this one begins."""
    return side - side % k + (side + k - 1) % k


@njit(cache=True)
def _meets(faces: Ints, side: int, vertex: int, k: int) -> bool:  # pragma: no cover - compiled
    found, first = False, side - side % k
    for corner in range(first, first + k):
        found = found or faces[corner] == vertex
    return found


@njit(cache=True)
def share_a_face(faces: Ints, across: Ints, side: int, vertex: int, k: int) -> bool:  # pragma: no cover - compiled
    """Whether a face around the start of `side` has the vertex; a border ends the walk in either direction."""
    at = side
    while True:
        if _meets(faces, at, vertex, k):
            return True
        at = across[previous_side(at, k)]
        if at == side:
            return False
        if at < 0:
            break
    at = across[side]
    while at >= 0:
        at = next_side(at, k)
        if _meets(faces, at, vertex, k):
            return True
        at = across[at]
    return False


@njit(cache=True)
def join(across: Ints, one: int, two: int) -> None:  # pragma: no cover - compiled
    """Make the two sides of one edge; two is -1 on a border."""
    across[one] = two
    if two >= 0:
        across[two] = one


@njit(cache=True)
def cosine(one: Vector, two: Vector) -> float:  # pragma: no cover - compiled
    """Of the angle between two vectors, rows of three or tuples."""
    dot = one[0] * two[0] + one[1] * two[1] + one[2] * two[2]
    squares = (one[0] ** 2 + one[1] ** 2 + one[2] ** 2) * (two[0] ** 2 + two[1] ** 2 + two[2] ** 2)
    return dot / max(np.sqrt(squares), 1e-300)

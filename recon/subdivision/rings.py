"""The vertices that a limit patch with one irregular corner depends on, in an order that its kind alone decides.

          o---o---o         first 0, then the fan around 0, then what is left around 1 and around 2; fans run
         / \\ / \\ / \\        counter-clockwise, from the border where there is one, else from the patch itself
        o---2---o---o
         \\ /#\\ / \\ /        # the patch; 0 is its irregular corner, 1 and 2 are regular
          0---1---o

Two patches with the same kind of corner 0, as many faces around it, and the same place in its fan have rings that
correspond entry by entry, so one table of weights serves both.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["face_rings", "fan_places"]

Ints = NDArray[np.int64]

MAX_RING = 80  # entries: room for a valence above 60


@njit(cache=True)
def _add(ring: Ints, count: int, vertex: int) -> int:
    """Append a vertex that is not there yet; the new length."""
    for i in range(count):
        if ring[i] == vertex:
            return count
    if count < len(ring):
        ring[count] = vertex
    return count + 1


@njit(cache=True)
def _first_side(across: Ints, side: int) -> tuple[int, bool]:
    """The side around the start of `side` from which a counter-clockwise walk meets all, and whether it is closed."""
    at = side
    while True:
        other = across[at]
        if other < 0:
            return at, False
        at = other - other % 3 + (other + 1) % 3
        if at == side:
            return side, True


@njit(cache=True)
def _add_fan(faces: Ints, across: Ints, side: int, ring: Ints, count: int) -> int:
    """Append the neighbours of the start of `side`, counter-clockwise."""
    first, _ = _first_side(across, side)
    at = first
    while True:
        base = at - at % 3
        count = _add(ring, count, faces[base + (at + 1) % 3])
        back = base + (at + 2) % 3
        at = across[back]
        if at < 0:
            return _add(ring, count, faces[back])
        if at == first:
            return count


@njit(cache=True)
def face_rings(faces: Ints, across: Ints, chosen: Ints) -> tuple[Ints, Ints]:
    """(n, MAX_RING) rings of the chosen faces and (n,) their lengths; a length above MAX_RING says that it was cut."""
    rings = np.full((len(chosen), MAX_RING), -1)
    lengths = np.zeros(len(chosen), dtype=np.int64)
    flat_faces, flat_across = faces.ravel(), across.ravel()
    for i in range(len(chosen)):
        count = _add(rings[i], 0, faces[chosen[i], 0])
        for corner in range(3):
            count = _add_fan(flat_faces, flat_across, 3 * chosen[i] + corner, rings[i], count)
        lengths[i] = count
    return rings, lengths


@njit(cache=True)
def fan_places(across: Ints, chosen: Ints) -> tuple[Ints, Ints]:
    """(n,) faces around corner 0 of the chosen faces, and (n,) place of the face in the fan; 0 where it is closed."""
    n_faces = np.zeros(len(chosen), dtype=np.int64)
    places = np.zeros(len(chosen), dtype=np.int64)
    flat = across.ravel()
    for i in range(len(chosen)):
        side = 3 * chosen[i]
        first, _ = _first_side(flat, side)
        at, count = first, 0
        while True:
            if at == side:
                places[i] = count
            count += 1
            at = flat[at - at % 3 + (at + 2) % 3]
            if at < 0 or at == first:
                break
        n_faces[i] = count
    return n_faces, places

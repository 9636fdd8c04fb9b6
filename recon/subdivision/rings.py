"""The vertices that a limit patch with one irregular corner depends on, in an order that its kind alone decides.

          o---o---o         first 0, then the fan around 0, then what is left around 1, 2 (and 3); fans run
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

MAX_RING = 80  # entries: room for a valence above 60 in triangles, of 35 in quadrilaterals


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
def _first_side(across: Ints, side: int, k: int) -> int:
    """The side around the start of `side` from which a counter-clockwise walk meets all; k corners a face."""
    at = side
    while True:
        other = across[at]
        if other < 0:
            return at
        at = other - other % k + (other + 1) % k
        if at == side:
            return side


@njit(cache=True)
def _add_fan(faces: Ints, across: Ints, side: int, k: int, ring: Ints, count: int) -> int:
    """Append the other corners of the faces around the start of `side`, counter-clockwise."""
    first = _first_side(across, side, k)
    at = first
    while True:
        base = at - at % k
        for i in range(1, k):
            count = _add(ring, count, faces[base + (at + i) % k])
        at = across[base + (at + k - 1) % k]
        if at < 0 or at == first:
            return count


@njit(cache=True)
def face_rings(faces: Ints, across: Ints, chosen: Ints) -> tuple[Ints, Ints]:
    """(n, MAX_RING) rings of the chosen faces and (n,) their lengths; a length above MAX_RING says that it was cut."""
    rings = np.full((len(chosen), MAX_RING), -1)
    lengths = np.zeros(len(chosen), dtype=np.int64)
    k = faces.shape[1]
    flat_faces, flat_across = faces.ravel(), across.ravel()
    for i in range(len(chosen)):
        count = _add(rings[i], 0, faces[chosen[i], 0])
        for corner in range(k):
            count = _add_fan(flat_faces, flat_across, k * chosen[i] + corner, k, rings[i], count)
        lengths[i] = count
    return rings, lengths


@njit(cache=True)
def fan_places(across: Ints, chosen: Ints) -> tuple[Ints, Ints]:
    """(n,) faces around corner 0 of the chosen faces, and (n,) place of the face in the fan; 0 where it is closed."""
    n_faces = np.zeros(len(chosen), dtype=np.int64)
    places = np.zeros(len(chosen), dtype=np.int64)
    k = across.shape[1]
    flat = across.ravel()
    for i in range(len(chosen)):
        side = k * chosen[i]
        first = _first_side(flat, side, k)
        at, count = first, 0
        while True:
            if at == side:
                places[i] = count
            count += 1
            at = flat[at - at % k + (at + k - 1) % k]
            if at < 0 or at == first:
                break
        n_faces[i] = count
    return n_faces, places

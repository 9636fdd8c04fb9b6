"""A patch of a surface with a border, made ready for a collapse that knows closed meshes only.

       a ----> b        The border's faces get an imaginary face each on their other side, up to one vertex c that lies
     . | \\   / | .      nowhere.  Neighbours around the border share the edges to c, fan by fan: so a walk around a
    c  |  \\ /  |  c     border vertex comes back to where it began, also where the patch touches itself there.
     ' | / \\ | '       All vertices of the border are locked, and so is c: no imaginary face is ever in a ring.

Two patches that lock what they share can change at the same time: a collapse needs to know the faces around the two
ends of its edge and no others [dey1999].
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["ClosedOff", "closed_off"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


class ClosedOff(NamedTuple):
    """faces (F + B, 3) with the imaginary ones at the end, twin (3 F + 3 B,), border (V,) whether a vertex is on it.

    The imaginary vertex has the number V.
    """

    faces: Ints
    twin: Ints
    border: Bools


def closed_off(faces: Ints, n_vertices: int) -> ClosedOff:
    """Close a patch of consistently oriented faces (F, 3), no edge of which has more than two."""
    twin = _twins(faces, n_vertices)
    start = faces.ravel()
    out = np.flatnonzero(twin < 0)
    ahead = start[_next(out)]
    first = len(start) + 3 * np.arange(len(out))
    imaginary = np.stack([ahead, start[out], np.full(len(out), n_vertices)], axis=1)
    number = np.full(len(start), -1, dtype=np.int64)
    number[out] = first
    into = number[_arriving(twin, out)]
    more = np.empty(3 * len(out), dtype=np.int64)
    more[0::3] = out
    more[first - len(start) + 1] = into + 2
    more[into + 2 - len(start)] = first + 1
    twin[out] = first
    border = np.zeros(n_vertices, dtype=bool)
    border[start[out]] = True
    return ClosedOff(np.concatenate([faces, imaginary]), np.append(twin, more), border)


def _next(h: Ints) -> Ints:
    return np.asarray(np.where(h % 3 == 2, h - 2, h + 1))


def _twins(faces: Ints, n_vertices: int) -> Ints:
    """(3 F,) the half-edge that runs the other way along the same edge, -1 on the border."""
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    key = np.minimum(start, end) * n_vertices + np.maximum(start, end)
    order = np.argsort(key, kind="stable")
    pair = np.flatnonzero(key[order[1:]] == key[order[:-1]])
    twin = np.full(len(key), -1, dtype=np.int64)
    twin[order[pair]], twin[order[pair + 1]] = order[pair + 1], order[pair]
    return twin


def _arriving(twin: Ints, out: Ints) -> Ints:
    """For half-edges that leave a vertex along the border, the ones that arrive along it in the same fan of faces."""
    found = _next(_next(out))
    turning = np.flatnonzero(twin[found] >= 0)
    while len(turning):
        found[turning] = _next(_next(twin[found[turning]]))
        turning = turning[twin[found[turning]] >= 0]
    return found

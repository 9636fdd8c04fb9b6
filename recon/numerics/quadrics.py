"""Plane quadrics about a point of their own, so that nothing cancels far from the origin.

A quadric is a row of ten numbers about a centre p, and means

    E(x) = y·A y + 2 g·y + c,   y = x - p,        row = (a_xx, a_xy, a_xz, a_yy, a_yz, a_zz, g_x, g_y, g_z, c)

The planes of the faces around a vertex pass through it: there g and c are zero.  Far from the origin the textbook's
form x·A x - 2 b·x + c loses, in c alone, more digits than the differences it is to rank have.

Paper  [garland1997].
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["vertex_quadrics", "moved_sum", "lowest_point", "quadric_value"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def vertex_quadrics(vertices: Floats, faces: Ints, *, regulariser: float) -> Floats:
    """(V, 10) sum of the planes of each vertex's faces, weighted with their areas, plus `regulariser` times |y|²."""
    rows = np.zeros((len(vertices), 10))
    rows[:, [0, 3, 5]] = regulariser
    _add_planes(rows, vertices, faces)
    return rows


@njit(cache=True)
def _add_planes(rows: Floats, vertices: Floats, faces: Ints) -> None:  # pragma: no cover - compiled
    normal, e, f = np.empty(3), np.empty(3), np.empty(3)
    for t in range(len(faces)):
        for i in range(3):
            e[i] = vertices[faces[t, 1], i] - vertices[faces[t, 0], i]
            f[i] = vertices[faces[t, 2], i] - vertices[faces[t, 0], i]
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            normal[i] = e[j] * f[k] - e[k] * f[j]
        size = np.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
        if not size > 0.0:
            continue
        for corner in faces[t]:
            column = 0
            for i in range(3):
                for j in range(i, 3):
                    rows[corner, column] += normal[i] * normal[j] / (2.0 * size)
                    column += 1


@njit(cache=True)
def moved_sum(total: Floats, one: Floats, other: Floats, shift: Floats) -> None:  # pragma: no cover - compiled
    """total = one + other, both about the centre of `one`; shift is that centre less the centre of `other`."""
    x, y, z = shift[0], shift[1], shift[2]
    ax = other[0] * x + other[1] * y + other[2] * z
    ay = other[1] * x + other[3] * y + other[4] * z
    az = other[2] * x + other[4] * y + other[5] * z
    for i in range(6):
        total[i] = one[i] + other[i]
    total[6] = one[6] + other[6] + ax
    total[7] = one[7] + other[7] + ay
    total[8] = one[8] + other[8] + az
    total[9] = one[9] + other[9] + 2.0 * (other[6] * x + other[7] * y + other[8] * z) + ax * x + ay * y + az * z


@njit(cache=True)
def quadric_value(q: Floats, y: Floats) -> float:  # pragma: no cover - compiled
    """E at the centre plus y."""
    ax = q[0] * y[0] + q[1] * y[1] + q[2] * y[2]
    ay = q[1] * y[0] + q[3] * y[1] + q[4] * y[2]
    az = q[2] * y[0] + q[4] * y[1] + q[5] * y[2]
    return (ax + 2.0 * q[6]) * y[0] + (ay + 2.0 * q[7]) * y[1] + (az + 2.0 * q[8]) * y[2] + q[9]


@njit(cache=True)
def lowest_point(q: Floats, y: Floats, work: Floats) -> bool:  # pragma: no cover - compiled
    """Write where E is least, less the centre, into y; False when A has no inverse.

    Elimination pivots along the diagonal: the planes of a flat leave A with one large and two tiny eigenvalues, whose
    determinant is all rounding.
    work  (3, 4) scratch
    """
    work[0, 0], work[0, 1], work[0, 2], work[0, 3] = q[0], q[1], q[2], -q[6]
    work[1, 0], work[1, 1], work[1, 2], work[1, 3] = q[1], q[3], q[4], -q[7]
    work[2, 0], work[2, 1], work[2, 2], work[2, 3] = q[2], q[4], q[5], -q[8]
    done = 0
    order = (0, 1, 2)
    for _ in range(3):
        best = -1
        for i in range(3):
            if not done >> i & 1 and (best < 0 or work[i, i] > work[best, best]):
                best = i
        pivot = work[best, best]
        if not pivot > 0.0:
            return False
        done |= 1 << best
        for i in range(3):
            if i != best:
                factor = work[i, best] / pivot
                for j in range(4):
                    work[i, j] -= factor * work[best, j]
                work[i, best] = 0.0
    for i in order:
        y[i] = work[i, 3] / work[i, i]
    return True

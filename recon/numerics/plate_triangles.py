"""Bending of a thin plate over triangles whose corners carry a height and a gradient each: discrete Kirchhoff.

           2            the gradient G of the height is quadratic on the triangle: given at the corners, and at the
          / \\           middle of a side (from i to j, length L, direction s)
       5 /   \\ 4            G . s = 3 (z_j - z_i) / (2 L) - (g_i + g_j) . s / 4        the side's cubic
        /     \\             G x s = mean of those of g_i and g_j
       0---3---1

       energy = integral of  G_x,x^2 + G_y,y^2 + (G_x,y + G_y,x)^2 / 2

Paper  [batoz1980] Batoz, Bathe, Ho: A study of three-node triangular plate bending elements.
"""

import numpy as np
from numpy.typing import NDArray

__all__ = ["bending_rows"]

Floats = NDArray[np.float64]

SIDES = ((0, 1), (1, 2), (2, 0))


def bending_rows(corners: Floats) -> Floats:
    """(F, 9, 9) rows R such that |R q|^2 is the bending energy of a triangle with the values q.

    corners  (F, 3, 2) counter-clockwise, no triangle without area
    q        z, g_x, g_y of the first corner, then of the second and third
    """
    n = len(corners)
    gradients = _nodal_gradients(corners)
    edge = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)  # opposite to each corner
    double_area = edge[:, 0, 0] * edge[:, 1, 1] - edge[:, 0, 1] * edge[:, 1, 0]
    slopes = np.stack([-edge[..., 1], edge[..., 0]], axis=-1) / double_area[:, None, None]  # of barycentric coordinates
    rows = np.empty((n, 3, 3, 9))
    for k, (i, j) in enumerate(SIDES):
        share = np.zeros(3)
        share[[i, j]] = 0.5
        shape = np.concatenate(
            [(4 * share - 1)[:, None] * slopes]
            + [4 * (share[a] * slopes[:, b] + share[b] * slopes[:, a])[:, None] for a, b in SIDES],
            axis=1,
        )
        change = (shape.transpose(0, 2, 1) @ gradients.reshape(n, 6, 18)).reshape(n, 2, 2, 9)
        rows[:, k, 0], rows[:, k, 1] = change[:, 0, 0], change[:, 1, 1]
        rows[:, k, 2] = (change[:, 0, 1] + change[:, 1, 0]) / np.sqrt(2.0)
    return rows.reshape(n, 9, 9) * np.sqrt(double_area / 6)[:, None, None]


def _nodal_gradients(corners: Floats) -> Floats:
    """(F, 6, 2, 9) matrices from the corners' values to the gradient at the corners and the middles of the sides."""
    out = np.zeros((len(corners), 6, 2, 9))
    for k in range(3):
        out[:, k, 0, 3 * k + 1] = out[:, k, 1, 3 * k + 2] = 1.0
    for k, (i, j) in enumerate(SIDES):
        way = corners[:, j] - corners[:, i]
        length = np.linalg.norm(way, axis=1)[:, None]
        s = way / length
        out[:, 3 + k, :, 3 * j] = 1.5 * s / length
        out[:, 3 + k, :, 3 * i] = -1.5 * s / length
        both = 0.5 * np.eye(2) - 0.75 * s[:, :, None] * s[:, None, :]
        for corner in (i, j):
            out[:, 3 + k, :, 3 * corner + 1 : 3 * corner + 3] = both
    return out

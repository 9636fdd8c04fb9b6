"""Closed polygons in the plane."""

import numpy as np
from numpy.typing import NDArray

__all__ = ["within"]

Floats = NDArray[np.float64]


def within(polygon: Floats, points: Floats) -> NDArray[np.bool_]:
    """(m,) whether points (m, 2) lie inside a closed polygon (n, 2): a ray to the right crosses it an odd number of
    times.
    """
    (ax, ay), (bx, by) = polygon.T, np.roll(polygon, -1, axis=0).T
    x, y = points[:, :1], points[:, 1:]
    straddles = (ay <= y) != (by <= y)
    reach = ax + (y - ay) * np.divide(bx - ax, by - ay, out=np.zeros_like(ax), where=by != ay)
    return np.asarray((straddles & (reach > x)).sum(axis=1) % 2 == 1)

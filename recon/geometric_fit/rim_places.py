"""Where the border of a disc goes: on a superellipse about as long and as wide as the border seems from its best side.

It is convex everywhere, as springs want it, and fills its rectangle but for the corners, where a rectangle would pinch.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

__all__ = ["cross", "least_box", "rim_places", "shares"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

ROUNDNESS = 6.0  # of the rim of a disc, a superellipse: 2 an ellipse, infinite a rectangle with corners that pinch


def rim_places(row: Floats) -> Floats:
    """(n, 2) places of the rim of a disc on a superellipse as long and wide as the rim seems from its best side."""
    middle = row - row.mean(axis=0)
    axes = np.linalg.svd(middle, full_matrices=False)[2]
    flat = middle @ axes[:2].T
    if 0.5 * cross(flat, np.roll(flat, -1, axis=0)).sum() < 0.0:
        flat = flat * [1.0, -1.0]
    box, turn = least_box(flat)
    flat = flat @ turn
    centre = 0.5 * (flat.max(axis=0) + flat.min(axis=0))
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) * 0.5 * box
    at = _corner_numbers(flat - centre, corners)
    share = shares(row)
    number = np.argsort(at)
    known = np.append(share[at[number]], share[at[number[0]]] + 1.0)
    quarter = np.interp(share + (share < known[0]), known, np.arange(5)) + number[0]
    return _superellipse(quarter) * 0.5 * box


def _corner_numbers(flat: Floats, corners: Floats) -> Ints:
    """(4,) points of the rim nearest to the corners of its box, in the order of the rim; else its quarters."""
    at = np.array([int(np.argmax(flat @ corner)) for corner in corners])
    turns = np.diff(np.append(at, at[0])) % len(flat)
    if (turns > 0).all() and turns.sum() == len(flat):
        return at
    share = shares(flat)
    first = share[at[0]]
    return np.array([int(np.argmin(np.abs((share - first - k / 4.0 + 0.5) % 1.0 - 0.5))) for k in range(4)])


def _superellipse(quarter: Floats) -> Floats:
    """(n, 2) points |x|^m + |y|^m = 1; quarter 0 at the corner (-, -), 1 at (+, -) and so on, even along the sides."""
    along = 2.0 * (quarter % 1.0) - 1.0
    side = np.stack([along, -np.ones(len(along))], axis=1)
    turn = np.floor(quarter).astype(np.int64) % 4
    cos, sin = np.array([1, 0, -1, 0])[turn], np.array([0, 1, 0, -1])[turn]
    square = np.stack([cos * side[:, 0] - sin * side[:, 1], sin * side[:, 0] + cos * side[:, 1]], axis=1)
    size = (np.abs(square) ** ROUNDNESS).sum(axis=1) ** (1.0 / ROUNDNESS)
    return square / size[:, None]


def least_box(flat: Floats) -> tuple[Floats, Floats]:
    """(2,) sides of the smallest rectangle around points (n, 2), and (2, 2) the turn that lays it along the axes."""
    hull = flat[ConvexHull(flat).vertices]
    edges = np.roll(hull, -1, axis=0) - hull
    angles = np.arctan2(edges[:, 1], edges[:, 0])
    turns = np.stack([np.cos(angles), -np.sin(angles), np.sin(angles), np.cos(angles)], axis=1).reshape(-1, 2, 2)
    boxes = np.ptp(np.einsum("ni,kij->knj", hull, turns), axis=1)
    least = int(np.argmin(boxes.prod(axis=1)))
    return boxes[least], turns[least]


def shares(row: Floats) -> Floats:
    """(n,) share of its length around a closed row before each of its points."""
    steps = np.linalg.norm(np.roll(row, -1, axis=0) - row, axis=1)
    return (np.cumsum(steps) - steps) / steps.sum()


def cross(a: Floats, b: Floats) -> Floats:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]

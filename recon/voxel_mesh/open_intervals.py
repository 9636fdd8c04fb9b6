"""What the grid leaves open of a surface's offset or radius, and the round value in it.

    o o o|. . .       every grid edge of the surface's vertices runs from a solid centre to an empty one; the surface may
    o o o|. . .       lie anywhere between the farthest solid centre and the nearest empty one
      farthest|nearest

A round value is a prior that the grid does not hold, so it is taken only when asked for.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from recon.geometry.analytic import AnalyticSurface, Blend, Cylinder, Plane

__all__ = ["open_interval", "snapped_blend", "snapped_surface"]

Floats = NDArray[np.float64]

UPRIGHT = np.cos(np.radians(0.3))
NEAR = 0.3  # voxels that an axis may move to a round place
OPEN = 0.5  # voxels that the radius of a blend is open to either side


def open_interval(surface: AnalyticSurface, solid_ends: Floats, empty_ends: Floats) -> tuple[float, float]:
    """How far the surface may move along its normal, from and to, without a centre changing sides.

    solid_ends, empty_ends  (n, 3) centres at the two ends of the grid edges of its vertices
    Returns  (low, high) around or near 0; where the fit itself leaves no room, the span that it misses
    """
    solid, empty = surface.distance(solid_ends), surface.distance(empty_ends)
    lower, upper = np.minimum(solid, empty), np.maximum(solid, empty)
    low, high = float(lower.max()), float(upper.min())
    return min(low, high), max(low, high)


def snapped_surface(
    surface: AnalyticSurface, interval: tuple[float, float], *, step: float, voxel: float
) -> AnalyticSurface:
    """Plane or cylinder at the roundest multiples of `step` that its interval holds; others as they are."""
    if isinstance(surface, Plane):
        normal = _upright(surface.normal_vector)
        if normal is None:
            return surface
        value = _roundest(surface.offset + interval[0], surface.offset + interval[1], step)
        return Plane(normal, surface.offset if value is None else value)
    if isinstance(surface, Cylinder):
        axis = _upright(surface.axis)
        if axis is None:
            return surface
        near = np.round(surface.point / step) * step
        point = np.where(np.abs(near - surface.point) <= NEAR * voxel, near, surface.point)
        point = np.where(np.abs(axis) > 0.5, surface.point, point)
        value = _roundest(surface.radius + interval[0], surface.radius + interval[1], step)
        return Cylinder(point, axis, surface.radius if value is None else value)
    return surface


def snapped_blend(blend: Blend, *, step: float, voxel: float) -> Blend:
    """Blend with the roundest radius within half a voxel."""
    value = _roundest(blend.radius - OPEN * voxel, blend.radius + OPEN * voxel, step)
    return blend if value is None or value <= 0 else replace(blend, radius=value)


def _upright(direction: Floats) -> Floats | None:
    """The coordinate axis that a direction runs along, or None."""
    k = int(np.abs(direction).argmax())
    if abs(direction[k]) < UPRIGHT:
        return None
    axis = np.zeros(3)
    axis[k] = np.sign(direction[k])
    return axis


def _roundest(low: float, high: float, step: float) -> float | None:
    """Of the multiples of a step from low to high the one with the most round multiplier, of those the most central."""
    first, last = int(np.ceil(low / step)), int(np.floor(high / step))
    choices: Sequence[int] = range(first, min(last, first + 100_000) + 1)
    if not choices:
        return None
    middle = 0.5 * (low + high) / step
    return max(choices, key=lambda n: (_roundness(n), -abs(n - middle))) * step


def _roundness(n: int) -> int:
    """How often 10, 5 or 2 divide a number: 0 is the roundest of all."""
    if n == 0:
        return 100
    tens = 0
    while n % 10 == 0:
        n, tens = n // 10, tens + 1
    return 3 * tens + (2 if n % 5 == 0 else 1 if n % 2 == 0 else 0)

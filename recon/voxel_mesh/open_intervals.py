"""What the grid leaves open of a surface's offset or radius, and the round value in it.

    o o o|. . .       every grid edge of the surface's vertices runs from a solid centre to an empty one; the
    o o o|. . .       surface may lie anywhere between the farthest solid centre and the nearest empty one
      farthest|nearest

A round value is a prior that the grid does not hold, so it is taken only when asked for.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from recon.geometry.analytic import AnalyticSurface, Blend, Cylinder, Plane
from recon.voxel_mesh.rolling_ball import rolled

__all__ = ["NEAR", "open_interval", "open_radius", "roundest", "snapped_surface"]

Floats = NDArray[np.float64]

UPRIGHT = np.cos(np.radians(0.3))
NEAR = 0.3  # voxels that an axis may move to a round place
ASKED = 400  # grid edges of a rounding that are asked


def open_interval(surface: AnalyticSurface, solid_ends: Floats, empty_ends: Floats) -> tuple[float, float]:
    """How far the surface may move along its normal, from and to, without a centre changing sides.

    solid_ends, empty_ends  (n, 3) centres at the two ends of the grid edges of its vertices
    Returns  (low, high), low <= high, around or near 0; where the fit itself leaves no room, the span that it misses
    """
    solid, empty = surface.distance(solid_ends), surface.distance(empty_ends)
    lower, upper = np.minimum(solid, empty), np.maximum(solid, empty)
    low, high = float(lower.max()), float(upper.min())
    return min(low, high), max(low, high)


def snapped_surface(
    surface: AnalyticSurface, interval: tuple[float, float], *, step: float, voxel: float, places: bool = True
) -> AnalyticSurface:
    """Plane or cylinder at the roundest multiples of `step` that its interval holds; others as they are.

    places  whether axes move to round places, too: those on a bolt circle have none
    """
    if isinstance(surface, Plane):
        normal = _upright(surface.normal_vector)
        if normal is None:
            return surface
        value = roundest(surface.offset + interval[0], surface.offset + interval[1], step)
        return Plane(normal, surface.offset if value is None else value)
    if isinstance(surface, Cylinder):
        axis = _upright(surface.axis)
        if axis is None:
            return surface
        near = np.round(surface.point / step) * step
        point = np.where(places & (np.abs(near - surface.point) <= NEAR * voxel), near, surface.point)
        point = np.where(np.abs(axis) > 0.5, surface.point, point)
        # the interval holds for an axis that has moved since
        value = roundest(surface.radius + interval[0] - NEAR * voxel, surface.radius + interval[1] + NEAR * voxel, step)
        return Cylinder(point, axis, surface.radius if value is None else value)
    return surface


def open_radius(
    blend: Blend, surfaces: Sequence[AnalyticSurface], solid_ends: Floats, empty_ends: Floats
) -> tuple[float, float]:
    """Radii of a blend, from and to, with which the fewest ends of its vertices' grid edges lie on a wrong side."""
    first, second = surfaces[blend.first], surfaces[blend.second]
    step = max(1, len(solid_ends) // ASKED)
    solid_ends, empty_ends = solid_ends[::step], empty_ends[::step]

    def misses(radius: float, outside: float) -> float:
        inner, outer = (
            outside * rolled(x, first, second, sides=blend.sides, radius=radius).distance
            for x in (solid_ends, empty_ends)
        )
        return float(np.maximum(inner, 0.0).sum() - np.minimum(outer, 0.0).sum())

    outside = min((-1.0, 1.0), key=lambda s: misses(blend.radius, s))
    low, high = 0.6 * blend.radius, 1.7 * blend.radius
    for _ in range(3):
        radii = np.linspace(low, high, 81)
        missed = np.array([misses(float(r), outside) for r in radii])
        best = np.flatnonzero(missed <= missed.min() + 1e-9)
        step_there = radii[1] - radii[0]
        low, high = float(radii[best[0]]) - step_there, float(radii[best[-1]]) + step_there
        if len(best) > 40:
            break
    return low + step_there, high - step_there


def _upright(direction: Floats) -> Floats | None:
    """The coordinate axis that a direction runs along, or None."""
    k = int(np.abs(direction).argmax())
    if abs(direction[k]) < UPRIGHT:
        return None
    axis = np.zeros(3)
    axis[k] = np.sign(direction[k])
    return axis


def roundest(low: float, high: float, step: float) -> float | None:
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

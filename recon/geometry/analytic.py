"""Surfaces with a formula, as neutral types: plane, cylinder, cone, sphere.

distance(points)  signed distance, positive on the side the normal looks to: outward for round ones
normal(points)    (n, 3) unit normals there

Fits make thousands of them, sound or not: they are checked when a boundary is made of them.
"""

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from recon.errors import BadGeometry
from recon.geometry.arrays import frozen_floats

__all__ = ["AnalyticSurface", "Blend", "Cone", "Cylinder", "Plane", "Sphere", "require_sound_surface"]

Floats = NDArray[np.float64]


class AnalyticSurface(Protocol):
    """What every surface here can say of points."""

    def distance(self, points: Floats) -> Floats: ...

    def normal(self, points: Floats) -> Floats: ...

    def placed(self, turn: Floats, scale: float, shift: Floats) -> "AnalyticSurface": ...


@dataclass(frozen=True, eq=False)
class Plane:
    """normal_vector · x = offset."""

    normal_vector: Floats
    offset: float

    def distance(self, points: Floats) -> Floats:
        return np.asarray(points @ self.normal_vector - self.offset)

    def normal(self, points: Floats) -> Floats:
        return np.broadcast_to(self.normal_vector, points.shape)

    def placed(self, turn: Floats, scale: float, shift: Floats) -> "Plane":
        """The plane under x -> shift + scale turn x."""
        normal = turn @ self.normal_vector
        return Plane(normal, scale * self.offset + float(normal @ shift))


@dataclass(frozen=True, eq=False)
class Cylinder:
    """Points at `radius` from the line through `point` along `axis`."""

    point: Floats
    axis: Floats
    radius: float

    def distance(self, points: Floats) -> Floats:
        return np.asarray(np.linalg.norm(self._away(points), axis=1) - self.radius)

    def normal(self, points: Floats) -> Floats:
        away = self._away(points)
        return np.asarray(away / np.maximum(np.linalg.norm(away, axis=1), 1e-300)[:, None])

    def _away(self, points: Floats) -> Floats:
        arm = points - self.point
        return np.asarray(arm - (arm @ self.axis)[:, None] * self.axis)

    def placed(self, turn: Floats, scale: float, shift: Floats) -> "Cylinder":
        return Cylinder(shift + scale * turn @ self.point, turn @ self.axis, scale * self.radius)


@dataclass(frozen=True, eq=False)
class Cone:
    """Opens from `apex` along `axis` with `half_angle` between axis and surface; the outside is away from the axis."""

    apex: Floats
    axis: Floats
    half_angle: float

    def distance(self, points: Floats) -> Floats:
        along, across = self._along_across(points)
        return np.asarray(across * np.cos(self.half_angle) - along * np.sin(self.half_angle))

    def normal(self, points: Floats) -> Floats:
        arm = points - self.apex
        out = arm - (arm @ self.axis)[:, None] * self.axis
        out = out / np.maximum(np.linalg.norm(out, axis=1), 1e-300)[:, None]
        return np.asarray(np.cos(self.half_angle) * out - np.sin(self.half_angle) * self.axis)

    def _along_across(self, points: Floats) -> tuple[Floats, Floats]:
        arm = points - self.apex
        along = arm @ self.axis
        return along, np.linalg.norm(arm - along[:, None] * self.axis, axis=1)

    def placed(self, turn: Floats, scale: float, shift: Floats) -> "Cone":
        return replace(self, apex=shift + scale * turn @ self.apex, axis=turn @ self.axis)


@dataclass(frozen=True, eq=False)
class Sphere:
    """Points at `radius` from `centre`."""

    centre: Floats
    radius: float

    def distance(self, points: Floats) -> Floats:
        return np.asarray(np.linalg.norm(points - self.centre, axis=1) - self.radius)

    def normal(self, points: Floats) -> Floats:
        away = points - self.centre
        return np.asarray(away / np.maximum(np.linalg.norm(away, axis=1), 1e-300)[:, None])

    def placed(self, turn: Floats, scale: float, shift: Floats) -> "Sphere":
        return Sphere(shift + scale * turn @ self.centre, scale * self.radius)


@dataclass(frozen=True, eq=False)
class Blend:
    """A rounded edge: a ball of `radius` rolls along `first` and `second` (numbers in a list of surfaces).

    middle  (3,) a point of the rounding, about halfway along it
    sides   of the two surfaces on which the ball's centre lies: 1 where their distance is positive, else -1
    """

    first: int
    second: int
    radius: float
    middle: Floats
    sides: tuple[float, float]

    def placed(self, turn: Floats, scale: float, shift: Floats) -> "Blend":
        return replace(self, radius=scale * self.radius, middle=shift + scale * turn @ self.middle)


DIRECTIONS = ("normal_vector", "axis")  # of unit length
LENGTHS = ("offset", "radius", "half_angle")


def require_sound_surface(surface: AnalyticSurface, what: str) -> None:
    """Raise BadGeometry unless points and directions are (3,), directions of unit length, and sizes positive."""
    for name, value in vars(surface).items():
        number = frozen_floats(value, () if name in LENGTHS else (3,), f"{what}: {name}")
        if name in DIRECTIONS and abs(np.linalg.norm(number) - 1.0) > 1e-6:
            raise BadGeometry(what, f"its {name} is not of unit length")
        if name in ("radius", "half_angle") and not number > 0:
            raise BadGeometry(what, f"its {name} is not positive")
    if isinstance(surface, Cone) and not surface.half_angle < np.pi / 2:
        raise BadGeometry(what, "its half_angle is not below a right angle")

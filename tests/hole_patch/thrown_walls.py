"""Walls turned from a known profile, with a hole cut out: inputs whose missing part is known exactly."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from recon.geometry.mesh import TriangleMesh
from recon.hole_patch.surroundings import Axis, HoleEdge, Wall

Floats = NDArray[np.float64]
Surface = Callable[[Floats, Floats], Floats]

AXIS = Axis(np.array([3.0, -2.0, 5.0]), np.array([0.1, 0.2, 1.0]), 0.0)


def turned(radius: Callable[[Floats], Floats], height: Callable[[Floats], Floats], axis: Axis = AXIS) -> Surface:
    """Point of (θ, t) on the surface with the profile (radius(t), height(t)); t runs from base to mouth."""
    return lambda angle, t: axis.cartesian(np.stack([angle, radius(t), height(t)], axis=-1))


def cylinder(radius: float, axis: Axis = AXIS) -> Surface:
    return turned(lambda t: np.full_like(t, radius), lambda t: t, axis)


def cone(radius: float, slope: float) -> Surface:
    return turned(lambda t: radius + slope * t, lambda t: t)


def sphere(radius: float) -> Surface:
    return turned(lambda t: radius * np.cos(t / radius), lambda t: radius * np.sin(t / radius))


def wall_with_hole(
    surface: Surface,
    *,
    size: tuple[float, float] = (0.5, 14.0),
    t_range: tuple[float, float] = (-35.0, 35.0),
    step: float = 1.2,
) -> Wall:
    """A wall all around, its mesh regular in (θ, t), with an oval hole of half widths `size` about (2.5, 0)."""
    around, up = 180, round((t_range[1] - t_range[0]) / step)
    angle, t = np.meshgrid(np.arange(around) * 2 * np.pi / around, np.linspace(*t_range, up), indexing="ij")
    angle, t = angle.ravel(), t.ravel()
    at = np.arange(around * up).reshape(around, up)
    a, b = at[:, :-1].ravel(), np.roll(at, -1, axis=0)[:, :-1].ravel()
    faces = np.concatenate([np.stack([a, b, b + 1], axis=1), np.stack([a, b + 1, a + 1], axis=1)])
    inside = ((angle - 2.5) / size[0]) ** 2 + (t / size[1]) ** 2 < 1.0
    mesh = TriangleMesh(surface(angle, t), faces[~inside[faces].any(axis=1)]).part(np.s_[:])
    turn = np.linspace(0, 2 * np.pi, 240, endpoint=False)
    edge = surface(2.5 + size[0] * np.cos(turn), size[1] * np.sin(turn))
    n = mesh.n_vertices
    return Wall(mesh, mesh, np.zeros(n, np.int64), np.ones(n), HoleEdge(edge, np.zeros(240, np.int64)))


def dish(depth_radius: float) -> Surface:
    """A spherical dish about the axis, t its distance from the axis."""
    return turned(lambda t: t, lambda t: depth_radius - np.sqrt(depth_radius**2 - t**2))


def dish_with_hole(surface: Surface, *, aside: float, radius: float) -> Wall:
    """A dish with a hole that is round in plan, its middle `aside` from the axis."""
    angle, t = np.meshgrid(np.arange(120) * 2 * np.pi / 120, np.linspace(0.4, 45.0, 40), indexing="ij")
    angle, t = angle.ravel(), t.ravel()
    at = np.arange(120 * 40).reshape(120, 40)
    a, b = at[:, :-1].ravel(), np.roll(at, -1, axis=0)[:, :-1].ravel()
    faces = np.concatenate([np.stack([a, b, b + 1], axis=1), np.stack([a, b + 1, a + 1], axis=1)])
    inside = np.hypot(t * np.cos(angle) - aside, t * np.sin(angle)) < radius
    mesh = TriangleMesh(surface(angle, t), faces[~inside[faces].any(axis=1)]).part(np.s_[:])
    x, y = plan_circle(aside, radius)
    edge = HoleEdge(surface(np.arctan2(y, x), np.hypot(x, y)), np.zeros(len(x), np.int64))
    return Wall(mesh, mesh, np.zeros(mesh.n_vertices, np.int64), np.ones(mesh.n_vertices), edge)


def plan_circle(aside: float, radius: float) -> tuple[Floats, Floats]:
    turn = np.linspace(0, 2 * np.pi, 240, endpoint=False)
    return aside + radius * np.sin(turn), radius * np.cos(turn)


def hole_points(surface: Surface, size: tuple[float, float] = (0.5, 14.0)) -> Floats:
    """Points of the surface within the hole."""
    share, turn = np.meshgrid(np.linspace(0, 0.97, 9), np.linspace(0, 2 * np.pi, 24, endpoint=False))
    return surface((2.5 + size[0] * share * np.cos(turn)).ravel(), (size[1] * share * np.sin(turn)).ravel())

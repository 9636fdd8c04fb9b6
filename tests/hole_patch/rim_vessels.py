"""Walls over a lip, turned from a known curve, with a part of the rim cut out."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from recon.geometry.mesh import TriangleMesh
from recon.hole_patch.surroundings import Axis, HoleEdge, Wall

Floats = NDArray[np.float64]

AXIS = Axis(np.array([3.0, -2.0, 5.0]), np.array([0.1, 0.2, 1.0]), 0.0)


def plain_lip(thickness: float = 3.0, height: float = 40.0, radius: float = 30.0) -> Floats:
    """(n, 2) dense profile: up the outside of a cylinder, half a circle, down the inside."""
    turn = np.linspace(0.0, np.pi, 400)
    half = 0.5 * thickness
    up = np.stack([np.full(900, radius), np.linspace(-height, 0, 900)], axis=1)
    lip = np.stack([radius - half + half * np.cos(turn), half * np.sin(turn)], axis=1)
    down = up[::-1] - [thickness, 0.0]
    return np.concatenate([up, lip[1:-1], down])


def rolled_lip(thickness: float = 2.5, height: float = 40.0, radius: float = 30.0) -> Floats:
    """(n, 2) the same with the lip rolled outward, through a half turn, to a round tip."""
    middle, half = 3.0, 0.5 * thickness
    turn = np.linspace(np.pi, 0.0, 400)
    bend = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    centre = np.array([radius + middle - half, 0.0])
    under, over = centre + (middle - half) * bend, centre + (middle + half) * bend
    tip = centre + [middle, 0.0] + half * np.stack([-np.cos(turn[::-1]), -np.sin(turn[::-1])], axis=1)
    up = np.stack([np.full(900, radius), np.linspace(-height, 0, 900)], axis=1)
    down = up[::-1] - [thickness, 0.0]
    return np.concatenate([up, under[1:], tip[1:-1], over[::-1], down[1:]])


def beaded_lip(thickness: float = 3.0, height: float = 40.0, radius: float = 30.0, bead: float = 1.2) -> Floats:
    """(n, 2) the same with a round bead on the lip, its radius `bead` thicknesses."""
    half, round_ = 0.5 * thickness, bead * thickness
    opening = np.arcsin(half / round_)  # half the angle that the wall takes of the bead
    turn = np.linspace(opening - 0.5 * np.pi, 1.5 * np.pi - opening, 900)
    centre = np.array([radius - half, round_ * np.cos(opening)])
    around = centre + round_ * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    up = np.stack([np.full(900, radius), np.linspace(-height, 0, 900)], axis=1)
    return np.concatenate([up, around[1:-1], up[::-1] - [thickness, 0.0]])


def rim_wall(
    profile: Floats,
    *,
    half_angle: float = 0.5,
    depth: float = 20.0,
    edge: float = 1.0,
    shift: Callable[[Floats], Floats] | None = None,
    axis: Axis = AXIS,
) -> Wall:
    """The wall all around with a gap in the rim: `half_angle` to both sides of 2.5 at the lip, `depth` down the walls.

    shift   (m,) change of radius at the angles (m,): what the wheel left out of round
    """
    run = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(profile, axis=0), axis=1))])
    s = np.linspace(0.0, run[-1], round(run[-1] / edge))
    lip = run[np.argmin(np.abs(np.arange(len(run)) - len(run) // 2))]
    around = round(2 * np.pi * 30.0 / edge)
    angle, s = np.meshgrid(np.arange(around) * 2 * np.pi / around, s, indexing="ij")
    up = angle.shape[1]
    angle = angle + 0.5 * (np.arange(up) % 2) * 2 * np.pi / around

    def place(angle: Floats, s: Floats) -> Floats:
        radius, height = (np.interp(s, run, column) for column in profile.T)
        return axis.cartesian(np.stack([angle, radius + (0.0 if shift is None else shift(angle)), height], axis=1))

    def in_gap(angle: Floats, s: Floats) -> NDArray[np.bool_]:
        down = _below(np.interp(s, run, profile[:, 1]), profile)
        return np.asarray(np.abs(angle - 2.5) < half_angle * (1.0 - 0.5 * (down / depth) ** 2)) & (down < depth)

    angle, s = angle.ravel(), s.ravel()
    at = np.arange(around * up).reshape(around, up)
    a, b = at[:, :-1].ravel(), np.roll(at, -1, axis=0)[:, :-1].ravel()
    faces = np.concatenate([np.stack([a, b, b + 1], axis=1), np.stack([a, b + 1, a + 1], axis=1)])
    mesh = TriangleMesh(place(angle, s), faces[~in_gap(angle, s)[faces].any(axis=1)]).part(np.s_[:])
    ring = _gap_edge(run, profile, lip, half_angle, depth)
    points = place(*ring.T)
    radius, height = (np.gradient(column, run) for column in profile.T)
    out = np.stack([np.interp(ring[:, 1], run, height), -np.interp(ring[:, 1], run, radius)], axis=1)
    tip = axis.cartesian(np.column_stack([ring[:, 0], out])) - axis.point
    n = mesh.n_vertices
    sherds = np.zeros(len(points), np.int64)
    edge_line = HoleEdge(points, sherds, tip / np.linalg.norm(tip, axis=1, keepdims=True))
    return Wall(mesh, mesh, np.zeros(n, np.int64), np.ones(n), edge_line, over_lip=True)


def _below(height: Floats, profile: Floats) -> Floats:
    return np.asarray(profile[:, 1].max() - height)


def _gap_edge(run: Floats, profile: Floats, lip: float, half_angle: float, depth: float) -> Floats:
    """(n, 2) angle and length along the profile, counter-clockwise: up on the right, down on the left."""
    down = _below(profile[:, 1], profile)
    inside = np.flatnonzero(down < depth)
    s = np.linspace(run[inside[0]], run[inside[-1]], 500)
    width = half_angle * (1.0 - 0.5 * (np.interp(s, run, down) / depth) ** 2)
    right, left = np.stack([2.5 + width, s], axis=1), np.stack([2.5 - width, s], axis=1)[::-1]

    def level(start: Floats, end: Floats) -> Floats:
        return start + np.linspace(0, 1, 80)[1:-1, None] * (end - start)

    return np.concatenate([right, level(right[-1], left[0]), left, level(left[-1], right[0])])

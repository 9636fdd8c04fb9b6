"""The wheel's axis from normals alone, and how often a face recurs around it."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from recon.hole_patch.axis import coverage, wheel_axis
from recon.hole_patch.surroundings import Axis

TURN = np.linalg.qr(np.random.default_rng(8).standard_normal((3, 3)))[0]
TURN *= np.sign(np.linalg.det(TURN))
SHIFT = np.array([120.0, -40.0, 900.0])


def beaker(around: float = 2 * np.pi) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points, outward normals and weights of a cone on a flat base, its axis z, base on z = 0."""
    angle, height = (x.ravel() for x in np.meshgrid(np.linspace(0, around, 90, endpoint=False), np.linspace(0, 60, 40)))
    radius, lean = 25.0 + height / 6, np.hypot(1.0, 1 / 6)
    out = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
    wall = radius[:, None] * out + height[:, None] * [0, 0, 1]
    normals = (out - np.array([0, 0, 1 / 6])) / lean
    rings = np.linspace(1, 24, 10).repeat(90)
    base = rings[:, None] * np.tile(out[:90], (10, 1))
    points = np.concatenate([wall, base])
    return points, np.concatenate([normals, np.tile([0.0, 0.0, -1.0], (900, 1))]), np.ones(len(points))


def distance_from_z(axis: Axis) -> float:
    """Distance between the found axis and the line x = y = 0, largest over the beaker's height."""
    at = [axis.point + axis.direction * (z - axis.point[2]) / axis.direction[2] for z in (0.0, 60.0)]
    return max(float(np.hypot(*p[:2])) for p in at)


def test_axis_of_an_exact_surface_of_revolution_is_exact():
    axis = wheel_axis(*beaker())
    assert axis is not None
    assert distance_from_z(axis) < 1e-6
    assert_allclose(axis.direction, [0, 0, 1], atol=1e-8)  # from base to mouth
    assert axis.quality < 1e-6


def test_axis_moves_with_the_vessel():
    points, normals, weights = beaker()
    axis = wheel_axis(points @ TURN.T + SHIFT, normals @ TURN.T, weights)
    assert axis is not None
    assert_allclose(axis.direction, TURN @ [0, 0, 1], atol=1e-7)
    assert_allclose(np.cross(axis.point - SHIFT, axis.direction), 0.0, atol=1e-4)


def test_a_third_of_wrong_faces_does_not_move_the_axis():
    points, normals, weights = beaker()
    chance = np.random.default_rng(1)
    wrong = chance.random(len(points)) < 0.3
    normals[wrong] = chance.standard_normal((wrong.sum(), 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    axis = wheel_axis(points, normals, weights)
    assert axis is not None
    assert distance_from_z(axis) < 0.1


def test_a_quarter_of_the_way_round_is_enough():
    axis = wheel_axis(*beaker(np.pi / 2))
    assert axis is not None
    assert distance_from_z(axis) < 1e-4


def test_an_ellipsoid_of_three_lengths_is_not_round():
    sphere = np.random.default_rng(2).standard_normal((6000, 3))
    sphere /= np.linalg.norm(sphere, axis=1, keepdims=True)
    lengths = np.array([30.0, 45.0, 70.0])
    normals = sphere / lengths
    assert wheel_axis(sphere * lengths, normals / np.linalg.norm(normals, axis=1, keepdims=True), np.ones(6000)) is None


@pytest.mark.parametrize("count", [0, 3])
def test_too_few_faces_have_no_axis(count):
    assert wheel_axis(np.ones((count, 3)), np.ones((count, 3)), np.ones(count)) is None


@pytest.mark.parametrize("sectors", [6, 12, 24])
def test_a_wall_covers_the_sectors_it_fills(sectors):
    points, normals, _ = beaker(2 * np.pi * sectors / 24)
    axis = Axis(np.zeros(3), np.array([0.0, 0.0, 1.0]), 0.0)
    found = coverage(axis, points, normals, step=1.0, among=np.ones(len(points), dtype=bool))
    assert set(found[:3600]) <= {sectors, sectors + 1}  # the frame's zero angle may cut a sector in two


def test_a_face_found_once_covers_one_sector():
    points, normals, _ = beaker()
    points[5], normals[5] = [10.0, 10.0, 30.0], [0.0, 0.0, 1.0]
    axis = Axis(np.zeros(3), np.array([0.0, 0.0, 1.0]), 0.0)
    assert coverage(axis, points, normals, step=1.0, among=np.ones(len(points), dtype=bool))[5] == 1

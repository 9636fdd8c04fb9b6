import numpy as np
import pytest
from numpy.testing import assert_allclose

from recon.geometry.bspline import BSplineSurface
from recon.numerics.bspline_basis import greville, uniform_knots
from recon.numerics.foot_points import foot_points


def waves(n=9, scale=1.0):
    knots = uniform_knots(n, 3)
    x, y = np.meshgrid(greville(knots, 3) * 40, greville(knots, 3) * 50, indexing="ij")
    net = scale * np.stack([x, y, 6 * np.sin(x / 12) * np.cos(y / 15)], axis=-1)
    return BSplineSurface(3, 3, knots, knots, net)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_foot_point_of_a_point_on_the_normal_is_where_the_normal_starts(scale):
    surface, rng = waves(scale=scale), np.random.default_rng(0)
    uv = rng.uniform(0.03, 0.97, size=(300, 2))
    points = surface.point(uv) + scale * rng.uniform(-1, 1, size=(300, 1)) * surface.normal(uv)
    assert_allclose(foot_points(surface, points), uv, atol=1e-10)


def test_no_point_of_a_fine_grid_is_nearer():
    surface = waves()
    points = np.random.default_rng(1).uniform([-5, -5, -8], [45, 55, 8], size=(200, 3))
    at = np.linspace(0, 1, 101)
    grid = surface.grid(at, at).reshape(-1, 3)
    found = np.linalg.norm(surface.point(foot_points(surface, points)) - points, axis=1)
    nearest = np.sqrt(((points[:, None] - grid) ** 2).sum(axis=2).min(axis=1))
    assert (found <= nearest + 1e-9).all()


def test_points_beyond_the_border_are_clamped_to_it():
    knots = np.array([0.0, 0.0, 1.0, 1.0])
    net = np.array([[[0, 0, 0], [0, 2, 0]], [[2, 0, 0], [2, 2, 0]]], dtype=float)
    surface = BSplineSurface(1, 1, knots, knots, net)
    points = np.array([[-1.0, 1.0, 3.0], [5.0, 5.0, 0.0], [0.5, 9.0, -1.0]])
    assert_allclose(foot_points(surface, points), [[0, 0.5], [1, 1], [0.25, 1]], atol=1e-12)


def test_a_given_start_is_never_made_worse():
    surface, rng = waves(), np.random.default_rng(2)
    start = rng.uniform(size=(100, 2))
    points = rng.uniform([0, 0, -5], [40, 50, 5], size=(100, 3))
    before = np.linalg.norm(surface.point(start) - points, axis=1)
    after = np.linalg.norm(surface.point(foot_points(surface, points, start)) - points, axis=1)
    assert (after <= before + 1e-9).all()


def test_no_points_have_no_foot_points():
    assert foot_points(waves(), np.zeros((0, 3))).shape == (0, 2)

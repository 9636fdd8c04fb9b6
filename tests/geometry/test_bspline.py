"""Curves and surfaces: exact on conics and polynomials, derivatives against closed forms, refused when ill-formed."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from recon.errors import BadGeometry
from recon.geometry.bspline import BSplineCurve, BSplineSurface
from recon.numerics.bspline_basis import greville, uniform_knots

QUARTER = BSplineCurve(2, [0, 0, 0, 1, 1, 1], [[1, 0], [1, 1], [0, 1]], [1, np.sqrt(0.5), 1])


def saddle():
    """z = x y over the unit square: bilinear, so the Greville net reproduces it."""
    ku, kv = uniform_knots(6, 3), uniform_knots(5, 2)
    x, y = np.meshgrid(greville(ku, 3), greville(kv, 2), indexing="ij")
    return BSplineSurface(3, 2, ku, kv, np.stack([x, y, x * y], axis=-1))


def test_a_rational_quadratic_is_a_circle():
    t = np.linspace(0, 1, 21)
    points, velocity, bend = QUARTER.point(t), QUARTER.derivative(t, 1), QUARTER.derivative(t, 2)
    assert_allclose(np.linalg.norm(points, axis=1), 1.0, atol=1e-14)
    turned = velocity[:, 0] * bend[:, 1] - velocity[:, 1] * bend[:, 0]
    assert_allclose(turned / np.linalg.norm(velocity, axis=1) ** 3, 1.0, atol=1e-12)  # curvature of the unit circle


def test_a_surface_reproduces_a_saddle_with_its_derivatives():
    uv = np.random.default_rng(3).random((50, 2))
    surface = saddle()
    assert_allclose(surface.point(uv)[:, 2], uv[:, 0] * uv[:, 1], atol=1e-14)
    assert_allclose(surface.derivative(uv, 1, 0)[:, 2], uv[:, 1], atol=1e-13)
    assert_allclose(surface.derivative(uv, 1, 1)[:, 2], 1.0, atol=1e-12)
    expected = np.stack([-uv[:, 1], -uv[:, 0], np.ones(50)], axis=1)
    assert_allclose(surface.normal(uv), expected / np.linalg.norm(expected, axis=1, keepdims=True), atol=1e-13)


def test_a_grid_holds_the_same_points_as_single_calls():
    surface, u, v = saddle(), np.linspace(0, 1, 4), np.linspace(0, 1, 7)
    pairs = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
    assert_allclose(surface.grid(u, v).reshape(-1, 3), surface.point(pairs), atol=1e-15)


def test_weights_of_one_change_nothing():
    plain = saddle()
    rational = BSplineSurface(3, 2, plain.knots_u, plain.knots_v, plain.control_net, np.ones((6, 5)))
    uv = np.random.default_rng(4).random((20, 2))
    assert_allclose(rational.point(uv), plain.point(uv), atol=1e-15)
    assert_allclose(rational.derivative(uv, 0, 1), plain.derivative(uv, 0, 1), atol=1e-13)


@pytest.mark.parametrize(
    ("knots", "fault"),
    [
        ([0, 0, 1, 1], "4 knots where 3 control points"),
        ([0, 0, 0, 1, 0.5, 1], "decrease"),
        ([0, 0, 0.5, 1, 1, 1], "not repeated 3 times"),
        ([0, 0, 0, np.nan, 1, 1], "not a finite number"),
    ],
)
def test_ill_formed_knots_are_refused_in_words(knots, fault):
    with pytest.raises(BadGeometry, match=fault):
        BSplineCurve(2, knots, np.zeros((3, 3)))


def test_weights_must_be_positive():
    with pytest.raises(BadGeometry, match="weight"):
        BSplineCurve(2, [0, 0, 0, 1, 1, 1], np.zeros((3, 3)), [1, 0, 1])


def test_arrays_are_copied_and_locked():
    mine = np.zeros((3, 3))
    curve = BSplineCurve(2, [0, 0, 0, 1, 1, 1], mine)
    mine[0] = 7
    assert_allclose(curve.control_points, 0)
    with pytest.raises(ValueError, match="read-only"):
        curve.control_points[0, 0] = 1


def test_a_reversed_curve_runs_through_the_same_points_backward():
    knots = np.array([1.0, 1, 1, 1, 2.5, 3, 6, 6, 6, 6])
    curve = BSplineCurve(3, knots, np.random.default_rng(4).random((6, 2)), np.linspace(1, 2, 6))
    t = np.linspace(1.0, 6.0, 40)
    assert_allclose(curve.reversed().point(t), curve.point(7.0 - t), atol=1e-14)
    assert curve.reversed().domain == curve.domain

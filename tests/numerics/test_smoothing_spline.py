"""Smoothing splines in the plane, against an independent dense solution and against curves that are known."""

import numpy as np
import pytest
from scipy.interpolate import BSpline

from recon.numerics.smoothing_spline import FREE_ENDS, bezier_segments, fitted_coefficients, fitted_knots

STIFFNESS = 0.12


def circle(m, radius=50.0):
    t = 2 * np.pi * np.arange(m) / m
    return radius * np.column_stack([np.cos(t), np.sin(t)]), radius * t, np.full(m, 2 * np.pi * radius / m)


def wave(m, length=200.0):
    s = np.linspace(0.0, length, m)
    weight = np.full(m, length / (m - 1))
    weight[[0, -1]] /= 2
    return np.column_stack([s, 8 * np.sin(s / 15)]), s, weight


def dense_system(points, s, weight, knots, stiffness):
    """Coefficients of an open spline by numpy's least squares, with the ends put in as heavy rows."""
    t = np.r_[[knots[0]] * 3, knots, [knots[-1]] * 3]
    basis = BSpline.design_matrix(np.minimum(s, knots[-1] - 1e-12), t, 3).toarray()
    bend = BSpline(t, np.eye(len(t) - 4), 3).derivative(2)
    low, width = knots[:-1], np.diff(knots)
    rows = [np.sqrt(weight)[:, None] * basis]
    for place in (0.5 - np.sqrt(1 / 12), 0.5 + np.sqrt(1 / 12)):
        rows.append(np.sqrt((stiffness * width) ** 4 * width / 2)[:, None] * bend(low + place * width))
    ends = np.eye(len(t) - 4)[[0, -1]] * 1e7
    right = np.vstack([np.sqrt(weight)[:, None] * points, np.zeros((2 * len(width), 2)), 1e7 * points[[0, -1]]])
    return np.linalg.lstsq(np.vstack([*rows, ends]), right, rcond=None)[0]


@pytest.mark.parametrize("n", [1, 2, 5, 23])
def test_an_open_spline_is_the_least_squares_solution(n):
    points, s, weight = wave(90)
    knots = np.linspace(0.0, s[-1], n + 1) ** 1.2 / s[-1] ** 0.2
    found = fitted_coefficients(points, weight, s, knots, False, np.full(n, STIFFNESS), FREE_ENDS)
    np.testing.assert_allclose(found, dense_system(points, s, weight, knots, STIFFNESS), atol=1e-5)


@pytest.mark.parametrize("n", [6, 7, 9, 30])
def test_a_ring_is_turned_as_its_points_are_and_closes_with_curvature(n):
    points, s, weight = circle(120)
    knots = np.linspace(0.0, weight.sum(), n + 1)
    stiffness = np.full(n, STIFFNESS)
    coefficients = fitted_coefficients(points, weight, s, knots, True, stiffness, FREE_ENDS)
    step = 2 * np.pi / n
    turn = np.array([[np.cos(step), -np.sin(step)], [np.sin(step), np.cos(step)]])
    if 120 % n == 0:
        np.testing.assert_allclose(coefficients @ turn.T, np.roll(coefficients, -1, axis=0), atol=1e-8)
    b = bezier_segments(knots, coefficients, True)
    np.testing.assert_array_equal(b[-1, 3], b[0, 0])
    np.testing.assert_allclose(b[-1, 3] - b[-1, 2], b[0, 1] - b[0, 0], atol=1e-9)
    np.testing.assert_allclose(b[-1, 3] - 2 * b[-1, 2] + b[-1, 1], b[0, 2] - 2 * b[0, 1] + b[0, 0], atol=1e-9)


@pytest.mark.parametrize("ring", [False, True])
def test_knots_are_added_until_no_point_is_missed_by_more(ring):
    points, s, weight = circle(400) if ring else wave(400)
    allowed = np.full(len(s), 0.05)
    rows = points, weight, s, allowed, np.zeros(len(s), dtype=bool)
    knots, moved = fitted_knots(rows, np.linspace(0.0, weight.sum(), 7), ring, STIFFNESS, 1.5, FREE_ENDS)
    assert (np.diff(moved) > 0).all()
    width = np.diff(knots)
    assert (width[1:] / width[:-1]).max() <= 2.01
    assert (width[:-1] / width[1:]).max() <= 2.01
    coefficients = fitted_coefficients(points, weight, moved, knots, ring, np.full(len(width), STIFFNESS), FREE_ENDS)
    b = bezier_segments(knots, coefficients, ring)
    t = np.linspace(0, 1, 400)[:, None, None]
    dense = (1 - t) ** 3 * b[:, 0] + 3 * t * (1 - t) ** 2 * b[:, 1] + 3 * t * t * (1 - t) * b[:, 2] + t**3 * b[:, 3]
    away = np.linalg.norm(points[:, None] - dense.reshape(1, -1, 2), axis=2).min(axis=1)
    assert away.max() < 0.08
    assert len(width) < 60


@pytest.mark.parametrize("n", [3, 4, 9])
def test_given_ends_are_kept_and_the_rest_fits_as_before(n):
    points, s, weight = wave(90)
    knots = np.linspace(0.0, s[-1], n + 1)
    ends = np.array([[[0.8, 0.6], [-0.003, 0.004]], [[1.0, 0.1], [0.0, -0.02]]])
    found = fitted_coefficients(points, weight, s, knots, False, np.full(n, STIFFNESS), ends)
    spline = BSpline(np.r_[[0.0] * 3, knots, [s[-1]] * 3], found, 3)
    for place, point, (way, bend) in zip((0.0, s[-1]), points[[0, -1]], ends):
        np.testing.assert_allclose(spline(place), point, atol=1e-9)
        np.testing.assert_allclose(spline(place, 1), way, atol=1e-9)
        np.testing.assert_allclose(spline(place, 2), bend, atol=1e-9)
    free = fitted_coefficients(points, weight, s, knots, False, np.full(n, STIFFNESS), FREE_ENDS)
    loose = BSpline(spline.t, free, 3)
    own = np.stack([loose([0.0, s[-1]], nu) for nu in (1, 2)], axis=1)
    again = fitted_coefficients(points, weight, s, knots, False, np.full(n, STIFFNESS), own)
    np.testing.assert_allclose(again, free, atol=1e-8)  # to ask for what it does anyway changes nothing

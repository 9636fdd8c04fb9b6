"""Curves of point rows: spline spaces are exact, feet are nearest, fits keep what they promise."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from recon.errors import BadGeometry, BadOption
from recon.geometric_fit.characteristic_points import characteristic_points
from recon.geometric_fit.convergence import StoppedBy
from recon.geometric_fit.curve_feet import nearest_curve_feet
from recon.geometric_fit.curve_fit import CurveKind, CurveOptions, CurveUpdate, fit_curve
from recon.geometric_fit.curve_moves import curve_move
from recon.geometric_fit.spline_space import SplineSpace


def flower(n=1200, petals=5, depth=0.3):
    a = np.linspace(0.0, 2.0 * np.pi, n, endpoint=False)
    return (1.0 + depth * np.cos(petals * a))[:, None] * np.stack([np.cos(a), np.sin(a)], axis=1)


def helix(n=800):
    a = np.linspace(0.0, 6.0 * np.pi, n)
    return np.stack([np.cos(a), np.sin(a), 0.2 * a], axis=1)


SPACES = [
    SplineSpace(degree, np.array([0.0, 0.7, 1.0, 2.5, 3.0, 4.2, 5.0]), periodic)
    for degree in (1, 2, 3, 4)
    for periodic in (False, True)
]


@pytest.mark.parametrize("space", SPACES, ids=lambda s: f"{s.degree}{'p' if s.periodic else ''}")
def test_weights_sum_to_one_and_derivatives_to_zero(space):
    t = np.linspace(0.0, 5.0, 101)
    assert_allclose(space.rows(t).sum(axis=1), 1.0, atol=1e-13)
    assert_allclose(space.rows(t, 1).sum(axis=1), 0.0, atol=1e-12)


@pytest.mark.parametrize("space", SPACES, ids=lambda s: f"{s.degree}{'p' if s.periodic else ''}")
def test_more_breaks_and_clamping_leave_the_curve_where_it_is(space):
    control = np.random.default_rng(1).normal(size=(space.n_control, 2))
    t = np.linspace(0.0, 4.999, 200)
    points = space.rows(t) @ control
    finer, moved = space.with_breaks(np.array([0.3, 2.0, 4.9]), control)
    assert finer.n_control == space.n_control + 3
    assert_allclose(finer.rows(t) @ moved, points, atol=1e-10)
    assert_allclose(space.curve(control).point(t), points, atol=1e-10)


def test_a_periodic_curve_is_as_smooth_at_its_seam_as_elsewhere():
    space = next(s for s in SPACES if s.degree == 3 and s.periodic)
    control = np.random.default_rng(2).normal(size=(space.n_control, 2))
    curve = space.curve(control)
    for order in (0, 1, 2):
        assert_allclose(curve.derivative([0.0], order), curve.derivative([5.0], order), atol=1e-9)


def test_characteristic_points_of_a_polygon_are_its_corners():
    corners = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [0.0, 3.0]])
    steps = np.linspace(0.0, 1.0, 25, endpoint=False)[:, None]
    row = np.concatenate([a + steps * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0))])
    assert characteristic_points(row, 4, closed=True).tolist() == [0, 25, 50, 75]
    assert characteristic_points(row, 99, closed=True, within=1e-9).tolist() == [0, 25, 50, 75]


@given(st.integers(3, 40), st.integers(0, 1000))
def test_fewer_characteristic_points_are_a_part_of_more(number, seed):
    row = np.cumsum(np.random.default_rng(seed).normal(size=(60, 2)), axis=0)
    fewer, more = characteristic_points(row, number), characteristic_points(row, number + 1)
    assert set(fewer) < set(more) and {0, 59} <= set(fewer) and len(fewer) == number


def test_feet_are_the_nearest_points_of_a_dense_sample():
    space = SplineSpace(3, np.arange(9.0), periodic=True)
    control = flower(8, petals=3)
    points = np.random.default_rng(3).uniform(-1.5, 1.5, size=(300, 2))
    feet = nearest_curve_feet(space, control, points)
    dense = space.rows(np.linspace(0.0, 8.0, 40001)) @ control
    away = np.linalg.norm(space.rows(feet) @ control - points, axis=1)
    for p, d in zip(points, away):
        best = np.linalg.norm(dense - p, axis=1).min()
        assert d <= best + 1e-7


def test_the_patents_move_is_the_mean_of_the_error_vectors_under_the_basis_functions():
    space = SplineSpace(3, np.arange(6.0))
    control = np.stack([np.linspace(0.0, 5.0, 8), np.zeros(8)], axis=1)
    feet = np.linspace(0.0, 5.0, 50)
    points = space.rows(feet) @ control + [0.0, 0.25]  # every error vector is the same, and so is every mean of them
    move = curve_move(space, control, points, feet, CurveUpdate.PATENT, fixed=np.array([0]))
    assert_allclose(move[1:], np.tile([0.0, 0.25], (7, 1)), atol=1e-12)
    assert_allclose(move[0], 0.0)


@pytest.mark.parametrize(("row", "closed"), [(flower(), True), (flower()[:900], False), (helix(), False)])
@pytest.mark.parametrize("scale", [1e-4, 1.0, 1e5])
def test_a_tolerance_is_met_at_every_scale(row, closed, scale):
    fit = fit_curve(scale * row, CurveOptions(closed=closed, tolerance=1e-3 * scale))
    assert fit.stopped_by is StoppedBy.TOLERANCE
    assert fit.distances.max() <= 1e-3 * scale
    assert len(fit.polygon) < len(row) / 8


def test_an_open_curve_begins_and_ends_with_the_row():
    row = helix()
    curve = fit_curve(row, CurveOptions(control_points=30)).curve
    assert_allclose(curve.point(curve.domain), row[[0, -1]], atol=1e-12)


@pytest.mark.parametrize("closed", [False, True])
@pytest.mark.parametrize("degree", [2, 3])
def test_as_many_control_points_as_points_interpolate(closed, degree):
    row = flower(40)
    fit = fit_curve(row, CurveOptions(closed=closed, degree=degree, control_points=40))
    assert fit.distances.max() < 1e-12
    assert len(fit.polygon) == 40


def test_the_tangent_distance_comes_nearer_in_as_many_rounds():
    tangent, patent = (
        fit_curve(flower(), CurveOptions(closed=True, control_points=40, update=update))
        for update in (CurveUpdate.TANGENT, CurveUpdate.PATENT)
    )
    assert tangent.errors.rms < 0.5 * patent.errors.rms
    assert len(tangent.polygon) == len(patent.polygon) == 40


def test_chaikins_curve_is_the_limit_of_cutting_the_corners_of_its_polygon():
    fit = fit_curve(flower(), CurveOptions(kind=CurveKind.CHAIKIN, closed=True, control_points=48))
    polygon = fit.polygon
    for _ in range(9):
        following = np.roll(polygon, -1, axis=0)
        polygon = np.stack([0.75 * polygon + 0.25 * following, 0.25 * polygon + 0.75 * following], axis=1).reshape(
            -1, 2
        )
    space = SplineSpace(2, np.unique(fit.curve.knots), periodic=True)
    feet = nearest_curve_feet(space, fit.polygon, polygon)
    # a polygon is cut to half the step every time, and lies within a quarter of its second difference from the limit
    assert np.linalg.norm(space.rows(feet) @ fit.polygon - polygon, axis=1).max() < 1e-5


def test_a_repeated_point_changes_nothing():
    row = flower(100)
    twice = np.repeat(row, 2, axis=0)
    a, b = (fit_curve(r, CurveOptions(closed=True, control_points=20)).curve for r in (row, twice))
    assert_allclose(a.control_points, b.control_points)


@pytest.mark.parametrize(
    ("points", "says"),
    [([[0.0, 0.0]] * 9, "1 different"), ([[0.0, 0.0], [1.0, 1.0]], "at least 4"), ([[0.0, np.nan]] * 5, "finite")],
)
def test_rows_without_a_curve_are_refused(points, says):
    with pytest.raises(BadGeometry, match=says):
        fit_curve(points)


def test_options_without_a_curve_are_refused():
    with pytest.raises(BadOption, match="at least 4"):
        CurveOptions(control_points=3)
    with pytest.raises(BadOption, match="positive"):
        CurveOptions(tolerance=0.0)

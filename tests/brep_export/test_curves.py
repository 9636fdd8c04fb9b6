import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from OCP.gp import gp_Pnt, gp_Vec

from brep_export.curves import (
    compressed_knots,
    curve_from_kernel,
    full_knots,
    kernel_curve,
    kernel_pcurve,
    smooth_stretches,
)
from recon.errors import BadGeometry
from recon.geometry.bspline import BSplineCurve
from recon.numerics.bspline_basis import uniform_knots


def random_curve(dimension, rational, degree=3, n=8, seed=0):
    rng = np.random.default_rng(seed)
    weights = rng.uniform(0.5, 2, n) if rational else None
    return BSplineCurve(degree, uniform_knots(n, degree, -1.0, 2.5), rng.normal(size=(n, dimension)), weights)


@pytest.mark.parametrize("rational", [False, True])
@pytest.mark.parametrize("dimension", [2, 3])
def test_curves_come_back_from_the_kernel_unchanged(dimension, rational):
    curve = random_curve(dimension, rational)
    back = curve_from_kernel((kernel_pcurve if dimension == 2 else kernel_curve)(curve))
    assert back.degree == curve.degree
    assert_array_equal(back.knots, curve.knots)
    assert_array_equal(back.control_points, curve.control_points)
    assert (back.weights is None) == (curve.weights is None)
    if rational:
        assert_array_equal(back.weights, curve.weights)


@pytest.mark.parametrize("rational", [False, True])
def test_the_kernel_evaluates_the_same_curve(rational):
    curve = random_curve(3, rational, degree=4)
    kernel = kernel_curve(curve)
    for t in np.linspace(*curve.domain, 17):
        point, tangent = gp_Pnt(), gp_Vec()
        kernel.D1(t, point, tangent)
        assert_allclose(point.Coord(), curve.point([t])[0], atol=1e-13)
        assert_allclose(tangent.Coord(), curve.derivative([t])[0], atol=1e-12)


def test_a_periodic_kernel_curve_comes_back_clamped_with_the_same_points():
    square = random_curve(3, False)
    closed = kernel_curve(
        BSplineCurve(3, square.knots, np.concatenate([square.control_points[:-1], square.control_points[:1]]))
    )
    closed.SetPeriodic()
    back = curve_from_kernel(closed)
    for t in np.linspace(*back.domain, 11):
        assert_allclose(back.point([t])[0], closed.Value(t).Coord(), atol=1e-12)
    assert closed.IsPeriodic()


def test_knots_and_multiplicities_say_the_same_as_the_knot_vector():
    t = np.array([0, 0, 0, 0, 0.5, 0.5, 2, 3, 3, 3, 3], dtype=float)
    knots, multiplicities = compressed_knots(t, 3)
    assert_array_equal(knots, [0, 0.5, 2, 3])
    assert_array_equal(multiplicities, [4, 2, 1, 4])
    assert_array_equal(full_knots(knots, multiplicities), t)


def test_smooth_stretches_are_the_curve_cut_at_its_corners():
    rng = np.random.default_rng(2)
    t = np.array([0, 0, 0, 0, 0.3, 1, 1, 1, 2, 2.5, 3, 3, 3, 4, 4, 4, 4], dtype=float)
    curve = BSplineCurve(3, t, rng.normal(size=(13, 2)), rng.uniform(0.5, 2, 13))
    stretches = smooth_stretches(curve)
    assert [s.domain for s in stretches] == [(0, 1), (1, 3), (3, 4)]
    for stretch in stretches:
        at = np.linspace(*stretch.domain, 9)[1:-1]
        assert_allclose(stretch.point(at), curve.point(at), atol=1e-13)


def test_what_the_kernel_cannot_hold_is_refused_by_name():
    with pytest.raises(BadGeometry, match="degree 26"):
        kernel_curve(BSplineCurve(26, np.repeat([0.0, 1.0], 27), np.zeros((27, 3))))
    with pytest.raises(BadGeometry, match=r"inner knot 0\.5 occurs 3 times"):
        kernel_curve(BSplineCurve(2, np.array([0, 0, 0, 0.5, 0.5, 0.5, 1, 1, 1]), np.zeros((6, 3))))
    with pytest.raises(BadGeometry, match="plane"):
        kernel_curve(random_curve(2, False))
    with pytest.raises(BadGeometry, match="space"):
        kernel_pcurve(random_curve(3, False))

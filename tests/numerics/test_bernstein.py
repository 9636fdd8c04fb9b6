import numpy as np
import pytest
from numpy.testing import assert_allclose

from recon.geometry.bspline import BSplineCurve
from recon.numerics.bernstein import (
    bernstein,
    bernstein_derivative,
    bernstein_product,
    cubic_halving,
    degree_elevation,
    reparametrization,
)

T = np.linspace(0.0, 1.0, 23)


@pytest.mark.parametrize("degree", [1, 2, 3, 5])
def test_bernstein_polynomials_are_a_partition_of_unity_with_linear_precision(degree):
    rows = bernstein(degree, T)
    assert_allclose(rows.sum(axis=1), 1.0, atol=1e-14)
    assert_allclose(rows @ (np.arange(degree + 1) / degree), T, atol=1e-14)


def test_derivative_of_a_cubic_power():
    power = np.array([0.0, 0.0, 0.0, 1.0])  # t³ has the ordinates 0, 0, 0, 1
    assert_allclose(bernstein_derivative(3, T) @ power, 3 * T**2, atol=1e-13)


@pytest.mark.parametrize("low", [1, 2, 3])
def test_degree_elevation_keeps_the_curve(low):
    control = np.random.default_rng(low).normal(size=(low + 1, 2))
    assert_allclose(bernstein(3, T) @ degree_elevation(low, 3) @ control, bernstein(low, T) @ control, atol=1e-14)


@pytest.mark.parametrize(("first", "second"), [(3, 2), (2, 3), (5, 3), (4, 1)])
def test_coefficients_of_a_product_are_those_of_the_product(first, second):
    random = np.random.default_rng(first)
    p, q = random.normal(size=first + 1), random.normal(size=second + 1)
    product = bernstein_product(first, second) @ q @ p
    expected = (bernstein(first, T) @ p) * (bernstein(second, T) @ q)
    assert_allclose(bernstein(first + second, T) @ product, expected, atol=1e-13)


def test_halving_keeps_the_curve():
    control = np.random.default_rng(2).normal(size=(4, 3))
    halved = BSplineCurve(3, [0, 0, 0, 0, 0.5, 1, 1, 1, 1], cubic_halving() @ control)
    assert_allclose(halved.point(T), bernstein(3, T) @ control, atol=1e-14)


def test_reparametrization_reads_the_same_polynomial_over_another_range():
    control = np.random.default_rng(4).normal(size=(4, 3))
    wider = reparametrization(3, -0.2, 1.3) @ control
    assert_allclose(bernstein(3, T) @ wider, bernstein(3, -0.2 + 1.5 * T) @ control, atol=1e-13)

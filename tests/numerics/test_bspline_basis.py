"""The basis is a partition of unity, reproduces polynomials, and differentiates exactly."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from recon.numerics.bspline_basis import basis_matrix, clamped_knots, greville, knot_spans, uniform_knots

KNOTS = clamped_knots([0.0, 0.1, 0.45, 0.5, 1.0], 3)


@pytest.mark.parametrize("derivative", [0, 1, 2, 3])
def test_rows_sum_to_one_and_those_of_derivatives_to_zero(derivative):
    x = np.linspace(0, 1, 57)
    sums = basis_matrix(KNOTS, 3, x, derivative) @ np.ones(len(KNOTS) - 4)
    assert_allclose(sums, 1.0 if derivative == 0 else 0.0, atol=1e-9)


def test_the_greville_points_reproduce_the_identity():
    x = np.linspace(0, 1, 31)
    assert_allclose(basis_matrix(KNOTS, 3, x) @ greville(KNOTS, 3), x, atol=1e-14)


def test_the_second_derivative_of_a_parabola_is_constant():
    knots = uniform_knots(7, 2)
    inner = np.array([knots[i + 1] * knots[i + 2] for i in range(7)])  # blossom of x² at the knots of a point
    assert_allclose(basis_matrix(knots, 2, np.linspace(0, 1, 9), 2) @ inner, 2.0, atol=1e-11)


def test_derivatives_beyond_the_degree_vanish():
    assert basis_matrix(KNOTS, 3, [0.3], 4).nnz == 0


def test_the_end_of_the_range_belongs_to_the_last_span():
    assert_allclose(knot_spans(KNOTS, 3, np.array([0.0, 0.45, 1.0])), [3, 5, len(KNOTS) - 5])


def test_parameters_outside_are_clamped():
    outside = basis_matrix(KNOTS, 3, [-1.0, 2.0]).toarray()
    assert_allclose(outside, basis_matrix(KNOTS, 3, [0.0, 1.0]).toarray())

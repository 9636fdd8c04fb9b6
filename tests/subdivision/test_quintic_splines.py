"""Pieces in rows become one spline with the knots that they need, and no others."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.interpolate import BSpline

from recon.numerics.bernstein import bernstein, degree_elevation, reparametrization
from recon.subdivision.quintic_splines import quintic_spline


def point(pieces, t):
    """Points of the pieces at parameters t over [0, n]."""
    at = np.minimum(t.astype(int), len(pieces) - 1)
    return np.einsum("ka,kax->kx", bernstein(5, t - at), pieces[at])


def inner(knots):
    return knots[6:-6]


def smooth_pieces(n, continuity, rng):
    """n pieces whose derivatives agree up to that order at their ends."""
    pieces = rng.random((n, 6, 3))
    for before, after in pairwise(pieces):
        after[0] = before[5]
        if continuity >= 1:
            after[1] = 2 * before[5] - before[4]
        if continuity >= 2:
            after[2] = before[3] - 4 * before[4] + 4 * before[5]
    return pieces


@pytest.mark.parametrize(("continuity", "times"), [(1, 4), (2, 3)])
def test_a_knot_stays_as_often_as_the_pieces_ask(continuity, times):
    pieces = smooth_pieces(4, continuity, np.random.default_rng(continuity))
    knots, points = quintic_spline(pieces)
    assert inner(knots).tolist() == np.repeat([1.0, 2.0, 3.0], times).tolist()
    t = np.linspace(0.0, 4.0, 201)
    assert np.abs(BSpline(knots, points, 5)(t) - point(pieces, t)).max() < 1e-12


def test_pieces_of_one_polynomial_have_no_inner_knot():
    whole = np.random.default_rng(3).random((6, 3))
    pieces = np.array([reparametrization(5, k / 4, (k + 1) / 4) @ whole for k in range(4)])
    knots, points = quintic_spline(pieces)
    assert len(inner(knots)) == 0
    assert np.abs(points - whole).max() < 1e-12


def test_a_cubic_spline_beside_a_free_piece_keeps_what_each_needs():
    cubic = np.random.default_rng(5).random((8, 2))
    uniform = BSpline(np.arange(12.0) - 3.0, cubic, 3)  # five unit spans over [0, 5]
    t = np.linspace(0.0, 1.0, 4)
    bezier = np.array([degree_elevation(3, 5) @ np.linalg.solve(bernstein(3, t), uniform(k + t)) for k in range(5)])
    bezier[0, :4] += np.random.default_rng(6).random((4, 2))  # end and tangent toward the next piece stay
    knots, points = quintic_spline(bezier)
    assert inner(knots).tolist() == [1.0] * 4 + [2.0] * 3 + [3.0] * 3 + [4.0] * 3
    at = np.linspace(0.0, 5.0, 101)
    assert np.abs(BSpline(knots, points, 5)(at) - point(bezier, at)).max() < 1e-12
    knots, net = quintic_spline(np.stack([bezier, 2.0 * bezier], axis=2))
    assert np.abs(net - np.stack([points, 2.0 * points], axis=1)).max() < 1e-12

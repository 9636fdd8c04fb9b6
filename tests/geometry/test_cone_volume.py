"""The cones over the faces of a solid add up to its volume, whatever the apex, trimmed or not."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from recon.geometry.bspline import BSplineCurve, BSplineSurface
from recon.geometry.cone_volume import cone_volume, surface_moments, trimmed_cone_volume
from recon.numerics.bspline_basis import uniform_knots

APEX = (0.3, -2.0, 0.7)


def graph(height, n=9):
    """z = height(x, y) over the unit square, interpolated by nothing: the control points are what they are."""
    knots = uniform_knots(n, 3)
    at = np.array([knots[i + 1 : i + 4].mean() for i in range(n)])  # Greville: x and y are the parameters themselves
    x, y = np.meshgrid(at, at, indexing="ij")
    return BSplineSurface(3, 3, knots, knots, np.stack([x, y, height(x, y)], axis=2))


def circle(centre, radius, n_curves=4, reverse=False):
    """A circle as rational quadratic arcs in the parameter plane."""
    w = np.cos(np.pi / n_curves)
    curves = []
    for k in range(n_curves):
        a, b = 2 * np.pi * k / n_curves, 2 * np.pi * (k + 1) / n_curves
        m = 0.5 * (a + b)
        points = [[np.cos(a), np.sin(a)], [np.cos(m) / w, np.sin(m) / w], [np.cos(b), np.sin(b)]]
        curves.append(BSplineCurve(2, [0, 0, 0, 1, 1, 1], centre + radius * np.array(points), [1.0, w, 1.0]))
    return [c.reversed() for c in reversed(curves)] if reverse else curves


def test_the_cone_over_a_unit_square_one_above_the_apex_is_a_third():
    assert_allclose(cone_volume(graph(lambda x, y: 1.0 + 0 * x)), 1 / 3, rtol=1e-14)


def test_a_sphere_as_nurbs_has_its_volume_from_any_apex():
    half = np.array([[0, -1, 1], [1, -1, np.sqrt(0.5)], [1, 0, 1], [1, 1, np.sqrt(0.5)], [0, 1, 1]])  # r, z, weight
    around = np.array([[1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1], [1, -1], [1, 0]])
    w = np.outer([1, np.sqrt(0.5)] * 4 + [1], half[:, 2])
    net = np.stack(
        [*(around[:, k, None] * half[None, :, 0] for k in (0, 1)), np.broadcast_to(half[:, 1], w.shape)], axis=2
    )
    full, arc = np.repeat([0, 0.25, 0.5, 0.75, 1], [3, 2, 2, 2, 3]), np.repeat([0, 0.5, 1], [3, 2, 3])
    sphere = BSplineSurface(2, 2, full, arc, net, w)
    assert_allclose(cone_volume(sphere, APEX), 4 / 3 * np.pi, rtol=1e-10)


def test_a_trim_along_the_border_leaves_the_whole_surface():
    surface = graph(lambda x, y: 1.0 + np.sin(5 * x) * y)
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    loop = [BSplineCurve(1, [0, 0, 1, 1], [a, b]) for a, b in zip(corners, np.roll(corners, -1, axis=0))]
    assert_allclose(trimmed_cone_volume(surface, loop, APEX), cone_volume(surface, APEX), rtol=1e-13)


@pytest.mark.parametrize("centre", [(0.5, 0.5), (0.31, 0.62)])
def test_a_disc_and_the_square_without_it_make_the_square(centre):
    surface = graph(lambda x, y: 1.0 + np.cos(7 * x * y))
    disc = trimmed_cone_volume(surface, circle(np.array(centre), 0.27), APEX)
    hole = trimmed_cone_volume(surface, circle(np.array(centre), 0.27, reverse=True), APEX)
    assert_allclose(hole, -disc, rtol=1e-9)
    flat = graph(lambda x, y: 1.0 + 0 * x)
    assert_allclose(trimmed_cone_volume(flat, circle(np.array(centre), 0.27)), np.pi * 0.27**2 / 3, atol=1e-8 / 3)


def test_moments_of_many_surfaces_are_those_of_each():
    surfaces = [graph(lambda x, y, k=k: 1.0 + np.sin((3 + k) * x) * y) for k in range(4)]
    knots = (surfaces[0].knots_u, surfaces[0].knots_v)
    found = surface_moments(np.array([s.control_net for s in surfaces]) - APEX, (3, 3), knots)
    assert_allclose(found[:, 4], [cone_volume(s, APEX) for s in surfaces], rtol=1e-13)
    flat = surface_moments(graph(lambda x, y: 1.0 + 0 * x).control_net[None], (3, 3), knots)[0]
    assert_allclose(flat[:4], [1.0, 0.5, 0.5, 1.0], rtol=1e-13)  # unit square at height 1
    assert_allclose(
        flat[4:], [1 / 3, 1 / 8, 1 / 8, 1 / 4], rtol=1e-13
    )  # pyramid: 3/4 of the way to the square's middle

import graph_walls as gw
import numpy as np
import pytest
from numpy.testing import assert_allclose

from recon.geometry.patches import side_curve
from recon.hole_patch.bicubic import base_surface, basis_patch_net, extended, mean_distance
from recon.hole_patch.box import edge_box

THIRDS = np.arange(4) / 3.0


def sides_of(net):
    return np.stack([net[:, 0], net[-1, :], net[:, -1], net[0, :]])


def test_a_bilinear_boundary_gives_the_bilinear_patch():
    corners = np.random.default_rng(0).normal(size=(2, 2, 3))
    weights = np.stack([1 - THIRDS, THIRDS], axis=1)
    net = np.einsum("ia,jb,abk->ijk", weights, weights, corners)
    assert_allclose(basis_patch_net(sides_of(net)), net, atol=1e-14)


def test_a_flat_boundary_gives_a_flat_patch():
    net = np.random.default_rng(1).normal(size=(4, 4, 3))
    net[..., 2] = 0.3 * net[..., 0] - 0.7 * net[..., 1] + 2.0
    patch = basis_patch_net(sides_of(net))
    assert_allclose(patch[..., 2], 0.3 * patch[..., 0] - 0.7 * patch[..., 1] + 2.0, atol=1e-13)


def test_a_sum_of_a_curve_along_and_a_curve_across_is_reproduced():
    rng = np.random.default_rng(2)
    net = rng.normal(size=(4, 1, 3)) + rng.normal(size=(1, 4, 3))  # a translational surface
    assert_allclose(basis_patch_net(sides_of(net)), net, atol=1e-13)


def test_the_patch_has_the_boundary_it_was_given_and_turns_with_it():
    rng = np.random.default_rng(3)
    sides = sides_of(rng.normal(size=(4, 4, 3)))
    patch, matrix = basis_patch_net(sides), gw.rigid(4)[:3, :3]
    assert_allclose(sides_of(patch), sides)
    assert_allclose(basis_patch_net(sides @ matrix), patch @ matrix, atol=1e-13)


def some_ordinates():
    net = np.random.default_rng(5).normal(size=(4, 4))
    return sides_of(net)


def test_the_base_patch_is_a_graph_over_the_box():
    box = edge_box(gw.graph_wall(gw.cylinder, matrix=gw.rigid(6)))
    surface = base_surface(some_ordinates(), box)
    uv = np.random.default_rng(7).uniform(size=(50, 2))
    assert_allclose(box.local(surface.point(uv))[:, :2], box.low + uv * (box.high - box.low), atol=1e-12)
    assert (surface.normal(uv) @ box.axes[2] > 0).all()
    assert_allclose(box.local(side_curve(surface, 1).point(THIRDS))[:, 0], box.high[0], atol=1e-12)


def test_an_extended_patch_runs_on_as_the_same_polynomial():
    box = edge_box(gw.graph_wall(gw.cylinder))
    surface = base_surface(some_ordinates(), box)
    wider = extended(surface, 0.25)
    uv = np.random.default_rng(8).uniform(size=(50, 2))
    assert_allclose(wider.point((uv + 0.25) / 1.5), surface.point(uv), atol=1e-11)


@pytest.mark.parametrize("slope", [0.0, 1.0])
def test_the_mean_distance_from_a_shifted_plane_is_the_shift(slope):
    box = edge_box(gw.graph_wall(gw.plane))
    x = box.low[0] + THIRDS * (box.high[0] - box.low[0])
    ordinates = sides_of(slope * np.tile(x[:, None], 4))
    flat = np.random.default_rng(9).uniform(box.low, box.high, size=(100, 2))
    points = np.column_stack([flat, slope * flat[:, 0] + 2.0])
    expected = 2.0 / np.sqrt(1 + slope**2)
    assert mean_distance(ordinates, box, points, np.ones(100)) == pytest.approx(expected)
    assert mean_distance(ordinates, box, points + 1e3, np.ones(100)) == np.inf

import numpy as np
import pytest
from exact_shapes import torus
from numpy.testing import assert_allclose, assert_array_equal

from brep_export.surfaces import kernel_surface, surface_from_kernel
from recon.errors import BadGeometry
from recon.geometry.bspline import BSplineSurface
from recon.numerics.bspline_basis import uniform_knots


def random_surface(rational):
    rng = np.random.default_rng(3)
    weights = rng.uniform(0.5, 2, (6, 9)) if rational else None
    return BSplineSurface(
        2, 5, uniform_knots(6, 2, 0, 4), uniform_knots(9, 5, -1, 1), rng.normal(size=(6, 9, 3)), weights
    )


@pytest.mark.parametrize("rational", [False, True])
def test_surfaces_come_back_from_the_kernel_unchanged(rational):
    surface = random_surface(rational)
    back = surface_from_kernel(kernel_surface(surface))
    assert (back.degree_u, back.degree_v) == (2, 5)
    for name in ("knots_u", "knots_v", "control_net"):
        assert_array_equal(getattr(back, name), getattr(surface, name))
    if rational:
        assert_array_equal(back.weights, surface.weights)
    else:
        assert back.weights is None


@pytest.mark.parametrize("rational", [False, True])
def test_the_kernel_evaluates_the_same_surface(rational):
    surface = random_surface(rational)
    kernel = kernel_surface(surface)
    uv = np.random.default_rng(0).uniform([0, -1], [4, 1], (25, 2))
    assert_allclose([kernel.Value(u, v).Coord() for u, v in uv.tolist()], surface.point(uv), atol=1e-13)


def test_a_periodic_kernel_surface_comes_back_clamped_with_the_same_points():
    kernel = kernel_surface(torus(3, 1))
    kernel.SetUPeriodic()
    kernel.SetVPeriodic()
    back = surface_from_kernel(kernel)
    uv = np.random.default_rng(0).uniform(0, 4, (25, 2))
    points = back.point(uv)
    assert_allclose((np.hypot(points[:, 0], points[:, 1]) - 3) ** 2 + points[:, 2] ** 2, 1, atol=1e-12)  # the torus


def test_an_inner_knot_that_tears_the_surface_is_refused():
    with pytest.raises(BadGeometry, match=r"inner knot 0\.5"):
        kernel_surface(BSplineSurface(1, 1, [0, 0, 0.5, 0.5, 1, 1], [0, 0, 1, 1], np.zeros((4, 2, 3))))

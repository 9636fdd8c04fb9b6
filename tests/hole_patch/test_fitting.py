import graph_walls as gw
import numpy as np
import pytest
from numpy.testing import assert_allclose

from recon.errors import NoSurface
from recon.geometry.bspline import BSplineSurface
from recon.hole_patch.fitting import distances_from, edge_samples, fit_surface

BEZIER = np.array([0, 0, 0, 0, 1, 1, 1, 1.0])


def flat_patch(half=20.0, scale=1.0):
    at = np.linspace(-half, half, 4)
    x, y = np.meshgrid(at, at, indexing="ij")
    return BSplineSurface(3, 3, BEZIER, BEZIER, scale * np.stack([x, y, 0 * x], axis=-1))


def ring(height, *, inner=10.0, outer=12.0, n=900):
    rng = np.random.default_rng(0)
    angle, radius = rng.uniform(0, 2 * np.pi, n), rng.uniform(inner, outer, n)
    x, y = radius * np.cos(angle), radius * np.sin(angle)
    return np.stack([x, y, height(x, y)], axis=1)


def test_a_paraboloid_known_in_a_ring_is_found_inside_it_too():
    fitted = fit_surface(flat_patch(), ring(gw.paraboloid))
    x, y = np.random.default_rng(1).uniform(-7, 7, size=(2, 200))
    inside = np.stack([x, y, gw.paraboloid(x, y)], axis=1)
    assert fitted.mean_distance < 1e-6
    assert distances_from(fitted.surface, inside).max() < 1e-5


def test_a_cubic_surface_sampled_everywhere_is_reproduced():
    rng = np.random.default_rng(2)
    x, y = rng.uniform(-19, 19, size=(2, 1500))
    points = np.stack([x, y, 1e-4 * x**3 - 2e-4 * x * y**2 + 1e-2 * x * y], axis=1)
    assert fit_surface(flat_patch(), points).mean_distance < 1e-3


def test_points_on_the_base_patch_leave_it_as_it_is():
    base = flat_patch()
    fitted = fit_surface(base, ring(lambda x, y: 0 * x))
    uv = np.random.default_rng(3).uniform(size=(50, 2))
    assert_allclose(fitted.surface.point(uv), base.point(uv), atol=1e-9)
    assert list(fitted.surface.knots_u) == [0, 0, 0, 0, 0.5, 1, 1, 1, 1]


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_the_fit_does_not_depend_on_the_unit(scale):
    samples = ring(gw.sphere)
    one = fit_surface(flat_patch(), samples, acceptance=np.inf)
    other = fit_surface(flat_patch(scale=scale), samples * scale, acceptance=np.inf)
    assert_allclose(other.surface.control_net / scale, one.surface.control_net, atol=1e-6)


def test_the_fit_turns_with_the_samples():
    matrix = gw.rigid(4)[:3, :3]
    base, samples = flat_patch(), ring(gw.cylinder)
    turned = BSplineSurface(3, 3, BEZIER, BEZIER, base.control_net @ matrix.T)
    one, other = fit_surface(base, samples), fit_surface(turned, samples @ matrix.T)
    at = np.random.default_rng(7).uniform(0.3, 0.7, size=(50, 2))  # where the samples are, and inside the ring
    assert distances_from(other.surface, one.surface.point(at) @ matrix.T).max() < 1e-4


@pytest.mark.parametrize("height", [gw.sphere, gw.cylinder])
def test_the_surface_stays_a_graph_over_its_base(height):
    rng = np.random.default_rng(5)
    samples = ring(height) + rng.normal(scale=0.3, size=(900, 3))
    fitted = fit_surface(flat_patch(), samples)
    at = np.linspace(0, 1, 41)
    uv = np.stack(np.meshgrid(at, at), axis=-1).reshape(-1, 2)
    assert (fitted.surface.normal(uv)[:, 2] > 0).all()


def test_samples_farther_than_accepted_are_refused_with_the_figure():
    rng = np.random.default_rng(6)
    samples = ring(gw.plane) + rng.normal(scale=2.0, size=(900, 3))
    with pytest.raises(NoSurface, match=r"mm \(mean\) from the 900 samples"):
        fit_surface(flat_patch(), samples, acceptance=0.5)


def test_without_samples_the_base_patch_stays():
    base = flat_patch()
    assert_allclose(fit_surface(base, np.zeros((0, 3))).surface.point([[0.3, 0.8]]), base.point([[0.3, 0.8]]))


def test_edge_samples_are_the_vertices_within_reach_of_the_edge():
    wall = gw.graph_wall(gw.plane)
    samples = edge_samples(wall, radius=2.0)
    away = np.linalg.norm(wall.measured.vertices[:, None] - wall.edge.points, axis=2).min(axis=1)
    assert len(samples) == (away <= 2.0).sum()
    assert np.linalg.norm(samples[:, None] - wall.edge.points, axis=2).min(axis=1).max() <= 2.0

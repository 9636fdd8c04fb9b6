import numpy as np
import pytest
from numpy.testing import assert_allclose

from recon.numerics.planes import circle_through, enclosing_circle, fit_plane, section_segments


def sphere_mesh(radius, n=40):
    """A sphere as a grid of longitudes and latitudes, open at the poles."""
    theta, phi = np.meshgrid(np.arange(n) * 2 * np.pi / n, np.linspace(0.05, np.pi - 0.05, n), indexing="ij")
    v = radius * np.stack([np.sin(phi) * np.cos(theta), np.sin(phi) * np.sin(theta), np.cos(phi)], -1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(n), np.arange(n - 1), indexing="ij")
    a, b, c, d = ((((i + di) % n) * n + j + dj).ravel() for di, dj in ((0, 0), (1, 0), (1, 1), (0, 1)))
    return v, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


@pytest.mark.parametrize("height", [0.0, 0.3, -0.7])
def test_section_of_a_sphere_by_a_plane_lies_on_the_circle(height):
    radius = 5.0
    vertices, faces = sphere_mesh(radius)
    normal = np.array([0.6, 0.0, 0.8])
    ends = section_segments(vertices, faces, vertices @ normal - height * radius).reshape(-1, 3)
    from_axis = np.linalg.norm(ends - np.outer(ends @ normal, normal), axis=1)
    circle = radius * np.sqrt(1 - height**2)
    longest = max(np.linalg.norm(vertices[faces] - np.roll(vertices[faces], 1, axis=1), axis=2).max(), 0)
    deepest = radius - np.sqrt(radius**2 - longest**2 / 4)  # sagitta of the longest edge
    assert_allclose(ends @ normal, height * radius, atol=1e-12)
    assert (from_axis <= circle + 1e-12).all()
    assert (np.linalg.norm(ends, axis=1) >= radius - deepest - 1e-12).all()


def test_section_of_a_closed_belt_is_a_closed_polyline():
    vertices, faces = sphere_mesh(2.0)
    segments = section_segments(vertices, faces, vertices[:, 2] - 0.123)
    ends, count = np.unique(segments.reshape(-1, 3), axis=0, return_counts=True)
    assert (count == 2).all()
    assert len(ends) == len(segments)


def test_a_plane_beside_the_mesh_cuts_nothing():
    vertices, faces = sphere_mesh(1.0)
    assert section_segments(vertices, faces, vertices[:, 2] + 3.0).shape == (0, 2, 3)


def test_fitted_plane_contains_the_points_of_a_plane():
    rng = np.random.default_rng(3)
    normal = np.array([2.0, -1.0, 2.0]) / 3.0
    points = rng.normal(size=(50, 3)) * [3.0, 1.0, 1.0]
    points -= np.outer(points @ normal, normal) - 7.0 * normal
    centre, axes = fit_plane(points)
    assert_allclose((points - centre) @ axes[2], 0.0, atol=1e-12)
    assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    assert abs(axes[2] @ normal) == pytest.approx(1.0)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_circle_through_three_points_is_as_far_from_each(scale):
    a, b, c = np.random.default_rng(5).normal(size=(3, 20, 3)) * scale
    centre, radius, normal = circle_through(a, b, c)
    for point in (a, b, c):
        assert_allclose(np.linalg.norm(point - centre, axis=1), radius, rtol=1e-9)
        assert_allclose(np.einsum("ij,ij->i", point - centre, normal) / radius, 0.0, atol=1e-9)
    assert (np.einsum("ij,ij->i", np.cross(a - b, c - b), normal) > 0).all()


def test_three_points_on_a_line_have_no_circle():
    row = np.arange(3.0)[:, None] * np.array([1.0, 2.0, 3.0])
    _, radius, normal = circle_through(row[:1], row[1:2], row[2:])
    assert np.isinf(radius).all()
    assert_allclose(normal, 0.0)


@pytest.mark.parametrize("seed", range(10))
def test_enclosing_circle_holds_all_points_and_rests_on_points_of_no_half_circle(seed):
    points = np.random.default_rng(seed).normal(size=(200, 2))
    centre, radius = enclosing_circle(points)
    away = np.linalg.norm(points - centre, axis=1)
    assert away.max() <= radius * (1 + 1e-9)
    angles = np.sort(np.arctan2(*(points - centre)[away > radius * (1 - 1e-9)].T))
    # Minimal exactly when the points it rests on leave no open half circle free.
    assert np.diff(np.append(angles, angles[0] + 2 * np.pi)).max() <= np.pi + 1e-6


def test_enclosing_circle_of_one_point_has_no_radius():
    centre, radius = enclosing_circle(np.array([[3.0, 4.0]] * 5))
    assert_allclose(centre, [3.0, 4.0])
    assert radius == 0.0

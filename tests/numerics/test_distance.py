import numpy as np
import pytest
from numpy.testing import assert_allclose

from recon.numerics.distance import closest_points, hausdorff_distance, one_sided_deviation, sample_surface


def soup(kind, n, rng):
    """n unconnected triangles of one kind as (vertices, faces)."""
    corners = rng.standard_normal((n, 1, 3)) + {"even": 0.1, "large": 1.0}.get(kind, 0.3) * rng.standard_normal(
        (n, 3, 3)
    )
    if kind == "slivers":  # three nearly equal points, one pulled far away: aspect up to 1e6
        corners[:, 1] = corners[:, 0] + 10.0 ** rng.uniform(-6, -1, (n, 1)) * rng.standard_normal((n, 3))
        corners[:, 2] = corners[:, 0] + rng.uniform(1, 5, (n, 1)) * rng.standard_normal((n, 3))
    if kind == "without area":
        corners[::2, 2] = 0.3 * corners[::2, 0] + 0.7 * corners[::2, 1]
        corners[1::4] = corners[1::4, :1]
    if kind == "mixed sizes":
        corners = corners[:, :1] + 10.0 ** rng.uniform(-4, 1, (n, 1, 1)) * (corners - corners[:, :1])
    return corners.reshape(-1, 3), np.arange(3 * n).reshape(n, 3)


def squared_distances(points, corners):
    """(n, F) squared distances of points to triangles by their sides and, over the inside, by their planes."""
    a, b, c = corners.transpose(1, 0, 2)
    p = points[:, None, :]

    def segment(u, v):
        along = v - u
        t = np.clip(np.sum((p - u) * along, axis=2) / np.maximum(np.sum(along * along, axis=1), 1e-300), 0, 1)
        return np.sum((p - u - t[..., None] * along) ** 2, axis=2)

    best = np.minimum(np.minimum(segment(a, b), segment(b, c)), segment(c, a))
    normal = np.cross(b - a, c - a)
    length = np.linalg.norm(normal, axis=1)
    normal = normal / np.maximum(length, 1e-300)[:, None]
    inside = length > 1e-12  # a triangle of less area is its sides
    for u, v in ((a, b), (b, c), (c, a)):
        inside = inside & (np.sum(np.cross(v - u, p - u) * normal, axis=2) >= 0)
    return np.where(inside, np.sum((p - a) * normal, axis=2) ** 2, best)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("kind", ["even", "large", "slivers", "without area", "mixed sizes"])
def test_distances_equal_those_to_every_triangle_in_turn(kind, scale):
    rng = np.random.default_rng(3)
    vertices, faces = soup(kind, 300, rng)
    points = np.concatenate([rng.standard_normal((150, 3)), 20 * rng.standard_normal((20, 3)), vertices[::20]])
    found = closest_points(scale * points, scale * vertices, faces)
    expected = np.sqrt(squared_distances(points, vertices[faces]).min(axis=1))
    assert_allclose(found.distances / scale, expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("kind", ["even", "slivers", "without area"])
def test_the_nearest_point_is_the_projection_on_its_face(kind):
    # Theorem: c is the point of a convex set nearest to p exactly when (p - c).(q - c) <= 0 for all q of the set.
    rng = np.random.default_rng(4)
    vertices, faces = soup(kind, 200, rng)
    points = 2 * rng.standard_normal((400, 3))
    found = closest_points(points, vertices, faces)
    away = points - found.points
    assert_allclose(np.linalg.norm(away, axis=1), found.distances, atol=1e-12)
    corners = vertices[faces[found.faces]]
    assert np.einsum("ij,ikj->ik", away, corners - found.points[:, None]).max() < 1e-9
    system = np.concatenate([corners.transpose(0, 2, 1), np.ones((400, 1, 3))], axis=1)
    inside = np.concatenate([found.points, np.ones((400, 1))], axis=1)
    weights = np.einsum("ijk,ik->ij", np.linalg.pinv(system), inside)
    assert_allclose(np.einsum("ijk,ik->ij", system, weights), inside, atol=1e-8)


def test_points_of_the_surface_are_at_no_distance():
    rng = np.random.default_rng(5)
    vertices, faces = soup("even", 3000, rng)
    on = sample_surface(vertices, faces, 500)
    assert closest_points(on, vertices, faces).distances.max() < 1e-14


def test_map_coordinates_lose_no_more_than_their_own_rounding():
    rng = np.random.default_rng(6)
    vertices, faces = soup("even", 400, rng)
    points = rng.standard_normal((200, 3))
    origin = np.array([5e5, 4e6, 2e3])
    near = closest_points(points, vertices, faces).distances
    assert_allclose(closest_points(points + origin, vertices + origin, faces).distances, near, atol=4e-9)


def test_no_points_have_no_distances_and_no_triangles_have_no_nearest_point():
    vertices, faces = soup("even", 10, np.random.default_rng(7))
    assert closest_points(np.empty((0, 3)), vertices, faces).distances.shape == (0,)
    with pytest.raises(ValueError, match="no triangles"):
        closest_points(vertices, vertices, faces[:0])


def square(height, size):
    vertices = np.array([[0, 0, height], [size, 0, height], [size, size, height], [0, size, height]], dtype=float)
    return vertices, np.array([[0, 1, 2], [0, 2, 3]])


def test_deviation_of_parallel_squares_is_their_distance_one_way_and_the_corner_the_other():
    small, large = square(0.0, 1.0), square(0.5, 4.0)
    there, back = one_sided_deviation(small, large), one_sided_deviation(large, small)
    assert_allclose(there, [0.5, 0.5, 0.5], rtol=1e-12)
    assert_allclose(back.maximum, np.sqrt(3**2 + 3**2 + 0.5**2), rtol=1e-12)
    assert back.mean < back.rms < back.maximum
    assert hausdorff_distance(small, large) == hausdorff_distance(large, small) == back.maximum


def test_samples_are_spread_by_area():
    # Two squares of area 1 and 16: the mean height of samples is 16/17.
    (a, f), (b, g) = square(0.0, 1.0), square(1.0, 4.0)
    points = sample_surface(np.concatenate([a, b]), np.concatenate([f, g + 4]), 3400)
    assert_allclose(points[:, 2].mean(), 16 / 17, atol=1e-3)
    upper = points[points[:, 2] > 0.5, :2]
    assert_allclose(upper.mean(axis=0), [2.0, 2.0], atol=0.02)
    assert_allclose(upper.var(axis=0), [16 / 12, 16 / 12], rtol=0.02)

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from recon.numerics.closed_mesh import opposite_halfedges
from recon.numerics.coplanar import coplanar_regions, corner_vertices, meet_planes, region_loops, region_planes


def roof(ridge):
    """A closed prism: a square base, two rectangles at the sides up to a ridge of that height, two gables."""
    points = np.array([[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0], [0, 1, ridge], [2, 1, ridge]], dtype=float)
    faces = [(0, 2, 1), (0, 3, 2), (0, 1, 5), (0, 5, 4), (2, 3, 4), (2, 4, 5), (1, 2, 5), (3, 0, 4)]
    return points, np.array(faces)


def regions_of(points, faces, tolerance):
    twin = opposite_halfedges(points, faces)
    return twin, coplanar_regions(points, faces, twin, tolerance)


def test_a_prism_has_five_flat_regions_with_their_planes_looking_out():
    points, faces = roof(1.0)
    _, region = regions_of(points, faces, 1e-9)
    assert region.max() + 1 == 5
    normal, offset = region_planes(points[faces], region)
    inside = points.mean(axis=0)
    assert (normal @ inside < offset).all()
    assert_allclose(np.linalg.norm(normal, axis=1), 1)
    on_plane = np.einsum("fkj,fj->fk", points[faces], normal[region]) - offset[region][:, None]
    assert_allclose(on_plane, 0, atol=1e-15)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_regions_do_not_depend_on_the_unit(scale):
    points, faces = roof(1.0)
    _, region = regions_of(points * scale, faces, 1e-9 * scale)
    assert region.max() + 1 == 5


def test_a_ridge_below_the_tolerance_is_flat_and_above_it_is_not():
    """The four points around the ridge lie within ridge / 2 of a plane, the best any plane can do."""
    points, faces = roof(1e-3)
    points, faces = np.concatenate([points, points[:4] - [0, 0, 5]]), faces[2:]  # stand it on a box
    walls = [(6, 8, 7), (6, 9, 8)]
    for a, b in ((0, 1), (1, 2), (2, 3), (3, 0)):
        walls += [(a, 6 + a, 6 + b), (a, 6 + b, b)]
    faces = np.concatenate([faces, walls])
    for tolerance, expected in ((0.45e-3, 8), (0.55e-3, 6)):
        _, region = regions_of(points, faces, tolerance)
        slopes = len(set(region[:4].tolist()))
        assert slopes == (2 if expected == 8 else 1)


def test_loops_of_regions_run_through_every_border_half_edge_once():
    points, faces = roof(1.0)
    twin, region = regions_of(points, faces, 1e-9)
    loops = region_loops(twin, region)
    border = np.flatnonzero(region[twin // 3] != np.repeat(region, 3))
    assert_array_equal(np.sort(np.concatenate(loops)), border)
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    for loop in loops:
        assert_array_equal(end[loop], np.roll(start[loop], -1))
        assert len(set(region[loop // 3].tolist())) == 1


def test_vertices_within_the_tolerance_of_a_straight_edge_go_and_bends_stay():
    t = np.linspace(0, 1, 11)
    points = np.stack([t, 0.01 * np.sin(9 * t), 0 * t], axis=1)
    points = np.concatenate([points, [[0.5, 2, 0], [0.5, -2, 0]]])
    line, up, down = np.arange(11), 11, 12
    loops = [np.append(line, up), np.append(line[::-1], down), np.array([0, up, 10, down])]
    assert np.flatnonzero(corner_vertices(points, loops, 0.02)).tolist() == [0, 10, 11, 12]
    kept = np.flatnonzero(corner_vertices(points, loops, 0.002))
    assert {0, 10, 11, 12} < set(kept.tolist()) < set(range(13))
    chain = points[kept[kept <= 10]]
    reach = np.abs(np.interp(points[:11, 0], chain[:, 0], chain[:, 1]) - points[:11, 1])
    assert reach.max() <= 0.0021


def test_points_move_to_where_their_planes_meet_by_the_shortest_way():
    normal = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [0.6, 0.8, 0]], dtype=float)
    planes = normal, np.array([1.0, 2.0, 3.0, 0.0])
    points = np.array([[1.01, 1.98, 3.02], [1.01, 7.0, 8.0], [5.0, 5.0, 5.0], [1.0, 2.0, 9.0]])
    incidence = np.array([0, 0, 0, 1, 2, 3, 3]), np.array([0, 1, 2, 0, 0, 0, 1])
    moved = meet_planes(points, incidence, planes, 0.1)
    assert_allclose(moved[0], [1, 2, 3], atol=1e-12)  # three planes: their point
    assert_allclose(moved[1], [1, 7, 8], atol=1e-12)  # one plane: the foot
    assert_array_equal(moved[2], points[2])  # too far away
    assert_array_equal(moved[3], points[3])  # on its planes already


def test_nearly_parallel_planes_do_not_throw_a_point_along_their_common_line():
    tilt = 1e-5
    planes = np.array([[0, 0, 1], [np.sin(tilt), 0, np.cos(tilt)]]), np.array([1e-6, -1e-6])
    moved = meet_planes(np.zeros((1, 3)), (np.array([0, 0]), np.array([0, 1])), planes, 1.0)
    assert np.linalg.norm(moved) < 1e-5

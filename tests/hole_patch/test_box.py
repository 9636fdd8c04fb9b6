from dataclasses import replace

import graph_walls as gw
import numpy as np
import pytest
from numpy.testing import assert_allclose

from recon.hole_patch.box import box_through, edge_box, find_picks, outward, surrounds, vertex_normals
from recon.numerics.planes import circle_through

SHAPES = [gw.plane, gw.cylinder, gw.sphere, gw.paraboloid]


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("seed", [0, 1])
def test_the_circle_through_the_found_points_surrounds_the_hole(shape, seed):
    wall = gw.graph_wall(shape, matrix=gw.rigid(seed))
    picks = find_picks(wall)
    assert picks is not None
    centre, radius, normal = circle_through(picks[:1], picks[1:2], picks[2:])
    assert surrounds(centre[0], normal[0], radius[0], wall.edge.points)
    assert (np.linalg.norm(wall.plain.vertices[:, None] - picks, axis=2).min(axis=0) == 0).all()


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0), (1, 2, 0)])
def test_the_box_is_a_square_around_the_circle_and_its_normal_points_outward(order):
    wall = gw.graph_wall(gw.cylinder, matrix=gw.rigid(3))
    picks = find_picks(wall)[list(order)]
    box = box_through(picks, wall)
    _, radius, _ = circle_through(picks[:1], picks[1:2], picks[2:])
    assert_allclose(box.high - box.low, 2 * radius[0])
    assert_allclose(box.low + box.high, 0.0, atol=1e-12)
    assert_allclose(np.linalg.norm(box.local(picks)[:, :2], axis=1), radius[0])
    assert_allclose(box.local(picks)[:, 2], 0.0, atol=1e-10)
    assert box.axes[2] @ gw_up(3) > 0.9


def gw_up(seed):
    return gw.rigid(seed)[:3, 2]


def test_turning_keeps_the_axis_and_ninety_turns_of_one_degree_make_a_right_angle():
    box = edge_box(gw.graph_wall(gw.sphere))
    turned = box
    for _ in range(90):
        turned = turned.turned(np.pi / 180)
    assert_allclose(turned.axes, [box.axes[1], -box.axes[0], box.axes[2]], atol=1e-12)
    assert_allclose(turned.centre, box.centre)


def test_a_narrowed_box_keeps_its_margin_and_never_grows():
    wall = gw.graph_wall(gw.sphere)
    box = edge_box(wall)
    flat = box.local(wall.edge.points)[:, :2]
    narrow = box.narrowed(wall.edge.points, 1.0)
    assert_allclose(flat.min(axis=0) - narrow.low, 1.0)
    assert_allclose(narrow.high - flat.max(axis=0), 1.0)
    assert_allclose(box.narrowed(wall.edge.points, 1e6).high, box.high)


def test_local_coordinates_go_there_and_back():
    box = edge_box(gw.graph_wall(gw.cylinder, matrix=gw.rigid(5)))
    points = np.random.default_rng(0).normal(size=(10, 3))
    assert_allclose(box.point(box.local(points)), points, atol=1e-12)
    assert np.linalg.det(box.axes) == pytest.approx(1.0)


def test_a_wall_on_two_opposite_sides_of_the_hole_carries_no_circle():
    wall = gw.graph_wall(gw.plane)
    strip = wall.plain.part(np.abs(wall.plain.corners()[:, :, 1]).max(axis=1) < 3.0)
    assert find_picks(wall) is not None
    assert find_picks(replace(wall, plain=strip)) is None


def test_outward_is_the_side_from_which_the_edge_runs_counter_clockwise():
    assert_allclose(outward(gw.graph_wall(gw.plane)), np.array([-0.1, 0.2, 1.0]) / np.sqrt(1.05), atol=1e-9)


def test_vertex_normals_of_a_plane_are_its_normal():
    mesh = gw.graph_wall(gw.plane).plain
    normals = vertex_normals(mesh.vertices, mesh.face_vertices)
    assert_allclose(normals, np.tile(np.array([-0.1, 0.2, 1.0]) / np.sqrt(1.05), (len(normals), 1)), atol=1e-12)

from dataclasses import replace

import graph_walls as gw
import numpy as np
import pytest
from numpy.testing import assert_allclose

from recon.errors import BadOption, NoSurface
from recon.hole_patch.box import find_picks
from recon.hole_patch.box_route import base_patch, box_sheet
from recon.hole_patch.fitting import distances_from
from recon.hole_patch.surroundings import BRIDGE, HoleEdge


def inside_points(height, matrix=None, reach=6.0):
    x, y = np.random.default_rng(0).uniform(-reach, reach, size=(2, 300)) * 0.7
    points = np.stack([x, y, height(x, y)], axis=1)
    return points if matrix is None else points @ matrix[:3, :3].T + matrix[:3, 3]


def test_a_flat_wall_gets_a_flat_patch():
    matrix = gw.rigid(1)
    wall = gw.graph_wall(gw.plane, matrix=matrix)
    base, sheet = base_patch(wall), box_sheet(wall)
    assert distances_from(base.surface, inside_points(gw.plane, matrix)).max() < 1e-9
    assert distances_from(sheet.trimmed.surface, inside_points(gw.plane, matrix)).max() < 1e-9
    assert sheet.edge_distance.max() < 1e-9
    assert not base.notes


# A hole of 16 mm in a wall of 40 mm radius; the square around it is some 30 mm wide, over which a cubic is off by
# about (15/40)^4 * 40/8 = 0.1 mm, and the base patch between its boundaries by as much again.
@pytest.mark.parametrize(("shape", "base_error"), [(gw.cylinder, 0.1), (gw.sphere, 0.3), (gw.paraboloid, 0.3)])
def test_the_sheet_over_a_curved_wall_lies_nearer_than_its_base_patch(shape, base_error):
    matrix = gw.rigid(2)
    wall, truth = gw.graph_wall(shape, matrix=matrix), inside_points(shape, matrix)
    sheet = box_sheet(wall)
    base = distances_from(sheet.base, truth).mean()
    assert base < base_error
    assert distances_from(sheet.trimmed.surface, truth).max() < 0.05
    assert sheet.edge_distance.max() < 0.02


def test_the_sheet_is_bounded_by_the_edge_and_faces_outward():
    matrix = gw.rigid(3)
    wall = gw.graph_wall(gw.sphere, matrix=matrix)
    sheet = box_sheet(wall)
    surface, loop = sheet.trimmed.surface, sheet.trimmed.loops[0]
    border = surface.point(loop.polygon(200))
    away = np.linalg.norm(wall.edge.points[:, None] - border, axis=2).min(axis=1)
    assert away.max() < 0.8 * np.sqrt(2)  # one cell of the grid along which the edge zigzags
    assert (surface.normal(loop.polygon()) @ matrix[:3, 2] > 0).all()
    assert sheet.sides == 4
    assert 0 <= sheet.box_angle_deg < 90


def test_the_chosen_angle_does_not_depend_on_the_pose():
    one, other = (base_patch(gw.graph_wall(gw.cylinder, matrix=m)) for m in (None, gw.rigid(4)))
    assert other.mean_distance == pytest.approx(one.mean_distance, rel=1e-6)


def test_picked_points_lead_to_the_box_through_them():
    wall = gw.graph_wall(gw.cylinder)
    picks = find_picks(wall)
    by_hand, found = base_patch(wall, picks=picks), base_patch(wall)
    assert_allclose(by_hand.surface.control_net, found.surface.control_net, atol=1e-9)
    with pytest.raises(BadOption, match=r"picks: point \d lies"):
        box_sheet(wall, picks=picks + np.array([8.0, 0.0, 0.0]))


def test_bridges_over_gaps_do_not_count_as_measured():
    wall = gw.graph_wall(gw.cylinder)
    sherds = np.where(np.arange(len(wall.edge.points)) < 5, BRIDGE, 0)
    sheet = box_sheet(replace(wall, edge=HoleEdge(wall.edge.points, sherds)))
    assert len(sheet.edge_distance) == len(wall.edge.points) - 5


def test_a_narrow_wall_gets_a_narrowed_box_and_says_so():
    wall = gw.graph_wall(gw.cylinder, half=11.5, steps=53, hole=8.0)
    base = base_patch(wall)
    assert any("narrowed" in note for note in base.notes)
    assert distances_from(base.surface, inside_points(gw.cylinder)).mean() < 0.1


def test_a_hole_without_a_wall_on_one_side_is_refused():
    wall = gw.graph_wall(gw.cylinder)
    half = wall.plain.vertices[wall.plain.face_vertices].mean(axis=1)[:, 0] > 4.0
    mesh = wall.plain.part(half)
    count = mesh.n_vertices
    part = replace(wall, measured=mesh, plain=mesh, sherds=np.zeros(count, dtype=int), trust=np.ones(count))
    with pytest.raises(NoSurface, match="misses the wall"):
        box_sheet(part)

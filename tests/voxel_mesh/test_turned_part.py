"""Axis and profile of turned parts, from grids of known ones."""

import numpy as np
import pytest
from generated_grids import ball, block_with_hole, centres, rotation

from recon.errors import NoSolid
from recon.geometry.turned import ProfileArc, ProfileLine, ProfileSpline, TurnedPart
from recon.geometry.voxel_grid import VoxelGrid
from recon.voxel_mesh.profile import profile_pieces
from recon.voxel_mesh.revoxelise import turned_wrong_side
from recon.voxel_mesh.turned import fitted_axis, turned_part

TURN = rotation([2, 1, -1], 35.0)
MIDDLE = 40.0 - np.array([0.137, 0.241, 0.359])


def vase(n=80):
    """Waist and belly of one period, flat at both ends, its axis turned out of the grid's."""
    x = centres(n) @ TURN
    height = x[..., 2]
    solid = (np.hypot(x[..., 0], x[..., 1]) < 14.0 + 4.0 * np.sin(height / 5.0)) & (np.abs(height) < 25.0)
    return VoxelGrid(solid=solid, name="vase")


def test_normals_that_meet_a_line_give_that_line():
    rng = np.random.default_rng(1)
    angle, height = rng.uniform(0, 6.28, 500), rng.uniform(-5, 5, 500)
    lean = np.arctan(np.cos(height))
    out = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    x = (3.0 + np.sin(height))[:, None] * out + height[:, None] * np.eye(3)[2]
    normal = np.cos(lean)[:, None] * out - np.sin(lean)[:, None] * np.eye(3)[2]
    origin, axis = fitted_axis(x @ TURN.T + 7.0, normal @ TURN.T)
    assert abs(axis @ TURN[:, 2]) == pytest.approx(1.0, abs=1e-9)
    assert np.cross(origin - 7.0, axis) == pytest.approx(np.zeros(3), abs=1e-6)


def test_a_vase_comes_back_with_its_axis_its_caps_and_its_belly():
    part = turned_part(vase())
    assert abs(part.axis @ TURN[:, 2]) > np.cos(np.radians(0.15))
    assert np.linalg.norm(np.cross(part.origin - MIDDLE, TURN[:, 2])) < 0.15
    (loop,) = part.loops
    caps = [p for p in loop if isinstance(p, ProfileLine) and p.start[0] + p.end[0] > 0]
    bellies = [p for p in loop if isinstance(p, ProfileSpline)]
    assert (len(caps), len(bellies)) == (2, 1)
    shift = (part.origin - MIDDLE) @ part.axis
    assert sorted(abs(p.start[1] + shift) for p in caps) == pytest.approx([25.0, 25.0], abs=0.15)
    r, z = bellies[0].curve.point(np.linspace(*bellies[0].curve.domain, 50)).T
    side = np.sign(part.axis @ TURN[:, 2])
    off = np.abs(r - 14.0 - 4.0 * np.sin(side * (z + shift) / 5.0))
    assert off.max() < 0.1
    assert np.median(off) < 0.02


def domed(n=100):
    """A dome of radius 34 on a foot of radius 22 with a groove of a half circle around it, its axis turned."""
    x = centres(n) @ TURN
    r, z = np.hypot(x[..., 0], x[..., 1]), x[..., 2]
    solid = ((r**2 + z**2 < 34.0**2) & (z > 4.0)) | ((r < 22.0) & (z > -40.0) & (z <= 4.0))
    return VoxelGrid(solid=solid & (np.hypot(r - 22.0, z + 18.0) > 8.0), name="dome")


@pytest.mark.parametrize("grid", [vase(), domed()], ids=["vase", "dome"])
def test_next_to_no_voxel_centre_lies_on_the_wrong_side_of_a_turned_part(grid):
    part = turned_part(grid)
    wrong = turned_wrong_side(grid, part)
    assert wrong.centres < 60
    assert wrong.deepest < 0.03


def test_the_dome_of_a_turned_part_stays_a_part_of_a_ball():
    (loop,) = turned_part(domed()).loops
    domes = [p for p in loop if isinstance(p, ProfileArc) and min(p.start[0], p.end[0]) == 0.0]
    assert len(domes) == 1
    centre, radius = domes[0].circle
    assert (centre[0], radius) == (pytest.approx(0.0, abs=1e-9), pytest.approx(34.0, abs=0.02))


def test_centres_on_the_wrong_side_of_a_turned_part_are_those_of_its_formula():
    grid = vase()
    cylinder = [(0.0, -20.0), (15.0, -20.0), (15.0, 20.0), (0.0, 20.0)]
    corners = [np.array(p) for p in cylinder]
    loop = tuple(ProfileLine(a, b) for a, b in zip(corners, [*corners[1:], corners[0]]))
    x = centres(80) @ TURN
    inside = (np.hypot(x[..., 0], x[..., 1]) < 15.0) & (np.abs(x[..., 2]) < 20.0)
    found = turned_wrong_side(grid, TurnedPart(MIDDLE, TURN[:, 2], (loop,)))
    assert found.centres == (inside != grid.solid).sum()
    assert found.deepest == pytest.approx(5.0, abs=0.9)  # the ends, 5 beyond the cylinder's


@pytest.mark.parametrize("grid", [block_with_hole(40), ball(30, 11.0)], ids=["block", "ball"])
def test_what_has_no_axis_or_too_many_is_refused(grid):
    with pytest.raises(NoSolid):
        turned_part(grid)


def test_two_lines_carried_on_meet_in_the_corner_that_was_rounded_off():
    down = np.column_stack([np.full(60, 10.0), np.linspace(30.0, 0.5, 60)])
    row = np.concatenate([np.column_stack([np.linspace(0.0, 9.5, 20), np.full(20, 30.5)]), down[1:]])
    row = np.concatenate([row, np.column_stack([np.linspace(9.5, 0.0, 20), np.zeros(20)])])
    pieces = profile_pieces(row)
    assert [type(p) for p in pieces] == [ProfileLine] * 3
    assert np.array([p.end for p in pieces]) == pytest.approx(np.array([[10, 30.5], [10, 0], [0, 0]]), abs=1e-6)

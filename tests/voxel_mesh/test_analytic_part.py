"""Surfaces recognised on grids of parts that are known."""

import numpy as np
import pytest
from generated_grids import (
    ball,
    block_with_hole,
    centres,
    flange,
    random_grid,
    rotation,
    rounded_block,
    rounded_disk,
    rounded_pocket,
)

from recon.errors import NoSolid
from recon.geometry.analytic import Cone, Cylinder, Plane, Sphere
from recon.geometry.voxel_grid import VoxelGrid
from recon.voxel_mesh.analytic_part import analytic_part
from recon.voxel_mesh.fits import fit_cone, fit_cylinder, fit_plane_through, fit_sphere
from recon.voxel_mesh.marching_cubes import marching_cubes
from recon.voxel_mesh.open_intervals import roundest
from recon.voxel_mesh.revoxelise import wrong_side
from recon.voxel_mesh.terraces import without_terraces


def spread(seed, n=400):
    rng = np.random.default_rng(seed)
    return rng.uniform(0, 2, n), rng.uniform(3, 9, n)


def test_each_fit_recovers_its_own_surface_exactly():
    turn = rotation([1, -2, 0.5], 40.0)
    angle, along = spread(0)
    circle = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    axis = np.array([0.0, 0.0, 1.0])
    found = fit_cylinder((7.0 * circle + along[:, None] * axis) @ turn.T, circle @ turn.T)
    assert (found.radius, abs(found.axis @ turn[:, 2])) == (pytest.approx(7.0), pytest.approx(1.0))
    lean = 0.4
    x = along[:, None] * (np.tan(lean) * circle + axis) + 3.0
    found = fit_cone(x @ turn.T, (np.cos(lean) * circle - np.sin(lean) * axis) @ turn.T)
    assert found.half_angle == pytest.approx(lean)
    assert found.apex == pytest.approx(turn @ [3.0, 3.0, 3.0])
    way = np.column_stack([np.cos(angle) * np.cos(along), np.sin(angle) * np.cos(along), np.sin(along)])
    found = fit_sphere(5.0 * way + 1.0, way)
    assert (found.radius, found.centre.tolist()) == (pytest.approx(5.0), pytest.approx([1.0, 1.0, 1.0]))
    flat = np.column_stack([along, angle, 0 * angle + 2.0])
    found = fit_plane_through(flat, np.tile(-axis, (400, 1)))
    assert (found.offset, found.normal_vector.tolist()) == (pytest.approx(-2.0), pytest.approx([0, 0, -1]))


def test_terraces_go_without_any_centre_changing_sides():
    grid = ball(40, 15.0)
    s = marching_cubes(grid)
    x = without_terraces(s, grid.proportions)
    slide = x - s.vertices
    across = np.eye(3, dtype=bool)[s.edge_axis]
    assert (slide[~across] == 0).all()
    assert np.abs(slide).max() <= 0.5
    middle = -np.array([0.137, 0.241, 0.359]) + 20.0
    raw, smooth = (np.linalg.norm(p - middle, axis=1) - 15.0 for p in (s.vertices, x))
    assert np.sqrt((smooth**2).mean()) < 0.6 * np.sqrt((raw**2).mean())


def test_a_turned_block_has_its_six_planes_and_its_hole():
    n, turn = 80, rotation([1, 2, 3], 25.0)
    part = analytic_part(block_with_hole(n, turn))
    planes = [s for s in part.surfaces if isinstance(s, Plane)]
    holes = [s for s in part.surfaces if isinstance(s, Cylinder)]
    assert (len(planes), len(holes), len(part.surfaces)) == (6, 1, 7)
    assert holes[0].radius == pytest.approx(0.12 * n, abs=0.05)
    assert abs(holes[0].axis @ turn[:, 1]) == pytest.approx(1.0, abs=1e-4)
    for plane in planes:
        along = int(np.abs(turn.T @ plane.normal_vector).argmax())
        assert abs(turn[:, along] @ plane.normal_vector) == pytest.approx(1.0, abs=1e-4)


def test_a_ball_is_a_sphere_and_a_cone_a_cone():
    part = analytic_part(ball(44, 17.0))
    assert [type(s) for s in part.surfaces] == [Sphere]
    assert part.surfaces[0].radius == pytest.approx(17.0, abs=0.05)
    x = centres(60)
    across = np.hypot(x[..., 0], x[..., 1])
    solid = (across < 0.5 * (28.0 - x[..., 2])) & (x[..., 2] > -22.0) & (x[..., 2] < 15.0)
    kinds = {type(s) for s in analytic_part(VoxelGrid(solid=solid)).surfaces}
    assert kinds == {Plane, Cone}


def test_the_true_offsets_of_an_upright_block_lie_in_the_intervals():
    part = analytic_part(block_with_hole(60))
    truth = {0: 0.35 * 60, 1: 0.25 * 60, 2: 0.2 * 60}
    middle = 30.0 - np.array([0.137, 0.241, 0.359])
    for surface, (low, high) in zip(part.surfaces, part.intervals):
        if isinstance(surface, Plane):
            axis = int(np.abs(surface.normal_vector).argmax())
            offset = truth[axis] + surface.normal_vector @ middle
            assert surface.offset + low <= offset <= surface.offset + high


def test_noise_has_no_surfaces():
    with pytest.raises(NoSolid):
        analytic_part(random_grid(2))


def test_a_mesh_of_the_grid_has_every_centre_on_its_side_and_a_shifted_one_has_not():
    grid = block_with_hole(30, rotation([1, 0, 1], 10.0))
    s = marching_cubes(grid)
    assert wrong_side(grid, grid.placed(s.vertices, s.face_vertices)).centres == 0
    shifted = wrong_side(grid, grid.placed(s.vertices + np.array([0.8, 0.0, 0.0]), s.face_vertices))
    assert shifted.centres > 100
    assert 0.1 < shifted.deepest < 0.9


@pytest.mark.parametrize(
    ("low", "high", "step", "value"), [(2.9, 3.1, 0.5, 3.0), (9.2, 12.1, 1.0, 10.0), (0.1, 0.2, 1.0, None)]
)
def test_the_roundest_value_of_an_interval(low, high, step, value):
    assert roundest(low, high, step) == value


def test_small_holes_along_the_grid_are_whole_cylinders():
    n = 128
    part = analytic_part(flange(n))
    cylinders = [s for s in part.surfaces if isinstance(s, Cylinder)]
    assert sorted(round(s.radius / n, 2) for s in cylinders) == [0.04] * 6 + [0.23, 0.46]
    assert len([s for s in part.surfaces if isinstance(s, Plane)]) == len(part.surfaces) - 8 == 3
    assert all(abs(s.axis[2]) == pytest.approx(1.0) for s in cylinders)
    holes = np.array([s.point[:2] for s in cylinders if s.radius < 0.1 * n]) - 0.5 * n + np.array([0.137, 0.241])
    assert np.hypot(*holes.T) == pytest.approx(np.full(6, 0.35 * n), abs=0.15)


def test_a_pocket_has_eight_rounded_edges_and_no_wall_bent_into_them():
    n = 110
    part = analytic_part(rounded_pocket(n, rotation([3, 4, 1], 28.0)))
    assert all(isinstance(s, Plane) for s in part.surfaces) and len(part.surfaces) == 11
    assert [b.radius / n for b in part.blends] == pytest.approx([0.07] * 8, abs=0.005)


@pytest.mark.parametrize("turn", [np.eye(3), rotation([1, 2, 5], 33.0)], ids=["along the grid", "turned"])
def test_the_ends_of_a_thin_tube_are_planes(turn):
    n = 100
    x, y, z = np.moveaxis(centres(n) @ turn, -1, 0)
    wall = (np.hypot(x, y) < 0.25 * n) & (np.hypot(x, y) > 0.2 * n)
    part = analytic_part(VoxelGrid(solid=wall & (np.abs(z) < 0.3 * n), name="tube"))
    ends = [s for s in part.surfaces if isinstance(s, Plane)]
    assert sorted(s.radius / n for s in part.surfaces if isinstance(s, Cylinder)) == pytest.approx(
        [0.2, 0.25], abs=3e-3
    )
    assert len(ends) == len(part.surfaces) - 2 == 2
    assert all(abs(s.normal_vector @ turn[:, 2]) == pytest.approx(1.0, abs=1e-4) for s in ends)


TURNED = rotation([2, 1, 5], 38.0)


@pytest.mark.slow
@pytest.mark.parametrize("turn", [np.eye(3), TURNED], ids=["along the grid", "turned"])
def test_the_edges_of_a_rounded_block_are_twelve_blends_of_one_radius(turn):
    n = 100
    part = analytic_part(rounded_block(n, turn))
    assert sorted(type(s).__name__ for s in part.surfaces) == ["Cylinder"] + ["Plane"] * 7
    assert len({frozenset((b.first, b.second)) for b in part.blends}) == len(part.blends) == 12
    assert [b.radius / n for b in part.blends] == pytest.approx([0.1] * 12, abs=2e-3)
    middle = 0.5 * n - np.array([0.137, 0.241, 0.359])
    sizes = sorted(abs(s.distance(middle[None])[0]) / n for s in part.surfaces if isinstance(s, Plane))
    walls = [*sizes[:4], *sizes[5:]]  # told by the roundings along the grid; the top of the stub is not
    assert walls == pytest.approx([0.25, 0.25, 0.3, 0.3, 0.4, 0.4], abs=2e-3)


def test_the_rims_of_a_rounded_disk_are_blends_of_a_plane_and_a_cylinder():
    n = 90
    part = analytic_part(rounded_disk(n, TURNED))
    assert sorted(type(s).__name__ for s in part.surfaces) == ["Cylinder"] + ["Plane"] * 6
    assert {type(part.surfaces[k]) for b in part.blends for k in (b.first, b.second)} == {Plane, Cylinder}
    assert [b.radius / n for b in part.blends] == pytest.approx([0.1, 0.1], abs=2e-3)


def test_a_chamfer_is_no_rounding():
    n = 90
    p = np.abs(centres(n) @ rotation([1, 3, 2], 20.0))
    block = (p < np.array([0.35, 0.3, 0.25]) * n).all(axis=-1)
    part = analytic_part(VoxelGrid(solid=block & (p[..., 0] + p[..., 1] < 0.53 * n), name="chamfers"))
    assert [type(s) for s in part.surfaces] == [Plane] * 10
    assert not part.blends


def test_next_to_no_centre_lies_on_the_wrong_side_of_a_turned_block():
    grid = block_with_hole(80, rotation([1, 2, 3], 25.0))
    part = analytic_part(grid)
    places = grid.place(np.argwhere(np.ones(grid.solid.shape)) * grid.proportions)
    inside = np.ones(len(places), dtype=bool)
    for surface in part.surfaces:
        d = surface.distance(places)
        inside &= d > 0.0 if isinstance(surface, Cylinder) else d < 0.0
    assert (inside != grid.solid.ravel()).sum() < 20

"""The cell table and the surface that it makes."""

import numpy as np
import pytest
from generated_grids import ball, random_grid

from recon.errors import BadGeometry
from recon.geometry.voxel_grid import VoxelGrid
from recon.numerics.closed_mesh import opposite_halfedges
from recon.voxel_mesh.cell_table import CELL_EDGES, cell_table, loops_of_case
from recon.voxel_mesh.marching_cubes import marching_cubes
from recon.voxel_mesh.topology import grid_topology, kept_bodies, mesh_topology


def test_every_case_uses_exactly_the_edges_whose_ends_differ():
    for case in range(256):
        crossed = {e for e, (a, b) in enumerate(CELL_EDGES) if (case >> a & 1) != (case >> b & 1)}
        assert sorted(e for loop in loops_of_case(case) for e in loop) == sorted(crossed)


def test_no_case_draws_a_diagonal_on_a_face_of_the_cell():
    table = cell_table()
    for case in range(256):
        loops = [{frozenset(p) for p in zip(loop, loop[1:] + loop[:1])} for loop in loops_of_case(case)]
        sides = set().union(*loops) if loops else set()
        for t in table.triangles[case, : table.counts[case]].tolist():
            for a, b in zip(t, t[1:] + t[:1]):
                ends = set(CELL_EDGES[a]) | set(CELL_EDGES[b])
                on_a_face = any(len({c >> axis & 1 for c in ends}) == 1 for axis in range(3))
                assert frozenset((a, b)) in sides or not on_a_face


@pytest.mark.parametrize("case", range(256))
def test_every_case_alone_in_a_grid_is_a_closed_manifold(case):
    solid = np.array([case >> c & 1 for c in range(8)], dtype=bool).reshape(2, 2, 2, order="F")
    for grid in (np.pad(solid, 2), ~np.pad(~solid, 2)):
        padded = np.pad(grid, 1)
        if padded.any():
            surface = marching_cubes(VoxelGrid(solid=padded))
            opposite_halfedges(surface.vertices, surface.face_vertices)


@pytest.mark.parametrize("seed", range(40))
def test_bodies_cavities_and_genus_of_noise_are_those_of_its_voxels(seed):
    grid = random_grid(seed)
    surface = marching_cubes(grid)
    opposite_halfedges(surface.vertices, surface.face_vertices)
    assert mesh_topology(surface.vertices, surface.face_vertices) == grid_topology(grid.solid)


def test_each_vertex_lies_halfway_along_the_grid_edge_it_keeps():
    grid = random_grid(3)
    s = marching_cubes(grid)
    step = np.eye(3, dtype=int)[s.edge_axis]
    assert np.allclose(s.vertices, s.edge_voxel + 0.5 * step)
    padded = np.pad(grid.solid, 1)
    low, high = padded[tuple((s.edge_voxel + 1).T)], padded[tuple((s.edge_voxel + 1 + step).T)]
    assert (low != high).all()
    assert (low == s.solid_below).all()
    assert grid.solid[tuple(s.solid_voxels().T)].all()


def test_anisotropic_voxels_give_the_ball_its_volume():
    grid = ball(24, 9.0, spacing=(1.0, 0.5, 2.0))
    s = marching_cubes(grid)
    mesh = grid.placed(s.vertices, s.face_vertices)
    assert mesh.volume() == pytest.approx(4 / 3 * np.pi * 9.0**3, rel=0.02)
    assert np.linalg.norm(mesh.vertices - mesh.vertices.mean(axis=0), axis=1) == pytest.approx(9.0, abs=1.2)


def test_left_handed_axes_do_not_turn_the_solid_inside_out():
    grid = ball(16, 6.0)
    mirrored = VoxelGrid(grid.spacing, grid.origin, np.diag([1.0, 1.0, -1.0]), "mirrored", grid.solid)
    s = marching_cubes(mirrored)
    assert mirrored.placed(s.vertices, s.face_vertices).volume() > 0


def test_bodies_that_touch_along_an_edge_stay_two():
    solid = np.zeros((6, 6, 6), dtype=bool)
    solid[1:3, 1:3, 1:3] = solid[3:5, 3:5, 1:3] = True
    topology = grid_topology(solid)
    s = marching_cubes(VoxelGrid(solid=solid))
    assert topology == mesh_topology(s.vertices, s.face_vertices)
    assert topology.bodies == 2


def test_specks_are_dropped_and_told():
    solid = np.zeros((12, 6, 6), dtype=bool)
    solid[1:5, 1:5, 1:5], solid[7:9, 1:3, 1:3], solid[10, 4, 4] = True, True, True
    kept, dropped = kept_bodies(solid, min_voxels=5)
    assert (kept.sum(), dropped.tolist()) == (72, [1])
    assert kept_bodies(solid, largest=True)[1].tolist() == [8, 1]


@pytest.mark.parametrize("value", [True, False])
def test_a_grid_without_a_boundary_is_refused(value):
    with pytest.raises(BadGeometry, match="voxel is solid"):
        VoxelGrid(solid=np.full((3, 3, 3), value))

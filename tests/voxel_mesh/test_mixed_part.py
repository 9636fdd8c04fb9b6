"""True faces and triangles of one surface, with common edges."""

from dataclasses import replace

import numpy as np
import pytest
from generated_grids import ball, block_with_hole, centres, rotation

from recon.geometry.analytic import Cylinder, Plane
from recon.geometry.voxel_grid import VoxelGrid
from recon.voxel_mesh.analytic_part import analytic_part, free_part
from recon.voxel_mesh.marching_cubes import marching_cubes
from recon.voxel_mesh.mixed_part import mixed_boundary
from recon.voxel_mesh.revoxelise import wrong_side
from recon.voxel_mesh.simplify import collapsed_between
from recon.voxel_mesh.terraces import without_terraces
from recon.voxel_mesh.topology import mesh_topology

N = 56
SKEW = rotation([1, 2, 3], 25.0)


def lumpy_block(turn: np.ndarray) -> VoxelGrid:
    """The block with a hole, 0.7 x 0.5 x 0.4 N, and on its top a lump that is no surface with a formula."""
    x, y, z = np.moveaxis(centres(N) @ turn, -1, 0)
    lump = ((x + 0.19 * N) / (0.14 * N)) ** 4 + (y / (0.18 * N)) ** 2 + (z / (0.38 * N)) ** 2 < 1.0
    return VoxelGrid(solid=block_with_hole(N, turn).solid | (lump & (z > 0.0)), name="lumpy block")


@pytest.fixture(scope="module", params=[np.eye(3), SKEW], ids=["along the grid", "turned"])
def lumpy(request):
    part = analytic_part(lumpy_block(request.param))
    return part.mixed, mixed_boundary(part.mixed, 0.1), request.param, len(part.surfaces)


def test_every_edge_is_run_through_once_each_way(lumpy):
    boundary = lumpy[1]
    uses = [use for face in boundary.faces for loop in face.loops for use in loop]
    assert len(uses) == len(set(uses)) == 2 * len(boundary.edges)


def test_the_block_and_its_hole_are_true_faces_and_the_lump_is_triangles(lumpy):
    _, boundary, turn, _ = lumpy
    kinds = [type(boundary.surfaces[f.surface]) for f in boundary.faces if f.surface is not None]
    assert (kinds.count(Plane), kinds.count(Cylinder), len(kinds)) == (6, 1, 7)
    assert boundary.n_triangles > 50
    rows, patch = boundary.triangles()
    middle = 0.5 * N - np.array([0.137, 0.241, 0.359])
    sizes = np.bincount(patch)
    lump = int(sizes.argmax())
    assert sizes.sum() - sizes[lump] < 30  # a corner of the block may be left open
    places = (boundary.vertices[np.unique(rows[patch == lump])] - middle) @ turn
    assert np.abs(places[:, 0] + 0.19 * N).max() < 0.14 * N + 2.0
    assert np.abs(places[:, 1]).max() < 0.18 * N + 2.0


def test_edges_lie_on_the_surfaces_of_their_faces(lumpy):
    boundary = lumpy[1]
    for face in boundary.faces:
        if face.surface is not None:
            for edge in {e for loop in face.loops for e, _ in loop}:
                one = boundary.edges[edge]
                ends = boundary.vertices[[one.start, one.end]]
                x = np.vstack([ends, ends.mean(axis=0)]) if one.points is None else one.points
                assert np.abs(boundary.surfaces[face.surface].distance(x)).max() <= boundary.slack


def test_loops_run_on_from_edge_to_edge(lumpy):
    boundary = lumpy[1]
    for face in boundary.faces:
        for loop in face.loops:
            ways = [(boundary.edges[e].start, boundary.edges[e].end)[:: 1 if way else -1] for e, way in loop]
            assert all(ways[k - 1][1] == ways[k][0] for k in range(len(ways)))


def test_a_whole_ball_is_one_sphere_without_edges():
    boundary = mixed_boundary(analytic_part(ball(40, 15.0)).mixed, 0.1)
    assert (len(boundary.faces), len(boundary.edges), len(boundary.vertices)) == (1, 0, 0)


def test_sheets_that_the_kernel_refuses_are_left_to_triangles(lumpy):
    part, boundary, _, _ = lumpy
    holes = [k for k, sheet in enumerate(part.sheets) if isinstance(sheet.surface, Cylinder)]
    rest = mixed_boundary(part.without(holes), 0.1)
    assert all(isinstance(surface, Plane) for surface in rest.surfaces)
    assert rest.n_triangles > boundary.n_triangles


def test_a_part_without_sheets_is_triangles_with_every_centre_on_its_side():
    grid = ball(40, 15.0, (1.0, 1.0, 2.0))
    boundary = mixed_boundary(free_part(grid), 0.1)
    rows, _ = boundary.triangles()
    assert len(rows) == len(boundary.faces) < 0.7 * len(marching_cubes(grid).face_vertices)
    assert mesh_topology(boundary.vertices, rows) == (1, 0, 0)
    assert wrong_side(grid, _mesh(boundary.vertices, rows)).centres == 0
    middle = 20.0 - np.array([0.137, 0.241, 0.359])
    off = np.linalg.norm(boundary.vertices - middle * np.ones(3), axis=1) - 15.0
    assert np.sqrt((off**2).mean()) < 0.2


def _mesh(vertices, rows):
    from recon.geometry.mesh import TriangleMesh

    return TriangleMesh(vertices, rows)


def test_what_is_not_free_stays_where_it_is():
    grid = block_with_hole(40, SKEW)
    surface = marching_cubes(grid)
    place = without_terraces(surface, grid.proportions)
    faces = surface.face_vertices
    free = place[faces].mean(axis=1)[:, 0] > 20.0
    there, rows, left = collapsed_between(surface, place, grid.proportions, free=free, tolerance=0.2)
    kept = np.unique(faces[~free])
    assert (there[kept] == place[kept]).all()
    assert free[left].all() and len(rows) == len(left) < 0.6 * free.sum()
    whole = np.concatenate([faces[~free], rows])
    assert mesh_topology(there, whole) == mesh_topology(place, faces)
    assert wrong_side(grid, _mesh(*_used(there, whole))).centres == 0


def _used(vertices, rows):
    used, numbers = np.unique(rows, return_inverse=True)
    return vertices[used], numbers.reshape(-1, 3)


def test_a_surface_that_misses_voxels_is_no_sheet(lumpy):
    part, _, _, n_surfaces = lumpy
    assert len(part.sheets) == 7 < n_surfaces
    sheet = next(sheet for sheet in part.sheets if isinstance(sheet.surface, Plane))
    assert (sheet.depth(part.ends, sheet.members) > 0.0).mean() < 0.04
    shifted = replace(sheet, surface=Plane(sheet.surface.normal_vector, sheet.surface.offset + 0.6))
    assert (shifted.depth(part.ends, sheet.members) > 0.0).mean() > 0.2

"""What the constrained collapse promises, on shapes with edges, curves, noise and thin walls."""

import numpy as np
import pytest
from generated_grids import ball, block_with_hole, random_grid, rotation

from recon.errors import BadOption
from recon.geometry.voxel_grid import VoxelGrid
from recon.numerics.closed_mesh import opposite_halfedges
from recon.numerics.distance import hausdorff_distance
from recon.numerics.self_intersection import crossing_triangles
from recon.voxel_mesh.pipeline import VoxelOptions, voxel_boundary

GRIDS = {
    "ball": ball(28, 11.0),
    "flat ball": ball(28, 11.0, spacing=(1.0, 1.0, 1.7)),
    "block with a hole": block_with_hole(40),
    "turned block": block_with_hole(40, rotation([1, 2, 3], 25.0)),
    "noise": random_grid(1),
}


@pytest.mark.parametrize("grid", GRIDS.values(), ids=GRIDS)
@pytest.mark.parametrize("tolerance", [0.3, 0.5])
def test_the_error_stays_within_the_tolerance_and_the_surface_whole(grid, tolerance):
    found = voxel_boundary(grid, VoxelOptions(tolerance=tolerance))
    vertices, faces = found.mesh.vertices, found.mesh.face_vertices
    own = grid.placed(found.surface.vertices, found.surface.face_vertices)
    opposite_halfedges(vertices, faces)
    assert len(crossing_triangles(vertices, faces)[0]) == 0
    error = hausdorff_distance((vertices, faces), (own.vertices, own.face_vertices), n_samples=30_000)
    assert error <= (tolerance + 0.02) * grid.voxel
    assert grid.name == "noise" or found.mesh.n_faces < 0.6 * own.n_faces


def test_an_upright_block_becomes_flat_faces_without_any_error():
    solid = np.zeros((30, 20, 16), dtype=bool)
    solid[3:26, 4:15, 3:12] = True
    found = voxel_boundary(VoxelGrid(solid=solid), VoxelOptions(tolerance=0.05))
    assert found.reduction > 0.9
    assert found.errors.max() <= 0.05


@pytest.mark.parametrize("options", [{"n_faces": 300}, {"reduction": 0.85}])
def test_the_collapse_stops_where_it_was_told(options):
    found = voxel_boundary(GRIDS["turned block"], VoxelOptions(tolerance=None, **options))
    wanted = options.get("n_faces") or round(0.15 * len(found.surface.face_vertices))
    assert abs(found.mesh.n_faces - wanted) <= 1


def test_feature_points_never_move():
    grid = GRIDS["turned block"]
    found = voxel_boundary(grid, VoxelOptions(features=True, reduction=0.7))
    assert found.n_features_kept > 0
    own = {tuple(v) for v in grid.place(found.surface.vertices).round(9).tolist()}
    kept = sum(tuple(v) in own for v in found.mesh.vertices.round(9).tolist())
    assert kept >= found.n_features_kept


@pytest.mark.parametrize(
    "options",
    [{"tolerance": 0.0}, {"n_faces": 3}, {"reduction": 1.0}, {"n_faces": 10, "reduction": 0.5}, {"tolerance": None}],
)
def test_options_that_make_no_sense_are_refused(options):
    with pytest.raises(BadOption):
        VoxelOptions(**options)

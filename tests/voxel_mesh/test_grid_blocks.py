"""Boundaries made block by block: what they share with those of the whole grid, and that no block leaves a trace."""

import numpy as np
import pytest
from generated_grids import ball, block_with_hole, flange, random_grid, rotation

from recon.errors import BadGeometry, BadOption
from recon.geometry.volume_source import SolidSource, VolumeSource, solid_source, source_labels
from recon.geometry.voxel_grid import Volume, VoxelGrid
from recon.numerics.closed_mesh import opposite_halfedges
from recon.numerics.distance import hausdorff_distance
from recon.numerics.open_patch import closed_off
from recon.numerics.self_intersection import crossing_triangles
from recon.voxel_mesh.block_bodies import body_table, wanted_bodies, write_bodies
from recon.voxel_mesh.block_collapse import Terms, collapse_block
from recon.voxel_mesh.block_lattice import block_lattice
from recon.voxel_mesh.block_topology import grid_count
from recon.voxel_mesh.blocks import blocks_of, boundary_by_blocks
from recon.voxel_mesh.marching_cubes import marching_cubes, window_surface
from recon.voxel_mesh.pipeline import VoxelOptions, voxel_boundary
from recon.voxel_mesh.topology import grid_topology, kept_bodies


def source_of(grid: VoxelGrid) -> SolidSource:
    volume = Volume(grid.spacing, grid.origin, grid.direction, grid.name, grid.solid.astype(np.uint8))
    return solid_source(VolumeSource.of(volume))


def shells(seed: int) -> VoxelGrid:
    """Balls in hollow balls, some of which reach into each other: bodies, cavities and handles across many planes."""
    rng = np.random.default_rng(seed)
    x = np.stack(np.meshgrid(*[np.arange(48.0)] * 3, indexing="ij"), axis=-1)
    solid = np.zeros((48, 48, 48), dtype=bool)
    for _ in range(7):
        away = np.linalg.norm(x - rng.uniform(9, 39, 3), axis=-1)
        radius = rng.uniform(5, 12)
        solid[away < radius] = True
        solid[away < radius - 3.0] = False
    return VoxelGrid(solid=solid, name="shells")


GRIDS = {
    "ball": ball(44, 20.0),
    "flat ball": ball(44, 20.0, spacing=(1.0, 1.0, 1.7)),
    "turned block": block_with_hole(52, rotation([1, 2, 3], 25.0)),
    "flange": flange(48),
    "shells": shells(3),
}


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize(("size", "shift"), [(3, 0), (4, 2), (5, 1), (100, 0)])
def test_bodies_cavities_and_handles_are_counted_as_in_the_whole(seed, size, shift):
    grid = random_grid(seed)
    count = grid_count(source_of(grid), block_lattice(grid.solid.shape, size, shifts=(shift, shift, 0)))
    assert count.topology == grid_topology(grid.solid)
    assert count.voxels == grid.solid.sum()
    assert count.faces == len(marching_cubes(grid).face_vertices)


def test_the_surfaces_of_windows_are_together_that_of_the_whole_to_the_last_bit():
    grid = random_grid(5)
    whole, solid = marching_cubes(grid), source_of(grid)
    lattice = block_lattice(grid.solid.shape, 4, shifts=(1, 2, 3))
    parts = []
    for block in lattice.blocks():
        low, stop = lattice.extent(block)
        part = window_surface(solid.window(low, stop + 1), low, solid.proportions)
        parts.append(part.vertices[part.face_vertices])
    corners = np.concatenate(parts).reshape(-1, 9)
    assert sorted(corners.tolist()) == sorted(whole.vertices[whole.face_vertices].reshape(-1, 9).tolist())


def test_a_patch_that_touches_itself_at_a_vertex_is_closed_off_fan_by_fan():
    faces = np.array([[0, 1, 2], [0, 2, 3], [0, 4, 5], [6, 7, 8]])
    closed = closed_off(faces, 9)
    sides = np.arange(closed.faces.size)
    assert (closed.twin[closed.twin] == sides).all() and (closed.twin != sides).all()
    start, end = closed.faces.ravel(), np.roll(closed.faces, -1, axis=1).ravel()
    assert (start[closed.twin] == end).all()
    assert closed.border.all()
    turned, around = 0, 0  # the fan of 0, 1, 2, 3 alone: two faces and the two beyond its sides
    while not around or turned:
        turned, around = closed.twin[turned - turned % 3 + (turned + 2) % 3], around + 1
    assert around == 4


@pytest.mark.parametrize("grid", GRIDS.values(), ids=GRIDS)
def test_the_boundary_by_blocks_keeps_what_that_of_the_whole_keeps(grid):
    whole, found = voxel_boundary(grid), boundary_by_blocks(source_of(grid), size=24)
    assert found.count.topology == whole.topology
    vertices, faces = found.mesh.vertices, found.mesh.face_vertices
    opposite_halfedges(vertices, faces)
    assert len(crossing_triangles(vertices, faces)[0]) == 0
    own = grid.placed(whole.surface.vertices, whole.surface.face_vertices)
    error = hausdorff_distance((vertices, faces), (own.vertices, own.face_vertices), n_samples=30_000)
    assert error <= 0.52 * grid.voxel
    assert abs(error - found.errors.max() * grid.voxel) < 0.1 * grid.voxel
    assert found.mesh.volume() == pytest.approx(whole.mesh.volume(), rel=0.01)
    assert found.mesh.n_faces < 1.6 * whole.mesh.n_faces  # faces no longer than a quarter of 24 voxels


def test_neither_order_nor_workers_change_a_byte():
    from concurrent.futures import ThreadPoolExecutor

    def backwards(function, *sequences):
        return [function(*given) for given in reversed(list(zip(*sequences)))][::-1]

    solid = source_of(GRIDS["turned block"])
    with ThreadPoolExecutor(3) as pool:
        one, *others = [boundary_by_blocks(solid, size=24, each=each) for each in (map, backwards, pool.map)]
    for other in others:
        assert other.mesh.vertices.tobytes() == one.mesh.vertices.tobytes()
        assert other.mesh.face_vertices.tobytes() == one.mesh.face_vertices.tobytes()
        assert other.errors.tobytes() == one.errors.tobytes()


def test_seams_are_no_finer_than_the_rest():
    grid = ball(72, 33.0)
    solid = source_of(grid)
    found = boundary_by_blocks(solid, size=40)
    planes = np.concatenate([blocks_of(solid.shape, 40, shift).cuts[0][1:-1] for shift in (0.0, 0.5, 0.25)])

    def near(vertices):
        away = np.abs(vertices[:, :, None] - planes).min(axis=(1, 2))
        return float((away < 1.0).mean())

    middles = [m.vertices[m.face_vertices].mean(axis=1) for m in (found.mesh, voxel_boundary(grid).mesh)]
    assert near(middles[0]) < 1.25 * near(middles[1])


def test_a_place_that_is_kept_does_not_change():
    grid = GRIDS["ball"]
    solid = source_of(grid)
    lattice = blocks_of(solid.shape, 32)
    place = marching_cubes(grid).vertices[:1]
    terms = Terms(0.5, 0.0, np.inf)
    block = lattice.blocks()[lattice.block_numbers(place)[0]]
    found = collapse_block(solid, lattice, terms, block, place)
    assert (np.abs(found.vertices - place).max(axis=1) == 0.0).any()


@pytest.mark.parametrize("options", [{"reduction": 0.8}, {"n_faces": 2000}, {"tolerance": None, "reduction": 0.9}])
def test_the_share_that_goes_is_the_one_that_was_asked_for(options):
    grid = GRIDS["ball"]
    n = len(marching_cubes(grid).face_vertices)
    wanted = options.get("n_faces") or round((1.0 - options["reduction"]) * n)
    found = boundary_by_blocks(source_of(grid), VoxelOptions(**options), size=32)
    assert found.mesh.n_faces == pytest.approx(wanted, rel=0.05)


def test_a_left_handed_grid_stays_outside_out():
    grid = ball(40, 15.0)
    mirrored = VoxelGrid(grid.spacing, grid.origin, np.diag([1.0, 1.0, -1.0]), "mirrored", grid.solid)
    assert boundary_by_blocks(source_of(mirrored), size=16).mesh.volume() > 0


def test_what_is_solid_is_told_as_of_the_whole():
    values = np.zeros((20, 20, 20), dtype=np.uint8)
    values[4:9, 4:9, 4:9], values[12:17, 4:9, 4:9] = 3, 200
    source = VolumeSource.of(Volume(values=values))
    low, stop = np.full(3, -2), np.full(3, 25)
    assert solid_source(source, threshold=3).window(low, stop).sum() == 250
    assert solid_source(source, label=3).window(low, stop).sum() == 125
    assert source_labels(source) == [3, 200]
    with pytest.raises(BadOption, match="not binary"):
        solid_source(source)
    with pytest.raises(BadOption, match="not both"):
        solid_source(source, threshold=3, label=3)


def test_what_makes_no_sense_is_refused():
    solid = source_of(GRIDS["ball"])
    with pytest.raises(BadOption, match="--block"):
        boundary_by_blocks(solid, size=8)
    with pytest.raises(BadOption, match="whole grid"):
        boundary_by_blocks(solid, VoxelOptions(features=True))
    for fill, says in ((0, "no voxel"), (1, "every voxel")):
        plain = VolumeSource.of(Volume(values=np.full((20, 20, 20), fill)))
        with pytest.raises(BadGeometry, match=says):
            boundary_by_blocks(solid_source(plain), size=16)


@pytest.mark.parametrize("options", [{"largest": True}, {"min_voxels": 5}])
def test_bodies_are_dropped_as_from_the_whole(tmp_path, options):
    grid = random_grid(2, (17, 15, 19))
    solid, lattice = source_of(grid), block_lattice(grid.solid.shape, 6)
    table = body_table(solid, lattice)
    write_bodies(solid, lattice, table, wanted_bodies(table, **options), tmp_path / "kept.npy")
    kept, dropped = kept_bodies(grid.solid, **options)
    assert (np.load(tmp_path / "kept.npy") == kept).all()
    assert sorted(table.sizes[~wanted_bodies(table, **options)].tolist(), reverse=True) == dropped.tolist()

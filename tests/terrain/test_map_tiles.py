"""Tiles of a large map: what neighbours share, that they join, that nothing depends on which are made."""

import numpy as np
import pytest
from generated_mountains import mountain_grid

from brep_export.app.terrain_job import TOLERANCE, lowest_place
from brep_export.blocks import block_solid
from brep_export.check import ShapeKind, check
from recon.errors import BadGeometry, BadOption
from recon.geometry.contour_map import HeightGrid
from recon.geometry.height_source import HeightSource
from recon.terrain import pipeline
from recon.terrain.contouring import contour_grid
from recon.terrain.evaluation import edge_angles, elevations
from recon.terrain.map_tiles import MapTiles, cells_within, plan_tiles
from recon.terrain.network import border_angles, joined_network, terrain_network
from recon.terrain.pipeline import PatchKind, TerrainOptions, terrain_surface

INTERVAL, SIZE = 10.0, 400.0


def rough_grid(seed, n=121, cell=10.0):
    """Fractal heights between 0 and 120 m."""
    random = np.random.default_rng(seed)
    k = np.hypot(*np.meshgrid(np.fft.fftfreq(n), np.fft.fftfreq(n)))
    k[0, 0] = np.inf
    z = np.fft.ifft2(np.fft.fft2(random.normal(size=(n, n))) * k**-2.6).real
    return HeightGrid(cell * np.arange(n), cell * np.arange(n), 0.1 * n * cell * (z - z.min()) / np.ptp(z))


def tiles_of(grid):
    return MapTiles(plan_tiles(HeightSource.of(grid), INTERVAL, SIZE))


@pytest.fixture(scope="module")
def grounds():
    tiles = tiles_of(rough_grid(3))
    assert tiles.plan.shape == (3, 3)
    return {(r, c): tiles.tile((r, c)) for r in range(3) for c in range(3)}


def test_nine_tiles_join_to_one_closed_solid_whose_top_is_smooth_across_their_borders(grounds):
    networks = [terrain_network(ground) for ground in grounds.values()]
    assert np.degrees(border_angles(networks).max()) < 1e-6
    assert len(border_angles(networks)) > 100
    whole = joined_network(networks)
    report = check(block_solid(whole, lowest_place(whole) - 20, TOLERANCE), TOLERANCE, expect=ShapeKind.SOLID)
    assert report.defects == ()
    assert report.as_json()["closed"]
    assert report.as_json()["solids"] == 1
    assert len(whole.patches) + 5 == report.as_json()["faces"]  # four walls and the base: no wall within


def test_neighbours_have_the_same_vertices_with_the_same_jets_to_the_last_bit(grounds):
    west, east = grounds[1, 1], grounds[1, 2]
    x = west.extent[1, 0]
    assert x == east.extent[0, 0]
    rows = []
    for ground in (west, east):
        on = np.flatnonzero(ground.tiling.points[:, 0] == x)
        on = on[np.argsort(ground.tiling.points[on, 1])]
        jets = ground.jets
        flat = [ground.tiling.points[on], jets.height[on, None], jets.gradient[on], jets.hessian[on].reshape(-1, 4)]
        rows.append(np.column_stack(flat))
    assert len(rows[0]) > 8
    np.testing.assert_array_equal(*rows)


def test_a_tile_is_the_same_whichever_others_were_made_before(grounds):
    alone = tiles_of(rough_grid(3)).tile((1, 1))
    for one, other in zip(alone.nets, grounds[1, 1].nets, strict=True):
        np.testing.assert_array_equal(one.nets, other.nets)


def test_a_tile_looks_no_farther_than_its_margin():
    grid = rough_grid(3)
    heights = grid.heights.copy()
    heights[-20:, :] += (
        40.0 * np.linspace(0.0, 1.0, 20)[:, None]
    )  # far north of the southern row of tiles and its margin
    near = tiles_of(grid).tile((2, 0))
    far = tiles_of(HeightGrid(grid.x, grid.y, heights)).tile((2, 0))
    for one, other in zip(near.nets, far.nets, strict=True):
        np.testing.assert_array_equal(one.nets, other.nets)


@pytest.mark.parametrize("tile", [(0, 0), (1, 1), (2, 1)])
def test_the_heights_near_a_tile_are_all_that_it_needs(tile):
    plan = tiles_of(rough_grid(3, 241)).plan
    near = plan.near(tile)
    held = near.source.read.heights.size
    assert held < plan.source.read.heights.size / 2
    for one, other in zip(MapTiles(near).tile(tile).nets, MapTiles(plan).tile(tile).nets, strict=True):
        np.testing.assert_array_equal(one.nets, other.nets)


def test_a_box_keeps_the_cells_within_it_and_nothing_beyond_is_read():
    grid = rough_grid(3)
    read = []

    def heights(rows, columns):
        read.append((rows.start, rows.stop, columns.start, columns.stop))
        return grid.heights[rows, columns]

    source = HeightSource(grid.x, grid.y, "", heights)
    part = cells_within(source, np.array([[101.0, 200.0], [899.0, 730.0]]))
    assert (part.x[0], part.x[-1], part.y[0], part.y[-1]) == (110.0, 890.0, 200.0, 730.0)
    tiles = MapTiles(plan_tiles(part, INTERVAL, SIZE))
    assert tiles.plan.shape == (1, 2)
    cut = HeightGrid(grid.x[11:90], grid.y[20:74], grid.heights[20:74, 11:90])
    alone = MapTiles(plan_tiles(HeightSource.of(cut), INTERVAL, SIZE))
    for one, other in zip(tiles.tile((0, 1)).nets, alone.tile((0, 1)).nets, strict=True):
        np.testing.assert_array_equal(one.nets, other.nets)
    south, north, west, east = np.array(read).T
    assert (south.min(), north.max(), west.min(), east.max()) == (20, 74, 11, 90)


@pytest.mark.parametrize("off", [-1e-7, 0.0, 1e-7])
def test_a_side_of_a_box_on_a_grid_line_keeps_it(off):
    grid = rough_grid(3)
    part = cells_within(HeightSource.of(grid), np.array([[100.0 - off, 100.0], [500.0, 400.0 + off]]))
    assert (part.x[0], part.y[-1]) == (100.0, 400.0)


@pytest.mark.parametrize(
    ("box", "told"),
    [
        ([[5000.0, 0.0], [6000.0, 900.0]], "no place in common"),
        ([[900.0, 0.0], [100.0, 900.0]], "no place in common"),
        ([[np.nan, 0.0], [900.0, 900.0]], "no place in common"),
        ([[101.0, 0.0], [265.0, 900.0]], "holds 15 by 90 cells"),
        ([[101.0, 0.0], [104.0, 900.0]], "holds 0 by 90 cells"),
    ],
)
def test_a_box_without_room_for_a_tile_is_refused(box, told):
    with pytest.raises(BadOption, match=f"--clip: .*{told}"):
        cells_within(HeightSource.of(rough_grid(3)), np.array(box))


def test_the_ground_by_tiles_is_as_near_to_the_heights_as_the_whole_one(grounds):
    grid = rough_grid(3)
    places, heights = grid.places()
    miss = np.full(len(heights), np.nan)
    for ground in grounds.values():
        z = elevations(ground, places)[0]
        miss = np.where(np.isfinite(z), z - heights, miss)
    whole = elevations(terrain_surface(contour_grid(grid, INTERVAL)), places)[0] - heights
    assert np.isfinite(miss).all()
    assert np.sqrt((miss**2).mean()) < 1.1 * np.sqrt((whole**2).mean())


@pytest.mark.parametrize("seed", [1, 2])
def test_every_tile_of_a_smooth_mountain_is_smooth_and_closes_alone(seed):
    tiles = MapTiles(plan_tiles(HeightSource.of(mountain_grid(seed)), 5.0, 250.0))
    ground = tiles.tile((0, 1))
    assert np.degrees(edge_angles(ground).max()) < 1e-5
    network = terrain_network(ground)
    report = check(block_solid(network, lowest_place(network) - 5, TOLERANCE), TOLERANCE, expect=ShapeKind.SOLID)
    assert report.defects == ()


def test_the_slope_at_a_corner_that_is_a_side_is_that_of_the_ground():
    ground = terrain_surface(contour_grid(mountain_grid(1), INTERVAL))
    vertices = np.unique(ground.layout.corners[ground.layout.is_triangle, 2])
    found = elevations(ground, ground.tiling.points[vertices] + ground.origin)[1]
    np.testing.assert_allclose(found, ground.jets.gradient[vertices], atol=1e-4)


def test_tiles_away_from_a_void_are_those_of_the_full_grid(grounds):
    grid = rough_grid(3)
    heights = grid.heights.copy()
    heights[5, 7] = np.nan  # in the south west
    tiles = tiles_of(HeightGrid(grid.x, grid.y, heights))
    ground = tiles.tile((0, 2))
    np.testing.assert_array_equal(ground.tiling.points, grounds[0, 2].tiling.points)
    np.testing.assert_array_equal(ground.jets.height, grounds[0, 2].jets.height)
    with pytest.raises(BadGeometry, match=r"no height is known at \(70.0, 50.0\)"):
        tiles.tile((2, 0))


def test_a_tile_whose_patches_are_made_again_finer_keeps_its_border(grounds, monkeypatch):
    limited, calls = pipeline.limited_jets, []

    def first_patch_astray(*arguments):
        calls.append(len(arguments[1].corners))
        jets, nets, _ = limited(*arguments)
        return jets, nets, np.arange(2 - len(calls))

    tiles = tiles_of(rough_grid(3))
    border = tiles.around((1, 1))
    monkeypatch.setattr(pipeline, "limited_jets", first_patch_astray)
    ground = tiles.tile((1, 1))
    assert calls == [grounds[1, 1].n_patches, ground.n_patches]
    assert calls[1] > calls[0]
    assert border.points.tobytes() == ground.tiling.points[_rows_of(border.points, ground.tiling.points)].tobytes()


def _rows_of(places, points):
    return [int(np.flatnonzero((points == place).all(axis=1))[0]) for place in places]


def test_gregory_tiles_meet_within_the_angle_and_close():
    options = TerrainOptions(patches=PatchKind.GREGORY, angle=0.1)
    tiles = MapTiles(plan_tiles(HeightSource.of(mountain_grid(1)), 5.0, 250.0, options))
    rows, columns = tiles.plan.shape
    grounds = [tiles.tile((r, c)) for r in range(rows) for c in range(columns)]
    networks = [terrain_network(ground) for ground in grounds]
    assert len(border_angles(networks)) > 20
    assert np.degrees(border_angles(networks).max()) < 0.1
    whole = joined_network(networks)
    report = check(block_solid(whole, lowest_place(whole) - 5, TOLERANCE), TOLERANCE, expect=ShapeKind.SOLID)
    assert report.defects == ()
    assert len(whole.patches) + 5 == report.as_json()["faces"]


def test_grids_without_heights_or_contours_and_too_small_tiles_are_refused():
    grid = rough_grid(1)
    with pytest.raises(BadGeometry, match="no height"):
        plan_tiles(HeightSource(grid.x, grid.y, "", lambda r, c: np.full_like(grid.heights, np.nan)[r, c]), 10.0, SIZE)
    with pytest.raises(BadOption, match="--tile"):
        plan_tiles(HeightSource.of(grid), INTERVAL, 100.0)
    with pytest.raises(BadOption, match="no contour"):
        plan_tiles(HeightSource.of(grid), 1000.0, SIZE)

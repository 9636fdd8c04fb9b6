"""Spot heights between contours, and voids that stay holes."""

import numpy as np
import pytest
import shapely
from generated_mountains import mountain_contours, mountain_grid
from scipy.interpolate import RegularGridInterpolator

from brep_export.app.terrain_job import TOLERANCE, lowest_place
from brep_export.blocks import block_solid
from brep_export.check import check
from recon.errors import BadGeometry, BadOption
from recon.geometry.contour_map import ContourMap, HeightGrid
from recon.terrain.clipping import clip_to_polygon
from recon.terrain.contouring import contour_grid, largest_piece
from recon.terrain.evaluation import edge_angles, elevations, sampled_triangles
from recon.terrain.network import terrain_network
from recon.terrain.pipeline import TerrainOptions, terrain_surface

INTERVAL = 20.0


def spots(seed, n=40):
    grid = mountain_grid(seed)
    places = np.random.default_rng(seed).uniform([40, 40], [560, 400], (n, 2))
    heights = RegularGridInterpolator((grid.y, grid.x), grid.heights, method="cubic")(places[:, ::-1])
    return np.column_stack([places, heights])


def rmse(seed, ground):
    places, heights = mountain_grid(seed).places()
    return np.sqrt(np.nanmean((elevations(ground, places)[0] - heights) ** 2))


@pytest.mark.parametrize("seed", [1, 3])
def test_the_ground_runs_through_spot_heights_and_comes_nearer_to_the_mountain(seed):
    contours, known = mountain_contours(seed, INTERVAL), spots(seed)
    without = terrain_surface(contours)
    ground = terrain_surface(contours.with_spots(known))
    kept = ground.tiling.spots + np.r_[ground.origin, 0.0]
    assert len(kept) >= 30
    assert np.abs(elevations(ground, kept[:, :2])[0] - kept[:, 2]).max() < 1e-6
    assert rmse(seed, ground) < 0.8 * rmse(seed, without)


def test_a_spot_on_a_contour_says_nothing_more_and_one_that_contradicts_is_refused_or_left_out():
    contours = mountain_contours(1, INTERVAL)
    x, y = contours.lines[0][len(contours.lines[0]) // 2]
    height = float(contours.heights[0])
    ground = terrain_surface(contours.with_spots([[x, y, height + 0.1]]))
    assert any("1 spot heights lie on contours" in note for note in ground.notes)
    assert len(ground.tiling.spots) == 0
    wrong = contours.with_spots([[x, y, height + 15.0]])
    with pytest.raises(BadGeometry, match="lies on a contour of another height"):
        terrain_surface(wrong)
    assert len(terrain_surface(wrong, TerrainOptions(mend=True)).tiling.spots) == 0


def test_a_spot_beyond_the_contours_on_either_side_is_refused_or_left_out():
    x = np.linspace(0.0, 100.0, 11)
    lines = [np.column_stack([x, np.full(11, y)]) for y in (10.0, 50.0, 90.0)]
    strips = ContourMap(lines, [10.0, 20.0, 30.0], [[0.0, 0.0], [100.0, 100.0]])
    wrong = strips.with_spots([[50.0, 30.0, 15.0], [40.0, 70.0, 44.0]])
    with pytest.raises(BadGeometry, match=r"44 m at \(40.0, 70.0\).*not between the contours"):
        terrain_surface(wrong)
    ground = terrain_surface(wrong, TerrainOptions(mend=True))
    assert (ground.tiling.spots + np.r_[ground.origin, 0.0]).tolist() == [[50.0, 30.0, 15.0]]


def with_voids(seed):
    grid, rng = mountain_grid(seed), np.random.default_rng(seed)
    heights = grid.heights.copy()
    heights[10:17, 20:30] = heights[:5, 50:] = np.nan
    heights[rng.integers(0, 45, 8), rng.integers(0, 61, 8)] = np.nan
    return largest_piece(HeightGrid(grid.x, grid.y, heights))[0]


@pytest.mark.parametrize("seed", [1, 2, 5])
def test_voids_stay_holes_in_a_closed_block(seed):
    grid = with_voids(seed)
    contours = contour_grid(grid, 10.0)
    ground = terrain_surface(contours)
    assert len(contours.voids) >= 5
    known = grid.known_cells()
    middles = np.stack(np.meshgrid(grid.x[:-1] + 5.0, grid.y[:-1] + 5.0), axis=-1)
    heights = elevations(ground, middles.reshape(-1, 2))[0].reshape(known.shape)
    np.testing.assert_array_equal(np.isfinite(heights), known)
    points, faces = sampled_triangles(ground)
    a, b, c = (points[faces[:, k], :2] for k in range(3))
    area = ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]).sum() / 2
    assert area == pytest.approx(100.0 * known.sum(), rel=1e-9)
    network = terrain_network(ground)
    report = check(block_solid(network, lowest_place(network) - 20.0, TOLERANCE), TOLERANCE)
    assert report.passed


def polygon(seed):
    rng = np.random.default_rng(seed)
    angle, reach = np.sort(rng.uniform(0.0, 2.0 * np.pi, 9)), rng.uniform(120.0, 210.0, 9)
    ring = np.column_stack([300.0 + 1.2 * reach * np.cos(angle), 220.0 + reach * np.sin(angle)])
    return np.vstack([ring, ring[:1]])


@pytest.mark.parametrize("seed", [1, 2, 3, 5])
def test_a_polygon_of_the_map_becomes_a_closed_block_with_the_same_walls(seed):
    contours = clip_to_polygon(mountain_contours(seed, 10.0), polygon(seed))
    ground = terrain_surface(contours)
    points, faces = sampled_triangles(ground)
    a, b, c = (points[faces[:, k], :2] for k in range(3))
    doubled = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    assert doubled.min() > -1e-9
    assert doubled.sum() / 2 == pytest.approx(shapely.Polygon(contours.outline).area, rel=1e-9)
    assert np.degrees(edge_angles(ground).max()) < 1e-6
    network = terrain_network(ground)
    report = check(block_solid(network, lowest_place(network) - 20.0, TOLERANCE), TOLERANCE)
    assert report.passed
    assert report.measures.faces == ground.n_patches + len(contours.outline)  # a wall a side, and the base


def test_a_polygon_keeps_the_voids_within_it():
    contours = contour_grid(with_voids(2), 10.0)
    ring = np.array([[150.0, 60.0], [420.0, 80.0], [380.0, 300.0], [160.0, 280.0], [150.0, 60.0]])
    clipped = clip_to_polygon(contours, ring)
    assert 1 <= len(clipped.voids) < len(contours.voids)
    assert (clipped.extent[0] >= ring.min(axis=0)).all()
    ground = terrain_surface(clipped)
    inside = np.random.default_rng(0).uniform(ring.min(axis=0), ring.max(axis=0), (300, 2))
    np.testing.assert_array_equal(np.isfinite(elevations(ground, inside)[0]), clipped.holds(inside))


@pytest.mark.parametrize(
    "ring", [[[0, 0], [9, 9], [9, 0], [0, 9], [0, 0]], [[900, 900], [950, 900], [950, 950], [900, 900]]]
)
def test_a_polygon_that_cuts_itself_or_lies_beside_the_map_is_refused(ring):
    with pytest.raises(BadOption, match="--clip"):
        clip_to_polygon(mountain_contours(1, 10.0), np.array(ring, dtype=float))

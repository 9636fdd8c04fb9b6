"""Spot heights between contours, and voids that stay holes."""

import numpy as np
import pytest
from generated_mountains import mountain_contours, mountain_grid
from scipy.interpolate import RegularGridInterpolator

from brep_export.app.terrain_job import TOLERANCE, lowest_place
from brep_export.blocks import block_solid
from brep_export.check import check
from recon.errors import BadGeometry
from recon.geometry.contour_map import ContourMap, HeightGrid
from recon.terrain.contouring import contour_grid, largest_piece
from recon.terrain.evaluation import elevations, sampled_triangles
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

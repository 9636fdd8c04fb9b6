"""Grids as they are measured: noise, plateaus at a contour's very height, whole metres."""

import numpy as np
import pytest
from generated_mountains import mountain_grid

from recon.geometry.contour_map import HeightGrid
from recon.terrain.contouring import contour_grid
from recon.terrain.evaluation import edge_angles, elevations
from recon.terrain.faults import checked_contours
from recon.terrain.pipeline import terrain_surface

INTERVAL = 10.0


def changed(how):
    grid = mountain_grid(1)
    return HeightGrid(grid.x, grid.y, how(grid.heights))


def noisy(share):
    random = np.random.default_rng(3)
    return changed(lambda z: z + random.normal(size=z.shape) * share * INTERVAL)


@pytest.mark.parametrize("grid", [noisy(0.05), noisy(0.3), changed(lambda z: np.maximum(z, 40.0)), changed(np.round)])
def test_the_ground_follows_a_grid_that_is_not_smooth(grid):
    ground = terrain_surface(contour_grid(grid, INTERVAL))
    places, heights = grid.places()
    miss = elevations(ground, places)[0] - heights
    assert np.isfinite(miss).all()
    assert np.abs(miss).max() < 1.3 * INTERVAL
    assert np.degrees(edge_angles(ground).max()) < 1e-5


def test_contours_through_heights_that_equal_levels_do_not_touch():
    grid = changed(lambda z: INTERVAL * np.round(z / INTERVAL))
    contours = contour_grid(grid, INTERVAL)
    same, notes = checked_contours(contours, 1.0, mend=False)
    assert len(same.lines) == len(contours.lines)
    assert notes == ()


def test_heights_near_a_level_move_contours_by_less_than_a_cell_share():
    z = np.add.outer(np.arange(20.0), 0.01 + np.arange(30.0))
    contours = contour_grid(HeightGrid(np.arange(30.0), np.arange(20.0), z), 10.0)
    for line, height in zip(contours.lines, contours.heights):
        assert np.abs(line.sum(axis=1) + 0.01 - height).max() < 0.11

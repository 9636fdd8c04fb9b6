"""Contours of the smooth ground, and what of it lies above a height."""

import numpy as np
import pytest
import shapely
from generated_mountains import mountain_contours, mountain_grid

from recon.errors import BadOption
from recon.geometry.contour_map import ContourMap, HeightGrid
from recon.terrain.base_contours import contours_with
from recon.terrain.clipping import clip_to_box
from recon.terrain.contouring import contour_grid
from recon.terrain.evaluation import edge_angles, elevations
from recon.terrain.pipeline import Terrain, TerrainOptions, terrain_surface
from recon.terrain.sections import contours_at, islands_above, welded_triangles


@pytest.fixture(scope="module")
def ground() -> Terrain:
    return terrain_surface(mountain_contours(1))


def test_contours_lie_at_their_height_and_end_on_the_border(ground):
    found = contours_at(ground, [33.0, 47.0])
    assert set(found.heights.tolist()) == {33.0, 47.0}
    for line, height in zip(found.lines, found.heights):
        assert np.nanmax(np.abs(elevations(ground, line)[0] - height)) < 0.5
        ends = line[[0, -1]]
        closed = (line[0] == line[-1]).all()
        border = (np.isclose(ends, found.extent[0]) | np.isclose(ends, found.extent[1])).any(axis=1)
        assert closed or border.all()


def test_no_contour_is_above_the_summit(ground):
    assert contours_at(ground, [1e4]) is None


def test_welded_triangles_cover_the_map_once(ground):
    points, faces = welded_triangles(ground)
    a, b, c = (points[faces[:, k], :2] for k in range(3))
    area = ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2
    assert area.sum() == pytest.approx(np.prod(ground.extent[1] - ground.extent[0]), rel=1e-9)
    sides = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    assert np.unique(sides, axis=0, return_counts=True)[1].max() == 2


def test_islands_lie_above_their_level_and_leave_the_rest():
    contours = mountain_contours(1)
    level = float(np.sort(contours.heights)[len(contours.heights) // 2])
    ground = terrain_surface(contours, floor=level)
    islands = islands_above(ground, level)
    assert 0 < sum(island.n_patches for island in islands) < ground.n_patches
    for island in islands:
        points, faces = welded_triangles(island)
        assert points[np.unique(faces), 2].min() > level - 1e-6


def test_tangent_planes_agree(ground):
    angles = edge_angles(ground)
    assert len(angles) > 500
    assert np.degrees(angles.max()) < 1e-6


def test_a_box_ends_contours_on_its_sides():
    contours = mountain_contours(2)
    box = np.array([[105.0, 95.0], [420.0, 333.0]])
    part = clip_to_box(contours, box)
    points = np.concatenate(part.lines)
    assert (points >= box[0]).all() and (points <= box[1]).all()
    for line in part.lines:
        closed = (line[0] == line[-1]).all()
        assert closed or ((line[[0, -1]] == box[0]) | (line[[0, -1]] == box[1])).any(axis=1).all()
    ground = terrain_surface(part)
    assert ground.n_patches > 50


@pytest.mark.parametrize("box", [[[900.0, 900.0], [990.0, 990.0]], [[300.0, 300.0], [200.0, 400.0]]])
def test_a_box_beside_the_map_is_refused(box):
    with pytest.raises(BadOption, match="--clip"):
        clip_to_box(mountain_contours(2), np.array(box))


def _terraced(interval: float) -> ContourMap:
    """Contours of whole metres, level in places, so that the ground lies at a contour's height beside it too."""
    grid = mountain_grid(4)
    return contour_grid(HeightGrid(grid.x, grid.y, interval / 2 * np.round(grid.heights / (interval / 2))), interval)


@pytest.mark.parametrize("share", [0.0, 0.004, 0.37, 0.9])
def test_nothing_above_a_base_dips_below_it(share):
    contours = _terraced(10.0)
    ground = terrain_surface(contours)
    level = float(np.unique(contours.heights)[2] + 10.0 * share)
    more, _ = contours_with(contours, ground, level)
    cut = terrain_surface(more, TerrainOptions(tolerance=ground.tolerance), floor=level)
    islands = islands_above(cut, level)
    assert islands
    for island in islands:
        points, faces = welded_triangles(island, steps=16)
        assert points[np.unique(faces), 2].min() > level - 1e-6
    assert np.degrees(edge_angles(cut).max()) < 1e-6


def test_a_contour_near_the_base_is_taken_to_lie_at_it(ground):
    contours = mountain_contours(1)
    level = float(contours.heights[0]) + 0.05
    more, told = contours_with(contours, ground, level)
    assert (more.heights == level).sum() == (contours.heights == contours.heights[0]).sum()
    assert len(told) == 1


def test_contours_beside_a_new_one_give_way_to_the_grounds_own(ground):
    contours = mountain_contours(1)
    level = float(np.sort(contours.heights)[len(contours.heights) // 2]) + 0.15
    more, told = contours_with(contours, ground, level)
    lines = [shapely.LineString(line) for line in more.lines]
    first, second = shapely.STRtree(lines).query(lines, predicate="intersects")
    assert (first == second).all()
    assert "as the ground has them" in told[0]
    assert set(np.unique(more.heights)) == {*np.unique(contours.heights), level}


def test_a_base_runs_close_beside_contours_of_a_steep_wall():
    """Its own contour lies a few centimetres from those of the wall, in plan, and all end on the border."""
    x, y = np.meshgrid(np.linspace(-1, 1, 61), np.linspace(-1, 1, 61))
    wall = 60 + 55 * np.tanh((y - 0.3 * np.sin(3 * x)) / 0.05) + 8 * x
    axis = 10.0 * np.arange(61)
    contours = contour_grid(HeightGrid(axis, axis, wall), 10.0)
    ground = terrain_surface(contours)
    more, told = contours_with(contours, ground, 50.3)
    assert any("of the base" in note for note in told)
    cut = terrain_surface(more, TerrainOptions(tolerance=ground.tolerance), floor=50.3)
    for island in islands_above(cut, 50.3):
        points, faces = welded_triangles(island, steps=16)
        assert points[np.unique(faces), 2].min() > 50.3 - 1e-6

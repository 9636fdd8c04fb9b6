"""Contours of the smooth ground, and what of it lies above a height."""

import numpy as np
import pytest
from generated_mountains import mountain_contours

from recon.errors import BadOption
from recon.terrain.clipping import clip_to_box
from recon.terrain.evaluation import edge_angles, elevations
from recon.terrain.pipeline import Terrain, terrain_surface
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
    level = float(np.median(contours.heights))
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

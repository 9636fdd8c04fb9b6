"""Patterns that are drawn after the wall's own."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import map_coordinates
from thrown_walls import AXIS, cylinder, wall_with_hole

from recon.geometry.mesh import TriangleMesh
from recon.hole_patch.relief import ReliefSource, continue_relief
from recon.hole_patch.relief_drawing import drawn_relief
from recon.hole_patch.relief_map import ReliefMap
from recon.hole_patch.surroundings import HoleEdge
from recon.hole_patch.wheel_sheet import wheel_sheet

SHAPE = (320, 140)
ROW, COLUMN = np.meshgrid(*(np.arange(n) for n in SHAPE), indexing="ij")
HOLE = ((ROW - 160) / 24) ** 2 + ((COLUMN - 70) / 28) ** 2 < 1


def wall(height: np.ndarray) -> ReliefMap:
    return ReliefMap(np.where(HOLE, 0.0, height), ~HOLE, np.zeros(2), np.full(2, 0.4))


def waves() -> np.ndarray:
    return 0.4 * np.sin(2 * np.pi * (ROW + 3.0 * np.sin(COLUMN / 11.0)) / 16.0)


def rings(seed: int = 5) -> np.ndarray:
    """Rings as of a hollow reed, pressed in by chance; the first row follows the last."""
    height = np.zeros(SHAPE)
    for row, column in np.random.default_rng(seed).integers(0, SHAPE, (110, 2)):
        turn = np.abs(ROW - row)
        away = np.hypot(np.minimum(turn, SHAPE[0] - turn), COLUMN - column)
        height = np.minimum(height, -0.5 * np.exp(-(((away - 4.0) / 1.5) ** 2)))
    return height - height.mean()


def test_a_pattern_that_comes_back_is_drawn_as_it_was() -> None:
    drawn = drawn_relief(wall(waves()), HOLE)
    assert np.abs(drawn - waves())[HOLE].mean() < 0.1 * 0.4


def test_what_was_measured_stays_and_the_hole_is_as_lively_as_the_wall() -> None:
    drawn = drawn_relief(wall(rings()), HOLE)
    np.testing.assert_array_equal(drawn[~HOLE], rings()[~HOLE])
    assert 0.5 < drawn[HOLE].std() / rings()[~HOLE].std() < 1.4
    assert drawn[HOLE].min() < -0.3  # rings as deep as those on the wall, not a mean of them


def test_no_step_is_left_along_the_edge() -> None:
    across = np.diff(HOLE.astype(int), axis=0) != 0
    drawn, true = (np.abs(np.diff(x, axis=0))[across] for x in (drawn_relief(wall(rings()), HOLE), rings()))
    assert drawn.mean() < 1.8 * true.mean()


def test_the_same_seed_draws_the_same_and_another_one_does_not() -> None:
    first, again, other = (drawn_relief(wall(rings()), HOLE, seed=seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def test_without_whole_patches_of_wall_the_hole_stays_level() -> None:
    everywhere = np.ones(SHAPE, dtype=bool)
    nothing = ReliefMap(np.zeros(SHAPE), ~everywhere, np.zeros(2), np.full(2, 0.4))
    assert not drawn_relief(nothing, HOLE).any()


@pytest.fixture(scope="module")
def stamped() -> tuple:
    """A wall with rings by chance, its sheet, and what is drawn on it."""
    plain = wall_with_hole(cylinder(30.0), step=0.6)
    pattern = rings(7)

    def pressed(points: np.ndarray) -> np.ndarray:
        p = AXIS.cylindrical(points)
        at = [(p[:, 0] / (2 * np.pi) % 1.0) * SHAPE[0], p[:, 2] / 0.6 + SHAPE[1] / 2]
        p[:, 1] += map_coordinates(pattern, at, order=1, mode="grid-wrap")
        return np.asarray(AXIS.cartesian(p))

    mesh = TriangleMesh(pressed(plain.measured.vertices), plain.measured.face_vertices)
    made = replace(plain, measured=mesh, edge=HoleEdge(pressed(plain.edge.points), plain.edge.sherds))
    sheet = wheel_sheet(made, AXIS)
    return made, sheet, continue_relief(sheet, made, AXIS, draw=True)


def test_what_nothing_foretells_is_drawn_on_request_and_said_so(stamped: tuple) -> None:
    made, sheet, drawn = stamped
    assert continue_relief(sheet, made, AXIS).source is ReliefSource.NONE
    assert drawn.source is ReliefSource.DRAWN
    assert "is not the one that was lost" in drawn.sheet.notes[-1]


def test_the_drawn_face_still_meets_the_edge(stamped: tuple) -> None:
    _, sheet, drawn = stamped
    assert drawn.sheet.edge_distance.mean() < sheet.edge_distance.mean()

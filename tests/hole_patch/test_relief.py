from dataclasses import replace

import numpy as np
import pytest
from thrown_walls import AXIS, cylinder, dish, dish_with_hole, wall_with_hole

from recon.geometry.mesh import TriangleMesh
from recon.hole_patch.relief import ReliefSheet, ReliefSource, continue_relief
from recon.hole_patch.relief_map import ReliefMap, inside_polygon, triangle_heights
from recon.hole_patch.relief_search import RECIPES, ReliefSearch, foretell, predicted
from recon.hole_patch.sample_vessel import VesselOptions, broken_vessel, whole_vessel
from recon.hole_patch.sheet import Sheet
from recon.hole_patch.sherds import surroundings
from recon.hole_patch.surroundings import Axis, HoleEdge, Wall
from recon.hole_patch.thick_piece import thick_piece
from recon.hole_patch.thickness import offset_sheet, piece_thickness
from recon.hole_patch.wheel_sheet import wheel_sheet
from recon.numerics.distance import closest_points

Floats = np.ndarray

RADIUS = 30.0
MARKS = 20  # around the turn
DEPTH = 0.4


def inside(sheet: Sheet, n: int = 60) -> Floats:
    """Points of a sheet within its loop."""
    polygon = sheet.trimmed.loops[0].polygon()
    low, step = polygon.min(axis=0), np.ptp(polygon, axis=0) / n
    cells = np.argwhere(inside_polygon((polygon - low) / step - 0.5, (n, n)))
    return np.asarray(sheet.trimmed.surface.point(low + (cells + 0.5) * step))


def cords(points: Floats) -> Floats:
    """Depth of slanted cords at cylindrical (θ, r, z), of wavelength 2π / |(MARKS / RADIUS, 1/2)|."""
    return np.asarray(DEPTH * np.sin(MARKS * points[:, 0] + points[:, 2] / 2))


def pressed_wall() -> Wall:
    """A cylinder with cords all around, and a hole."""
    wall = wall_with_hole(cylinder(RADIUS), step=0.8)

    def pressed(points: Floats) -> Floats:
        p = AXIS.cylindrical(points)
        p[:, 1] += cords(p)
        return AXIS.cartesian(p)

    mesh = TriangleMesh(pressed(wall.measured.vertices), wall.measured.face_vertices)
    return replace(wall, measured=mesh, edge=HoleEdge(pressed(wall.edge.points), wall.edge.sherds))


@pytest.fixture(scope="module")
def pressed() -> tuple[Wall, Sheet, ReliefSheet]:
    wall = pressed_wall()
    sheet = wheel_sheet(wall, AXIS)
    return wall, sheet, continue_relief(sheet, wall, AXIS)


def off_cords(sheet: Sheet) -> Floats:
    p = AXIS.cylindrical(inside(sheet))
    return np.abs(p[:, 1] - RADIUS - cords(p))


def test_cords_on_a_cylinder_go_on_across_the_hole(pressed: tuple[Wall, Sheet, ReliefSheet]) -> None:
    _, smooth, relief = pressed
    assert off_cords(smooth).mean() > 0.8 * DEPTH * 2 / np.pi  # the mean of |sin|
    assert off_cords(relief.sheet).mean() < 0.1 * DEPTH
    assert relief.source is ReliefSource.REGULAR
    assert relief.explained > 0.95
    assert relief.score > 0.95


def test_measures_of_the_relief_are_those_of_the_wave(pressed: tuple[Wall, Sheet, ReliefSheet]) -> None:
    relief = pressed[2]
    assert relief.wavelength == pytest.approx(2 * np.pi / np.hypot(MARKS / RADIUS, 0.5), rel=0.05)
    assert relief.depth == pytest.approx(DEPTH / np.sqrt(2), rel=0.15)  # the mesh's edges cut across the waves


def test_the_measured_edge_wins(pressed: tuple[Wall, Sheet, ReliefSheet]) -> None:
    wall, _, relief = pressed
    assert relief.sheet.edge_distance.max() < 0.1
    loop = relief.sheet.trimmed.surface.point(relief.sheet.trimmed.loops[0].polygon())
    edge = wall.edge.points
    sides = np.stack([edge, np.roll(edge, -1, axis=0), edge], axis=1)
    assert closest_points(loop, sides.reshape(-1, 3), np.arange(3 * len(edge)).reshape(-1, 3)).distances.max() < 0.15


def test_the_piece_closes_with_relief_on_its_outer_wall(pressed: tuple[Wall, Sheet, ReliefSheet]) -> None:
    outer = pressed[2].sheet
    inner = offset_sheet(outer, 3.0)
    assert thick_piece(outer, inner).outer.surface is outer.trimmed.surface
    assert piece_thickness(outer, inner).greatest > 3.0 + 0.5 * DEPTH  # the cords stand on the outer wall alone


def test_a_smooth_wall_keeps_its_sheet_and_says_so() -> None:
    wall = wall_with_hole(cylinder(RADIUS))
    noise = np.random.default_rng(2).normal(0, 0.02, wall.measured.vertices.shape)
    wall = replace(wall, measured=TriangleMesh(wall.measured.vertices + noise, wall.measured.face_vertices))
    sheet = wheel_sheet(wall, AXIS)
    relief = continue_relief(sheet, wall, AXIS)
    assert relief.source is ReliefSource.NONE
    assert relief.sheet.trimmed is sheet.trimmed
    assert relief.sheet.notes[:-1] == sheet.notes
    assert "smooth" in relief.sheet.notes[-1]


@pytest.mark.parametrize(("axis", "reason"), [(None, "not round"), (AXIS, "over the axis")])
def test_where_nothing_is_turned_nothing_is_continued(axis: Axis | None, reason: str) -> None:
    wall = dish_with_hole(dish(80.0), aside=0.0, radius=14.0)
    sheet = wheel_sheet(wall, AXIS)
    relief = continue_relief(sheet, wall, axis)
    assert relief.sheet.trimmed is sheet.trimmed
    assert reason in relief.sheet.notes[-1]


def test_a_broken_vessel_gets_its_cords_back() -> None:
    options = VesselOptions()
    around, whole = surroundings(broken_vessel(options).sherds), whole_vessel(options)
    assert around.axis is not None
    smooth = wheel_sheet(around.outer, around.axis)
    relief = continue_relief(smooth, around.outer, around.axis)
    before, after = (
        closest_points(inside(sheet), whole.vertices, whole.face_vertices).distances for sheet in (smooth, relief.sheet)
    )
    assert after.mean() < 0.6 * before.mean()
    assert relief.sheet.edge_distance.mean() <= smooth.edge_distance.mean()
    assert np.quantile(relief.sheet.edge_distance, 0.95) < 0.1
    assert relief.sheet.edge_distance.max() <= smooth.edge_distance.max() + 0.1


def test_chips_that_did_not_draw_the_smooth_face_do_not_draw_the_relief(
    pressed: tuple[Wall, Sheet, ReliefSheet],
) -> None:
    wall, _, _ = pressed
    points = wall.edge.points.copy()
    inward = AXIS.cylindrical(points[40:43]) - [0.0, 0.9, 0.0]
    points[40:43] = AXIS.cartesian(inward)
    chipped = replace(wall, edge=HoleEdge(points, wall.edge.sherds))
    smooth = wheel_sheet(chipped, AXIS)
    assert smooth.sound is not None and not smooth.sound[40:43].any()
    relief = continue_relief(smooth, chipped, AXIS)
    assert len(relief.sheet.edge_distance) <= smooth.sound.sum()
    assert relief.sheet.edge_distance.max() < 0.15


def texture(rng: np.random.Generator, shape: tuple[int, int]) -> Floats:
    """A field without any repetition, waves of four cells and more, mean square 1."""
    waves = np.fft.rfft2(rng.normal(size=shape))
    waves *= np.exp(-0.5 * (6.0 * np.hypot(np.fft.fftfreq(shape[0])[:, None], np.fft.rfftfreq(shape[1]))) ** 2)
    field = np.fft.irfft2(waves, shape)
    return np.asarray(field / field.std())


def search_of(height: Floats) -> ReliefSearch:
    """A round hole of radius 12 cells about (50, 48), a ring of 12 cells around it in four sectors."""
    i, j = np.indices(height.shape)
    away, turn = np.hypot(i - 50, j - 48), np.arctan2(j - 48, i - 50)
    hole = away < 12
    sectors = np.where(hole | (away > 24), -1, np.floor(turn / (np.pi / 2)).astype(np.int64) % 4)
    around = ReliefMap(height, ~hole, np.zeros(2), np.full(2, 0.4))
    return ReliefSearch(around, hole=hole, sectors=sectors)


@pytest.mark.parametrize("mirror", [(1, 1), (-1, 1), (1, -1), (-1, -1)])
def test_a_shifted_and_mirrored_copy_is_found_exactly(mirror: tuple[int, int]) -> None:
    height = texture(np.random.default_rng(3), (300, 90))
    copy = height[20:80, 18:79]
    height[171:231, 25:86] = copy[:: mirror[0], :: mirror[1]]
    search = search_of(height)
    best = search.candidates(range(4), count=1, apart=0)
    assert best.score[0] == pytest.approx(1.0, abs=1e-4)
    assert tuple(best.mirror[0]) == mirror
    hole = np.argwhere(search.hole)
    np.testing.assert_array_equal(search.heights(best, hole)[0][0], height[tuple(hole.T)])


def test_a_wave_around_the_turn_is_foretold_whatever_its_slant() -> None:
    i, j = np.indices((300, 90))
    height = np.sin(2 * np.pi * (25 * i / 300 + j / 14.0))
    search = search_of(height)
    found = foretell(search)
    hole = np.argwhere(search.hole)
    assert found.explained > 0.99
    np.testing.assert_allclose(predicted(search, [found.recipe], range(4), hole)[0], height[tuple(hole.T)], atol=0.1)


def test_rows_of_their_own_pitch_and_phase_are_put_together_row_by_row() -> None:
    rng = np.random.default_rng(1)
    i, j = np.indices((300, 90))
    marks, phase = rng.integers(18, 30, 9), rng.uniform(0, 2 * np.pi, 9)
    row = j // 10
    height = np.sin(2 * np.pi * marks[row] * i / 300 + phase[row])
    search = search_of(height)
    found = foretell(search)
    hole = np.argwhere(search.hole)
    guess = predicted(search, [found.recipe], range(4), hole)[0]
    assert not found.recipe.regular
    assert ((guess - height[tuple(hole.T)]) ** 2).mean() < 0.05 * (height[tuple(hole.T)] ** 2).mean()


def test_where_rows_were_begun_and_ended_the_longer_side_of_the_hole_goes_on() -> None:
    rng = np.random.default_rng(1)
    i, j = np.indices((300, 90))
    marks, phase = rng.integers(18, 30, 9) + 0.5, rng.uniform(0, 2 * np.pi, 9)
    begun = 58  # two thirds of the hole lie before it
    height = np.sin(2 * np.pi * marks[j // 10] * ((i - begun) % 300) / 300 + phase[j // 10])
    search = search_of(height)
    hole = np.argwhere(search.hole & (i < begun - 4))
    recipe = next(recipe for recipe in RECIPES if recipe.turned)
    off = np.abs(predicted(search, [recipe], range(4), hole)[0] - height[tuple(hole.T)])
    assert off.mean() < 0.25 * np.abs(height[tuple(hole.T)]).mean()


def test_what_repeats_nowhere_is_not_foretold() -> None:
    assert foretell(search_of(texture(np.random.default_rng(4), (300, 90)))).explained < 0.2


@pytest.mark.parametrize("start", [0.0, 7.3])
def test_a_plane_is_its_own_height_map(start: float) -> None:
    x, y = np.meshgrid(start + np.linspace(0, 12, 7), np.linspace(-1, 9, 6), indexing="ij")
    at = np.arange(42).reshape(7, 6)
    a, b, c, d = at[:-1, :-1].ravel(), at[1:, :-1].ravel(), at[1:, 1:].ravel(), at[:-1, 1:].ravel()
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    vertices = np.stack([x, y, 2 * x - y], axis=-1).reshape(-1, 3)
    height, known = triangle_heights(TriangleMesh(vertices, faces), (15, 8))
    i, j = np.indices((15, 8))
    unrolled = np.where(i < start, i + 15, i)  # the map runs round: what lies beyond 15 comes back at 0
    np.testing.assert_array_equal(known, unrolled <= start + 12)
    np.testing.assert_allclose(height[known], (2.0 * unrolled - j)[known], atol=1e-9)
    assert not triangle_heights(TriangleMesh(vertices, faces[:, ::-1]), (15, 8))[1].any()


def test_inside_of_a_polygon_is_its_area() -> None:
    turn = np.linspace(0, 2 * np.pi, 90, endpoint=False)
    star = (20.0 + 6.0 * np.cos(5 * turn))[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1) + [30.3, 31.7]
    area = np.pi * (20.0**2 + 6.0**2 / 2)  # ∫ r²/2 dφ
    assert inside_polygon(star, (62, 64)).sum() == pytest.approx(area, rel=0.01)
    np.testing.assert_array_equal(inside_polygon(star[::-1], (62, 64)), inside_polygon(star, (62, 64)))

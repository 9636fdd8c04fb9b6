"""Holes in the rim of a made vessel, from sherds to the piece; and the virtual curve across open rims."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial import cKDTree

from recon.errors import NoSurface
from recon.geometry.bspline import BSplineSurface
from recon.geometry.trimmed import LipPiece, TrimmedSurface
from recon.hole_patch.hole_edges import Cycle
from recon.hole_patch.lip_piece import lip_piece
from recon.hole_patch.open_rims import between_rims, excursions
from recon.hole_patch.pipeline import MissingPiece, PatchOptions, Relief, patch_hole
from recon.hole_patch.relief import ReliefSource
from recon.hole_patch.rim_check import RimFigures, check_rim_piece, rim_figures
from recon.hole_patch.sample_vessel import BrokenVessel, VesselOptions, broken_vessel
from recon.hole_patch.sherd_reading import find_holes
from recon.hole_patch.surroundings import Axis, HoleEdge, HoleKind
from recon.hole_patch.unit_length import axis_in, wall_in
from recon.hole_patch.wheel_edge import clean_wall
from recon.hole_patch.wheel_sheet import wheel_sheet
from recon.numerics.polygons import within

OPTIONS = VesselOptions(edge=1.4, seed=1, lost_at_rim=True)
Z_AXIS = Axis(np.zeros(3), np.array([0.0, 0.0, 1.0]), 0.0)


@cache
def vessel() -> BrokenVessel:
    return broken_vessel(OPTIONS)


@cache
def piece(kind: str) -> MissingPiece:
    return patch_hole(getattr(vessel(), kind))


@pytest.mark.parametrize(("kind", "n_walls"), [("sherds", 2), ("outer_walls", 1)])
def test_the_hole_is_listed_as_one_at_the_rim(kind: str, n_walls: int) -> None:
    hole = find_holes(getattr(vessel(), kind))[0]
    assert (hole.kind, hole.n_walls, hole.problem) == (HoleKind.RIM, n_walls, "")


def test_closed_sherds_give_a_piece_over_the_lip() -> None:
    shape = piece("sherds").shape
    assert isinstance(shape, LipPiece)
    top = shape.face.surface.point(shape.face.loops[0].polygon())[:, 2].max()
    assert top > 0.97 * OPTIONS.height


def test_outer_walls_give_a_face_that_ends_at_the_rim() -> None:
    shape = piece("outer_walls").shape
    assert isinstance(shape, TrimmedSurface)
    top = shape.surface.point(shape.loops[0].polygon())[:, 2].max()
    assert abs(top - vessel().lost.vertices[:, 2].max()) < 2.0


@pytest.mark.parametrize("kind", ["sherds", "outer_walls"])
def test_the_edge_of_the_piece_lies_on_the_lost_sherd(kind: str) -> None:
    shape = piece(kind).shape
    face = shape.face if isinstance(shape, LipPiece) else shape
    assert isinstance(face, TrimmedSurface)
    lost = vessel().lost
    truth = np.concatenate([lost.vertices, lost.corners().mean(axis=1)])
    away = cKDTree(truth).query(face.surface.point(face.loops[0].polygon()))[0]
    assert np.median(away) < 0.5 * OPTIONS.edge
    assert np.quantile(away, 0.9) < 1.2 * OPTIONS.edge


def test_relief_runs_on_over_the_edge_and_fades_out_on_the_inner_wall() -> None:
    smooth, pressed = piece("sherds"), patch_hole(vessel().sherds, PatchOptions(relief=Relief.CONTINUE))
    assert pressed.relief is not None and pressed.relief.source is not ReliefSource.NONE
    surface, lip = pressed.outer.trimmed.surface, pressed.outer.lip
    assert lip is not None
    loop = pressed.outer.trimmed.loops[0].polygon()
    uv = np.stack(np.meshgrid(*np.linspace(loop.min(axis=0), loop.max(axis=0), 60).T, indexing="ij"), -1).reshape(-1, 2)
    uv = uv[within(loop, uv)]
    away = np.linalg.norm(surface.point(uv) - smooth.outer.trimmed.surface.point(uv), axis=1)
    outside, inside = away[uv[:, 1] < lip - 8.0], away[uv[:, 1] > lip + 8.0]
    assert np.quantile(outside, 0.9) > 0.15
    assert np.quantile(inside, 0.9) < 0.08


def moved(shape: LipPiece, place: Callable[[np.ndarray], np.ndarray]) -> LipPiece:
    def surface(s: BSplineSurface) -> BSplineSurface:
        net = place(s.control_net.reshape(-1, 3)).reshape(s.control_net.shape)
        return BSplineSurface(s.degree_u, s.degree_v, s.knots_u, s.knots_v, net)

    return LipPiece(TrimmedSurface(surface(shape.face.surface), shape.face.loops), tuple(map(surface, shape.wall)))


def turned(points: np.ndarray) -> np.ndarray:
    angle = np.radians(8.0)
    return points @ np.array([[np.cos(angle), np.sin(angle), 0], [-np.sin(angle), np.cos(angle), 0], [0, 0, 1]])


BREAKS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "down": lambda p: p - np.array([0.0, 0.0, 3.0]),
    "up": lambda p: p + np.array([0.0, 0.0, 3.0]),
    "turned about the axis": turned,
    "too small": lambda p: 0.85 * p,
}


def test_a_right_piece_of_the_rim_has_no_problem() -> None:
    shape = piece("sherds").shape
    assert isinstance(shape, LipPiece)
    figures = rim_figures(shape, piece("sherds").around)
    assert figures.problem() == ""
    assert figures.fracture > 0.95
    assert abs(figures.thickness - 1.0) < 0.25


@pytest.mark.parametrize("broken", BREAKS)
def test_a_piece_out_of_place_is_refused(broken: str) -> None:
    shape = piece("sherds").shape
    assert isinstance(shape, LipPiece)
    with pytest.raises(NoSurface, match="cannot be right"):
        check_rim_piece(moved(shape, BREAKS[broken]), piece("sherds").around)


def test_a_part_of_the_piece_is_refused_where_its_edge_was_not_scanned() -> None:
    """A straight line from below across the lip to below: a valid solid, and a third of what was lost."""
    made = piece("sherds")
    wall, axis = made.around.outer, made.around.axis
    assert axis is not None
    angle = axis.cylindrical(wall.edge.points)[:, 0]
    angle = np.angle(np.exp(1j * (angle - np.angle(np.exp(1j * angle).mean()))))
    kept = angle > np.quantile(angle, 0.3)
    part = HoleEdge(wall.edge.points[kept], wall.edge.sherds[kept], wall.edge.normals[kept])
    sheet = wheel_sheet(replace(wall, edge=part), axis)
    with pytest.raises(NoSurface, match="edge"):
        check_rim_piece(lip_piece(sheet), made.around)


@pytest.mark.parametrize("scale", [1.0, 0.3])
def test_points_of_the_edge_are_counted_alike_when_the_relief_is_drawn_to_it(scale: float) -> None:
    """Spikes are cut off in units of the vessel; in millimetres others would be, and the flags would not fit."""
    wall, axis = piece("sherds").around.outer, piece("sherds").around.axis
    assert axis is not None
    small, about = wall_in(wall, 1.0 / scale), axis_in(axis, 1.0 / scale)
    sound = wheel_sheet(small, about).sound
    assert sound is not None
    edge = clean_wall(small, about).edge
    assert len(edge.points) == len(sound)
    assert cKDTree(small.edge.points).query(edge.points)[0].max() < 1e-9


GOOD = RimFigures(bridged=0.02, edge=0.95, fracture=0.99, turned=0.01, covered=0.0, thickness=1.1)


@pytest.mark.parametrize(
    ("figure", "value", "reason"),
    [
        ("bridged", 0.3, "in one stretch"),
        ("edge", 0.6, "scanned edge"),
        ("fracture", 0.7, "neighbours' fracture"),
        ("turned", 0.4, "do not go on"),
        ("covered", 0.3, "wall that is there"),
        ("thickness", 2.0, "as thick as"),
        ("thickness", 0.5, "as thick as"),
    ],
)
def test_every_figure_of_a_rim_piece_can_refuse_it(figure: str, value: float, reason: str) -> None:
    assert GOOD.problem() == ""
    assert reason in replace(GOOD, **{figure: value}).problem()


def slanted_rim(gap: float) -> Cycle:
    """A mouth whose height waves with the angle, with a V cut into it, `gap` radians wide, about the angle 0."""
    angle = np.linspace(np.pi, -np.pi, 900, endpoint=False)
    height = 50.0 + 0.4 * np.cos(angle) - 25.0 * np.clip(1.0 - np.abs(angle) / (0.5 * gap), 0.0, None)
    points = np.stack([30 * np.cos(angle), 30 * np.sin(angle), height], axis=1)
    outward = points * [1, 1, 0] / 30.0
    return Cycle(points, outward, np.zeros(900, np.int64), np.ones(900, np.int64), 0.0)


@pytest.mark.parametrize("gap", [0.4, 1.0, 2.0])
def test_the_virtual_curve_runs_on_from_the_rim_on_both_sides(gap: float) -> None:
    (hole,) = excursions(slanted_rim(gap), Z_AXIS, 0.25)
    x, y, height = hole.points[hole.sherds < 0].T
    np.testing.assert_allclose(np.hypot(x, y), 30.0, atol=1e-3)
    np.testing.assert_allclose(height, 50.0 + 0.4 * x / 30.0, atol=0.1)


def split_wall(gap: float, *, base: float = 0.0) -> Cycle:
    """The border of a cylinder, open above and below, with a slot `gap` radians wide, about the angle 0, from the mouth
    to the base; the wall on its left, base the height to which the lower border waves.
    """
    half = 0.5 * gap
    round_ = np.linspace(half, 2 * np.pi - half, 900)
    slot = np.linspace(0.0, 50.0, 200)[1:-1]
    angle = np.concatenate([round_[::-1], np.full(198, half), round_, np.full(198, -half)])
    wave = base * np.cos(5 * round_)
    height = np.concatenate([np.full(900, 50.0), slot[::-1], wave, slot])
    points = np.stack([30 * np.cos(angle), 30 * np.sin(angle), height], axis=1)
    n = len(points)
    return Cycle(points, points * [1, 1, 0] / 30.0, np.zeros(n, np.int64), np.ones(n, np.int64), 0.0)


@pytest.mark.parametrize("gap", [0.3, 1.2])
@pytest.mark.parametrize("start", [0, 500, 1000, 1500])
def test_a_hole_from_mouth_to_base_is_cut_off_at_both(gap: float, start: int) -> None:
    line = split_wall(gap)
    line = Cycle(
        np.roll(line.points, start, axis=0), np.roll(line.normals, start, axis=0), line.sherds, line.walls, 0.0
    )
    hole = between_rims(line, Z_AXIS, 0.25)
    assert hole is not None
    x, y, height = hole.points.T
    assert np.abs(np.arctan2(y, x)).max() < 0.5 * gap + 0.02
    assert np.ptp(height) == pytest.approx(50.0, abs=0.2)
    bridged = hole.sherds < 0
    np.testing.assert_allclose(np.hypot(x, y), 30.0, atol=1e-2)
    assert set(height[bridged].round(1)) == {0.0, 50.0}
    turned = np.angle(np.exp(1j * np.diff(np.arctan2(y, x), append=np.arctan2(y[0], x[0]))))
    assert abs(turned.sum()) < 1e-9


def test_a_line_that_keeps_to_no_level_is_no_hole_from_mouth_to_base() -> None:
    assert between_rims(split_wall(0.5, base=20.0), Z_AXIS, 0.25) is None

import numpy as np
import pytest
from thrown_walls import AXIS, cylinder, sphere, wall_with_hole

from recon.errors import BadOption, NoWall
from recon.geometry.trimmed import ThickPiece, TrimmedSurface
from recon.hole_patch.sheet import Sheet
from recon.hole_patch.thickness import offset_sheet, piece_thickness, thick_piece
from recon.hole_patch.wheel_sheet import wheel_sheet


@pytest.fixture(scope="module")
def outer() -> Sheet:
    return wheel_sheet(wall_with_hole(cylinder(30.0)), AXIS)


@pytest.fixture(scope="module")
def inner() -> Sheet:
    """Smaller and turned a little: a fracture that is not square to the wall."""
    return wheel_sheet(wall_with_hole(cylinder(27.0), size=(0.45, 12.5)), AXIS)


@pytest.fixture(scope="module")
def piece(outer: Sheet, inner: Sheet) -> ThickPiece:
    return thick_piece(outer, inner)


def rims(piece: ThickPiece) -> list[tuple[np.ndarray, np.ndarray]]:
    """Points of every wall border beside those of the pcurve that belongs to it, at the same parameters."""
    pairs = []
    for k, wall in enumerate(piece.wall):
        s = np.linspace(*wall.domain[0], 700)
        for row, sheet in enumerate((piece.outer, piece.inner)):
            on_wall = wall.point(np.stack([s, np.full(700, float(row))], axis=1))
            pairs.append((on_wall, sheet.surface.point(sheet.loops[0].pcurves[k].point(s))))
    return pairs


def test_walls_run_along_the_loops_of_both_sheets(piece: ThickPiece) -> None:
    for on_wall, on_sheet in rims(piece):
        assert np.linalg.norm(on_wall - on_sheet, axis=1).max() < 1e-3


def test_each_wall_begins_where_the_one_before_ends(piece: ThickPiece) -> None:
    for before, wall in zip((piece.wall[-1], *piece.wall[:-1]), piece.wall):
        assert before.domain[1] == wall.domain[1]
        np.testing.assert_allclose(before.control_net[-1], wall.control_net[0], atol=1e-12)
        (_, end), (start, _) = before.domain[0], wall.domain[0]
        t = np.array([0.0, 0.5, 1.0])
        left = before.normal(np.stack([np.full(3, end), t], axis=1))
        right = wall.normal(np.stack([np.full(3, start), t], axis=1))
        np.testing.assert_allclose(left, right, atol=1e-6)


def test_partners_never_go_back(piece: ThickPiece) -> None:
    for wall in piece.wall:
        s = np.linspace(*wall.domain[0], 400)
        for row in (0.0, 1.0):
            along = wall.derivative(np.stack([s, np.full(400, row)], axis=1), 1, 0)
            across = np.einsum("ij,ij->i", along, wall.derivative(np.stack([s, np.full(400, 0.5)], axis=1), 1, 0))
            assert across.min() > 0


def test_sheets_keep_their_surfaces_and_nearly_their_loops(piece: ThickPiece, outer: Sheet) -> None:
    assert piece.outer.surface is outer.trimmed.surface
    assert piece.outer.loops[0].signed_area() == pytest.approx(outer.trimmed.loops[0].signed_area(), rel=1e-5)


def test_volume_of_the_piece_is_that_between_two_cylinders(outer: Sheet) -> None:
    """Divergence theorem over sheets and walls, against a hole of area A unrolled: A t (1 - t / 2r)."""
    thickness, radius = 3.0, 30.0
    piece = thick_piece(outer, offset_sheet(outer, thickness))
    unrolled = outer.trimmed.loops[0].signed_area()
    expected = unrolled * thickness * (1 - thickness / (2 * radius))
    assert _volume(piece) == pytest.approx(expected, rel=2e-3)


def test_thickness_between_two_cylinders(outer: Sheet, inner: Sheet) -> None:
    found = piece_thickness(outer, inner)
    np.testing.assert_allclose([found.least, found.mean, found.greatest], 3.0, atol=1e-4)


@pytest.mark.parametrize("thickness", [0.5, 2.0, 8.0])
def test_offset_of_a_cylinder_is_a_cylinder(outer: Sheet, thickness: float) -> None:
    sheet = offset_sheet(outer, thickness)
    uv = sheet.trimmed.loops[0].polygon()
    radius = AXIS.cylindrical(sheet.trimmed.surface.point(uv))[:, 1]
    np.testing.assert_allclose(radius, 30.0 - thickness, atol=1e-4)
    assert len(sheet.edge_distance) == 0
    assert "not measured" in sheet.notes[0]


def test_offset_keeps_parameters_and_sides(outer: Sheet) -> None:
    sheet = offset_sheet(outer, 2.0)
    uv = outer.trimmed.loops[0].polygon()
    apart = outer.trimmed.surface.point(uv) - sheet.trimmed.surface.point(uv)
    np.testing.assert_allclose(apart, 2.0 * outer.trimmed.surface.normal(uv), atol=1e-3)
    np.testing.assert_allclose(sheet.trimmed.surface.normal(uv), outer.trimmed.surface.normal(uv), atol=1e-3)


def test_a_wall_thicker_than_the_radius_is_refused() -> None:
    ball = wheel_sheet(wall_with_hole(sphere(24.0), t_range=(-24.0, 24.0), size=(0.4, 8.0)), AXIS)
    assert offset_sheet(ball, 20.0).samples == 0
    with pytest.raises(NoWall, match="radius"):
        offset_sheet(ball, 25.0)


def test_walls_in_the_wrong_order_are_refused(outer: Sheet, inner: Sheet) -> None:
    with pytest.raises(NoWall, match="comes out"):
        thick_piece(inner, outer)


@pytest.mark.parametrize("thickness", [0.0, -1.0, float("nan")])
def test_a_thickness_must_be_positive(outer: Sheet, thickness: float) -> None:
    with pytest.raises(BadOption):
        offset_sheet(outer, thickness)


def _volume(piece: ThickPiece) -> float:
    """∫ x · n / 3: sheets by quadrature over their loops' polygons through a fan, walls over their rectangles."""
    total = _sheet_flux(piece.outer) - _sheet_flux(piece.inner)
    for wall in piece.wall:
        s = np.unique(wall.knots_u)
        u, du = _midpoints(np.interp(np.linspace(0, len(s) - 1, 4 * len(s)), np.arange(len(s)), s))
        v, dv = _midpoints(np.linspace(0, 1, 9))
        uv = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
        normal = np.cross(wall.derivative(uv, 1, 0), wall.derivative(uv, 0, 1))
        # along the loop, then inward: S_u x S_v points into the material
        total -= float(np.einsum("ij,ij,i->", _centred(wall.point(uv)), normal, np.outer(du, dv).ravel())) / 3
    return total


def _sheet_flux(sheet: TrimmedSurface) -> float:
    polygon = sheet.loops[0].polygon(200)
    surface = sheet.surface
    middle = polygon.mean(axis=0)
    rho, drho = _midpoints(np.linspace(0, 1, 41))
    spoke = 0.5 * (polygon + np.roll(polygon, -1, axis=0)) - middle
    step = np.roll(polygon, -1, axis=0) - polygon
    weight = (spoke[:, 0] * step[:, 1] - spoke[:, 1] * step[:, 0])[:, None] * (rho * drho)
    uv = (middle + spoke[:, None] * rho[:, None]).reshape(-1, 2)
    normal = np.cross(surface.derivative(uv, 1, 0), surface.derivative(uv, 0, 1))
    return float(np.einsum("ij,ij,i->", _centred(surface.point(uv)), normal, weight.ravel())) / 3


def _centred(points: np.ndarray) -> np.ndarray:
    return points - AXIS.cartesian(np.array([[2.5, 29.0, 0.0]]))


def _midpoints(breaks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return 0.5 * (breaks[1:] + breaks[:-1]), np.diff(breaks)

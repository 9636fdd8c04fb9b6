import numpy as np
import pytest
from thrown_walls import AXIS, cylinder, wall_with_hole

from recon.errors import NoSurface, NoWall
from recon.geometry.bspline import BSplineSurface
from recon.geometry.mesh import TriangleMesh
from recon.geometry.trimmed import ThickPiece, TrimmedSurface
from recon.hole_patch.sheet import Sheet
from recon.hole_patch.thick_piece import thick_piece
from recon.hole_patch.thickness import offset_sheet
from recon.hole_patch.wheel_sheet import wheel_sheet
from recon.numerics.distance import TriangleTree


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


def test_walls_in_the_wrong_order_are_refused(outer: Sheet, inner: Sheet) -> None:
    with pytest.raises(NoWall, match="comes out"):
        thick_piece(inner, outer)


def fracture(bulge: float = 0.0, *, span: tuple[float, float] = (0.0, 2 * np.pi)) -> TriangleMesh:
    """The face between the edges of both cylinders, `bulge` off the straight way in its middle, away from the hole.

    Where the angle about the middle of the hole is outside the span nothing was measured.
    """
    turn, t = np.meshgrid(np.linspace(*span, 400), np.linspace(0, 1, 21), indexing="ij")
    wide, high = 0.5 + t * (0.45 - 0.5), 14.0 + t * (12.5 - 14.0)
    more = 4 * t * (1 - t) * bulge
    angle = 2.5 + (wide + more / 30.0) * np.cos(turn)
    place = np.stack([angle, 30.0 - 3.0 * t, (high + more) * np.sin(turn)], axis=-1)
    at = np.arange(400 * 21).reshape(400, 21)
    a, b, c, d = at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]
    faces = np.stack([np.stack([a, b, c], -1), np.stack([a, c, d], -1)]).reshape(-1, 3)
    return TriangleMesh(AXIS.cartesian(place.reshape(-1, 3)), faces)


def wall_points(walls: tuple[BSplineSurface, ...], rows: tuple[float, ...] = (0.25, 0.5, 0.75)) -> np.ndarray:
    found = []
    for wall in walls:
        s, t = np.meshgrid(np.linspace(*wall.domain[0], 200), rows)
        found.append(wall.point(np.stack([s.ravel(), t.ravel()], axis=1)))
    return np.concatenate(found)


def away_from(face: TriangleMesh, points: np.ndarray) -> np.ndarray:
    return TriangleTree(face.vertices, face.face_vertices).closest(points).distances


@pytest.mark.parametrize("bulge", [-0.4, 0.0, 0.4])
def test_the_wall_follows_the_fracture(outer: Sheet, inner: Sheet, bulge: float) -> None:
    face = fracture(bulge)
    straight = away_from(face, wall_points(thick_piece(outer, inner).wall))
    followed = away_from(face, wall_points(thick_piece(outer, inner, face).wall))
    assert followed.mean() < 0.08 and followed.max() < 0.25
    if bulge:
        assert followed.mean() < 0.3 * straight.mean()


def test_a_wall_that_follows_still_runs_along_both_loops(outer: Sheet, inner: Sheet) -> None:
    for on_wall, on_sheet in rims(thick_piece(outer, inner, fracture(0.4))):
        assert np.linalg.norm(on_wall - on_sheet, axis=1).max() < 1e-3


def test_where_no_fracture_was_measured_the_wall_is_straight(outer: Sheet, inner: Sheet) -> None:
    half = fracture(0.4, span=(0.5, np.pi - 0.5))
    plain, followed = (wall_points(thick_piece(outer, inner, face).wall) for face in (None, half))
    moved = np.linalg.norm(plain - followed, axis=1)
    height = AXIS.cylindrical(plain)[:, 2]
    assert moved[height < -2.0].max() < 1e-6
    assert np.median(moved[height > 9.0]) > 0.2


def test_a_rough_fracture_never_folds_the_wall(outer: Sheet, inner: Sheet) -> None:
    face = fracture(0.0)
    rng = np.random.default_rng(4)
    rough = TriangleMesh(face.vertices + rng.normal(0.0, 0.35, face.vertices.shape), face.face_vertices)
    for wall in thick_piece(outer, inner, rough).wall:
        s, t = (grid.ravel() for grid in np.meshgrid(np.linspace(*wall.domain[0], 400), np.linspace(0, 1, 9)))
        along = wall.derivative(np.stack([s, t], axis=1), 1, 0)
        at_edge = wall.derivative(np.stack([s, np.zeros_like(t)], axis=1), 1, 0)
        assert np.einsum("ij,ij->i", along, at_edge).min() > 0.0


@pytest.mark.parametrize("clearance", [0.2, 0.5])
def test_the_clearance_is_kept(outer: Sheet, inner: Sheet, clearance: float) -> None:
    face = fracture(0.3)
    gap = away_from(
        face, wall_points(thick_piece(outer, inner, face, clearance=clearance).wall, (0, 0.25, 0.5, 0.75, 1))
    )
    assert gap.min() > 0.6 * clearance and np.median(gap) == pytest.approx(clearance, rel=0.15)


def test_a_clearance_that_leaves_nothing_is_refused(outer: Sheet, inner: Sheet) -> None:
    with pytest.raises(NoSurface, match="clearance of 20 mm"):
        thick_piece(outer, inner, clearance=20.0)


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

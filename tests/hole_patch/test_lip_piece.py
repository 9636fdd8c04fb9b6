"""A piece of the rim: the profile over the lip, the face, and the fracture inside its edge."""

from collections.abc import Callable, Iterator

import numpy as np
import pytest
from rim_vessels import AXIS, beaded_lip, plain_lip, rim_wall, rolled_lip
from scipy.spatial import cKDTree
from threadpoolctl import threadpool_limits

from recon.errors import NoSurface, NoWall
from recon.geometry.mesh import TriangleMesh
from recon.geometry.trimmed import LipPiece
from recon.hole_patch.lip_piece import lip_piece, lip_thickness
from recon.hole_patch.profile import wall_profile
from recon.hole_patch.section_samples import lengths_from_lip, section_samples
from recon.hole_patch.sheet import Sheet
from recon.hole_patch.surroundings import Wall
from recon.hole_patch.wheel_sheet import wheel_sheet
from recon.numerics.distance import TriangleTree
from recon.numerics.polygons import within


@pytest.fixture(autouse=True, scope="module")
def one_thread() -> Iterator[None]:
    with threadpool_limits(limits=1, user_api="blas"):
        yield


LIPS: dict[str, Callable[[], np.ndarray]] = {"plain": plain_lip, "rolled": rolled_lip}


@pytest.fixture(scope="module", params=LIPS)
def lip(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def sheet(lip: str) -> Sheet:
    return wheel_sheet(rim_wall(LIPS[lip]()), AXIS)


@pytest.fixture(scope="module")
def piece(sheet: Sheet) -> LipPiece:
    return lip_piece(sheet)


def section(points: np.ndarray) -> np.ndarray:
    return AXIS.cylindrical(points)[:, 1:]


def test_the_profile_turns_back_over_the_lip_and_meets_both_walls(lip: str) -> None:
    truth = LIPS[lip]()
    profile = wall_profile(rim_wall(truth), AXIS)
    s = np.linspace(*profile.curve.domain, 3000)
    line = profile.curve.point(s)
    near = line[:, 1] > -30.0  # the ends run straight on
    allowed = 0.15  # a mesh of 1 mm cuts the corners of bends as sharp as these by 0.1
    assert cKDTree(truth).query(line[near])[0].max() < allowed
    assert cKDTree(line).query(truth[truth[:, 1] > -25.0])[0].max() < allowed


def linked(wall: Wall, height: float, angles: np.ndarray) -> Wall:
    """The wall over a lip with a level strip from the outer wall to the inner one: fracture that was read as wall."""
    across = np.linspace(30.0, 27.0, 5)
    angle, radius = np.meshgrid(angles, across, indexing="ij")
    rows = np.column_stack([angle.ravel(), radius.ravel(), np.full(angle.size, height)])
    strip = np.arange(wall.measured.n_vertices, wall.measured.n_vertices + angle.size).reshape(angle.shape)
    nearest = cKDTree(wall.measured.vertices).query(AXIS.cartesian(rows))[1].reshape(angle.shape)
    strip[:, [0, -1]] = nearest[:, [0, -1]]
    a, b, c, d = strip[:-1, :-1], strip[1:, :-1], strip[1:, 1:], strip[:-1, 1:]
    faces = np.concatenate([np.stack(x, axis=-1).reshape(-1, 3) for x in ((a, b, c), (a, c, d))])
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    mesh = TriangleMesh(
        np.concatenate([wall.measured.vertices, AXIS.cartesian(rows)]),
        np.concatenate([wall.measured.face_vertices, faces]),
    )
    n = mesh.n_vertices
    return Wall(mesh, mesh, np.zeros(n, np.int64), np.ones(n), wall.edge, over_lip=True)


def test_fracture_that_was_read_as_wall_is_no_part_of_the_section() -> None:
    wall = linked(rim_wall(plain_lip()), -23.0, np.linspace(2.14, 2.86, 44))
    samples = section_samples(wall, AXIS, middle=2.5, nearness=np.inf)
    edge = AXIS.cylindrical(wall.edge.points)[:, 1:]
    length = lengths_from_lip(samples, edge, wall=wall.measured)
    between = (samples.place[:, 0] > 28.0) & (samples.place[:, 0] < 29.0) & (samples.place[:, 1] < -10.0)
    outside = samples.place[:, 0] > 29.9
    assert between.sum() > 20
    assert np.isnan(length[between]).all()
    assert np.nanmax(length[outside]) < 0.0


def test_the_tip_parts_the_profile_where_the_walls_meet() -> None:
    truth = rolled_lip()
    profile = wall_profile(rim_wall(truth), AXIS)
    tip = profile.curve.point(np.array([profile.tip()]))[0]
    assert tip[0] > 33.0 and tip[1] < 0.0  # at the end of the roll, not on its highest point


def test_the_face_lies_on_the_turned_lip(lip: str, sheet: Sheet) -> None:
    loop = sheet.trimmed.loops[0].polygon()
    steps = np.linspace(loop.min(axis=0), loop.max(axis=0), 60)
    uv = np.stack(np.meshgrid(*steps.T, indexing="ij"), axis=-1).reshape(-1, 2)
    away = cKDTree(LIPS[lip]()).query(section(sheet.trimmed.surface.point(uv[within(loop, uv)])))[0]
    assert away.mean() < 0.03
    assert away.max() < 0.15
    assert sheet.edge_distance.mean() < 0.03
    assert sheet.sides == 3


def test_what_the_wheel_left_out_of_round_is_followed_across_the_gap() -> None:
    wall = rim_wall(plain_lip(), shift=lambda angle: 0.6 * np.cos(2 * angle))
    sheet = wheel_sheet(wall, AXIS)
    assert sheet.lip is not None
    u = np.mean(sheet.trimmed.surface.domain[0])
    outer = AXIS.cylindrical(sheet.trimmed.surface.point(np.array([[u, sheet.lip - 12.0]])))[0]
    assert abs(outer[1] - (30.0 + 0.6 * np.cos(2 * outer[0]))) < 0.15


def test_the_fracture_lies_on_the_face_along_both_sides(piece: LipPiece) -> None:
    pcurves, surface = piece.face.loops[0].pcurves, piece.face.surface
    for k, wall in enumerate(piece.wall):
        for side, pcurve in ((0.0, pcurves[k]), (1.0, pcurves[-1 - k].reversed())):
            t = np.linspace(*wall.domain[0], 500)
            on_wall = wall.point(np.stack([t, np.full_like(t, side)], axis=1))
            assert np.linalg.norm(surface.point(pcurve.point(t)) - on_wall, axis=1).max() < 0.02


def test_the_fracture_ends_in_a_point_on_both_sides_and_is_as_wide_as_the_wall_between(piece: LipPiece) -> None:
    rungs = [np.linalg.norm(w.control_net[:, 0] - w.control_net[:, -1], axis=1) for w in piece.wall]
    assert rungs[0][0] < 1e-9 and rungs[-1][-1] < 1e-9
    middle = np.concatenate(rungs[1:-1])
    assert 2.0 < np.median(middle) < 3.6


def test_the_outer_part_of_the_loop_lies_on_the_outer_wall(sheet: Sheet, piece: LipPiece) -> None:
    assert sheet.lip is not None
    curves, n = piece.face.loops[0].pcurves, len(piece.wall)
    outer, inner = (np.concatenate([c.control_points for c in part]) for part in (curves[:n], curves[n:]))
    assert (outer[:, 1] < sheet.lip + 0.5).all()
    assert (inner[:, 1] > sheet.lip - 0.5).all()


def test_thickness_is_that_of_the_wall(lip: str, sheet: Sheet) -> None:
    found = lip_thickness(sheet)
    assert abs(found.mean - {"plain": 3.0, "rolled": 2.5}[lip]) < 0.15


@pytest.fixture(scope="module")
def beaded() -> LipPiece:
    return lip_piece(wheel_sheet(rim_wall(beaded_lip()), AXIS))


def test_rungs_leave_a_fat_bead_square_to_its_face(beaded: LipPiece) -> None:
    """Straight ones would run along the face at the lip, and cut it wherever it is rough."""
    wall, pcurve = beaded.wall[0], beaded.face.loops[0].pcurves[0]
    t = wall.domain[0][0] + np.linspace(0.02, 0.15, 20) * np.ptp(wall.domain[0])
    down = wall.derivative(np.stack([t, np.zeros(20)], axis=1), 0, 1)
    down /= np.linalg.norm(down, axis=1, keepdims=True)
    assert (np.einsum("ij,ij->i", down, beaded.face.surface.normal(pcurve.point(t))) < -0.8).all()


def test_the_fracture_stays_under_the_bead(beaded: LipPiece) -> None:
    truth = beaded_lip()
    inside = [w.grid(np.linspace(*w.domain[0], 200), np.linspace(0.1, 0.9, 7)).reshape(-1, 3) for w in beaded.wall]
    rows = section(np.concatenate(inside))
    assert within(truth, rows[rows[:, 1] > -30.0]).mean() > 0.99


def shifted_fracture(piece: LipPiece, move: np.ndarray) -> TriangleMesh:
    """The fracture of a piece as triangles, its middle moved: what a neighbour's fracture may look like."""
    grids = []
    for wall in piece.wall:
        height = np.linspace(0.0, 1.0, 21)
        points = wall.grid(np.linspace(*wall.domain[0], 120), height)
        grids.append(points + (4 * height * (1 - height))[None, :, None] * move)
    at = np.arange(120 * 21).reshape(120, 21)
    a, b, c, d = at[:-1, :-1].ravel(), at[1:, :-1].ravel(), at[1:, 1:].ravel(), at[:-1, 1:].ravel()
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return TriangleMesh(
        np.concatenate([grid.reshape(-1, 3) for grid in grids]),
        np.concatenate([faces + k * at.size for k in range(len(grids))]),
    )


def test_the_fracture_follows_that_of_the_neighbours(sheet: Sheet, piece: LipPiece) -> None:
    """Below the hole the neighbours' fracture bulges by a third of a millimetre: away from the lip it is met."""
    around = shifted_fracture(piece, 0.35 * AXIS.direction)
    tree = TriangleTree(around.vertices, around.face_vertices)

    def missed(one: LipPiece) -> float:
        middle = [wall.grid(np.linspace(*wall.domain[0], 80), np.array([0.5]))[:, 0] for wall in one.wall[1:3]]
        return float(np.median(tree.closest(np.concatenate(middle)).distances))

    assert missed(lip_piece(sheet, around)) < 0.3 * missed(piece)


def test_a_sheet_that_does_not_run_over_the_lip_is_refused(sheet: Sheet) -> None:
    off = Sheet(sheet.trimmed, sheet.edge_distance, 0, 3, lip=sheet.trimmed.surface.domain[1][1] + 1.0)
    with pytest.raises(NoWall, match="two sides"):
        lip_piece(off)


def test_a_gap_of_two_thirds_of_the_rim_is_refused() -> None:
    with pytest.raises(NoSurface, match="degrees of the rim"):
        wheel_sheet(rim_wall(plain_lip(), half_angle=2.1, depth=12.0), AXIS)


def test_a_gap_of_a_third_of_the_rim_is_bridged() -> None:
    sheet = wheel_sheet(rim_wall(plain_lip(), half_angle=1.05), AXIS)
    loop = sheet.trimmed.loops[0].polygon()
    middle = sheet.trimmed.surface.point(
        np.stack([np.full(40, loop[:, 0].mean()), np.linspace(*np.quantile(loop[:, 1], [0.1, 0.9]), 40)], 1)
    )
    assert cKDTree(plain_lip()).query(section(middle))[0].max() < 0.1

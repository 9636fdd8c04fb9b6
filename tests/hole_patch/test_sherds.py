"""From sherds to the surroundings of the hole, and what is refused."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial import cKDTree

from recon.errors import BadGeometry, BadOption, NoHole, NotManifold, ReconError
from recon.geometry.mesh import TriangleMesh
from recon.hole_patch.edge_cleaning import chart_points, crossings, signed_area
from recon.hole_patch.sample_vessel import BrokenVessel, VesselOptions, broken_vessel, whole_vessel
from recon.hole_patch.sherd_reading import find_holes
from recon.hole_patch.sherds import surroundings
from recon.hole_patch.surroundings import HoleKind, Surroundings, Wall

SHARED = Path(__file__).parents[2].parent / "shared" / "data"
OPTIONS = VesselOptions(edge=2.0, seed=3)


@cache
def vessel() -> BrokenVessel:
    return broken_vessel(OPTIONS)


@cache
def found(kind: str) -> Surroundings:
    return surroundings(getattr(vessel(), kind))


def along(line: np.ndarray, step: float = 0.2) -> np.ndarray:
    """Points every step along a closed line."""
    ahead = np.roll(line, -1, axis=0)
    count = np.maximum(1, np.ceil(np.linalg.norm(ahead - line, axis=1) / step)).astype(int)
    return np.concatenate([a + (b - a) * (np.arange(n) / n)[:, None] for a, b, n in zip(line, ahead, count)])


def on_surface(mesh: TriangleMesh) -> np.ndarray:
    """Corners, edge midpoints and centres of all faces."""
    a, b, c = mesh.corners().transpose(1, 0, 2)
    return np.concatenate([a, (a + b) / 2, (b + c) / 2, (c + a) / 2, (a + b + c) / 3])


def outward(wall: Wall) -> np.ndarray:
    """Normals of the measured wall at the points of its edge."""
    centres = wall.measured.corners().mean(axis=1)
    _, near = cKDTree(centres).query(wall.edge.points)
    normals = wall.measured.area_vectors()[near]
    return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True))


@pytest.mark.parametrize("kind", ["sherds", "outer_walls"])
def test_edge_lies_on_the_lost_sherd(kind):
    distance, _ = cKDTree(on_surface(vessel().lost)).query(found(kind).outer.edge.points)
    assert np.quantile(distance, 0.95) < 0.5 * OPTIONS.edge  # the truth is sampled at half an edge length


@pytest.mark.parametrize(("kind", "side"), [("sherds", "outer"), ("sherds", "inner"), ("outer_walls", "outer")])
def test_edge_runs_counter_clockwise_seen_from_outside_and_never_crosses_itself(kind, side):
    wall = getattr(found(kind), side)
    uv = chart_points(wall.edge.points, outward(wall))
    assert signed_area(uv) > 0
    assert len(crossings(uv)) == 0


def test_both_kinds_of_scan_give_the_same_edge():
    solid, open_ = (along(found(kind).outer.edge.points) for kind in ("sherds", "outer_walls"))
    for a, b in ((solid, open_), (open_, solid)):
        distance, _ = cKDTree(a).query(b)
        assert distance.mean() < 0.3
        assert distance.max() < OPTIONS.thickness


def test_points_of_the_edge_were_measured_on_their_sherd():
    edge = found("sherds").outer.edge
    for number in np.unique(edge.sherds[edge.sherds >= 0]):
        vertices = vessel().sherds[number].vertices
        distance, _ = cKDTree(vertices).query(edge.points[edge.sherds == number])
        assert distance.max() == 0.0


def test_normals_of_both_walls_point_away_from_the_inside():
    around = found("sherds")
    assert around.inner is not None
    for wall in (around.outer, around.inner):
        area, centres = wall.measured.area_vectors(), wall.measured.corners().mean(axis=1)
        upright = np.abs(area[:, 2]) < 0.5 * np.linalg.norm(area, axis=1)
        out = (area[:, :2] * centres[:, :2]).sum(axis=1) > 0
        assert out[upright].mean() > 0.97


def test_plain_walls_keep_faces_and_number_of_vertices():
    wall = found("sherds").outer
    assert (wall.plain.face_vertices == wall.measured.face_vertices).all()
    assert wall.plain.n_vertices == wall.measured.n_vertices == len(wall.sherds) == len(wall.trust)
    assert wall.trust.min() == 0.0
    assert wall.trust.max() == 1.0


def test_only_outer_walls_give_no_inner_wall():
    assert found("outer_walls").inner is None


def test_axis_is_that_of_the_wheel():
    axis = found("sherds").axis
    assert axis is not None
    assert_allclose(axis.direction, [0, 0, 1], atol=0.005)
    assert np.hypot(*axis.point[:2]) < 0.5


def test_the_hole_moves_with_the_sherds():
    angle = 2.0
    matrix = np.eye(4)
    matrix[:3, :3] = [[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]]
    matrix[:3, 3] = [400.0, -70.0, 1000.0]
    moved = surroundings([sherd.moved(matrix) for sherd in vessel().outer_walls])
    expected = along(found("outer_walls").outer.edge.points) @ matrix[:3, :3].T + matrix[:3, 3]
    distance, _ = cKDTree(along(moved.outer.edge.points)).query(expected)
    assert distance.max() < 0.5 * OPTIONS.edge


def test_one_file_with_all_sherds_is_taken_apart():
    sherds = vessel().outer_walls
    first = np.cumsum([0, *(s.n_vertices for s in sherds[:-1])])
    joined = TriangleMesh(
        np.concatenate([s.vertices for s in sherds]),
        np.concatenate([s.face_vertices + k for s, k in zip(sherds, first)]),
    )
    distance, _ = cKDTree(along(surroundings([joined]).outer.edge.points)).query(found("outer_walls").outer.edge.points)
    assert distance.max() < 0.5 * OPTIONS.edge


def test_holes_are_listed_longest_first_with_their_place():
    holes = find_holes(vessel().sherds)
    assert [hole.length for hole in holes] == sorted((hole.length for hole in holes), reverse=True)
    assert np.linalg.norm(holes[0].place - vessel().lost.vertices.mean(axis=0)) < 10.0
    with pytest.raises(BadOption):
        surroundings(vessel().sherds, hole=len(holes))


def whole() -> TriangleMesh:
    return whole_vessel(OPTIONS)


def sphere() -> TriangleMesh:
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 40, endpoint=False), np.linspace(0.2, np.pi - 0.2, 20), indexing="ij")
    points = np.stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)], axis=-1).reshape(-1, 3)
    i, j = (a.ravel() for a in np.meshgrid(np.arange(40), np.arange(19), indexing="ij"))
    a, b = i * 20 + j, (i + 1) % 40 * 20 + j
    return TriangleMesh(30 * points, np.concatenate([np.stack([a, a + 1, b], 1), np.stack([b, a + 1, b + 1], 1)]))


def torus() -> TriangleMesh:
    u, v = np.meshgrid(*2 * [np.linspace(0, 2 * np.pi, 40, endpoint=False)], indexing="ij")
    points = np.stack([(30 + 5 * np.cos(v)) * np.cos(u), (30 + 5 * np.cos(v)) * np.sin(u), 5 * np.sin(v)], axis=-1)
    i, j = (a.ravel() for a in np.meshgrid(np.arange(40), np.arange(40), indexing="ij"))
    a, b, c, d = i * 40 + j, (i + 1) % 40 * 40 + j, (i + 1) % 40 * 40 + (j + 1) % 40, i * 40 + (j + 1) % 40
    return TriangleMesh(points.reshape(-1, 3), np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]))


def soup() -> TriangleMesh:
    chance = np.random.default_rng(0)
    return TriangleMesh(chance.standard_normal((300, 3)), np.arange(300).reshape(-1, 3))


def moebius() -> TriangleMesh:
    u = np.linspace(0, 2 * np.pi, 60, endpoint=False)[:, None]
    w = np.array([-3.0, 0.0, 3.0])
    r = 20 + w * np.cos(u / 2)
    points = np.stack([r * np.cos(u), r * np.sin(u), w * np.sin(u / 2)], axis=-1).reshape(-1, 3)
    faces = []
    for k in range(60):
        here = [3 * k + c for c in range(3)]
        there = [3 * k + 3 + c for c in range(3)] if k < 59 else [2, 1, 0]
        for c in range(2):
            faces += [[here[c], there[c], here[c + 1]], [here[c + 1], there[c], there[c + 1]]]
    return TriangleMesh(points, faces)


@pytest.mark.parametrize(
    ("make", "error"),
    [
        (whole, NoHole),
        (sphere, NoHole),
        (torus, NoHole),
        (soup, NotManifold),
        (moebius, NotManifold),
        (lambda: TriangleMesh(np.zeros((0, 3)), np.zeros((0, 3))), BadGeometry),
        (lambda: TriangleMesh(np.eye(3), [[0, 1, 2]]), NoHole),
        (lambda: TriangleMesh(np.zeros((3, 3)), [[0, 1, 2]]), BadGeometry),
    ],
    ids=["whole", "sphere", "torus", "soup", "moebius", "nothing", "triangle", "no area"],
)
def test_what_has_no_hole_is_refused_in_one_sentence(make, error):
    with pytest.raises(error) as refusal:
        surroundings([make()])
    assert str(refusal.value).endswith(".")
    assert "\n" not in str(refusal.value)


def test_a_few_sherds_of_a_vessel_surround_nothing():
    with pytest.raises(ReconError):
        surroundings(vessel().sherds[:2])


def read_ply(path: Path) -> TriangleMesh:
    import trimesh

    mesh = trimesh.load(path, process=False)
    return TriangleMesh(mesh.vertices, mesh.faces, path.name)


@pytest.mark.skipif(not SHARED.is_dir(), reason="the scanned vessels are not here")
@pytest.mark.parametrize(
    ("name", "kind"), [("cup_wall", "solid"), ("cup_wall", "outer"), ("bowl", "solid"), ("bowl", "outer")]
)
def test_edge_of_a_scanned_vessel_lies_on_the_missing_piece(name, kind):
    around = surroundings([read_ply(path) for path in sorted((SHARED / "vessels" / name / kind).glob("*.ply"))])
    truth = cKDTree(on_surface(read_ply(SHARED / "vessels" / name / "truth" / "piece.ply")))
    for wall in filter(None, (around.outer, around.inner)):
        distance, _ = truth.query(wall.edge.points)
        assert distance.mean() < 0.3
        assert np.quantile(distance, 0.95) < 0.8


@pytest.mark.skipif(not SHARED.is_dir(), reason="the scanned vessels are not here")
@pytest.mark.parametrize("kind", ["solid", "outer"])
def test_a_hole_at_the_rim_is_found_and_runs_over_the_lip_where_both_walls_are_known(kind):
    around = surroundings([read_ply(path) for path in sorted((SHARED / "vessels" / "cup_rim" / kind).glob("*.ply"))])
    assert around.kind is HoleKind.RIM
    assert around.outer.over_lip == (kind == "solid")

"""`recon patch` from files to files: a vessel that the package makes, and scanned vessels where they are at hand."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib.path import Path as Polygon

from brep_export.app.demo_job import common_over_union
from brep_export.app.patch_job import kernel_piece
from brep_export.mesh_files import write_mesh
from brep_export.triangulation import triangulate
from recon.hole_patch.pipeline import patch_hole
from recon.hole_patch.sample_vessel import VesselOptions, broken_vessel
from recon.numerics.distance import closest_points
from recon.readers.meshes import read_mesh

RECON = [sys.executable, "-c", "from brep_export.app.cli import main; main()"]
VESSELS = Path(__file__).parents[2].parent / "shared" / "data" / "vessels"
THICKNESS = 3.5
ENDINGS = ("step", "iges", "brep", "stl", "3mf", "glb")
LOST_TOO = 2  # a sherd of the belly, opposite the lost one


def recon(*words):
    command = [*RECON, *map(str, words), "--json"]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)


def passed(run):
    """The answer of a run that must have passed."""
    assert run.returncode == 0, run.stderr
    answer = json.loads(run.stdout)
    assert answer["verdict"] == "pass" and answer["reasons"] == []
    assert answer["kernel"]["valid"] and answer["kernel"]["self_intersections"] == 0
    assert all(Path(path).stat().st_size > 0 for path in answer["outputs"])
    return answer


@pytest.fixture(scope="module")
def vessel():
    return broken_vessel(VesselOptions(edge=1.6, thickness=THICKNESS))


@pytest.fixture(scope="module")
def scans(vessel, tmp_path_factory):
    """Files of the closed sherds, and of their outer walls."""
    folder = tmp_path_factory.mktemp("scans")
    files = {}
    for kind, meshes in (("closed", vessel.sherds), ("outer", vessel.outer_walls)):
        files[kind] = [folder / f"{kind}-{i}.stl" for i in range(len(meshes))]
        for mesh, path in zip(meshes, files[kind]):
            assert write_mesh(mesh, path).same
    return files


@pytest.fixture(scope="module")
def mended(scans, tmp_path_factory):
    """The folder and the answer of a run with closed sherds and nothing else asked for."""
    folder = tmp_path_factory.mktemp("mended")
    outputs = [word for ending in ENDINGS for word in ("-o", folder / f"piece.{ending}")]
    return folder, passed(recon("patch", *scans["closed"], *outputs, "--picture", folder / "piece.png"))


def test_closed_sherds_give_one_closed_solid_in_every_format(vessel, mended):
    folder, answer = mended
    kernel, room = answer["kernel"], answer["room"]
    assert (kernel["type"], kernel["closed"], kernel["solids"], kernel["free_edges"]) == ("solid", True, 1, 0)
    assert kernel["read_back"]["same"]
    assert kernel["volume"] == pytest.approx(vessel.lost.volume(), rel=0.1)
    assert room["thickness"]["mean"] == pytest.approx(THICKNESS, rel=0.1)
    assert room["holes"] == 1 and room["boundary"]["mean"] < 0.25
    assert room["gap"]["overlap"] < 0.03 and room["gap"]["min"] < 0.5
    assert room["gap"]["min"] == min(n["gap"]["min"] for n in room["neighbours"])
    assert room["gap"]["overlap"] == pytest.approx(sum(n["overlap"]["share"] for n in room["neighbours"]))
    assert room["gap"]["usual"] == pytest.approx(0.0, abs=0.5) and room["gap"]["usual"] >= room["gap"]["min"]
    assert room["collision_free"] or any(n["holds"] for n in room["neighbours"])
    assert "handle" in room["confidence"]["assumed"]
    assert 0.0 < room["confidence"]["expected_volume_error"] < 0.2
    assert not any("cracks lean" in note for note in answer["notes"])
    inward = -vessel.lost.vertices.mean(axis=0)[:2]
    assert np.dot(room["insert_direction"][:2], inward) > 0  # from outside, toward the vessel's axis
    assert sorted(p.name for p in folder.iterdir()) == sorted(f"piece.{e}" for e in (*ENDINGS, "png"))


def test_outer_walls_give_a_face_and_with_a_thickness_a_solid(vessel, scans, tmp_path):
    face = passed(recon("patch", *scans["outer"], "-o", tmp_path / "face.step"))
    assert (face["kernel"]["type"], face["kernel"]["closed"]) == ("face", False)
    assert face["room"]["thickness"] is None
    assert face["room"]["confidence"]["expected_volume_error"] is None
    solid = passed(recon("patch", *scans["outer"], "-o", tmp_path / "solid.step", "--thickness", 2))
    assert (solid["kernel"]["type"], solid["kernel"]["closed"]) == ("solid", True)
    assert solid["kernel"]["volume"] == pytest.approx(2 * face["kernel"]["area"], rel=0.15)  # less where it is concave
    (told,) = [note for note in solid["notes"] if "cracks lean" in note]
    assert f"{164.5 * solid['room']['confidence']['expected_volume_error']:.0f} % more or less" in told


def test_sherds_are_settled_unless_told_not_to_and_each_motion_is_said(vessel, scans, mended, tmp_path):
    left = passed(recon("patch", *scans["closed"], "--no-settle", "-o", tmp_path / "left.step"))
    assert left["room"]["settled"] is None
    moves = mended[1]["room"]["settled"]
    assert len(moves) == len(vessel.sherds)
    assert all(0 <= move["shift_mm"] <= 0.5 and 0 <= move["turn_deg"] <= 0.5 for move in moves)
    assert any(move["shift_mm"] > 0 for move in moves)  # they came a tenth of a millimetre out of place


def test_holes_are_listed_by_number_and_chosen_by_it(vessel, scans, tmp_path):
    listed = recon("patch", *scans["closed"], "--list")
    holes = json.loads(listed.stdout)["room"]
    assert listed.returncode == 0 and list(holes) == [f"hole {k}" for k in range(len(holes))]
    place = np.array([float(x) for x in holes["hole 0"]["near"].split()])
    assert np.linalg.norm(place - vessel.lost.vertices.mean(axis=0)) < 5.0
    passed(recon("patch", *scans["closed"], "--hole", 0, "-o", tmp_path / "piece.step"))
    beyond = recon("patch", *scans["closed"], "--hole", len(holes), "-o", tmp_path / "other.step")
    assert beyond.returncode == 2 and "hole" in beyond.stderr and not (tmp_path / "other.step").exists()


def test_every_hole_gets_a_piece_of_its_own_numbered_as_they_are_listed(vessel, scans, tmp_path):
    left = [*scans["outer"][:LOST_TOO], *scans["outer"][LOST_TOO + 1 :]]
    listed = recon("patch", *left, "--list", "--picture", tmp_path / "holes.png")
    holes = list(json.loads(listed.stdout)["room"].values())
    assert [hole["number"] for hole in holes] == [0, 1] and (tmp_path / "holes.png").stat().st_size > 0
    assert all(hole["kind"] == "wall" and hole["problem"] is None for hole in holes)
    answer = passed(recon("patch", *left, "--hole", "all", "-o", tmp_path / "face.step", "-o", tmp_path / "face.brep"))
    pieces = answer["room"]["pieces"]
    written = [f"{tmp_path}/face-{number}.{ending}" for number in (0, 1) for ending in ("step", "brep")]
    assert answer["outputs"] == written == [path for piece in pieces for path in piece["outputs"]]
    assert [piece["hole"] for piece in pieces] == [0, 1] and answer["room"]["holes"] == 2
    for piece, hole in zip(pieces, holes):
        away = np.mean(piece["kernel"]["bounding_box"], axis=0) - [float(x) for x in hole["near"].split()]
        assert piece["verdict"] == "pass" and np.linalg.norm(away) < 5.0
    assert answer["kernel"]["faces"] == sum(piece["kernel"]["faces"] for piece in pieces)


def test_of_several_pieces_all_are_written_or_none(scans, tmp_path):
    left = [*scans["outer"][:LOST_TOO], *scans["outer"][LOST_TOO + 1 :]]
    (tmp_path / "face-1.step").mkdir()  # in the way of the second piece
    run = recon("patch", *left, "--hole", "all", "-o", tmp_path / "face.step")
    assert run.returncode == 2 and "face-1.step" in run.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["face-1.step"]


@pytest.mark.parametrize("hole", ["every", "-1", "1.5"])
def test_a_hole_that_is_no_number_is_refused_in_words(scans, tmp_path, hole):
    run = recon("patch", *scans["outer"], "--hole", hole, "-o", tmp_path / "face.step")
    assert run.returncode == 2 and "--hole" in run.stderr and not list(tmp_path.iterdir())


def test_a_thickness_that_the_scans_make_needless_is_said(scans, tmp_path):
    answer = passed(recon("patch", *scans["closed"], "--thickness", 2, "-o", tmp_path / "piece.step"))
    assert any("not used" in note for note in answer["notes"])
    assert answer["room"]["thickness"]["mean"] == pytest.approx(THICKNESS, rel=0.1)


def test_a_clearance_makes_the_piece_smaller_and_a_thin_wall_is_named(scans, mended, tmp_path):
    tight = mended[1]
    loose = passed(recon("patch", *scans["closed"], "-o", tmp_path / "loose.step", "--clearance", 0.3, "--min-wall", 9))
    assert loose["kernel"]["volume"] < tight["kernel"]["volume"]
    assert loose["room"]["gap"]["min"] > tight["room"]["gap"]["min"]
    assert loose["room"]["gap"]["overlap"] < 0.5 * tight["room"]["gap"]["overlap"]
    assert any("thinner than 9 mm over 100 %" in note for note in loose["notes"])
    assert not any("thinner than" in note for note in tight["notes"])


@pytest.mark.parametrize(("thickness", "said"), [("auto", "nothing in the scans shows"), ("thick", "or auto")])
def test_a_thickness_that_cannot_be_had_is_refused_in_words(scans, tmp_path, thickness, said):
    answer = recon("patch", *scans["outer"], "-o", tmp_path / "piece.step", "--thickness", thickness)
    assert answer.returncode == 2 and said in answer.stderr and not list(tmp_path.iterdir())


def test_the_published_route_is_driven_by_picks(vessel, scans, tmp_path):
    centre = vessel.lost.vertices.mean(axis=0)
    outer = np.concatenate([wall.vertices for wall in vessel.outer_walls])
    away = outer[:, :2] @ centre[:2] > 0  # the side of the vessel on which the hole is
    reach = np.ptp(vessel.lost.vertices[:, 2])
    wanted = centre + reach * np.array([[0, 0, 0.85], [0, 0, -0.85], [0, 0, 0]])
    wanted[2, :2] += reach * np.array([-centre[1], centre[0]]) / np.linalg.norm(centre[:2])
    picks = [outer[away][np.linalg.norm(outer[away] - point, axis=1).argmin()].tolist() for point in wanted]
    (tmp_path / "picks.json").write_text(json.dumps({"picks": picks}))
    words = ["--method", "box", "--picks", tmp_path / "picks.json", "-o", tmp_path / "piece.step"]
    room = passed(recon("patch", *scans["outer"], *words))["room"]
    assert room["method"] == "box" and 0 <= room["box_angle_deg"] < 90 and room["sides"] == 4


def test_an_open_face_is_not_printed_unless_asked_for_and_the_old_file_stays(scans, tmp_path):
    old = tmp_path / "piece.stl"
    old.write_text("what was there")
    run = recon("patch", *scans["outer"], "-o", old, "-o", tmp_path / "piece.step")
    assert run.returncode == 1 and "--thickness" in run.stderr
    assert old.read_text() == "what was there" and [p.name for p in tmp_path.iterdir()] == ["piece.stl"]
    assert passed(recon("patch", *scans["outer"], "-o", old, "--allow-open"))["kernel"]["type"] == "face"


def test_metres_are_read_as_metres(vessel, scans, tmp_path):
    files = []
    for i, sherd in enumerate(vessel.sherds):
        files.append(tmp_path / f"metres-{i}.stl")
        write_mesh(sherd.moved(np.diag([1e-3, 1e-3, 1e-3, 1.0])), files[-1])
    answer = passed(recon("patch", *files, "--unit", "m", "-o", tmp_path / "piece.step"))
    assert answer["kernel"]["volume"] == pytest.approx(vessel.lost.volume(), rel=0.1)


def test_nothing_is_missing_from_a_whole_vessel(vessel, tmp_path):
    whole = tmp_path / "whole.stl"
    write_mesh(vessel.plain, whole)
    run = recon("patch", whole, "-o", tmp_path / "piece.step")
    assert run.returncode == 1 and "no hole" in run.stderr and len(run.stderr.splitlines()) == 1
    assert not (tmp_path / "piece.step").exists()


def test_what_was_written_passes_the_gate_from_the_file(mended):
    checked = passed(recon("check", mended[0] / "piece.step"))
    assert checked["kernel"]["solids"] == 1


def distance_inside(sheet, plain, n=60):
    """Distances of the sheet, on a grid of points within its loop, from the vessel before its relief was pressed."""
    surface = sheet.trimmed.surface
    u, v = (np.linspace(*ends, n) for ends in surface.domain)
    grid = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
    inside = Polygon(sheet.trimmed.loops[0].polygon()).contains_points(grid)
    return closest_points(surface.point(grid[inside]), plain.vertices, plain.face_vertices).distances


@pytest.mark.skipif(not VESSELS.is_dir(), reason="the folder of scanned vessels is not beside this checkout")
@pytest.mark.parametrize(
    ("name", "kind", "mean", "largest"),
    [
        ("cup_wall", "solid", 0.10, 0.7),
        ("cup_wall", "outer", 0.10, 0.7),
        ("bowl", "solid", 0.15, 0.8),
        ("bowl", "outer", 0.15, 0.8),
        ("cup_rim", "solid", 0.10, 0.7),
    ],
)
def test_scanned_vessels_come_as_near_as_was_promised(name, kind, mean, largest):
    """The promises of the missing piece; [kinoshita], table 1, has 0.23 to 0.64 and 1.00 to 2.21 at the edge alone."""
    sherds = [read_mesh(path).mesh for path in sorted((VESSELS / name / kind).glob("*.ply"))]
    piece = patch_hole(sherds)
    edge = piece.outer.edge_distance
    assert edge.mean() <= 0.08 and edge.max() <= 0.7 and piece.outer.rejected <= 0.02
    inside = distance_inside(piece.outer, read_mesh(VESSELS / name / "truth" / "plain.ply").mesh)
    assert inside.mean() <= mean and inside.max() <= largest
    if kind == "solid":
        made = triangulate(kernel_piece(piece)[0], 0.02).mesh
        lost = read_mesh(VESSELS / name / "truth" / "piece.ply").mesh
        assert common_over_union(made, lost) >= {"cup_wall": 0.85, "cup_rim": 0.87, "bowl": 0.73}[name]
    assert (piece.inner is not None) == (kind == "solid" and name != "cup_rim")

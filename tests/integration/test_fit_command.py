"""`recon fit` from a scan to files, on a bumpy ball that the test makes."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from brep_export.mesh_files import write_mesh
from recon.geometry.mesh import TriangleMesh

THREADS = {"n_workers": 2, "threads_per_worker": 1, "processes": False, "protocol": "tcp", "dashboard_address": ":0"}
RECON = [sys.executable, "-c", "from brep_export.app.cli import main; main()"]


def recon(*words):
    command = [*RECON, *map(str, words), "--json"]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)


@pytest.fixture(scope="module")
def scan(tmp_path_factory):
    unit = np.random.default_rng(8).normal(size=(1500, 3))
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    faces = ConvexHull(unit).simplices.astype(np.int64)
    a, b, c = unit[faces].transpose(1, 0, 2)
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), a) < 0
    faces[inward] = faces[inward][:, ::-1]
    points = unit * (40.0 + 3.0 * np.sin(3.0 * unit[:, :1]) * np.cos(2.0 * unit[:, 1:2]))
    path = tmp_path_factory.mktemp("scan") / "ball.stl"
    write_mesh(TriangleMesh(points, faces), path)
    return path


def test_a_scan_becomes_a_control_mesh_and_a_closed_solid(scan, tmp_path):
    net, solid, picture = tmp_path / "ball.obj", tmp_path / "ball.step", tmp_path / "ball.png"
    run = recon("fit", scan, "-o", net, "-o", solid, "--surface", "loop", "--control-points", 40, "--picture", picture)
    assert run.returncode == 0, run.stderr
    answer = json.loads(run.stdout)
    room, kernel = answer["room"], answer["kernel"]
    assert kernel["type"] == "solid" and kernel["closed"] and kernel["valid"]
    assert kernel["read_back"]["same"] and kernel["free_edges"] == 0
    assert room["control_points"] <= 40 and room["stopped_by"] == "control points"
    assert room["data_points"] == 1500
    assert 0 < room["e_mean_percent"] < room["e_rms_percent"] < room["e_max_percent"] < 2.0
    lines = net.read_text().splitlines()
    assert sum(line.startswith("v ") for line in lines) == room["control_points"]
    assert {Path(path).name for path in answer["outputs"]} == {"ball.obj", "ball.step", "ball.png"}
    assert picture.stat().st_size > 10_000


def test_a_share_of_the_diagonal_is_a_tolerance(scan, tmp_path):
    run = recon("fit", scan, "-o", tmp_path / "ball.obj", "--tolerance", "0.4%", "--control-points", 400)
    answer = json.loads(run.stdout)
    assert run.returncode == 0 and answer["room"]["stopped_by"] == "tolerance"
    assert answer["room"]["e_max_percent"] <= 0.4


@pytest.mark.parametrize("words", [["--tolerance", "near"], ["--tolerance", "-1"], ["-o", "ball.xyz"]])
def test_bad_options_are_one_sentence_and_status_two(scan, words):
    run = recon("fit", scan, *words)
    assert run.returncode == 2
    assert "Traceback" not in run.stderr


def test_a_control_mesh_with_semi_sharp_creases_becomes_a_smooth_solid(tmp_path):
    rim = [0, 1, 3, 2]
    corners = [(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)]
    faces = [[0, 2, 3, 1], [4, 5, 7, 6], *([a, b, b + 4, a + 4] for a, b in zip(rim, rim[1:] + rim[:1]))]
    lines = [f"v {x} {y} {z}" for x, y, z in corners] + ["f " + " ".join(str(v + 1) for v in face) for face in faces]
    net = tmp_path / "cube.obj"
    net.write_text("\n".join([*lines, "t crease 5/1/0 4 5 7 6 4 1.5", "t corner 1/1/0 0 0.5"]) + "\n")
    run = recon("fit", "--control-mesh", net, "-o", tmp_path / "cube.step")
    assert run.returncode == 0, run.stderr
    answer = json.loads(run.stdout)
    assert answer["kernel"]["closed"] and answer["kernel"]["max_smooth_edge_angle_deg"] < 0.01
    assert answer["room"]["crease_edges"] == 0 and answer["kernel"]["read_back"]["same"]
    net.write_text("\n".join([*lines, "t corner 1/1/0 0 10"]) + "\n")
    cone = recon("fit", "--control-mesh", net, "-o", tmp_path / "cone.step")
    assert cone.returncode == 2 and "no tangent plane" in cone.stderr


def test_quadrilaterals_are_written_as_their_control_mesh_and_as_a_solid(scan, tmp_path):
    net = tmp_path / "quads.obj"
    run = recon("fit", scan, "-o", net, "--surface", "catmull-clark", "--control-points", 80, "--plain")
    assert run.returncode == 0, run.stderr
    room = json.loads(run.stdout)["room"]
    assert room["scheme"] == "catmull-clark" and room["control_points"] <= 80
    faces = [line.split()[1:] for line in net.read_text().splitlines() if line.startswith("f ")]
    assert {len(face) for face in faces} == {4}
    made = recon("fit", scan, "-o", tmp_path / "quads.step", "--surface", "doo-sabin", "--control-points", 80)
    assert made.returncode == 0, made.stderr
    assert json.loads(made.stdout)["kernel"]["max_smooth_edge_angle_deg"] < 0.01


def test_a_scan_is_thinned_first_where_that_is_asked_for(scan, tmp_path):
    run = recon("fit", scan, "-o", tmp_path / "ball.obj", "--surface", "loop", "--control-points", 40, "--thin", 400)
    answer = json.loads(run.stdout)
    assert run.returncode == 0, run.stderr
    thinned = answer["room"]["thinned"]
    assert (thinned["points"], thinned["left"]) == (1500, pytest.approx(400, rel=0.05))
    assert 0.0 < thinned["rms"] < thinned["max"] < 1.0
    assert answer["room"]["data_points"] == thinned["left"]
    assert "thinned scan" in answer["error"]["against"]
    assert any("1500 points were thinned" in note for note in answer["notes"])


def test_the_workers_of_a_cluster_thin_a_scan_to_the_same_points(scan, tmp_path):
    distributed = pytest.importorskip("distributed")
    options = ["--surface", "loop", "--control-points", 40, "--thin", 400, "--plain", "--rounds", 1]
    with distributed.LocalCluster(**THREADS) as cluster:
        for name, more in (("here", []), ("there", ["--scheduler", cluster.scheduler_address])):
            run = recon("fit", scan, *options, *more, "-o", tmp_path / f"{name}.obj")
            assert run.returncode == 0, run.stderr
    assert (tmp_path / "here.obj").read_bytes() == (tmp_path / "there.obj").read_bytes()

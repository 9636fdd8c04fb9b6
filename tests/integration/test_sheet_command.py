"""`recon fit --surface bspline|nurbs` from a scan to files, on scans that the test makes."""

import json
import subprocess
import sys

import numpy as np
import pytest
from hull_meshes import bumpy_ball
from PIL import Image
from sheets import pierced, sheet, torus, tube

from brep_export.mesh_files import write_mesh

RECON = [sys.executable, "-c", "from brep_export.app.cli import main; main()"]
SCANS = {
    "sheet": pierced(sheet(30), (np.array([2.0, 1.0, 0.183]), 0.3)),
    "tube": tube(30),
    "torus": torus(30),
    "holed": pierced(torus(30), ([4.0, 0.0, 0.0], 0.5)),
    "ball": bumpy_ball(500),
}


SLOW = pytest.mark.slow


def recon(*words):
    return subprocess.run(
        [*RECON, *map(str, words), "--json"], capture_output=True, text=True, timeout=300, check=False
    )


@pytest.fixture(scope="module")
def scans(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scans")
    for name, mesh in SCANS.items():
        write_mesh(mesh, folder / f"{name}.stl")
    return folder


@pytest.mark.parametrize(
    "name, words, kind, shape, free_edges, faces",
    [
        ("sheet", [], "disc", "shell", 2, 1),
        ("torus", ["--surface", "nurbs"], "torus", "solid", 0, 1),
        pytest.param("sheet", ["--close"], "disc", "shell", 1, 1, marks=SLOW),
        pytest.param("tube", [], "cylinder", "shell", 2, 1, marks=SLOW),
        pytest.param("tube", ["--close"], "cylinder", "solid", 0, 3, marks=SLOW),
        pytest.param("holed", [], "torus", "shell", 1, 1, marks=SLOW),
        pytest.param("holed", ["--close"], "torus", "solid", 0, 1, marks=SLOW),
    ],
)
def test_every_kind_becomes_one_face_that_passes_the_gate(scans, tmp_path, name, words, kind, shape, free_edges, faces):
    scheme = [] if "--surface" in words else ["--surface", "bspline"]
    out = tmp_path / "out.step"
    run = recon("fit", scans / f"{name}.stl", "-o", out, "--control-points", 250, *scheme, *words)
    assert run.returncode == 0, run.stdout + run.stderr
    answer = json.loads(run.stdout)
    room, kernel = answer["room"], answer["kernel"]
    assert room["kind"] == kind and room["scheme"] == (words[1] if not scheme else "bspline")
    assert kernel["type"] == shape and kernel["valid"] and kernel["free_edges"] == free_edges
    assert kernel["faces"] == faces and kernel["read_back"]["same"]
    assert room["data_points"] == SCANS[name].n_vertices and room["control_points"] <= 250
    assert 0 < room["e_mean_percent"] < room["e_rms_percent"] < room["e_max_percent"] < 0.5
    assert room["stopped_by"] == "control points" and room["folds"] == 0
    assert out.stat().st_size > 1000


@pytest.mark.slow
def test_a_picture_alone_and_a_tolerance(scans, tmp_path):
    picture = tmp_path / "tube.png"
    run = recon("fit", scans / "tube.stl", "--surface", "bspline", "--tolerance", "0.2%", "--picture", picture)
    assert run.returncode == 0, run.stderr
    room = json.loads(run.stdout)["room"]
    assert room["stopped_by"] == "tolerance" and room["e_max_percent"] <= 0.2
    assert picture.stat().st_size > 10_000


def test_the_picture_shows_the_face_cut_where_the_scan_has_a_hole(scans, tmp_path):
    blue = []
    for words in ([], ["--close"]):
        picture = tmp_path / "sheet.png"
        run = recon("fit", scans / "sheet.stl", "--surface", "bspline", "--picture", picture, *words)
        assert run.returncode == 0, run.stderr
        shown = np.asarray(Image.open(picture).convert("RGB"), dtype=np.int64)
        surface = shown[:, shown.shape[1] // 2 : 3 * shown.shape[1] // 4]  # the third of four views
        blue.append((surface[..., 2] - surface[..., 0] > 60).sum())
    hole = np.pi * 0.3**2 / 8.0  # of the sheet
    assert blue[0] < (1.0 - 0.7 * hole) * blue[1]


def test_a_closed_ball_is_refused_with_what_to_do(scans, tmp_path):
    run = recon("fit", scans / "ball.stl", "--surface", "bspline", "-o", tmp_path / "ball.step")
    assert run.returncode == 1 and "--surface loop" in run.stderr
    assert not (tmp_path / "ball.step").exists()


@pytest.mark.parametrize(
    "words",
    [
        ["--crease-angle", "20"],
        pytest.param(["-o", "net.obj"], marks=SLOW),
        pytest.param(["--control-points", "5"], marks=SLOW),
        pytest.param(["--degree", "12"], marks=SLOW),
    ],
)
def test_what_a_spline_face_has_not_is_refused(scans, words):
    run = recon("fit", scans / "tube.stl", "--surface", "bspline", *words)
    assert run.returncode == 2 and "Traceback" not in run.stderr

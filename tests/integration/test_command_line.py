"""The contract of the command line, as a user or a script meets it."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

RECON = [sys.executable, "-c", "from brep_export.app.cli import main; main()"]
SHARED = Path(__file__).parents[2].parent / "shared" / "data"
BAD = sorted((SHARED / "bad").glob("*")) if (SHARED / "bad").is_dir() else []
KEYS = {"command", "version", "inputs", "outputs", "verdict", "reasons", "kernel", "error", "room", "seconds"}


def recon(*words, **options):
    return subprocess.run(
        [*RECON, *map(str, words)], capture_output=True, text=True, timeout=300, check=False, **options
    )


def assert_one_sentence(run, status=2):
    """The status, one line on stderr that names the command, nothing on stdout, and no traceback anywhere."""
    assert run.returncode == status, run.stderr
    assert "Traceback" not in run.stderr and "fault in recon-brep" not in run.stderr
    assert len(run.stderr.strip().splitlines()) == 1, run.stderr
    assert run.stderr.startswith("recon ")
    assert run.stdout == ""


@pytest.mark.parametrize("words", [[], ["patch"], ["check"], ["batch"], ["demo"], ["views"]], ids=str)
def test_help_answers_without_loading_anything_heavy(words):
    probe = (
        "import sys; from brep_export.app.cli import app\n"
        f"try: app({[*words, '--help']!r})\n"
        "except SystemExit: pass\n"
        "heavy = {'numpy', 'scipy', 'OCP', 'trimesh', 'pyvista', 'cadquery'} & set(sys.modules)\n"
        "sys.exit(f'loaded {heavy}' if heavy else 0)"
    )
    run = subprocess.run([sys.executable, "-c", probe], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert "Usage" in run.stdout


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["patch", "nowhere.ply", "-o", "piece.step"], "nowhere.ply"),
        (["patch", "a.ply", "-o", "piece.xyz"], "ending"),
        (["patch", "a.ply", "-o", "no/such/folder/piece.step"], "does not exist"),
        (["patch", "a.step", "-o", "a.step"], "never written to"),
        (["patch", "a.ply", "-o", "a.step", "-o", "a.step"], "twice"),
        (["patch", "a.ply", "-o", "a.step", "--picture", "a.jpg"], ".png"),
        (["patch", "a.ply", "-o", "a.step", "--report", "a.pdf"], ".html"),
        (["patch", "a.ply", "-o", "a.step", "--thickness", "-2"], "thickness"),
        (["patch", "a.ply", "-o", "a.step", "--picks", "p.json"], "p.json"),
        (["check", "nowhere.step"], "nowhere.step"),
        (["check", "mesh.ply"], "ending"),
        (["check", "a.step", "--silence", "noise"], "thin-wall"),
    ],
)
def test_bad_usage_gets_one_sentence_and_status_2(words, says, tmp_path):
    run = recon(*words, cwd=tmp_path)
    assert_one_sentence(run)
    assert says in run.stderr
    assert list(tmp_path.iterdir()) == []


def test_the_version_names_the_kernel():
    assert re.fullmatch(
        r"recon-brep \S+ \(OpenCascade \d+\.\d+\.\d+, Python \d+\.\d+\.\d+\)\n", recon("--version").stdout
    )


def test_formats_are_those_of_the_commands():
    table = json.loads(recon("formats", "--json").stdout)
    assert {"patch", "fit", "curve", "terrain", "voxels", "views", "check"} == set(table)
    assert ".ply" in table["patch"]["reads"] and ".step" in table["patch"]["writes"]
    assert ".obj" in table["fit"]["writes"] and ".nrrd" in table["voxels"]["reads"]
    said = recon("formats").stdout
    assert all(ending in said for row in table.values() for ending in (*row["reads"], *row["writes"]))


def test_a_dry_run_says_what_it_would_do_and_does_nothing(tmp_path):
    (tmp_path / "a.ply").write_text("not looked into")
    (tmp_path / "piece.step").write_text("old")
    words = ("patch", "a.ply", "-o", "piece.step", "--picture", "p.png", "--dry-run", "--clearance", 0.5)
    run = recon(*words, cwd=tmp_path)
    assert run.returncode == 0 and run.stderr == ""
    assert "would read   a.ply" in run.stdout and "p.png (picture)" in run.stdout
    assert "piece.step (STEP, in place of the one there)" in run.stdout
    planned = json.loads(recon(*words, "--json", cwd=tmp_path).stdout)
    assert (planned["dry_run"], planned["options"]["clearance"]) == (True, 0.5)
    assert recon("demo", "--dry-run", cwd=tmp_path).returncode == 0
    assert {path.name for path in tmp_path.iterdir()} == {"a.ply", "piece.step"}
    assert (tmp_path / "piece.step").read_text() == "old"


def test_a_dry_run_misses_what_is_missing(tmp_path):
    run = recon("patch", "nowhere.ply", "--dry-run", cwd=tmp_path)
    assert_one_sentence(run)
    assert "nowhere.ply" in run.stderr


def test_no_color_is_kept_to():
    plain, coloured = (
        recon("patch", "--help", env={**os.environ, "FORCE_COLOR": "1", "TERM": "xterm-256color", **more}).stdout
        for more in ({"NO_COLOR": "1"}, {})
    )
    colour = re.compile(r"\x1b\[[0-9;]*3[0-7]")
    assert colour.search(coloured) and not colour.search(plain)


def test_shells_can_complete():
    """As bash asks: the words so far in the environment, what may follow on stdout."""
    named = [sys.executable, "-c", "import sys; sys.argv[0] = 'recon'; from brep_export.app.cli import main; main()"]
    asked = {"_RECON_COMPLETE": "complete_bash", "COMP_WORDS": "recon vo", "COMP_CWORD": "1"}
    run = subprocess.run(named, capture_output=True, text=True, check=False, env={**os.environ, **asked})
    assert run.stdout.split() == ["voxels"], run.stderr


def test_json_says_the_same_as_the_sentence(tmp_path):
    run = recon("check", "nowhere.step", "--json", cwd=tmp_path)
    answer = json.loads(run.stdout)
    assert set(answer) >= KEYS
    assert answer["verdict"] == "refused"
    assert answer["reasons"][0] in run.stderr


def test_a_report_has_a_picture_even_where_none_was_asked_for(tmp_path):
    box = pytest.importorskip("cadquery").Workplane().box(1, 2, 3)
    box.val().exportStep(str(tmp_path / "box.step"))
    run = recon("check", "box.step", "--report", "page.html", "--json", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert json.loads(run.stdout)["outputs"] == ["page.html"]
    assert {path.name for path in tmp_path.iterdir()} == {"box.step", "page.html"}
    assert "data:image/png;base64," in (tmp_path / "page.html").read_text(encoding="utf-8")


@pytest.mark.skipif(not BAD, reason="the folder of bad files is not beside this checkout")
@pytest.mark.parametrize("command", ["patch", "check"])
@pytest.mark.parametrize("path", BAD, ids=lambda path: path.name)
def test_bad_files_get_one_sentence(command, path, tmp_path):
    output = ["-o", tmp_path / "piece.step"] if command == "patch" else []
    run = recon(command, path, *output)
    assert run.returncode in (1, 2)
    assert_one_sentence(run, status=run.returncode)
    assert list(tmp_path.iterdir()) == []

"""`recon views`, from a drawing on disk to checked files."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from recon.three_view.pipeline import interpret

RECON = [sys.executable, "-c", "from brep_export.app.cli import main; main()"]
DRAWINGS = Path(__file__).parents[2].parent / "shared" / "data" / "views"
SQUARE = [[0, 0, 40, 0], [40, 0, 40, 40], [40, 40, 0, 40], [0, 40, 0, 0]]


def recon(*words, **options):
    return subprocess.run(
        [*RECON, *map(str, words)], capture_output=True, text=True, timeout=300, check=False, **options
    )


def puzzle(path, *diagonals):
    views = {
        name: {"visible": [*SQUARE, *diagonal], "hidden": []}
        for name, diagonal in zip(("front", "top", "side"), diagonals)
    }
    path.write_text(json.dumps({"views": views}))
    return path


def test_every_solid_of_a_puzzle_is_written_and_passes_the_gate(tmp_path):
    drawing = puzzle(tmp_path / "puzzle.json", [[0, 40, 40, 0]], [[0, 0, 40, 40]], [[0, 0, 40, 40]])
    run = recon(
        "views", drawing, "--all", "-o", "part.step", "-o", "part.obj", "-o", "part.json", "--json",
        "--report", "page.html", cwd=tmp_path
    )  # fmt: skip
    answer = json.loads(run.stdout)
    assert (run.returncode, answer["verdict"]) == (0, "pass"), run.stderr
    assert (answer["room"]["solutions"], answer["room"]["complete"]) == (6, True)
    assert len(list(tmp_path.glob("part_*.step"))) == 6
    page = (tmp_path / "page.html").read_text()
    assert page.count("<figure data-picks=") == 6
    assert page.count("<option>") == 7  # any, and one for each option of the only choice
    made = json.loads((tmp_path / "part_1.json").read_text())
    assert len(made["vertices"]) - len(made["edges"]) + len(made["faces"]) == 2
    assert (tmp_path / "part_1.obj").read_text().count("\nf ") == len(made["faces"])


def test_all_solids_are_written_or_none(tmp_path):
    drawing = puzzle(tmp_path / "puzzle.json", [[0, 40, 40, 0]], [[0, 0, 40, 40]], [[0, 0, 40, 40]])
    (tmp_path / "part_5.step").mkdir()
    run = recon("views", drawing, "--all", "-o", "part.step", cwd=tmp_path)
    assert run.returncode == 1
    assert "part_5.step" in run.stderr
    assert not [path for path in tmp_path.glob("*.step") if path.is_file()]


def test_no_more_solids_are_written_than_asked_for_and_that_is_said(tmp_path):
    drawing = puzzle(tmp_path / "puzzle.json", [[0, 40, 40, 0]], [[0, 0, 40, 40]], [[0, 0, 40, 40]])
    answer = json.loads(recon("views", drawing, "--all", "--limit", "2", "-o", tmp_path / "part.stl", "--json").stdout)
    assert sorted(path.name for path in tmp_path.glob("*.stl")) == ["part_1.stl", "part_2.stl"]
    assert answer["room"]["solutions"] == 6
    assert any("--limit" in note for note in answer["notes"])


def test_a_drawing_without_dashes_is_read_when_it_is_said_that_it_has_none(tmp_path):
    pocket = [[10, 20, 10, 40], [30, 20, 30, 40], [10, 20, 30, 20]]  # hidden, but drawn through
    square = [[10, 10, 30, 10], [30, 10, 30, 30], [30, 30, 10, 30], [10, 30, 10, 10]]
    drawing = puzzle(tmp_path / "pocket.json", pocket, square, pocket)
    assert recon("views", drawing, "-o", tmp_path / "part.stl").returncode == 1
    answer = json.loads(recon("views", drawing, "--no-hidden", "-o", tmp_path / "part.stl", "--json").stdout)
    assert (answer["verdict"], answer["room"]["solutions"]) == ("pass", 1)
    assert answer["kernel"]["volume"] == pytest.approx(40**3 - 20**3)


def test_a_number_too_large_and_a_contradiction_get_one_sentence(tmp_path):
    drawing = puzzle(tmp_path / "puzzle.json", [[0, 40, 40, 0]], [[0, 0, 40, 40]], [[0, 0, 40, 40]])
    run = recon("views", drawing, "--solution", "7", "-o", tmp_path / "part.step")
    assert run.returncode == 2
    assert "--solution" in run.stderr
    odd = puzzle(tmp_path / "odd.json", [[0, 40, 40, 0]], [], [])
    run = recon("views", odd, "-o", tmp_path / "part.step")
    assert run.returncode == 1
    assert "No solid" in run.stderr
    answer = json.loads(recon("views", odd, "-o", tmp_path / "part.step", "--json").stdout)
    assert "(0, 40) to (40, 0)" in " ".join(answer["room"]["conflicts"])
    assert "(0, 40) to (40, 0) should not be there" in answer["room"]["repairs"][0]
    assert not list(tmp_path.glob("*.step"))


def test_a_repair_is_made_on_request_and_said(tmp_path):
    odd = puzzle(tmp_path / "odd.json", [[0, 40, 40, 0]], [], [])
    answer = json.loads(recon("views", odd, "--repair", "-o", tmp_path / "part.step", "--json").stdout)
    assert (answer["verdict"], answer["room"]["solutions"]) == ("pass", 1)
    assert "(0, 40) to (40, 0) should not be there" in answer["room"]["repaired"]
    assert any("repaired" in note for note in answer["notes"])
    assert answer["room"]["conflicts"]
    assert answer["kernel"]["volume"] == pytest.approx(40**3)


@pytest.mark.skipif(not DRAWINGS.is_dir(), reason="the folder of drawings is not beside this checkout")
def test_real_drawings_have_as_many_solids_as_are_known():
    from recon.readers.views import read_views

    known = json.loads((DRAWINGS / "drawings" / "manifest.json").read_text())
    counts = {name: interpret(read_views(DRAWINGS / "drawings" / f"{name}.dxf").drawing).count for name in known}
    assert counts == {name: row["solutions"] for name, row in known.items()}


@pytest.mark.skipif(not DRAWINGS.is_dir(), reason="the folder of drawings is not beside this checkout")
def test_sheets_with_arcs_are_refused_with_their_places(tmp_path):
    run = recon("views", DRAWINGS / "sheets" / "5.dxf", "-o", tmp_path / "part.step")
    assert run.returncode == 1
    assert "circle at (-40, 20) of radius 5" in run.stderr

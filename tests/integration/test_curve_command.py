"""recon curve, from a file of points to an edge that reads back."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from brep_export.app.cli import app
from brep_export.app.result import summary

a = np.linspace(0.0, 2.0 * np.pi, 400)
ELLIPSE = np.stack([30.0 * np.cos(a), 20.0 * np.sin(a)], axis=1)


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    folder = tmp_path_factory.mktemp("curve")
    row = ELLIPSE.copy()
    row[-1] = row[0]
    np.savetxt(folder / "row.csv", row, delimiter=",", header="x,y", comments="")
    outputs = [str(folder / name) for name in ("curve.step", "curve.iges", "curve.json")]
    words = [
        "curve",
        str(folder / "row.csv"),
        *(w for o in outputs for w in ("-o", o)),
        "--tolerance",
        "0.01",
        "--json",
    ]
    run = CliRunner().invoke(app, [*words, "--picture", str(folder / "curve.png")])
    return folder, run


def test_a_closed_row_becomes_a_closed_edge(fitted):
    folder, run = fitted
    assert run.exit_code == 0, run.output
    answer = json.loads(run.stdout)
    assert answer["kernel"]["type"] == "edge" and answer["kernel"]["closed"] and answer["kernel"]["read_back"]["same"]
    assert answer["error"]["max"] <= 0.01
    assert "closed, valid edge" in summary(answer)
    assert answer["room"]["stopped_by"] == "tolerance" and answer["room"]["control_points"] < 40
    assert {path.name for path in folder.iterdir()} == {
        "row.csv",
        "curve.step",
        "curve.iges",
        "curve.json",
        "curve.png",
    }


def test_the_numbers_are_those_of_the_curve(fitted):
    numbers = json.loads((fitted[0] / "curve.json").read_text(encoding="utf-8"))
    assert len(numbers["knots"]) == len(numbers["control_points"]) + numbers["degree"] + 1
    assert np.allclose(numbers["control_points"][0], numbers["control_points"][-1])


def test_the_gate_for_solids_refuses_a_curve(fitted):
    run = CliRunner().invoke(app, ["check", str(fitted[0] / "curve.step")])
    assert run.exit_code == 1
    assert "no faces" in run.output

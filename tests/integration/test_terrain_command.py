"""`recon terrain`: a small hill from a grid to a solid, and what is refused."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from brep_export.app.cli import app


@pytest.fixture
def hill(tmp_path):
    x, y = np.meshgrid(np.arange(0.0, 130.0, 10.0), np.arange(0.0, 110.0, 10.0))
    z = 3.3 + 0.11 * x + 31.7 * np.exp(-(((x - 57) / 35) ** 2) - ((y - 48) / 30) ** 2)
    path = tmp_path / "hill.json"
    path.write_text(json.dumps({"width": 13, "height": 11, "values": z[::-1].ravel().tolist()}))
    return path, z


def run(*arguments):
    return CliRunner().invoke(app, ["terrain", *map(str, arguments)])


def test_a_grid_becomes_a_closed_solid_in_metres(hill, tmp_path):
    path, z = hill
    out = tmp_path / "hill.step"
    answer = run(path, "--interval", 10, "--base-depth", 5, "--against", path, "-o", out, "--json")
    result = json.loads(answer.stdout)
    assert result["reasons"] == []
    assert answer.exit_code == 0
    assert result["kernel"]["type"] == "solid"
    assert result["kernel"]["closed"]
    assert result["room"]["contours"] >= 4
    assert result["room"]["rmse"] < 10 / np.sqrt(12)  # what is left when only the band between two contours is known
    base = result["kernel"]["bounding_box"][0][2]
    assert result["kernel"]["volume"] == pytest.approx(120 * 100 * (z[:-1, :-1].mean() - base), rel=0.05)
    assert "SI_UNIT($,.METRE.)" in out.read_text()


def test_a_grid_needs_an_interval(hill, tmp_path):
    answer = run(hill[0], "-o", tmp_path / "hill.step")
    assert answer.exit_code == 2
    assert "--interval" in answer.output


def test_a_base_inside_the_ground_is_refused(hill, tmp_path):
    answer = run(hill[0], "--interval", 10, "--base-level", 20, "-o", tmp_path / "hill.step")
    assert answer.exit_code == 2
    assert "--base-level" in answer.output
    assert not (tmp_path / "hill.step").exists()

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


def test_gregory_patches_become_a_closed_solid_at_the_promised_angle(hill, tmp_path):
    out = tmp_path / "hill.step"
    answer = run(
        hill[0], "--interval", 10, "--patches", "gregory", "--angle", 0.05, "-o", out, "--allow-open", "--json"
    )
    result = json.loads(answer.stdout)
    assert result["reasons"] == []
    assert result["kernel"]["max_edge_angle_deg"] < 0.05
    assert result["room"]["g1_max_deg"] < 0.05
    block = run(hill[0], "--interval", 10, "--patches", "gregory", "--base-depth", 5, "-o", out, "--force", "--json")
    assert json.loads(block.stdout)["reasons"] == []
    assert json.loads(block.stdout)["kernel"]["closed"]


def test_an_angle_is_promised_for_gregory_patches_alone(hill, tmp_path):
    answer = run(hill[0], "--interval", 10, "--angle", 1, "-o", tmp_path / "hill.step")
    assert answer.exit_code == 2
    assert "--angle" in answer.output


def test_a_grid_needs_an_interval(hill, tmp_path):
    answer = run(hill[0], "-o", tmp_path / "hill.step")
    assert answer.exit_code == 2
    assert "--interval" in answer.output


def test_a_base_above_the_ground_is_refused(hill, tmp_path):
    answer = run(hill[0], "--interval", 10, "--base-level", 99, "-o", tmp_path / "hill.step")
    assert answer.exit_code == 2
    assert "--base-level" in answer.output
    assert not (tmp_path / "hill.step").exists()


def test_a_base_inside_the_ground_leaves_an_island_and_contours_come_beside_it(hill, tmp_path):
    out, lines = tmp_path / "island.step", tmp_path / "lines.geojson"
    answer = run(hill[0], "--interval", 10, "--base-level", 23, "--contours", 5, "-o", out, "-o", lines, "--json")
    result = json.loads(answer.stdout)
    assert result["reasons"] == []
    assert result["kernel"]["closed"]
    assert result["kernel"]["bounding_box"][0][2] == pytest.approx(23, abs=1e-3)
    heights = {feature["properties"]["elevation"] for feature in json.loads(lines.read_text())["features"]}
    assert {25.0, 30.0} <= heights
    assert json.loads((tmp_path / "island.step.json").read_text())["origin"] == result["room"]["origin"]


def test_what_is_written_beside_never_replaces_the_map(hill, tmp_path):
    grid = tmp_path / "map.step.json"
    grid.write_bytes(hill[0].read_bytes())
    answer = run(grid, "--interval", 10, "--base-depth", 5, "-o", tmp_path / "map.step")
    assert answer.exit_code == 2 and "never written to" in answer.output
    assert grid.read_bytes() == hill[0].read_bytes() and not (tmp_path / "map.step").exists()


def test_a_scale_makes_a_model_of_that_size(hill, tmp_path):
    sizes = []
    for scale in ("1:1", "1:100"):
        answer = run(
            hill[0], "--interval", 10, "--base-depth", 5, "--scale", scale, "-o", tmp_path / "a.step", "--json"
        )
        sizes.append(json.loads(answer.stdout)["kernel"]["volume"])
    assert sizes[0] / sizes[1] == pytest.approx(1e6, rel=1e-3)


@pytest.mark.parametrize("options", [["--scale", "half"], ["--clip", "1,2,3"], ["--contours", "5"], ["--unit", "mile"]])
def test_options_that_make_no_sense_are_named(hill, tmp_path, options):
    answer = run(hill[0], "--interval", 10, "-o", tmp_path / "a.step", *options)
    assert answer.exit_code == 2
    assert options[0] in answer.output


def test_what_is_mended_stays_mended_where_the_base_cuts_the_ground(tmp_path):
    a = np.linspace(0.0, 2.0 * np.pi, 41)[:-1]
    rings = [np.column_stack([100 + r * np.cos(a), 90 + r * np.sin(a)]) for r in (80.0, 60.0, 40.0, 20.0)]
    lines = [[[*p, 10.0 * k] for p in [*ring.tolist(), ring[0].tolist()]] for k, ring in enumerate(rings, 1)]
    features = [{"properties": {}, "geometry": {"type": "LineString", "coordinates": line}} for line in lines]
    wrong = {"properties": {}, "geometry": {"type": "Point", "coordinates": [170, 90, 99]}}
    path = tmp_path / "rings.geojson"
    crs = {"type": "name", "properties": {"name": "EPSG:32610"}}
    content = {"type": "FeatureCollection", "crs": crs, "features": [*features, features[1], wrong]}
    path.write_text(json.dumps(content))
    out = tmp_path / "island.step"
    assert "leave them out with --mend" in run(path, "--base-level", 25, "-o", out).output
    answer = run(path, "--base-level", 25, "--mend", "-o", out, "--json")
    assert json.loads(answer.stdout)["reasons"] == []

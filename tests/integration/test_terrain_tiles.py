"""`recon terrain --tile`: a file a tile, or the chosen ones as one solid; and what it refuses."""

import json
import os
import re
import time

import dask
import numpy as np
import pytest
from OCP.StdFail import StdFail_NotDone
from typer.testing import CliRunner

from brep_export.app import front_desk, terrain_tiles_job
from brep_export.app.cli import app
from brep_export.app.cluster_calls import calls
from brep_export.app.workshop import Bench, work_here
from recon.errors import Refusal
from recon.terrain.map_tiles import MapTiles, TiledMap

CLUSTER = {"n_workers": 2, "threads_per_worker": 1, "protocol": "tcp", "dashboard_address": ":0"}
DATE = re.compile(rb"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d")


@pytest.fixture
def ridge(tmp_path):
    x, y = np.meshgrid(10.0 * np.arange(41), 10.0 * np.arange(37))
    z = 4.0 + 60.0 * np.exp(-(((x - 0.6 * y - 80) / 90) ** 2)) + 0.05 * y
    path = tmp_path / "ridge.json"
    path.write_text(json.dumps({"width": 41, "height": 37, "values": z[::-1].ravel().tolist()}))
    return path


def run(path, *arguments):
    return CliRunner().invoke(app, ["terrain", str(path), "--interval", "10", "--json", *map(str, arguments)])


def test_every_tile_becomes_a_closed_block_in_a_file_of_its_own(ridge, tmp_path):
    answer = run(ridge, "--tile", 0.2, "--only", "0-1,0", "--base-depth", 20, "-o", tmp_path / "r.step")
    result = json.loads(answer.stdout)
    assert result["reasons"] == []
    assert result["room"]["lattice"] == [2, 2]
    assert result["kernel"]["solids"] == 2
    assert sorted(p.name for p in tmp_path.glob("r*.step")) == ["r-r0-c0.step", "r-r1-c0.step"]
    sidecars = [json.loads((tmp_path / f"r-r{row}-c0.step.json").read_text()) for row in (0, 1)]
    assert sidecars[0] == sidecars[1]


def test_a_dry_run_names_the_file_of_every_tile(ridge, tmp_path):
    told = {}
    for more in ((), ("--only", "0-1,0"), ("--join",)):
        answer = run(ridge, "--tile", 0.2, "--base-depth", 20, "-o", tmp_path / "r.step", "--dry-run", *more)
        told[more] = [path.rpartition("/")[2] for path in json.loads(answer.stdout)["outputs"]]
    assert told[()] == ["r-r0-c0.step", "r-r0-c1.step", "r-r1-c0.step", "r-r1-c1.step"]
    assert told["--only", "0-1,0"] == ["r-r0-c0.step", "r-r1-c0.step"]
    assert told["--join",] == ["r.step"]
    assert not list(tmp_path.glob("*.step"))
    wrong = run(ridge, "--tile", 0.2, "--only", "5,0", "-o", tmp_path / "r.step", "--dry-run")
    assert wrong.exit_code == 2 and "--only" in wrong.output


def test_joined_tiles_are_one_solid_without_walls_within(ridge, tmp_path):
    answer = run(ridge, "--tile", 0.2, "--join", "--base-depth", 20, "-o", tmp_path / "r.step")
    result = json.loads(answer.stdout)
    assert result["reasons"] == []
    assert result["kernel"]["solids"] == 1
    assert result["kernel"]["faces"] == result["room"]["patches"] + 5
    assert result["room"]["border_max_deg"] < 1e-6


def test_tiles_beside_a_void_are_named_and_the_others_written(tmp_path):
    n = 150
    x, y = np.meshgrid(10.0 * np.arange(n), 10.0 * np.arange(40))
    z = 4.0 + 60.0 * np.sin(x / 150) ** 2 + 0.05 * y
    z[20, 5] = -9999
    path = tmp_path / "long.asc"
    head = f"ncols {n}\nnrows 40\nxllcenter 0\nyllcenter 0\ncellsize 10\nnodata_value -9999\n"
    path.write_text(head + "\n".join(" ".join(map(repr, row)) for row in z[::-1].tolist()))
    answer = run(path, "--tile", 0.39, "--base-depth", 20, "-o", tmp_path / "r.step")
    result = json.loads(answer.stdout)
    assert answer.exit_code == 1
    assert [reason[:5] for reason in result["reasons"]] == ["r0-c0", "r0-c1"]
    assert "no height is known at (50.0, 200.0)" in result["reasons"][0]
    assert sorted(p.name for p in tmp_path.glob("r*.step")) == ["r-r0-c2.step", "r-r0-c3.step"]


def spoil(monkeypatch, tile, problem):
    """One tile raises; the work is done in this process, where it can be made to."""
    sound = MapTiles.tile

    def ground(self, place, **more):
        if place == tile:
            raise problem
        return sound(self, place, **more)

    monkeypatch.setattr(MapTiles, "tile", ground)
    here = Bench(lambda message: None)
    monkeypatch.setattr(front_desk, "run", lambda job, request, **more: work_here(job, request, here))


@pytest.mark.parametrize(
    ("problem", "told", "cause"),
    [
        (StdFail_NotDone("no curve"), "a fault in recon-brep itself (StdFail_NotDone: no curve; test_terrain", "fault"),
        (MemoryError(), "not enough memory", "memory"),
    ],
)
def test_a_tile_that_breaks_off_is_named_and_the_others_are_written(ridge, tmp_path, monkeypatch, problem, told, cause):
    spoil(monkeypatch, (0, 1), problem)
    answer = run(ridge, "--tile", 0.2, "--base-depth", 20, "-o", tmp_path / "r.step")
    result = json.loads(answer.stdout)
    assert answer.exit_code == 1
    assert [reason.partition(": ")[0] for reason in result["reasons"]] == ["r0-c1"]
    assert told in result["reasons"][0]
    assert result["cause"] == cause
    assert sorted(p.name for p in tmp_path.glob("r*.step")) == ["r-r0-c0.step", "r-r1-c0.step", "r-r1-c1.step"]
    assert result["kernel"]["solids"] == 3


def test_where_a_fault_in_a_tile_was_raised_is_shown_on_request(ridge, tmp_path, monkeypatch):
    spoil(monkeypatch, (0, 1), ZeroDivisionError("by zero"))
    options = ["--tile", 0.2, "--base-depth", 20, "-o", tmp_path / "r.step"]
    assert "Run it again with --debug" in run(ridge, *options).stderr
    told = run(ridge, *options, "--debug").stderr
    assert "r0-c1: Traceback" in told and "in ground" in told


def test_joined_tiles_are_not_written_where_one_breaks_off_and_every_such_tile_is_named(ridge, tmp_path, monkeypatch):
    spoil(monkeypatch, (0, 1), ZeroDivisionError("by zero"))
    page = tmp_path / "r.html"
    answer = run(ridge, "--tile", 0.2, "--join", "--base-depth", 20, "-o", tmp_path / "r.step", "--report", page)
    result = json.loads(answer.stdout)
    assert answer.exit_code == 1
    assert [reason.partition(": ")[0] for reason in result["reasons"]] == ["r0-c1"]
    assert "ZeroDivisionError" in page.read_text()
    assert not list(tmp_path.glob("r*.step"))


def test_a_tile_that_reaches_below_the_base_is_named_and_the_others_written(ridge, tmp_path):
    answer = run(ridge, "--tile", 0.2, "--only", "0-1,1", "--base-level", 8, "-o", tmp_path / "r.step")
    result = json.loads(answer.stdout)
    assert answer.exit_code == 1
    assert [reason.partition(": ")[0] for reason in result["reasons"]] == ["r1-c1"]
    assert "reaches down to" in result["reasons"][0]
    assert [p.name for p in tmp_path.glob("r*.step")] == ["r-r0-c1.step"]


def test_a_scheduler_that_is_lost_is_said():
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(processes=True, **CLUSTER | {"n_workers": 1}) as cluster,
        pytest.raises(Refusal, match="connection to the scheduler was lost"),
        calls(cluster.scheduler_address) as each,
    ):
        for _ in each(time.sleep, [0.0, 60.0]):
            cluster.close()


def test_a_geotiff_by_tiles_gives_the_bytes_of_a_text_grid(tmp_path):
    rasterio = pytest.importorskip("rasterio")
    x, y = np.meshgrid(10.0 * np.arange(80), 10.0 * np.arange(70))
    z = (4.0 + 60.0 * np.sin(x / 150) ** 2 + 0.05 * y).astype(np.float32)[::-1]
    head = "ncols 80\nnrows 70\nxllcorner 500000\nyllcorner 4000000\ncellsize 10\n"
    (tmp_path / "grid.asc").write_text(head + "\n".join(" ".join(map(repr, row)) for row in z.tolist()))
    way = rasterio.transform.from_origin(500_000.0, 4_000_700.0, 10.0, 10.0)
    layout = {"tiled": True, "blockxsize": 32, "blockysize": 16, "compress": "deflate"}
    with rasterio.open(
        tmp_path / "grid.tif", "w", driver="GTiff", width=80, height=70, count=1, dtype=z.dtype, transform=way, **layout
    ) as file:
        file.write(z, 1)
    made = {}
    for kind in ("asc", "tif"):
        options = ["--tile", 0.39, "--base-depth", 20, "-o", tmp_path / f"{kind}.step"]
        assert run(tmp_path / f"grid.{kind}", *options).exit_code == 0
        made[kind] = [DATE.sub(b"", path.read_bytes()) for path in sorted(tmp_path.glob(f"{kind}-*.step"))]
    assert len(made["asc"]) == 4
    assert made["asc"] == made["tif"]


@pytest.fixture(scope="module")
def scheduler():
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(processes=False, **CLUSTER) as cluster:
        yield cluster.scheduler_address


@pytest.mark.parametrize("together", [[], ["--join"]], ids=["a file each", "joined"])
def test_the_workers_of_a_cluster_make_the_same_bytes(ridge, tmp_path, monkeypatch, scheduler, together):
    monkeypatch.chdir(tmp_path)
    rooms, files = {}, {}
    for name, more in (("here", []), ("there", ["--scheduler", scheduler])):
        (tmp_path / name).mkdir()
        options = ["--tile", 0.2, "--base-depth", 20, *together, "-o", f"{name}/r.step", "-o", f"{name}/r.stl"]
        answer = run(ridge, *options, *more)
        assert answer.exit_code == 0, answer.output
        result = json.loads(answer.stdout)
        files[name] = {
            path.rpartition("/")[2]: DATE.sub(b"", (tmp_path / path).read_bytes()) for path in result["outputs"]
        }
        assert sorted(result["outputs"]) == sorted(f"{name}/{path.name}" for path in (tmp_path / name).iterdir())
        rooms[name] = result["room"]
    assert len(files["here"]) == 4 * (1 if together else 4)
    assert files["here"] == files["there"]
    assert rooms["here"] == rooms["there"]


def test_a_tile_that_breaks_off_on_a_cluster_is_named_and_the_others_are_written(
    ridge, tmp_path, monkeypatch, scheduler
):
    spoil(monkeypatch, (0, 1), StdFail_NotDone("no curve"))  # the workers are threads of this process
    answer = run(ridge, "--tile", 0.2, "-o", tmp_path / "r.step", "--scheduler", scheduler)
    result = json.loads(answer.stdout)
    assert answer.exit_code == 1
    assert [reason.partition(" (")[0] for reason in result["reasons"]] == ["r0-c1: a fault in recon-brep itself"]
    assert result["cause"] == "fault"
    assert sorted(p.name for p in tmp_path.glob("r*.step")) == ["r-r0-c0.step", "r-r1-c0.step", "r-r1-c1.step"]


def test_a_tile_whose_heights_cannot_be_read_is_named_on_a_cluster_too(ridge, tmp_path, monkeypatch, scheduler):
    spoil(monkeypatch, None, None)
    sound = TiledMap.near

    def near(self, tile):
        if tile == (1, 0):
            raise OSError("the disk has a hole")
        return sound(self, tile)

    monkeypatch.setattr(TiledMap, "near", near)
    options = ["--tile", 0.2, "--only", "1,0-1", "-o", tmp_path / "r.step", "--scheduler", scheduler]
    result = json.loads(run(ridge, *options).stdout)
    assert [reason.partition(" (")[0] for reason in result["reasons"]] == ["r1-c0: a fault in recon-brep itself"]
    assert [p.name for p in tmp_path.glob("r*.step")] == ["r-r1-c1.step"]


def test_a_tile_over_which_workers_die_is_named(ridge, tmp_path, monkeypatch):
    distributed = pytest.importorskip("distributed")
    spoil(monkeypatch, None, None)
    monkeypatch.setattr(terrain_tiles_job, "made_alone", lambda order, tile: os._exit(1))
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),
        distributed.LocalCluster(processes=True, **CLUSTER | {"n_workers": 1}) as cluster,
    ):
        options = ["--tile", 0.2, "--only", "0,1", "-o", tmp_path / "r.step", "--scheduler", cluster.scheduler_address]
        result = json.loads(run(ridge, *options).stdout)
    assert result["reasons"] == ["r0-c1: every worker that was given it broke off; nothing was written."]
    assert result["cause"] == "crash"


def test_a_box_of_a_map_goes_by_tiles_and_a_note_says_which_cells_it_keeps(ridge, tmp_path):
    options = ["--tile", 0.2, "--clip", "33,40,271,360", "--base-depth", 20, "-o", tmp_path / "r.step"]
    planned = json.loads(run(ridge, *options, "--dry-run").stdout)
    result = json.loads(run(ridge, *options).stdout)
    assert result["reasons"] == []
    assert result["notes"] == ["--clip keeps whole cells of the grid, here those in 40,40,270,360"]
    assert [path for path in result["outputs"] if path.endswith(".step")] == planned["outputs"]
    assert result["room"]["lattice"] == [2, 1]
    x, y = result["room"]["origin"]
    (west, south, _), (east, north, _) = result["kernel"]["bounding_box"]
    np.testing.assert_allclose([west + x, south + y, east + x, north + y], [40, 40, 270, 360], atol=1e-6)


def test_a_box_along_the_lines_of_a_grid_needs_no_note(ridge, tmp_path):
    options = ["--tile", 0.2, "--clip", "40,40,270,360", "--only", "0,0", "--base-depth", 20]
    assert json.loads(run(ridge, *options, "-o", tmp_path / "r.step").stdout)["notes"] == []


def test_gregory_tiles_join_to_one_solid_within_the_angle(ridge, tmp_path):
    options = ["--patches", "gregory", "--angle", 0.05, "--tile", 0.2, "--join", "--base-depth", 20]
    result = json.loads(run(ridge, *options, "-o", tmp_path / "r.step").stdout)
    assert result["reasons"] == []
    assert result["kernel"]["solids"] == 1
    assert 1e-6 < result["room"]["border_max_deg"] < 0.05
    assert result["room"]["g1_max_deg"] < 0.05


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["--tile", 0.2, "--only", "0,7"], "2 rows and 2 columns"),
        (["--tile", 0.2, "--only", "all"], "0-2,4-6"),
        (["--tile", 0.01], "--tile"),
        (["--tile", 0.2, "--clip", "0,0,9,9"], "the box holds 0 by 0 cells"),
        (["--tile", 0.2, "--clip", "900,0,990,300"], "no place in common"),
        (["--tile", 0.2, "--clip", "1,2,3"], "four numbers"),
        (["--tile", 0.2, "--clip", "parcel.geojson"], "only a box"),
        (["--tile", 0.2, "--picture", "r.png"], "--join"),
        (["--tile", 0.2, "--scale", "1:0"], "--scale"),
        (["--join"], "--tile"),
        (["--scheduler", "tcp://127.0.0.1:1"], "--tile"),
        (["--tile", 0.2, "--scheduler", "tcp://127.0.0.1:1"], "no scheduler answers"),
    ],
)
def test_what_does_not_go_by_tiles_is_refused(ridge, tmp_path, arguments, named):
    answer = run(ridge, *arguments, "-o", tmp_path / "r.step")
    assert answer.exit_code == 2
    assert named in answer.output
    assert not list(tmp_path.glob("r*.step"))

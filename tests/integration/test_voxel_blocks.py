"""`recon voxels --block`: a volume by blocks, from the command line and on a Dask cluster."""

import json
import subprocess
import sys

import numpy as np
import pytest

from brep_export.app.voxel_blocks import block_size
from brep_export.app.workshop import Bench
from recon.errors import BadOption

THREADS = {"n_workers": 2, "threads_per_worker": 1, "processes": False, "protocol": "tcp", "dashboard_address": ":0"}
RECON = [sys.executable, "-c", "from brep_export.app.cli import main; main()"]


def recon(*words):
    return subprocess.run([*RECON, *map(str, words)], capture_output=True, text=True, timeout=600, check=False)


def request(path, **options):
    usual = {
        "analytic": False,
        "smooth": False,
        "largest": False,
        "min_voxels": 1,
        "features": "none",
        "block": None,
        "scheduler": None,
    }
    return usual | options | {"inputs": [str(path)]}


@pytest.fixture(scope="module")
def hollow(tmp_path_factory):
    """A block with a void and a hole through it, and a ball of its own, which reach over several blocks."""
    x, y, z = np.meshgrid(*[np.arange(n) - n / 2 + 0.3 for n in (56, 44, 40)], indexing="ij")
    solid = (np.abs(x) < 24) & (np.abs(y) < 18) & (np.abs(z) < 16)
    solid &= ~((x + 12) ** 2 + y**2 < 6**2) & ~((x - 10) ** 2 + y**2 + z**2 < 7**2)
    path = tmp_path_factory.mktemp("volume") / "hollow.npy"
    np.save(path, solid.astype(np.uint8))
    return path


def test_a_volume_by_blocks_is_the_solid_that_it_is_as_a_whole(tmp_path, hollow):
    answers = {}
    for name, options in (("whole", []), ("blocks", ["--block", "24"])):
        run = recon("voxels", hollow, *options, "--spacing", "0.5", "-o", tmp_path / f"{name}.step", "--json")
        assert run.returncode == 0, run.stderr
        answers[name] = json.loads(run.stdout)
    whole, blocks = answers["whole"], answers["blocks"]
    for key in ("voxels", "shape", "spacing", "faces_marching_cubes", "bodies", "cavities", "genus"):
        assert blocks["room"][key] == whole["room"][key]
    assert (blocks["room"]["cavities"], blocks["room"]["genus"]) == (1, 1)
    assert (blocks["room"]["block"], blocks["room"]["blocks"]) == (24, [3, 2, 2])
    assert blocks["kernel"]["closed"] and blocks["kernel"]["solids"] == 1
    assert blocks["kernel"]["volume"] == pytest.approx(whole["kernel"]["volume"], rel=0.01)
    assert blocks["room"]["max_error_voxels"] <= 0.5


def test_the_workers_of_a_cluster_make_the_same_bytes(tmp_path, hollow):
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(**THREADS) as cluster:
        for name, options in (("here", []), ("there", ["--scheduler", cluster.scheduler_address])):
            run = recon("voxels", hollow, "--block", "24", *options, "-o", tmp_path / f"{name}.stl")
            assert run.returncode == 0, run.stderr
    assert (tmp_path / "here.stl").read_bytes()[80:] == (tmp_path / "there.stl").read_bytes()[80:]


def test_blocks_are_taken_by_themselves_where_a_volume_is_large(tmp_path):
    path = tmp_path / "large.npy"
    np.lib.format.open_memmap(path, mode="w+", dtype=np.uint8, shape=(650, 650, 650)).flush()  # a sparse file
    said = []
    bench = Bench(said.append)
    assert block_size(request(path), bench) == 256
    assert "by blocks of 256" in bench.notes[0]
    assert block_size(request(path, analytic=True), bench) is None
    assert block_size(request(path, block=128), bench) == 128


@pytest.mark.parametrize("option", [{"analytic": True}, {"smooth": True}, {"features": "paper"}])
def test_what_looks_at_the_whole_volume_is_refused_beside_blocks(hollow, option):
    with pytest.raises(BadOption, match=f"--{next(iter(option))}"):
        block_size(request(hollow, block=32, **option), Bench(lambda message: None))


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--scheduler", "tcp://nowhere:1"], "--block"),
        (["--block", "32", "--label", "7"], "no voxel"),
    ],
)
def test_what_makes_no_sense_gets_one_sentence(tmp_path, hollow, words, says):
    run = recon("voxels", hollow, *words, "-o", tmp_path / "part.step")
    assert run.returncode == 2
    assert says in run.stderr and "Traceback" not in run.stderr
    assert not (tmp_path / "part.step").exists()


def test_small_bodies_are_dropped_by_blocks_too(tmp_path):
    values = np.zeros((40, 30, 26), dtype=np.uint8)
    values[3:30, 4:26, 3:22], values[34:37, 3:6, 3:6], values[36:38, 24:26, 20:22] = 1, 1, 1
    np.save(tmp_path / "specks.npy", values)
    part = tmp_path / "part.stl"
    run = recon("voxels", tmp_path / "specks.npy", "--block", "20", "--largest", "-o", part, "--json")
    answer = json.loads(run.stdout)
    assert run.returncode == 0, run.stderr
    assert (answer["room"]["bodies"], answer["room"]["voxels"]) == (1, 27 * 22 * 19)
    assert any("dropped 2 bodies" in note and "35 voxels" in note for note in answer["notes"])
    assert sorted(path.name for path in tmp_path.iterdir()) == ["part.stl", "specks.npy"]

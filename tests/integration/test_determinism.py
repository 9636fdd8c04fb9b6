"""The same input gives the same bytes, the date in the header apart, whatever the process, its hash seed, its threads,
and the number of workers.
"""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import small_jobs
from hull_meshes import bumpy_ball
from limit_meshes import faces_of, prism

from brep_export.control_mesh_files import write_control_mesh
from brep_export.mesh_files import write_mesh
from recon.geometry.control_mesh import ControlMesh

RECON = [sys.executable, "-c", "from brep_export.app.cli import main; main()"]
ROOT = Path(__file__).parents[2]
SQUARE = [[0, 0, 40, 0], [40, 0, 40, 40], [40, 40, 0, 40], [0, 40, 0, 0]]
DATE = re.compile(rb"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d|\d{8}\.\d{6}|\d{15}H?")
SPENT = re.compile(rb'"(?:\w*seconds|peak_memory_mb)": (?:[0-9.e-]+|\{[^}]*\})')
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
ENVIRONMENTS = [
    os.environ | {"PYTHONHASHSEED": str(n), "PYTHONPATH": str(ROOT)} | dict.fromkeys(THREADS, str(n)) for n in (1, 2)
]


def ambiguous_views(folder):
    diagonals = {"front": [[0, 40, 40, 0]], "top": [[0, 0, 40, 40]], "side": [[0, 0, 40, 40]]}  # six solids
    views = {name: {"visible": [*SQUARE, *more], "hidden": []} for name, more in diagonals.items()}
    (folder / "views.json").write_text(json.dumps({"views": views}))
    return ["views", folder / "views.json"]


def rounded_block(folder):
    p = np.stack(np.indices((26, 22, 18)), axis=-1)
    solid = ((p > 2) & (p < np.array([22, 18, 14]))).all(axis=-1) & (np.hypot(p[..., 0] - 12, p[..., 1] - 10) > 4.2)
    np.save(folder / "block.npy", solid.astype(np.uint8))
    return ["voxels", folder / "block.npy"]


def large_ball(folder):
    write_mesh(bumpy_ball(3000), folder / "ball.stl")
    return ["fit", folder / "ball.stl"]


def control_mesh(folder):
    mesh = ControlMesh.from_faces(prism(5).vertices, faces_of(prism(5)))
    write_control_mesh(mesh, folder / "prism.obj", scheme="catmull-clark")
    return ["fit", "--control-mesh", folder / "prism.obj"]


def wide_hill(folder):
    x, y = np.meshgrid(np.arange(40), np.arange(36))
    heights = 100.0 + 60.0 * np.exp(-((x - 19.0) ** 2 + (y - 17.0) ** 2) / 90.0)
    content = {"width": 40, "height": 36, "values": heights.ravel().tolist()}
    (folder / "hill.json").write_text(json.dumps(content))
    return ["terrain", folder / "hill.json", "--interval", 10, "--base-depth", 20]


def drawn(kind):
    return lambda folder: kind(folder, np.random.default_rng(3))


def with_options(source, *options):
    return lambda folder: [*source(folder), *options]


PARTS = ("a.step", "a.iges", "a.brep", "a.stl", "a.3mf", "a.glb")
TERRAIN = drawn(small_jobs.terrain)
SOURCES = {
    "views": (ambiguous_views, (*PARTS, "a.obj", "a.json")),
    "curve": (drawn(small_jobs.curve), ("a.step", "a.json")),
    "voxels": (drawn(small_jobs.voxels), PARTS),
    "voxels smooth": (with_options(rounded_block, "--smooth"), ("a.step",)),
    "voxels analytic": (with_options(rounded_block, "--analytic"), ("a.step",)),
    "voxels by blocks": (with_options(rounded_block, "--block", 16), ("a.step",)),
    "voxels as published": (with_options(rounded_block, "--features", "paper"), ("a.stl",)),
    "terrain": (TERRAIN, ("a.step", "a.stl")),
    "terrain gregory": (with_options(TERRAIN, "--patches", "gregory"), ("a.step",)),
    "terrain tiles": (with_options(wide_hill, "--tile", 0.2, "--join"), ("a.step",)),
    "fit": (drawn(small_jobs.fit), ("a.obj", "a.step")),
    "fit thinned": (with_options(large_ball, "--thin", 800, "--control-points", 50), ("a.obj",)),
    "fit one face": (drawn(small_jobs.fit_face), ("a.step",)),
    "fit quads": (drawn(small_jobs.fit_quads), ("a.obj",)),
    "control mesh": (control_mesh, ("a.step",)),
    "patch": (drawn(small_jobs.patch), ("a.step", "a.stl")),
}


def run_in(folder, words, environment):
    folder.mkdir(exist_ok=True)
    command = [*RECON, *map(str, words)]
    run = subprocess.run(command, cwd=folder, capture_output=True, timeout=590, check=False, env=environment)
    assert run.returncode == 0, run.stderr.decode()
    return run


def written(folder):
    """Every file of a folder by its name, without dates."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): DATE.sub(b"", path.read_bytes()) for path in files}


@pytest.mark.slow
@pytest.mark.parametrize("name", SOURCES)
def test_the_same_input_gives_the_same_bytes(name, tmp_path):
    source, outputs = SOURCES[name]
    words = source(tmp_path)
    named = [word for path in outputs for word in ("-o", path)]
    one, other = (tmp_path / "one", tmp_path / "other")
    answers = [run_in(f, [*words, *named, "--json"], e).stdout for f, e in zip((one, other), ENVIRONMENTS)]
    assert set(outputs) <= set(written(one))
    assert {k for k, v in written(one).items() if v != written(other)[k]} == set()
    assert SPENT.sub(b"", answers[0]) == SPENT.sub(b"", answers[1])


@pytest.mark.slow
def test_a_check_says_the_same(tmp_path):
    run_in(tmp_path, [*rounded_block(tmp_path), "-o", "a.step"], ENVIRONMENTS[0])
    one, other = (run_in(tmp_path, ["check", "a.step", "--json"], e).stdout for e in ENVIRONMENTS)
    assert SPENT.sub(b"", one) == SPENT.sub(b"", other)


@pytest.mark.slow
def test_workers_of_a_batch_make_the_same_bytes_however_many_they_are(tmp_path):
    sources = {"views": ambiguous_views, "voxels": rounded_block, "terrain": TERRAIN}
    jobs = []
    for name, source in sources.items():
        command, path, *options = source(tmp_path)
        lines = {"name": name, "command": command, "inputs": str(path), "outputs": "a.step"}
        lines["options"] = [str(word) for word in options]
        jobs.append("[[job]]\n" + "".join(f"{key} = {json.dumps(value)}\n" for key, value in lines.items()))
    (tmp_path / "jobs.toml").write_text("\n".join(jobs))
    for number, environment in enumerate(ENVIRONMENTS, 1):
        words = ["batch", tmp_path / "jobs.toml", "-o", "out", "--workers", number, "--quiet"]
        run_in(tmp_path / f"by {number}", words, environment)
    for name in sources:
        one, other = (written(tmp_path / f"by {n}" / "out" / name)["a.step"] for n in (1, 2))
        assert one == other

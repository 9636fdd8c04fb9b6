"""The same input gives the same bytes, the date in the header apart, whatever the process."""

import json
import re
import subprocess
import sys

import numpy as np
import pytest

RECON = [sys.executable, "-c", "from brep_export.app.cli import main; main()"]
SQUARE = [[0, 0, 40, 0], [40, 0, 40, 40], [40, 40, 0, 40], [0, 40, 0, 0]]
DATE = re.compile(rb"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d|\d{8}\.\d{6}|\d{15}H?")


def views_source(folder):
    diagonals = {"front": [[0, 40, 40, 0]], "top": [[0, 0, 40, 40]], "side": [[0, 0, 40, 40]]}  # six solids
    views = {name: {"visible": [*SQUARE, *more], "hidden": []} for name, more in diagonals.items()}
    (folder / "views.json").write_text(json.dumps({"views": views}))
    return ["views", "views.json"]


def curve_source(folder):
    a = np.linspace(0.0, np.pi, 60)
    np.savetxt(folder / "row.csv", np.stack([30.0 * np.cos(a), 20.0 * np.sin(3 * a)], axis=1), delimiter=",")
    return ["curve", "row.csv", "--tolerance", "0.1%"]


def voxels_source(folder):
    i, j, k = np.indices((14, 14, 14)) - 6.5
    np.save(folder / "ball.npy", (i * i + j * j + k * k < 30).astype(np.uint8))
    return ["voxels", "ball.npy"]


def terrain_source(folder):
    x, y = np.meshgrid(np.arange(20), np.arange(18))
    heights = 100.0 + 60.0 * np.exp(-((x - 9.0) ** 2 + (y - 8.0) ** 2) / 30.0)
    content = {"width": 20, "height": 18, "values": heights.ravel().tolist()}
    (folder / "grid.json").write_text(json.dumps(content))
    return ["terrain", "grid.json", "--interval", "10", "--base-depth", "20"]


def fit_source(folder):
    import trimesh

    trimesh.creation.icosphere(3, 20.0).export(folder / "ball.ply")
    return ["fit", "ball.ply"]


SOURCES = {
    "views": (views_source, ("a.step", "a.obj", "a.json")),
    "curve": (curve_source, ("a.step", "a.json")),
    "voxels": (voxels_source, ("a.step", "a.stl")),
    "terrain": (terrain_source, ("a.step", "a.stl")),
    "fit": (fit_source, ("a.obj",)),
}


def made(folder, words, outputs):
    named = [word for path in outputs for word in ("-o", path)]
    run = subprocess.run([*RECON, *words, *named], cwd=folder, capture_output=True, text=True, timeout=400, check=False)
    assert run.returncode == 0, run.stderr
    return {path: DATE.sub(b"", (folder / path).read_bytes()) for path in outputs}


@pytest.mark.slow
@pytest.mark.parametrize("name", SOURCES)
def test_the_same_input_gives_the_same_bytes(name, tmp_path):
    source, outputs = SOURCES[name]
    words = source(tmp_path)
    assert made(tmp_path, words, outputs) == made(tmp_path, words, outputs)

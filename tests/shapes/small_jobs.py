"""Small jobs of every command, each with an input of its own, done by the commands themselves, but in this process."""

import gc
import io
import json
from collections.abc import Callable, Iterator
from contextlib import redirect_stdout
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest.mock import patch as put_in_place

import numpy as np
import psutil

from brep_export.app import front_desk
from brep_export.app.cli import app
from brep_export.app.workshop import Bench, Outcome, work_here
from brep_export.mesh_files import write_mesh
from recon.geometry.mesh import TriangleMesh
from recon.hole_patch.sample_vessel import VesselOptions, broken_vessel

MEBIBYTE = 2**20
Rng = np.random.Generator
Kind = Callable[[Path, Rng], list[object]]


def ball(folder: Path, rng: Rng) -> Path:
    """A bumpy ball of some hundred triangles."""
    import trimesh

    made = trimesh.creation.icosphere(3, rng.uniform(10.0, 30.0))
    bumps = 1.0 + 0.01 * np.sin(made.vertices @ rng.normal(size=(3, 4)) * 0.1).sum(axis=1)
    write_mesh(TriangleMesh(made.vertices * bumps[:, None], made.faces), folder / "ball.stl")
    return folder / "ball.stl"


def sheet(folder: Path, rng: Rng) -> Path:
    """A wave, open all around."""
    n = int(rng.integers(16, 24))
    x, y = np.meshgrid(np.arange(float(n)), np.arange(float(n)), indexing="ij")
    z = rng.uniform(0.5, 2.0) * np.sin(rng.uniform(0.1, 0.4) * x + rng.uniform(0.0, 0.2) * y)
    number = np.arange(n * n).reshape(n, n)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    faces = np.concatenate([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)]).reshape(-1, 3)
    write_mesh(TriangleMesh(np.stack([x, y, z], axis=-1).reshape(-1, 3), faces), folder / "sheet.stl")
    return folder / "sheet.stl"


def patch(folder: Path, rng: Rng) -> list[object]:
    vessel = broken_vessel(VesselOptions(edge=3.0, thickness=rng.uniform(3.0, 4.0), seed=int(rng.integers(1000))))
    files = [folder / f"sherd-{i}.stl" for i in range(len(vessel.sherds))]
    for mesh, path in zip(vessel.sherds, files):
        write_mesh(mesh, path)
    return ["patch", *files]


def fit(folder: Path, rng: Rng) -> list[object]:
    return ["fit", ball(folder, rng), "--control-points", int(rng.integers(30, 60))]


def fit_quads(folder: Path, rng: Rng) -> list[object]:
    return ["fit", ball(folder, rng), "--surface", "catmull-clark", "--control-points", int(rng.integers(40, 60))]


def fit_face(folder: Path, rng: Rng) -> list[object]:
    return ["fit", sheet(folder, rng), "--surface", "bspline", "--control-points", int(rng.integers(60, 120))]


def curve(folder: Path, rng: Rng) -> list[object]:
    t = np.linspace(0.0, np.pi, int(rng.integers(40, 80)))
    np.savetxt(folder / "row.csv", np.stack([30.0 * np.cos(t), rng.uniform(5, 20) * np.sin(3 * t)], axis=1))
    return ["curve", folder / "row.csv", "--tolerance", "0.1%"]


def terrain(folder: Path, rng: Rng) -> list[object]:
    nx, ny = rng.integers(12, 18, 2)
    x, y = np.meshgrid(np.arange(nx), np.arange(ny))
    top, middle = rng.uniform(30.0, 60.0), rng.uniform(5.0, 9.0, 2)
    heights = top * np.exp(-((x - middle[0]) ** 2 + (y - middle[1]) ** 2) / 20.0) + 0.3 * x
    content = {"width": int(nx), "height": int(ny), "values": heights.ravel().tolist()}
    (folder / "grid.json").write_text(json.dumps(content))
    return ["terrain", folder / "grid.json", "--interval", 10, "--base-depth", 20]


def voxels(folder: Path, rng: Rng) -> list[object]:
    n = int(rng.integers(14, 22))
    p = np.stack(np.indices((n, n, n)), axis=-1) - 0.5 * n + 0.5
    solid = (p / rng.uniform(0.25, 0.42, 3)) ** 2
    np.save(folder / "ball.npy", (solid.sum(axis=-1) < n * n).astype(np.uint8))
    return ["voxels", folder / "ball.npy"]


def views(folder: Path, rng: Rng) -> list[object]:
    w, d, h = np.round(rng.uniform(10.0, 40.0, 3), 1).tolist()
    x, z = round(w / 2, 1), round(h / 2, 1)  # a step
    front = [[0, 0, w, 0], [w, 0, w, z], [w, z, x, z], [x, z, x, h], [x, h, 0, h], [0, h, 0, 0]]
    top = [[0, 0, w, 0], [w, 0, w, d], [w, d, 0, d], [0, d, 0, 0], [x, 0, x, d]]
    side = [[0, 0, d, 0], [d, 0, d, h], [d, h, 0, h], [0, h, 0, 0], [0, z, d, z]]
    content = {
        name: {"visible": rows, "hidden": []} for name, rows in zip(("front", "top", "side"), (front, top, side))
    }
    (folder / "views.json").write_text(json.dumps({"views": content}))
    return ["views", folder / "views.json"]


# a mixture: what takes long comes once, what is quick more often
KINDS: tuple[Kind, ...] = (
    *(views, voxels, curve, terrain, fit, voxels, views, terrain, curve, fit_face),
    *(views, voxels, curve, terrain, fit, voxels, views, fit_face, fit_quads, patch),
)


def _here(job: str, request: dict[str, Any], **terms: Any) -> Outcome:
    del terms
    return work_here(job, request, Bench(lambda message: None))


def done(kind: Kind, number: int) -> str:
    """Do a job of a kind, its input drawn by its number, and check what it wrote; what went wrong, or nothing."""
    with TemporaryDirectory() as place, put_in_place.object(front_desk, "run", _here), redirect_stdout(io.StringIO()):
        folder = Path(place)
        words = kind(folder, np.random.default_rng(number))
        status = app([*map(str, words), "-o", str(folder / "out.step"), "--quiet"], standalone_mode=False)
        if status == 0:
            status = app(["check", str(folder / "out.step"), "--allow-open", "--quiet"], standalone_mode=False)
    return "" if status == 0 else f"job {number}, {kind.__name__}, ended with {status}"


def resident() -> float:
    """Megabytes that this process holds."""
    gc.collect()
    return float(psutil.Process().memory_info().rss) / MEBIBYTE


def memory_held(kinds: tuple[Kind, ...], marks: tuple[int, ...]) -> Iterator[tuple[int, float, list[str]]]:
    """After so many jobs as each mark says: the jobs done, megabytes held, and what went wrong since the last mark."""
    number = 0
    for mark in marks:
        wrong = [problem for k in range(number, mark) if (problem := done(kinds[k % len(kinds)], k))]
        number = mark
        yield mark, resident(), wrong

"""What stood under an output's name stays until a whole file takes its place: killed at any moment, on a full disk."""

import json
import os
import random
import signal
import subprocess
import sys
import time

import pytest

RECON = [sys.executable, "-c", "from brep_export.app.cli import main; main()"]
SQUARE = [[0, 0, 40, 0], [40, 0, 40, 40], [40, 40, 0, 40], [0, 40, 0, 0]]
OLD = "what stood here before"
WAIT = 300.0


@pytest.fixture
def cube(tmp_path):
    views = {name: {"visible": SQUARE, "hidden": []} for name in ("front", "top", "side")}
    path = tmp_path / "cube.json"
    path.write_text(json.dumps({"views": views}))
    return path


def start(cube, folder, *outputs):
    words = [word for path in outputs for word in ("-o", str(folder / path))]
    command = [*RECON, "views", str(cube), *words, "--quiet"]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def identity(path):
    found = path.stat()
    return path.read_bytes(), found.st_mtime_ns, found.st_ctime_ns, found.st_ino


def is_old_or_complete(folder):
    """Whether each output is the old file, or one that ends as its format does."""
    step, polygons = (folder / "part.step").read_text(), (folder / "part.obj").read_text()
    assert step == OLD or step.rstrip().endswith("END-ISO-10303-21;")
    assert polygons == OLD or polygons.count("\nf ") == 6
    return step != OLD


def kill_and_look(cube, folder, moment):
    """Kill the command when the moment comes, wait for its end and that of all it started."""
    for name in ("part.step", "part.obj"):
        (folder / name).write_text(OLD)
    run = start(cube, folder, "part.step", "part.obj")
    moment(run)
    run.send_signal(signal.SIGKILL)
    run.communicate(timeout=WAIT)  # ends when the last process with its streams has ended
    return is_old_or_complete(folder)


def when_a_temporary_file_is_there(folder):
    def moment(run):
        while run.poll() is None and not list(folder.glob(".part*")):
            time.sleep(0.0005)

    return moment


def test_a_command_that_is_killed_while_it_writes_leaves_the_old_files(cube, tmp_path):
    folder = tmp_path / "out"
    folder.mkdir()
    before = identity(cube)
    for _ in range(2):
        kill_and_look(cube, folder, when_a_temporary_file_is_there(folder))
        for path in folder.glob(".part*"):
            path.unlink()
    assert identity(cube) == before


@pytest.mark.slow
def test_a_command_that_is_killed_at_any_moment_leaves_the_old_files_or_whole_new_ones(cube, tmp_path):
    folder = tmp_path / "out"
    folder.mkdir()
    begun = time.monotonic()
    assert kill_and_look(cube, folder, lambda run: run.wait(WAIT))
    whole = time.monotonic() - begun
    moments = random.Random(4)
    for _ in range(20):
        delay = moments.uniform(0.0, 1.1 * whole)
        kill_and_look(cube, folder, lambda run, delay=delay: time.sleep(delay))


@pytest.fixture
def full_disk(tmp_path):
    """A file system of its own with hardly any room left."""
    place = tmp_path / "full"
    place.mkdir()
    try:
        made = subprocess.run(
            ["mount", "-t", "tmpfs", "-o", "size=8k", "tmpfs", str(place)], capture_output=True, check=False
        )
    except OSError:
        pytest.skip("there is no mount here")
    if made.returncode:
        pytest.skip("a small file system cannot be mounted here: that takes the rights of an administrator")
    try:
        yield place
    finally:
        subprocess.run(["umount", str(place)], check=False)


def run_on(disk, *words):
    run = subprocess.run([*RECON, *map(str, words)], capture_output=True, text=True, timeout=WAIT, check=False)
    assert run.returncode == 1, run.stderr
    assert run.stderr.count("\n") == 1 and "was not written" in run.stderr
    assert "fault" not in run.stderr
    return {path.name: path.read_text() for path in disk.iterdir()}


ENDINGS = (".brep",)
MORE = (".step", ".3mf", ".json", ".iges", ".stl", ".glb", ".obj", ".png", ".html")


@pytest.mark.parametrize("ending", [*ENDINGS, *(pytest.param(e, marks=pytest.mark.slow) for e in MORE)])
def test_a_full_disk_leaves_the_old_file_and_is_told_of_in_a_sentence(ending, cube, tmp_path, full_disk):
    target = full_disk / f"part{ending}"
    target.write_text(OLD)
    (full_disk / "filling").write_text("x" * 3500)
    option = {".png": "--picture", ".html": "--report"}.get(ending, "-o")
    words = ["views", cube, option, target, *(["-o", tmp_path / "part.step"] if option != "-o" else [])]
    left = run_on(full_disk, *words)
    assert left == {target.name: OLD, "filling": "x" * 3500}


@pytest.mark.slow
def test_a_batch_on_a_full_disk_names_its_jobs_and_keeps_nothing_half_written(cube, tmp_path, full_disk):
    (tmp_path / "jobs.toml").write_text(
        '[[job]]\nname = "cube"\ncommand = "views"\ninputs = "cube.json"\noutputs = "part.step"\n'
    )
    run = subprocess.run(
        [*RECON, "batch", tmp_path / "jobs.toml", "-o", full_disk / "out", "--workers", "1"],
        capture_output=True,
        text=True,
        timeout=WAIT,
        check=False,
        env=os.environ,
    )
    assert run.returncode == 1
    assert "Traceback" not in run.stderr
    assert not list(full_disk.rglob("part.step"))

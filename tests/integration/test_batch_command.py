"""`recon batch`: killed in the middle and started again, with jobs that crash, hang, eat memory or cannot be read."""

import csv
import json
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np
import psutil
import pytest

ROOT = Path(__file__).parents[2]
POISON = ROOT / "tests" / "shapes" / "poison"
RECON = [sys.executable, "-c", "from brep_export.app.cli import main; main()"]
SQUARE = [[0, 0, 40, 0], [40, 0, 40, 40], [40, 40, 0, 40], [0, 40, 0, 0]]
BROKEN_OFF = {"crash": "SIGSEGV", "hang": "--timeout", "hungry": "--memory"}
OWN_TIME = {"hang": ("--timeout", "3")}
WAIT = 900.0


def environment():
    return os.environ | {"PYTHONPATH": os.pathsep.join(map(str, (POISON, ROOT)))}


def start(folder, *words):
    command = [*RECON, "batch", "jobs.toml", "-o", "out", "--workers", "2", "--json", *map(str, words)]
    return subprocess.Popen(
        command, cwd=folder, env=environment(), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def journal(folder):
    path = folder / "out" / "journal.jsonl"
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


def wait_for(wanted, folder):
    deadline = time.monotonic() + WAIT
    while time.monotonic() < deadline:
        found = wanted(journal(folder))
        if found:
            return found
        time.sleep(0.05)
    raise AssertionError(f"it did not happen; the journal holds {journal(folder)}")


def finished(lines):
    return {line["job"] for line in lines if line["event"] in ("done", "failed")}


def times(folder):
    return {path: path.stat().st_mtime_ns for path in folder.rglob("*") if path.is_file()}


def at_work_in(folder):
    """Processes that stand in a folder, as every attempt does in its own."""
    found = []
    for process in psutil.process_iter(["pid"]):
        try:
            if str(folder) in process.cwd() and process.status() != psutil.STATUS_ZOMBIE:
                found.append(process)
        except psutil.Error:
            continue
    return found


def job(name, command, source, ending=".step", options=()):
    lists = {"inputs": [source], "outputs": [f"{name}{ending}"] if ending else [], "options": list(options)}
    lines = "".join(f"{key} = {json.dumps(value)}\n" for key, value in lists.items())
    return f'[[job]]\nname = "{name}"\ncommand = "{command}"\n{lines}'


def sources(folder):
    views = {name: {"visible": SQUARE, "hidden": []} for name in ("front", "top", "side")}
    (folder / "cube.json").write_text(json.dumps({"views": views}))
    (folder / "bar.json").write_text(json.dumps({"views": views}).replace("40", "60"))
    a = np.linspace(0.0, np.pi, 30)
    np.savetxt(folder / "arc.csv", np.stack([30.0 * np.cos(a), 20.0 * np.sin(a)], axis=1), delimiter=",")
    np.save(folder / "box.npy", np.pad(np.ones((6, 5, 4), np.uint8), 2))
    (folder / "bad.json").write_text('{"views": ')


def test_a_run_that_is_killed_goes_on_and_what_breaks_off_is_named(tmp_path):
    sources(tmp_path)
    good = [job("cube", "views", "cube.json"), job("arc", "curve", "arc.csv"), job("bar", "views", "bar.json")]
    poisoned = [job(name, "curve", "arc.csv", options=OWN_TIME.get(name, ())) for name in BROKEN_OFF]
    poisoned.append(job("unreadable", "views", "bad.json"))
    (tmp_path / "jobs.toml").write_text("".join([good[1], poisoned[0], good[0], *poisoned[1:], good[2]]))
    terms = ("--memory", "1500MB", "--retries", 1)

    first = start(tmp_path, *terms)
    done = wait_for(finished, tmp_path)
    first.kill()
    first.communicate()
    deadline = time.monotonic() + 20.0
    while at_work_in(tmp_path / "out") and time.monotonic() < deadline:
        time.sleep(0.1)
    assert at_work_in(tmp_path / "out") == []  # nobody works on for a run that is gone
    before = {name: times(tmp_path / "out" / name) for name in done}
    count = len(journal(tmp_path))

    second = start(tmp_path, *terms)
    victim = wait_for(lambda lines: [line for line in lines[count:] if line["event"] == "started"], tmp_path)[0]
    os.kill(victim["process"], signal.SIGKILL)
    printed, errors = second.communicate(timeout=WAIT)
    assert second.returncode == 1, errors
    answer = json.loads(printed)

    assert {name: times(tmp_path / "out" / name) for name in done} == before
    starts = Counter(line["job"] for line in journal(tmp_path)[count:] if line["event"] == "started")
    assert not done & set(starts)
    assert starts[victim["job"]] >= 2
    told = {row["name"]: row for row in answer["room"]["list"]}
    assert [name for name, row in told.items() if row["status"] == "done"] == ["arc", "cube", "bar"]
    for name, said in BROKEN_OFF.items():
        assert said in told[name]["reasons"][0]
        assert told[name]["attempts"] == 2
    assert "is no JSON" in told["unreadable"]["reasons"][0] and told["unreadable"]["attempts"] == 1
    assert len(answer["reasons"]) == 4 and "Traceback" not in errors

    table = list(csv.DictReader((tmp_path / "out" / "summary.csv").read_text().splitlines()))
    assert {row["job"]: row["cause"] for row in table if row["status"] == "failed"} == {
        "crash": "crash",
        "hang": "timeout",
        "hungry": "memory",
        "unreadable": "",
    }
    volumes = {row["job"]: row["volume"] for row in table}
    assert abs(float(volumes["cube"]) - 64000.0) < 1e-6
    assert "4 of 7 failed" in (tmp_path / "out" / "summary.html").read_text()
    assert not list((tmp_path / "out").glob(".attempts*"))

    third = start(tmp_path, *terms)
    printed, _ = third.communicate(timeout=WAIT)
    assert json.loads(printed)["room"]["kept"] == 7
    assert third.returncode == 1


def test_a_job_waits_for_a_free_worker_in_the_order_given(tmp_path):
    sources(tmp_path)
    names = [f"job{i}" for i in range(6)]
    (tmp_path / "jobs.toml").write_text("".join(job(name, "curve", "arc.csv") for name in names))
    printed, errors = start(tmp_path).communicate(timeout=WAIT)
    assert json.loads(printed)["room"]["done"] == 6, errors
    started = [line["job"] for line in journal(tmp_path) if line["event"] == "started"]
    for place, name in enumerate(names):
        assert abs(started.index(name) - place) <= 1  # the two that run at once may be entered either way
    free = {}
    for line in journal(tmp_path):
        assert free.get(line["process"], True) == (line["event"] == "started")
        free[line["process"]] = line["event"] != "started"


def test_a_second_run_in_the_same_folder_and_a_scheduler_that_is_not_there_are_refused(tmp_path):
    sources(tmp_path)
    (tmp_path / "jobs.toml").write_text(job("arc", "curve", "arc.csv"))
    (tmp_path / "out").mkdir()
    with (tmp_path / "out" / ".lock").open("w") as held:
        fcntl = pytest.importorskip("fcntl")
        fcntl.flock(held, fcntl.LOCK_EX)
        run = start(tmp_path)
        assert "another run" in run.communicate(timeout=WAIT)[1]
        assert run.returncode == 2
    for address, says in (("nonsense", "no address"), ("tcp://127.0.0.1:9", "no scheduler answers")):
        run = subprocess.Popen(
            [*RECON, "batch", "jobs.toml", "-o", "out", "--scheduler", address],
            cwd=tmp_path,
            env=environment(),
            stderr=subprocess.PIPE,
            text=True,
        )
        (sentence,) = run.communicate(timeout=WAIT)[1].splitlines()
        assert run.returncode == 2
        assert sentence.startswith("recon batch: --scheduler: ") and says in sentence


def test_a_plan_is_told_and_nothing_done(tmp_path):
    sources(tmp_path)
    (tmp_path / "jobs.toml").write_text(job("arc", "curve", "arc.csv"))
    printed, _ = start(tmp_path, "--dry-run").communicate(timeout=WAIT)
    assert json.loads(printed)["room"]["jobs"] == [f"arc: recon curve {tmp_path / 'arc.csv'} -o arc.step"]
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_two_hundred_jobs_with_ten_poisoned_ones(tmp_path):
    sources(tmp_path)
    kinds = (("views", "cube.json"), ("curve", "arc.csv"), ("voxels", "box.npy"), ("views", "bar.json"))
    jobs = [job(f"good{i}", *kinds[i % 4]) for i in range(190)]
    poison = ["crash", "hang", "hungry"] * 3
    for i, name in enumerate(poison):
        jobs.insert(20 * i + 7, job(f"{name}{i}", "curve", "arc.csv", options=OWN_TIME.get(name, ())))
    jobs.insert(100, job("unreadable", "views", "bad.json"))
    (tmp_path / "jobs.toml").write_text("".join(jobs))
    terms = ("--memory", "1500MB")
    run = start(tmp_path, *terms)
    for part in (20, 60):
        wait_for(lambda lines, part=part: len(finished(lines)) >= part, tmp_path)
        os.kill(journal(tmp_path)[-1]["process"], signal.SIGKILL)
    before = {}
    for _ in range(2):
        many = len(before) + 60
        wait_for(lambda lines, many=many: len(finished(lines)) >= many, tmp_path)
        run.kill()
        run.communicate()
        done = finished(journal(tmp_path))
        before = {name: times(tmp_path / "out" / name) for name in done}
        run = start(tmp_path, *terms)
    printed, errors = run.communicate(timeout=3000)
    room = json.loads(printed)["room"]
    assert (run.returncode, room["done"], room["failed"]) == (1, 190, 10), errors
    assert {row["name"] for row in room["list"] if row["status"] == "failed"} == {
        *(f"{name}{i}" for i, name in enumerate(poison)),
        "unreadable",
    }
    assert {name: times(tmp_path / "out" / name) for name in before} == before
    ends = Counter(line["job"] for line in journal(tmp_path) if line["event"] in ("done", "failed"))
    assert set(ends.values()) == {1}
    assert len(ends) >= 196  # a kill between a record and its line in the journal costs the line

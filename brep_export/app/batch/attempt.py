"""On a worker: one job, in a child process that is watched, tried again where it broke off, its record put in place.

A refusal and bad input say the same every time; only what broke off (crash, time, memory, a fault) is tried again.
"""

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import brep_export
from brep_export.app.batch.journal import enter
from brep_export.app.batch.records import kept_record, put_record
from brep_export.app.batch.words import Order

__all__ = ["ATTEMPTS", "Terms", "work"]

ATTEMPTS = ".attempts"
LOOK = 0.1  # seconds between two looks at a child's memory
BEGINNING, COUNTED = 30, 10  # looks until it has started all processes, as a rule; then every tenth finds them anew,
# which takes a hundred times as long as a look
GRACE = 20.0  # seconds a command may take to stop itself, before it is stopped from outside
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
WORKERS_OWN = {"MALLOC_TRIM_THRESHOLD_"}  # Dask has workers give memory back at once, which slows jobs by a quarter
MEBIBYTE = 2**20


@dataclass(frozen=True)
class Terms:
    """What a job may take.

    timeout  seconds an attempt, or None
    memory   bytes that the processes of an attempt may hold together, as asked for, or None
    retries  further attempts after one that broke off
    share    the same as memory where nobody asked: what this machine has for one job now
    """

    timeout: float | None = None
    memory: int | None = None
    retries: int = 0
    share: int | None = None

    @property
    def limits(self) -> dict[str, Any]:
        """What was asked for: a job that broke off under it is done again only where it changes."""
        return {"timeout": self.timeout, "memory": self.memory}

    @property
    def most_memory(self) -> float:
        allowed = self.share if self.memory is None else self.memory
        return float("inf") if allowed is None else allowed


@dataclass(frozen=True)
class Ending:
    """How one attempt ended: status, what it printed, bytes held at most, and why it was stopped from outside."""

    status: int
    answer: Mapping[str, Any]
    errors: str
    peak: int
    stopped: str


def work(order: Order, key: str, directory: str, terms: Terms) -> dict[str, Any]:
    """The record of a job, done now unless another worker has finished it meanwhile."""
    root = Path(directory)
    kept = kept_record(root / order.name, key, terms.limits)
    if kept is not None:
        return kept
    started, log, record = time.perf_counter(), "", {}
    for attempt in range(1, terms.retries + 2):
        (root / ATTEMPTS).mkdir(parents=True, exist_ok=True)
        made = Path(tempfile.mkdtemp(prefix=f"{order.name}.", dir=root / ATTEMPTS))
        try:
            enter(root, "started", order.name, attempt=attempt)
            ending = _attempt(order, made, terms)
            log += _log(order, attempt, ending)
            record = _record(order, key, terms, ending) | {"attempts": attempt}
            if not record["cause"] or attempt > terms.retries:
                record["seconds"] = round(time.perf_counter() - started, 3)
                (made / "log.txt").write_text(log, encoding="utf-8")
                record = put_record(root / order.name, made, record)
                enter(root, record["status"], order.name, attempt=attempt)
                break
            enter(root, "broke off", order.name, attempt=attempt)
        finally:
            shutil.rmtree(made, ignore_errors=True)
    return record


def _attempt(order: Order, made: Path, terms: Terms) -> Ending:
    for name in order.words:
        if "/" in name and not Path(name).is_absolute() and ".." not in Path(name).parts:
            (made / name).parent.mkdir(parents=True, exist_ok=True)
    limit = [] if terms.timeout is None else ["--timeout", str(terms.timeout)]
    words = [order.command, "--json", "--quiet", *limit, *order.words]
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as errors:
        child = subprocess.Popen(
            [sys.executable, "-m", "brep_export.app.batch.child", str(os.getpid()), *words],
            cwd=made,
            env=_environment(),
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=errors,
        )
        own_time = any(word.startswith("--timeout") for word in order.words)
        stopped, peak = _watched(child, terms, None if own_time else terms.timeout)
        out.seek(0)
        errors.seek(0)
        return Ending(child.returncode, _answer(out.read()), errors.read().decode("utf-8", "replace"), peak, stopped)


def _environment() -> dict[str, str]:
    """One thread for the kernel and its like, memory managed as the system does, and this package where it was found:
    the child stands elsewhere.
    """
    places = [str(Path(brep_export.__file__).parents[1]), *os.environ.get("PYTHONPATH", "").split(os.pathsep)]
    inherited = {name: value for name, value in os.environ.items() if name not in WORKERS_OWN}
    return inherited | ONE_THREAD | {"PYTHONPATH": os.pathsep.join(place for place in places if place)}


def _watched(child: subprocess.Popen[bytes], terms: Terms, timeout: float | None) -> tuple[str, int]:
    """Wait for the child; stop it, and all that it started, when it outgrows its terms.

    A command keeps its time itself; `timeout` with some grace is for one that does not.
    """
    import psutil

    peak, begun, looks, family = 0, time.monotonic(), 0, list[Any]()
    while True:
        try:
            child.wait(LOOK)
            return "", peak
        except subprocess.TimeoutExpired:
            if looks < BEGINNING or looks % COUNTED == 0:
                family = _family(psutil, child.pid)
            held = _held(psutil, family)
        looks, peak = looks + 1, max(peak, held)
        late = timeout is not None and time.monotonic() - begun > timeout + GRACE
        if late or held > terms.most_memory:
            _kill(psutil, child)
            return "timeout" if late else "memory", peak


def _family(psutil: Any, number: int) -> list[Any]:
    try:
        process = psutil.Process(number)
        return [process, *process.children(recursive=True)]
    except psutil.Error:
        return []


def _held(psutil: Any, family: Sequence[Any]) -> int:
    """Bytes of memory that processes hold."""
    held = 0
    for process in family:
        try:
            held += process.memory_info().rss
        except psutil.Error:
            continue
    return held


def _kill(psutil: Any, child: subprocess.Popen[bytes]) -> None:
    for process in _family(psutil, child.pid):
        try:
            process.kill()
        except psutil.Error:
            continue
    child.wait()


def _answer(printed: bytes) -> dict[str, Any]:
    try:
        answer = json.loads(printed)
    except ValueError:
        return {}
    return answer if isinstance(answer, dict) else {}


def _record(order: Order, key: str, terms: Terms, ending: Ending) -> dict[str, Any]:
    cause = ending.stopped or str(ending.answer.get("cause", "")) or ("" if ending.answer else "crash")
    done = ending.status == 0 and not cause
    return {
        "name": order.name,
        "command": order.command,
        "words": list(order.words),
        "key": key,
        "status": "done" if done else "failed",
        "cause": cause,
        "reasons": [] if done else _reasons(ending, terms),
        "limits": terms.limits,
        "peak_memory_mb": round(ending.peak / MEBIBYTE, 1),
        "answer": dict(ending.answer),
    }


def _reasons(ending: Ending, terms: Terms) -> list[str]:
    if ending.stopped == "memory":
        held, allowed = ending.peak / MEBIBYTE, terms.most_memory / MEBIBYTE
        return [f"stopped when it held {held:.0f} MB of memory, {allowed:.0f} MB allowed; allow more with --memory."]
    if ending.stopped:
        return [f"stopped from outside after {terms.timeout:g} s and {GRACE:g} s of grace."]
    said = ending.answer.get("reasons") or ending.errors.strip().splitlines()[-1:]
    return list(said) or [f"the command ended with status {ending.status} and said nothing."]


def _log(order: Order, attempt: int, ending: Ending) -> str:
    line = f"attempt {attempt}: recon {order.command} {' '.join(order.words)}\n"
    stopped = f", stopped for {ending.stopped}" if ending.stopped else ""
    notes = "".join(f"note: {note}\n" for note in ending.answer.get("notes", ()))
    return f"{line}{ending.errors}{notes}status {ending.status}{stopped}\n"

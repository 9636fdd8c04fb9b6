"""A run of many jobs: those that are finished are kept, the others given to workers, all summed up in a table."""

import os
import shutil
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from brep_export.app.batch.attempt import ATTEMPTS, Terms
from brep_export.app.batch.cluster import records_as_they_come, workers
from brep_export.app.batch.jobs import Job
from brep_export.app.batch.records import job_key, kept_record
from brep_export.app.batch.summary import write_summary
from brep_export.app.batch.words import Order, order
from brep_export.app.result import result
from recon.errors import BadOption

__all__ = ["BatchRun", "available_processors", "memory_share", "run_batch"]

Told = Callable[[dict[str, Any], int, int], None]


@dataclass(frozen=True)
class BatchRun:
    """How a run is done.

    scheduler    address of a cluster, or None for one on this machine
    n_workers    of the cluster on this machine
    again        whether jobs that failed before are tried again
    """

    directory: Path
    terms: Terms
    scheduler: str | None = None
    n_workers: int = 1
    again: bool = False


@dataclass
class _Tally:
    records: dict[str, dict[str, Any]] = field(default_factory=dict)
    kept: int = 0


def run_batch(jobs: Sequence[Job], run: BatchRun, *, told: Told = lambda record, ended, all_of_them: None) -> Any:
    """Do the jobs; the answer as a JSON object, its verdict `pass` where none failed.

    told    called with each record as it comes, how many jobs have ended, and how many there are
    Raises  BadOption for a job whose words make no sense (before any is started), for a folder that cannot be used or
            in which another run is at work, for a scheduler that does not answer; NotWritten for the summary.
    """
    begun = time.perf_counter()
    orders = [order(job) for job in jobs]
    tally = _Tally()
    with _alone_in(run.directory):
        shutil.rmtree(run.directory / ATTEMPTS, ignore_errors=True)
        open_orders = _open(orders, run, tally)
        try:
            _do(open_orders, len(orders), run, tally, told)
        finally:
            shutil.rmtree(run.directory / ATTEMPTS, ignore_errors=True)
            ended = [tally.records[one.name] for one in orders if one.name in tally.records]
            summaries = write_summary(run.directory, ended)
    return _answer(ended, summaries, tally.kept, time.perf_counter() - begun)


def _open(orders: Sequence[Order], run: BatchRun, tally: _Tally) -> list[tuple[Order, str]]:
    """Jobs that are still to be done, with their keys."""
    left = []
    for one in orders:
        key = job_key(one)
        kept = kept_record(run.directory / one.name, key, run.terms.limits)
        if kept is None or (run.again and kept["status"] != "done"):
            left.append((one, key))
        else:
            tally.records[one.name] = kept
            tally.kept += 1
    return left


def _do(left: Sequence[tuple[Order, str]], n_jobs: int, run: BatchRun, tally: _Tally, told: Told) -> None:
    if not left:
        return
    for one, _ in left:
        _forget_failure(run.directory / one.name, again=run.again)
    with workers(run.scheduler, min(run.n_workers, len(left))) as client:
        for record in records_as_they_come(client, left, str(run.directory), run.terms):
            tally.records[record["name"]] = record
            told(record, len(tally.records), n_jobs)


def _forget_failure(folder: Path, *, again: bool) -> None:
    """A worker would keep the record of a failure, as the run does where nobody asks to try again."""
    if again:
        (folder / "result.json").unlink(missing_ok=True)


def _answer(records: Sequence[dict[str, Any]], summaries: list[str], kept: int, seconds: float) -> dict[str, Any]:
    failed = [record for record in records if record["status"] != "done"]
    reasons = [f"{record['name']}: {' '.join(record['reasons'])}" for record in failed]
    room = {"jobs": len(records), "done": len(records) - len(failed), "failed": len(failed), "kept": kept}
    room["attempts"] = sum(record["attempts"] for record in records)
    listed = [{key: record[key] for key in ("name", "status", "cause", "reasons", "attempts")} for record in records]
    return result(
        "batch",
        inputs=(),
        outputs=summaries,
        reasons=reasons,
        kernel={},
        seconds={"total": seconds},
        room={**room, "list": listed},
    )


@contextmanager
def _alone_in(directory: Path) -> Iterator[None]:
    """Make the folder and hold it; the system lets go of it when this process ends, however it ends."""
    try:
        directory.mkdir(parents=True, exist_ok=True)
        place = os.open(directory / ".lock", os.O_RDWR | os.O_CREAT, 0o666)
    except OSError as problem:
        raise BadOption("--output", f"{directory} cannot be written to ({problem.strerror})") from problem
    try:
        _hold(place, directory)
        yield
    finally:
        os.close(place)


def _hold(place: int, directory: Path) -> None:
    if sys.platform == "win32":
        return
    import fcntl

    try:
        fcntl.flock(place, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as problem:
        raise BadOption("--output", f"another run is at work in {directory}") from problem


def available_processors() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def memory_share(n_workers: int) -> int:
    """Bytes for each of so many workers: what is free now, shared out."""
    import psutil

    return int(psutil.virtual_memory().available * 0.9 / n_workers)

"""Work in a child process, so that a crash of the kernel, or a job that never ends, becomes one sentence.

     front desk (this process, light)              workshop (spawned, holds the kernel)
     ---------------------------------             -------------------------------------
     run(job, request)  ---- request ------------> job(request, Bench)
       progress line    <--- ("doing", text) -----   bench.phase("read") ...
       notes            <--- ("note", text) ------   bench.note("...")
       clean-up list    <--- ("staged", path) ----   a temporary file exists from now on
       what stays       <--- ("kept", paths) -----   files that are whole, whatever becomes of the rest
       Outcome          <--- ("done", dict) ------   or ("refused", ...) or ("bad input", ...)

Whatever ends the workshop early, the front desk removes the temporary files that it was told of.  Where the front desk
itself is killed, the workshop ends with it.
"""

import importlib
import multiprocessing
import os
import signal
import time
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from enum import IntEnum
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from brep_export.orphans import die_with_parent
from recon.errors import InputError, ReconError

__all__ = ["Bench", "Exit", "Outcome", "ended_by", "run", "work_here"]


class Exit(IntEnum):
    """Exit status of the command line."""

    WRITTEN = 0
    REFUSED = 1
    BAD_INPUT = 2
    INTERRUPTED = 130


@dataclass(frozen=True)
class Outcome:
    """How a job ended.

    status   exit status
    result   the JSON object of the command, or None where nothing could be said but `reasons`
    reasons  why it was refused, one sentence each
    trace    where a fault of our own was raised, for a report to the authors
    cause    `timeout`, `crash`, `memory` or `fault` where the work broke off, and might do better at another time
    figures  what the reasons say, for a program, where there is no result
    """

    status: Exit
    result: dict[str, Any] | None = None
    reasons: tuple[str, ...] = ()
    trace: str = ""
    cause: str = ""
    figures: Mapping[str, Any] = field(default_factory=dict)


@dataclass
class Bench:
    """What a job holds while it works: phases that are timed and announced, notes, and staged files.

    silenced  names of notes that are kept for the answer and not shown
    """

    send: Callable[[tuple[str, Any]], None]
    silenced: frozenset[str] = frozenset()
    seconds: dict[str, float] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    started: float = field(default_factory=time.perf_counter)

    @contextmanager
    def phase(self, key: str, doing: str) -> Iterator[None]:
        """Announce `doing` and add the time it takes to `seconds[key]`."""
        self.doing(doing)
        begin = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[key] = self.seconds.get(key, 0.0) + time.perf_counter() - begin

    def elapsed(self) -> float:
        """Seconds since the bench was set up."""
        return time.perf_counter() - self.started

    def doing(self, text: str) -> None:
        self.send(("doing", text))

    def note(self, text: str, *, name: str = "") -> None:
        """Tell the user something at once, unless it is silenced by its name, and keep it for the answer."""
        self.notes.append(text)
        if name not in self.silenced:
            self.send(("note", f"{text} [{name}]" if name else text))

    def staged(self, path: Path) -> None:
        """Tell the front desk of a temporary file, which it removes if this process cannot."""
        self.send(("staged", str(path)))

    def kept(self, paths: Sequence[str]) -> None:
        """Tell the front desk of files that are finished while the job goes on."""
        self.send(("kept", list(paths)))


def run(
    job: str,
    request: dict[str, Any],
    *,
    timeout: float | None = None,
    doing: Callable[[str], None] = lambda text: None,
    note: Callable[[str], None] = lambda text: None,
) -> Outcome:
    """Run a job in a fresh process and wait for its end, at most `timeout` seconds.

    job    `module:function`, imported in the workshop only, since it loads the kernel; the function takes the request
           and a Bench, and returns the fields of an Outcome
    doing  called with each new step's name
    note   called with each remark or warning
    """
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_work, args=(theirs, job, request), daemon=True)
    process.start()
    theirs.close()
    try:
        return _listen(process, ours, timeout, doing, note)
    finally:
        process.kill()
        process.join()


def _listen(
    process: Any,
    ours: Connection,
    timeout: float | None,
    doing: Callable[[str], None],
    note: Callable[[str], None],
) -> Outcome:
    deadline = None if timeout is None else time.monotonic() + timeout
    step, staged, outcome = "starting", [], None
    kept: list[str] = []
    try:
        while outcome is None:
            if not ours.poll(None if deadline is None else max(0.0, deadline - time.monotonic())):
                outcome = _late(step, timeout, kept)
                break
            kind, value = ours.recv()
            if kind == "doing":
                step = value
                doing(value)
            elif kind == "note":
                note(value)
            elif kind == "staged":
                staged.append(Path(value))
            elif kind == "kept":
                kept.extend(value)
            else:
                outcome = value
    except EOFError:
        process.join()
        outcome = _crashed(step, process.exitcode, kept)
    except KeyboardInterrupt:
        outcome = Outcome(Exit.INTERRUPTED, reasons=(f"interrupted; {_written(kept)}.",))
    finally:
        process.kill()
        process.join()
        for path in staged:
            path.unlink(missing_ok=True)
    return outcome


def _late(step: str, timeout: float | None, kept: Sequence[str]) -> Outcome:
    reason = f"stopped after {timeout:g} s while {step}; {_written(kept)}. Allow more time with --timeout."
    return Outcome(Exit.REFUSED, reasons=(reason,), cause="timeout")


def _crashed(step: str, exitcode: int | None, kept: Sequence[str]) -> Outcome:
    name = signal.Signals(-exitcode).name if exitcode is not None and exitcode < 0 else f"exit status {exitcode}"
    reason = f"the work broke off while {step} ({name}); {_written(kept)}."
    return Outcome(Exit.REFUSED, reasons=(reason,), cause="crash")


def _written(kept: Sequence[str]) -> str:
    if not kept:
        return "nothing was written"
    count = "1 file was finished before" if len(kept) == 1 else f"{len(kept)} files were finished before, the last"
    return f"{count}: {kept[-1]}"


def _work(pipe: Connection, job: str, request: dict[str, Any]) -> None:
    """Life of the workshop: one job, then the end. What libraries print must not reach the caller's output."""
    if not request.get("debug"):
        sink = os.open(os.devnull, os.O_WRONLY)
        os.dup2(sink, 1)
        os.dup2(sink, 2)
    # matrices are small here: threads of the linear algebra library wait for each other far longer than they work
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    die_with_parent()
    pipe.send(("outcome", work_here(job, request, Bench(pipe.send, frozenset(request.get("silence") or ())))))
    pipe.close()


def work_here(job: str, request: dict[str, Any], bench: Bench) -> Outcome:
    """Run a job in this process; whatever it raises is said in the outcome."""
    try:
        module, function = job.split(":")
        return Outcome(*getattr(importlib.import_module(module), function)(request, bench))
    except Exception as problem:  # noqa: BLE001 - the last door: a fault of our own must still end in a sentence
        return ended_by(problem)


def ended_by(problem: Exception) -> Outcome:
    """What is said of work that raised, and where a fault of our own was raised."""
    if isinstance(problem, ReconError):
        status = Exit.BAD_INPUT if isinstance(problem, InputError) else Exit.REFUSED
        return Outcome(status, reasons=(str(problem),), figures=dict(problem.figures))
    if isinstance(problem, MemoryError):
        reason = "not enough memory for this input; nothing was written."
        return Outcome(Exit.REFUSED, reasons=(reason,), cause="memory")
    place = traceback.extract_tb(problem.__traceback__)[-1]
    where = f"{Path(place.filename).name}:{place.lineno}"
    reason = f"a fault in recon-brep itself ({type(problem).__name__}: {problem}; {where})"
    trace = "".join(traceback.format_exception(problem))
    return Outcome(Exit.REFUSED, reasons=(reason,), trace=trace, cause="fault")

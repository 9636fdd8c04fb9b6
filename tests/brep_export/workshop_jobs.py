"""Jobs that end in every way a job can end, run by test_workshop in a child process."""

import os
import signal
import time
from pathlib import Path

from brep_export.app.workshop import Exit
from recon.errors import BadOption, NoHole


def good(request, bench):
    with bench.phase("read", "reading"):
        bench.note("a remark")
    os.write(1, b"what a library prints")
    return Exit.WRITTEN, {"echo": request["word"], "phases": sorted(bench.seconds)}


def bad_input(request, bench):
    raise BadOption("--word", f"is {request['word']}")


def refused(request, bench):
    raise NoHole("there is no hole.")


def faulty(request, bench):
    return 1 / request["zero"]


def hungry(request, bench):
    raise MemoryError


def crash(request, bench):
    Path(request["file"]).write_text("half a file")
    bench.staged(Path(request["file"]))
    bench.doing("cutting")
    os.kill(os.getpid(), signal.SIGSEGV)


def endless(request, bench):
    Path(request["file"]).write_text("half a file")
    bench.staged(Path(request["file"]))
    bench.doing("waiting")
    time.sleep(3600)


def crash_at_the_second(request, bench):
    Path(request["first"]).write_text("a whole file")
    bench.kept([request["first"]])
    crash(request, bench)

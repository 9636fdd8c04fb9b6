"""Damaged files for every reader: how many are refused with a reason, how long the worst takes, and what it holds.

python benchmarks/damaged_inputs.py [files] [folder of further files]

Each file is a small sound one of its format, damaged in one of ten ways (tests/shapes/specimens.py).  Further files,
read as their endings say, are damaged in the same ways.  A fault is whatever a reader raises beside its own errors, or
more than ten seconds, or more than two gigabytes.
"""

import logging
import multiprocessing
import resource
import signal
import sys
import tempfile
import time
import warnings
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "shapes"))

from specimens import DAMAGES, SPECIMENS

from recon.errors import ReconError

SLOW = 10  # s
MUCH = 2048  # MB
PROCESSES = 2
BY_ENDING = {ending: name for name, (_, ending, _) in reversed(SPECIMENS.items())}


@dataclass
class Row:
    """What came of the files of one format."""

    ran: int = 0
    refused: int = 0
    accepted: int = 0
    slowest: float = 0.0
    most: float = 0.0
    faults: list[str] = field(default_factory=list)


class Late(BaseException):
    """Ten seconds are over; no reader may catch it."""


def ring(number: int, frame: object) -> None:
    raise Late


def most_memory() -> float:
    """Megabytes that this process has held at most."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def one(task: tuple[str, bytes, int, int]) -> tuple[str, str, float, float, str]:
    """Damage a file and read it: what came of it, in how many seconds, megabytes more at most."""
    name, data, way, seed = task
    read, ending, _ = SPECIMENS[name]
    damaged = DAMAGES[way](data, np.random.default_rng(seed))
    held, begun, fault = most_memory(), time.perf_counter(), ""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"file{ending}"
        path.write_bytes(damaged)
        signal.alarm(SLOW)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                read(path)
            ended = "accepted"
        except ReconError as problem:
            ended = "refused" if "\n" not in str(problem) else "fault"
            fault = f"{str(problem)!r} is no sentence" if ended == "fault" else ""
        except Late:
            ended, fault = "fault", f"took more than {SLOW} s"
        except Exception as problem:  # noqa: BLE001 - to find what should not come out is what this is for
            ended, fault = "fault", f"{type(problem).__name__}: {problem}"
        finally:
            signal.alarm(0)
    more = most_memory() - held
    if more > MUCH:
        ended, fault = "fault", f"held {more:.0f} MB"
    return name, ended, time.perf_counter() - begun, more, fault and f"{DAMAGES[way].__name__} {seed}: {fault[:200]}"


def sound_files(folder: Path | None) -> Iterator[tuple[str, bytes]]:
    yield from ((name, make()) for name, (_, _, make) in SPECIMENS.items())
    for path in sorted(folder.rglob("*")) if folder else ():
        if path.suffix.lower() in BY_ENDING and 0 < path.stat().st_size < 4e6:
            yield BY_ENDING[path.suffix.lower()], path.read_bytes()


def prepare() -> None:
    signal.signal(signal.SIGALRM, ring)
    logging.getLogger("ezdxf").setLevel(logging.CRITICAL)
    for name, (_, _, make) in SPECIMENS.items():
        one((name, make(), 0, 0))  # imports are not to count as what a file costs


def total(rows: dict[str, Row]) -> Row:
    """All formats together."""
    made = Row()
    for row in rows.values():
        made.ran, made.refused, made.accepted = (
            made.ran + row.ran,
            made.refused + row.refused,
            made.accepted + row.accepted,
        )
        made.slowest, made.most = max(made.slowest, row.slowest), max(made.most, row.most)
        made.faults += row.faults
    return made


def main() -> None:
    files = int(sys.argv[1]) if len(sys.argv) > 1 else 10_000
    sound = list(sound_files(Path(sys.argv[2]) if len(sys.argv) > 2 else None))
    tasks = ((*sound[i % len(sound)], i // len(sound) % len(DAMAGES), i) for i in range(files))
    rows: dict[str, Row] = defaultdict(Row)
    with multiprocessing.get_context("spawn").Pool(PROCESSES, prepare) as pool:
        for name, ended, seconds, more, fault in pool.imap_unordered(one, tasks, chunksize=20):
            row = rows[name]
            row.ran += 1
            row.refused += ended == "refused"
            row.accepted += ended == "accepted"
            row.slowest, row.most = max(row.slowest, seconds), max(row.most, more)
            row.faults += [fault] if fault else []
    print(f"{'format':24} {'ran':>6} {'refused':>8} {'accepted':>9} {'faults':>7} {'slowest s':>10} {'most MB':>8}")
    for name in [*SPECIMENS, "all"]:
        r = rows[name] if name in SPECIMENS else total(rows)
        print(f"{name:24} {r.ran:6} {r.refused:8} {r.accepted:9} {len(r.faults):7} {r.slowest:10.2f} {r.most:8.0f}")
    faults = [f"{name}: {fault}" for name, r in rows.items() for fault in r.faults]
    print(*faults[:40], sep="\n")
    sys.exit(1 if faults else 0)


if __name__ == "__main__":
    main()

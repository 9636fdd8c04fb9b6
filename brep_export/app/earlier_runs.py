"""How long the steps of a command took when it last ran, and so for how long it will work yet.

Most steps cannot say of themselves how far they are. But the same command goes through the same steps each time, on
one machine at much the same pace. So the steps of the last run are kept in the user's cache folder, a few lines for
each command and choice of options. Nothing depends on them: a folder that cannot be written, or a file that cannot be
understood, only leaves the remaining time unsaid.
"""

import json
import os
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

from brep_export.app.plan import options_chosen

__all__ = ["EarlierRun", "RunKey", "kind_of", "recall", "remember", "run_key"]

FOLDER = "recon-brep"
KEPT = 8  # runs of a command, with options chosen differently


@dataclass(frozen=True)
class RunKey:
    """What makes two runs alike: the command, the options chosen; and how far alike: the bytes of the inputs."""

    command: str
    options: str
    size: int


@dataclass(frozen=True)
class EarlierRun:
    """A run that came to its end.

    options  a digest of the options chosen
    size     bytes of its inputs
    steps    kind of each step, as `kind_of` gives it, and the seconds from the start until it began
    seconds  until its end
    """

    options: str
    size: int
    steps: Sequence[tuple[str, float]]
    seconds: float


def kind_of(step: str) -> str:
    """A step's name without its numbers, so that every round of a loop is of one kind."""
    return re.sub(r"[-+\d.,]+(e[-+]?\d+)?", "#", step)


def run_key(command: str, request: Mapping[str, Any]) -> RunKey:
    """The key of a run that is about to begin; inputs that cannot be seen weigh nothing, the job will say so."""
    options = json.dumps(options_chosen(request), sort_keys=True, default=str)
    return RunKey(command, sha256(options.encode()).hexdigest()[:16], sum(map(_size, request["inputs"])))


def recall(key: RunKey) -> EarlierRun | None:
    """The last run of the command with the same options, else the last with any; None where none is known."""
    runs = _kept(key.command)
    alike = [run for run in runs if run.options == key.options]
    return next(iter([*alike, *runs]), None)


def remember(key: RunKey, steps: Sequence[tuple[str, float]], seconds: float) -> None:
    """Keep how a run that came to its end went, in place of the last like it."""
    newest = EarlierRun(key.options, key.size, [(kind, round(began, 2)) for kind, began in steps], round(seconds, 2))
    runs = [newest, *(run for run in _kept(key.command) if run.options != key.options)][:KEPT]
    with suppress(OSError):
        path = _path(key.command)
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_suffix(f".{os.getpid()}")
        part.write_text(json.dumps([asdict(run) for run in runs]), encoding="utf-8")
        part.replace(path)


def _size(path: str) -> int:
    with suppress(OSError):
        return Path(path).stat().st_size
    return 0


def _kept(command: str) -> list[EarlierRun]:
    try:
        entries = json.loads(_path(command).read_text(encoding="utf-8"))
        return [_read(entry) for entry in entries]
    except (OSError, ValueError, TypeError, KeyError):
        return []


def _read(entry: Mapping[str, Any]) -> EarlierRun:
    steps = [(str(kind), float(began)) for kind, began in entry["steps"]]
    return EarlierRun(str(entry["options"]), int(entry["size"]), steps, float(entry["seconds"]))


def _path(command: str) -> Path:
    from platformdirs import user_cache_path

    return user_cache_path(FOLDER) / f"{command}.json"

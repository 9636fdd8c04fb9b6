"""A job as the command line that does it, checked by the command's own options before anything is started."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from brep_export.app.batch.jobs import Job
from recon.errors import BadOption

__all__ = ["Order", "order"]

WRITTEN = ("outputs", "picture", "report")


@dataclass(frozen=True)
class Order:
    """What a worker is told to run.

    words  of the command line, outputs relative to the folder in which it runs
    reads  absolute paths of every file that the words name to be read
    """

    name: str
    command: str
    words: tuple[str, ...]
    reads: tuple[str, ...]


def order(job: Job) -> Order:
    """The command line of a job; relative paths of its options are those from the job's folder.

    Raises  BadOption naming the job, where its command does not understand an option.
    """
    chosen = _chosen(job)
    read = {word: str(Path(job.folder) / word) for word in _read_by_options(chosen)}
    options = [_placed(word, read) for word in job.options]
    for word in map(str, _written(chosen)):
        if Path(word).is_absolute() or ".." in Path(word).parts:
            raise BadOption(f"job {job.name}", f"would write {word}; what a job writes is a name in its own folder")
    words = [*job.inputs, *(word for path in job.outputs for word in ("-o", path)), *options]
    return Order(job.name, job.command, tuple(words), (*job.inputs, *sorted(read.values())))


def _chosen(job: Job) -> dict[str, Any]:
    """The parameters of the command as its own parser reads them."""
    from typer.main import get_command

    from brep_export.app.cli import app

    if {"-h", "--help"} & set(job.options):
        raise BadOption(f"job {job.name}", "asks for help, and is no job")
    command = get_command(app).commands[job.command]  # type: ignore[attr-defined]
    words = [*job.inputs, *(word for path in job.outputs for word in ("-o", path)), *job.options]
    try:
        return dict(command.make_context(job.command, words).params)
    except Exception as problem:
        # typer carries its own copy of click's errors or not, by version; what they say is all that is needed of them
        if not hasattr(problem, "format_message"):
            raise
        raise BadOption(f"job {job.name}", problem.format_message().strip().rstrip(".")) from problem


def _read_by_options(chosen: dict[str, Any]) -> list[str]:
    named = {key: value for key, value in chosen.items() if key not in ("inputs", *WRITTEN)}
    return [str(path) for path in _paths(named.values())]


def _written(chosen: dict[str, Any]) -> list[Path]:
    return _paths(chosen.get(key) for key in WRITTEN)


def _paths(values: Any) -> list[Path]:
    flat = [entry for value in values for entry in (value if isinstance(value, Sequence) else [value])]
    return [entry for entry in flat if isinstance(entry, Path)]


def _placed(word: str, read: dict[str, str]) -> str:
    """A word of the options with the path in it made absolute, also behind an equals sign."""
    head, sign, tail = word.partition("=")
    if word in read:
        return read[word]
    return f"{head}={read[tail]}" if sign and tail in read else word

"""recon batch: many commands, resumable, on this machine or a cluster."""

import json
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from brep_export.app.commands.options import AsJson, DryRun, Quiet
from brep_export.app.result import refusal, summary
from brep_export.app.workshop import Exit
from recon.errors import BadOption, InputError, ReconError

if TYPE_CHECKING:
    from brep_export.app.batch.jobs import Job

__all__ = ["batch"]

UNITS = {"": 1, "k": 2**10, "m": 2**20, "g": 2**30, "t": 2**40}


def batch(
    inputs: Annotated[
        list[Path],
        typer.Argument(metavar="JOBS", help="A .toml or .csv file of jobs; with --command, files or quoted patterns."),
    ],
    directory: Annotated[Path, typer.Option("-o", "--output", help="Folder for the results, one folder a job.")],
    command: Annotated[
        str | None,
        typer.Option(help="The same command for every file: 'views {path} -o {stem}.step --all'.", metavar="TEMPLATE"),
    ] = None,
    workers: Annotated[int | None, typer.Option(help="Jobs at a time. Default: one a processor.", min=1)] = None,
    scheduler: Annotated[
        str | None, typer.Option(help="A running Dask cluster, in place of one on this machine.", metavar="tcp://...")
    ] = None,
    retries: Annotated[int, typer.Option(help="Further attempts at a job that broke off.", min=0)] = 0,
    timeout: Annotated[float | None, typer.Option(help="Stop a job after this many seconds.", min=0.1)] = None,
    memory: Annotated[
        str | None,
        typer.Option(help="What a job may hold, as 2GB. Default: an equal share of what is free.", metavar="SIZE"),
    ] = None,
    again: Annotated[bool, typer.Option("--again", help="Try jobs that failed before once more.")] = False,
    as_json: AsJson = False,
    quiet: Quiet = False,
    dry_run: DryRun = False,
) -> None:
    """Many jobs: each alone in a process, what is finished is kept, what fails is named. Start it again to go on."""
    given = [str(path) for path in inputs]
    try:
        answer = _answered(
            inputs,
            command,
            {"directory": directory, "workers": workers, "scheduler": scheduler, "retries": retries}
            | {"timeout": timeout, "memory": _bytes(memory), "again": again, "quiet": quiet, "dry_run": dry_run},
        )
        status = Exit.REFUSED if answer["reasons"] else Exit.WRITTEN
    except ReconError as problem:
        answer, status = refusal("batch", given, [str(problem)]), Exit.REFUSED
        status = Exit.BAD_INPUT if isinstance(problem, InputError) else status
    except KeyboardInterrupt:
        reason = "interrupted; what is finished is kept, and the same call goes on from there."
        answer, status = refusal("batch", given, [reason]), Exit.INTERRUPTED
    failed_at_once = not answer["room"]
    if failed_at_once:
        typer.echo(f"recon batch: {answer['reasons'][0]}", err=True)
    answer["inputs"] = given
    if as_json:
        typer.echo(json.dumps(answer))
    elif not failed_at_once:
        typer.echo(summary(answer))
    raise typer.Exit(status)


def _answered(inputs: Sequence[Path], command: str | None, chosen: dict[str, Any]) -> dict[str, Any]:
    from brep_export.app.batch.attempt import Terms
    from brep_export.app.batch.jobs import jobs_from_template, read_jobs
    from brep_export.app.batch.run import BatchRun, available_processors, memory_share, run_batch

    if command is None and len(inputs) > 1:
        raise BadOption("JOBS", "several files need --command, which says what is done with each")
    if chosen["scheduler"] is not None and chosen["workers"] is not None:
        raise BadOption("--workers", "a cluster has its own workers; leave one of --workers and --scheduler out")
    jobs = read_jobs(inputs[0]) if command is None else jobs_from_template(inputs, command)
    if chosen["dry_run"]:
        return _planned(jobs, chosen["directory"])
    n_workers = chosen["workers"] or available_processors()
    share = memory_share(n_workers) if chosen["scheduler"] is None else None
    terms = Terms(chosen["timeout"], chosen["memory"], chosen["retries"], share)
    run = BatchRun(chosen["directory"].absolute(), terms, chosen["scheduler"], n_workers, chosen["again"])
    with _shown(len(jobs), quiet=chosen["quiet"] or not sys.stderr.isatty()) as told:
        return run_batch(jobs, run, told=told)


def _planned(jobs: "Sequence[Job]", directory: Path) -> dict[str, Any]:
    """What would be run, checked as before a run."""
    from brep_export.app.batch.words import order

    orders = [order(job) for job in jobs]
    lines = [f"{one.name}: recon {one.command} {' '.join(one.words)}" for one in orders]
    return refusal("batch", [], []) | {"outputs": [str(directory)], "dry_run": True, "room": {"jobs": lines}}


def _bytes(text: str | None) -> int | None:
    """2GB, 512 MiB, 300m: bytes, in powers of 1024."""
    if text is None:
        return None
    found = re.fullmatch(r"([0-9]+(?:\.[0-9]+)?)\s*([kmgt]?)(?:i?b)?", text.strip().lower())
    if found is None or float(found.group(1)) <= 0:
        raise BadOption("--memory", f"{text!r} is no size; write it as 2GB or 512MB")
    return int(float(found.group(1)) * UNITS[found.group(2)])


@contextmanager
def _shown(n_jobs: int, *, quiet: bool) -> Iterator[Callable[[dict[str, Any], int, int], None]]:
    """A bar on stderr, and a line for each job that failed."""
    if quiet:
        yield lambda record, ended, all_of_them: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
    from rich.text import Text

    console = Console(stderr=True)
    columns = (TextColumn("jobs"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        bar = progress.add_task("", total=n_jobs)

        def told(record: dict[str, Any], ended: int, all_of_them: int) -> None:
            progress.update(bar, completed=ended, total=all_of_them)
            if record["status"] != "done":
                console.print(Text(f"{record['name']}: {' '.join(record['reasons'])}"))

        yield told

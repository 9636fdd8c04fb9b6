"""Takes a command's options, has the work done in the workshop, prints what comes back, leaves with its status."""

import json
import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from enum import Enum
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import typer

from brep_export.app.exhibits import gathered, length_unit
from brep_export.app.outputs import check_destinations
from brep_export.app.report import write_report
from brep_export.app.result import refusal, summary
from brep_export.app.workshop import Exit, Outcome, run
from recon.errors import InputError

__all__ = ["answer"]


def answer(command: str, job: str, options: Mapping[str, Any], **fixed: Any) -> None:
    """Run a job, print its result on stdout and everything else on stderr, and exit with its status.

    command  as the user typed it
    job      `module:function`, see workshop.run
    options  the command's parameters by name; as_json, quiet and timeout are for the front desk, the rest for the job
    fixed    what the command itself adds for its job
    """
    request = {key: _plain(value) for key, value in {**options, **fixed}.items()}
    request["inputs"], request["outputs"] = _listed(request["inputs"]), _listed(request["outputs"])
    as_json, quiet, timeout = request.pop("as_json"), request.pop("quiet"), request.pop("timeout")
    try:
        check_destinations(request)
        work = partial(_watched, job, quiet=quiet or not sys.stderr.isatty(), timeout=timeout)
        outcome = work(request) if request.get("report") is None else _with_report(work, request)
    except InputError as problem:
        outcome = Outcome(Exit.BAD_INPUT, reasons=(str(problem),))
    except KeyboardInterrupt:
        outcome = Outcome(Exit.INTERRUPTED, reasons=("interrupted; nothing was written.",))
    result = outcome.result or refusal(command, request["inputs"], outcome.reasons)
    if outcome.result is None:
        _complain(command, outcome, request["debug"])
    if as_json:
        typer.echo(json.dumps(result))
    elif outcome.result is not None:
        typer.echo(summary(result))
    raise typer.Exit(outcome.status)


def _with_report(work: Callable[[dict[str, Any]], Outcome], request: dict[str, Any]) -> Outcome:
    """Do the work, with a folder for what the page shows beside figures, and write the page of its result."""
    page = Path(request["report"])
    with TemporaryDirectory() as folder:
        outcome = work({**request, "page": folder})
        if outcome.result is None:
            return outcome
        result = {**outcome.result, "outputs": [*outcome.result["outputs"], str(page)]}
        write_report(page, result, gathered(Path(folder), length_unit(request)))
        return replace(outcome, result=result)


def _plain(value: Any) -> Any:
    """What may travel to another process: text in place of paths and choices."""
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, Path):
        return str(value)
    return [_plain(entry) for entry in value] if isinstance(value, list) else value


def _listed(value: Any) -> list[str]:
    if value is None:
        return []
    return value if isinstance(value, list) else [value]


def _complain(command: str, outcome: Outcome, debug: bool) -> None:
    for reason in outcome.reasons:
        typer.echo(f"recon {command}: {reason}", err=True)
    if outcome.trace and debug:
        typer.echo(outcome.trace, err=True)
    elif outcome.trace:
        typer.echo("Run it again with --debug and send what it prints to the authors.", err=True)


def _watched(job: str, request: dict[str, Any], *, quiet: bool, timeout: float | None) -> Outcome:
    if quiet:
        return run(job, request, timeout=timeout)
    from rich.console import Console

    console = Console(stderr=True)
    with console.status("starting") as status:
        return run(job, request, timeout=timeout, doing=_shown(status.update), note=_shown(console.print))


def _shown(show: Callable[[str], object]) -> Callable[[str], None]:
    from rich.markup import escape

    return lambda text: (show(escape(text)), None)[1]

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

from brep_export.app.earlier_runs import recall, remember, run_key
from brep_export.app.exhibits import gathered, length_unit
from brep_export.app.note_names import require_names
from brep_export.app.outputs import check_destinations
from brep_export.app.plan import plan, plan_summary
from brep_export.app.progress import Clock, shown_progress
from brep_export.app.report import write_report
from brep_export.app.result import refusal, summary
from brep_export.app.workshop import Exit, Outcome, run
from recon.errors import InputError, ReconError

__all__ = ["answer"]


def answer(
    command: str,
    job: str,
    options: Mapping[str, Any],
    *,
    planned_files: Callable[[Mapping[str, Any]], list[str]] = lambda request: request["outputs"],
    **fixed: Any,
) -> None:
    """Run a job, print its result on stdout and everything else on stderr, and exit with its status.

    command  as the user typed it
    job      `module:function`, see workshop.run
    options  the command's parameters by name, and under `usual` those that many commands take; as_json, quiet, timeout
             and dry_run are for the front desk, the rest for the job
    planned_files  the files that a request leads to, for a plan
    fixed    what the command itself adds for its job
    """
    request = {key: _plain(value) for key, value in {**options, **options.get("usual", {}), **fixed}.items()}
    request.pop("usual", None)
    request["inputs"], request["outputs"] = _listed(request["inputs"]), _listed(request["outputs"])
    as_json, quiet, timeout = request.pop("as_json"), request.pop("quiet"), request.pop("timeout")
    dry_run = request.pop("dry_run")
    try:
        require_names(request["silence"] or ())
        if dry_run:
            check_destinations(request, make=False)
            planned = plan(command, {**request, "outputs": planned_files(request)})
            _tell_plan(planned, as_json=as_json)
            raise typer.Exit
        check_destinations(request)
        work = partial(_watched, command, job, quiet=quiet or not sys.stderr.isatty(), timeout=timeout)
        outcome = work(request) if request.get("report") is None else _with_report(work, request)
    except ReconError as problem:
        status = Exit.BAD_INPUT if isinstance(problem, InputError) else Exit.REFUSED
        outcome = Outcome(status, reasons=(str(problem),))
    except KeyboardInterrupt:
        outcome = Outcome(Exit.INTERRUPTED, reasons=("interrupted; nothing was written.",))
    result = outcome.result or refusal(command, request["inputs"], outcome.reasons, cause=outcome.cause)
    if outcome.result is None:
        result["room"] = dict(outcome.figures)
        _complain(command, outcome)
    elif outcome.cause:
        result = {**result, "cause": outcome.cause}
    _tell_trace(outcome, request["debug"])
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


def _complain(command: str, outcome: Outcome) -> None:
    for reason in outcome.reasons:
        typer.echo(f"recon {command}: {reason}", err=True)


def _tell_trace(outcome: Outcome, debug: bool) -> None:
    if outcome.trace and debug:
        typer.echo(outcome.trace, err=True)
    elif outcome.trace:
        typer.echo("Run it again with --debug and send what it prints to the authors.", err=True)


def _watched(command: str, job: str, request: dict[str, Any], *, quiet: bool, timeout: float | None) -> Outcome:
    if quiet:
        return run(job, request, timeout=timeout)
    key = run_key(command, request)
    clock = Clock(earlier=recall(key), size=key.size)
    with shown_progress(clock) as note:
        outcome = run(job, request, timeout=timeout, doing=clock.hear, note=note)
    if outcome.result is not None:
        remember(key, clock.steps, clock.spent())
    return outcome


def _tell_plan(planned: Mapping[str, Any], *, as_json: bool) -> None:
    typer.echo(json.dumps(planned) if as_json else plan_summary(planned))

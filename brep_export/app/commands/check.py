"""recon check: the gate alone."""

from pathlib import Path
from typing import Annotated

import typer

from brep_export.app.commands.options import (
    AllowOpen,
    AsJson,
    Debug,
    DryRun,
    Picture,
    Quiet,
    Report,
    Silence,
    Timeout,
)
from brep_export.app.front_desk import answer

__all__ = ["check"]

JOB = "brep_export.app.check_job:check_file"


def check(
    inputs: Annotated[Path, typer.Argument(metavar="CAD_FILE", help="STEP, IGES or BREP file.")],
    tolerance: Annotated[float, typer.Option(help="Largest tolerance and gap allowed, in the file's unit.")] = 0.05,
    picture: Picture = None,
    report: Report = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
    timeout: Timeout = None,
    allow_open: AllowOpen = False,
    silence: Silence = None,
    dry_run: DryRun = False,
    debug: Debug = False,
) -> None:
    """The gate alone: is this file one or more closed, valid solids?"""
    answer("check", JOB, locals(), outputs=[])

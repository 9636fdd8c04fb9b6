"""recon check: the gate alone."""

from pathlib import Path
from typing import Annotated, Any

import typer

from brep_export.app.commands.options import RUNNING, AllowOpen, Picture, Report, takes
from brep_export.app.front_desk import answer

__all__ = ["check"]

JOB = "brep_export.app.check_job:check_file"


@takes(RUNNING)
def check(
    inputs: Annotated[Path, typer.Argument(metavar="CAD_FILE", help="STEP, IGES or BREP file.")],
    tolerance: Annotated[float, typer.Option(help="Largest tolerance and gap allowed, in the file's unit.")] = 0.05,
    picture: Picture = None,
    report: Report = None,
    allow_open: AllowOpen = False,
    **usual: Any,
) -> None:
    """The gate alone: is this file one or more closed, valid solids?"""
    answer("check", JOB, locals(), outputs=[])

"""recon demo: the main job on a vessel made, broken and rebuilt here."""

from pathlib import Path
from typing import Annotated, Any

import typer

from brep_export.app.commands.options import RUNNING, Report, takes
from brep_export.app.front_desk import answer

__all__ = ["demo"]

JOB = "brep_export.app.demo_job:demo"


@takes(RUNNING)
def demo(
    directory: Annotated[Path, typer.Option("--directory", "-d", help="Where the files go.")] = Path("demo"),
    seed: Annotated[int, typer.Option(help="Another seed breaks another vessel.")] = 1,
    report: Report = None,
    **usual: Any,
) -> None:
    """Make a vessel, break it, lose a sherd, rebuild it, and compare the two."""
    outputs = [directory / f"piece{ending}" for ending in (".step", ".stl")]
    page = report or directory / "piece.html"
    answer("demo", JOB, locals(), inputs=[], picture=directory / "piece.png", report=page, make_directory=directory)

"""recon views: a three-view drawing to every solid it can mean."""

from pathlib import Path
from typing import Annotated, Any

import typer

from brep_export.app.commands.options import RUNNING, WRITING, takes
from brep_export.app.front_desk import answer
from brep_export.app.outputs import ENDINGS

__all__ = ["views"]

JOB = "brep_export.app.views_job:views"


@takes(WRITING, RUNNING)
def views(
    inputs: Annotated[Path, typer.Argument(metavar="DRAWING", help="Three-view drawing: DXF, SVG or JSON.")],
    outputs: Annotated[
        list[Path] | None,
        typer.Option("-o", "--output", help=f"File to write ({' '.join(ENDINGS)} .obj .json). Repeatable."),
    ] = None,
    solution: Annotated[int, typer.Option(help="Number of the solid, the most plausible first.", min=1)] = 1,
    all_solutions: Annotated[bool, typer.Option("--all", help="Write every solid, its number in the name.")] = False,
    limit: Annotated[int, typer.Option(help="Solids written with --all, at most.", min=1)] = 100,
    snap: Annotated[
        float | None, typer.Option(help="Ends of lines that lie closer than this are one. Default: by the size.")
    ] = None,
    no_hidden: Annotated[
        bool, typer.Option("--no-hidden", help="The drawing does not tell hidden lines from visible ones.")
    ] = False,
    repair: Annotated[
        bool, typer.Option("--repair", help="Where no solid is drawn like this, change the one line that mends it.")
    ] = False,
    report: Annotated[
        Path | None, typer.Option(help="Page with each solid beside the drawing, choices to toggle (.html).")
    ] = None,
    **usual: Any,
) -> None:
    """Every solid with planar faces that a three-view drawing can mean."""
    answer("views", JOB, locals(), more_endings=(".obj", ".json"))

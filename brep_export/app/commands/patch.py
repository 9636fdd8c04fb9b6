"""recon patch: the missing piece of a broken vessel."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from brep_export.app.commands.options import RUNNING, WRITING, AllowOpen, Outputs, UnitOfScans, takes
from brep_export.app.front_desk import answer

__all__ = ["patch"]

JOB = "brep_export.app.patch_job:patch"


class Method(StrEnum):
    """How the surface over a hole is found."""

    WHEEL = "wheel"
    BOX = "box"


class Relief(StrEnum):
    """What becomes of the pattern on the outer wall."""

    NONE = "none"
    CONTINUE = "continue"
    DRAW = "draw"


@takes(WRITING, RUNNING)
def patch(
    inputs: Annotated[
        list[Path],
        typer.Argument(
            metavar="SHERDS", help="Scans in pose: closed sherds, open outer walls, or one mesh with a hole."
        ),
    ],
    outputs: Outputs = None,
    thickness: Annotated[
        str | None,
        typer.Option(
            help="Thickness of the wall in mm, where only the outer wall was scanned; auto takes it from where the"
            " scans show both sides.",
            metavar="MM|auto",
        ),
    ] = None,
    clearance: Annotated[
        float, typer.Option(help="How far in mm the piece keeps from its neighbours: room for glue.", min=0.0)
    ] = 0.0,
    min_wall: Annotated[float, typer.Option(help="Say where the piece is thinner than this, in mm.", min=0.0)] = 1.0,
    method: Annotated[
        Method, typer.Option(help="wheel: profile about the vessel's axis; box: the published route.")
    ] = Method.WHEEL,
    picks: Annotated[
        Path | None, typer.Option(help="JSON file with three points around the hole, for --method box.")
    ] = None,
    settle: Annotated[
        bool,
        typer.Option(
            "--settle/--no-settle", help="First settle the sherds against each other, by at most 0.75 mm and 0.75°."
        ),
    ] = True,
    relief: Annotated[
        Relief,
        typer.Option(
            help="continue: the pattern of the rest of the vessel goes on over the piece, where that foretells it;"
            " draw: else one like it is drawn, and said so."
        ),
    ] = Relief.NONE,
    hole: Annotated[
        str | None,
        typer.Option(
            metavar="N|all",
            help="Number of the hole, as --list gives it. Default: the longest that can be patched. all: a piece for"
            " every hole that can be patched, hole 0 in piece-0.step where piece.step is named, and so on; all are"
            " written, or none.",
        ),
    ] = None,
    list_holes: Annotated[
        bool, typer.Option("--list", help="List the holes and make nothing; --picture draws them with their numbers.")
    ] = False,
    pass_band: Annotated[
        float, typer.Option(help="Pass band k_PB of the filter that removes the relief.", min=0.001, max=0.5)
    ] = 0.01,
    unit: UnitOfScans = None,
    allow_open: AllowOpen = False,
    **usual: Any,
) -> None:
    """Missing piece of a broken vessel, from the sherds around it."""
    answer("patch", JOB, locals())

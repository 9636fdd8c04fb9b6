"""recon terrain: contour lines to a mountain."""

from pathlib import Path
from typing import Annotated

import typer

from brep_export.app.commands.options import (
    AllowOpen,
    AsJson,
    Debug,
    Force,
    Name,
    Outputs,
    Picture,
    ProtocolSchema,
    Quiet,
    Report,
    Schema,
    Timeout,
)
from brep_export.app.front_desk import answer

__all__ = ["terrain"]

JOB = "brep_export.app.terrain_job:terrain"


def terrain(
    inputs: Annotated[
        Path,
        typer.Argument(
            metavar="CONTOURS",
            help="Contour lines (.geojson .csv), or a height grid (.asc .json .tif) with --interval.",
        ),
    ],
    outputs: Outputs = None,
    tolerance: Annotated[
        float | None,
        typer.Option(
            help="Metres that contours may be smoothed by. Default: a fifth of their points' spacing.", min=1e-6
        ),
    ] = None,
    interval: Annotated[float | None, typer.Option(help="Contour a grid at multiples of so many metres.")] = None,
    attribute: Annotated[str | None, typer.Option(help="Property of the lines that holds their height.")] = None,
    base_depth: Annotated[
        float | None, typer.Option(help="Close to a solid, its base so many metres below the ground.", min=1e-3)
    ] = None,
    base_level: Annotated[
        float | None, typer.Option(help="Close to a solid, its base at this height in metres.")
    ] = None,
    against: Annotated[Path | None, typer.Option(help="Height grid to measure the ground against.")] = None,
    schema: ProtocolSchema = Schema.AP214,
    name: Name = None,
    picture: Picture = None,
    report: Report = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
    timeout: Timeout = None,
    allow_open: AllowOpen = False,
    force: Force = False,
    debug: Debug = False,
) -> None:
    """Smooth mountain of G1 faces, or a solid, from contour lines."""
    answer("terrain", JOB, locals(), header_unit="M")

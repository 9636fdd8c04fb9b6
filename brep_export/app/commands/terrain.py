"""recon terrain: contour lines to a mountain."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from brep_export.app.commands.options import (
    AllowOpen,
    AsJson,
    Debug,
    DryRun,
    Force,
    Name,
    Outputs,
    Picture,
    ProtocolSchema,
    Quiet,
    Report,
    Schema,
    Silence,
    Timeout,
)
from brep_export.app.front_desk import answer

__all__ = ["terrain"]

JOB = "brep_export.app.terrain_job:terrain"


class PatchKind(StrEnum):
    """What lies between the contours' curves."""

    POLYNOMIAL = "polynomial"
    GREGORY = "gregory"


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
    unit: Annotated[
        str | None, typer.Option(help="Unit of the map's coordinates and heights: m or ft. Default: metres.")
    ] = None,
    clip: Annotated[str | None, typer.Option(help="Box to keep: west,south,east,north in map coordinates.")] = None,
    contours: Annotated[
        float | None, typer.Option(help="Contours of the smooth ground at so many metres, into a .geojson.", min=1e-6)
    ] = None,
    scale: Annotated[str | None, typer.Option(help="Scale of the model, as 1:25000.")] = None,
    exaggerate: Annotated[float | None, typer.Option(help="Stretch heights by this factor.", min=1e-6)] = None,
    mend: Annotated[
        bool, typer.Option("--mend", help="Leave out contours that repeat another; each is named.")
    ] = False,
    base_depth: Annotated[
        float | None, typer.Option(help="Close to a solid, its base so many metres below the ground.", min=1e-3)
    ] = None,
    base_level: Annotated[
        float | None,
        typer.Option(help="Close to a solid, its base at this height in metres; where it cuts the ground, islands."),
    ] = None,
    patches: Annotated[
        PatchKind,
        typer.Option(
            help="polynomial: exactly G1; gregory: the paper's patches as B-splines, G1 to --angle.",
        ),
    ] = PatchKind.POLYNOMIAL,
    angle: Annotated[
        float | None,
        typer.Option(
            help="Degrees that neighbouring faces may differ by, with --patches gregory. Default: 0.1.",
            min=1e-3,
            max=90.0,
        ),
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
    silence: Silence = None,
    dry_run: DryRun = False,
    debug: Debug = False,
) -> None:
    """Smooth mountain of G1 faces, or a solid, from contour lines."""
    answer("terrain", JOB, locals() | {"more_endings": (".geojson",)}, header_unit="M")

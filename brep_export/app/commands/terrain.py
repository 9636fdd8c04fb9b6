"""recon terrain: contour lines to a mountain."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from brep_export.app.commands.options import RUNNING, WRITING, AllowOpen, Outputs, takes
from brep_export.app.front_desk import answer
from brep_export.app.tile_names import planned_files

__all__ = ["terrain"]

JOB = "brep_export.app.terrain_job:terrain"
TILES_JOB = "brep_export.app.terrain_tiles_job:terrain_tiles"


class PatchKind(StrEnum):
    """What lies between the contours' curves."""

    POLYNOMIAL = "polynomial"
    GREGORY = "gregory"


@takes(WRITING, RUNNING)
def terrain(
    inputs: Annotated[
        Path,
        typer.Argument(
            metavar="CONTOURS",
            help="Contour lines (.geojson .csv .dxf .shp .gpkg), or a grid (.asc .json .tif .hgt) with --interval.",
        ),
    ],
    outputs: Outputs = None,
    tolerance: Annotated[
        float | None,
        typer.Option(help="Metres that contours may be smoothed by. Default: 0.28 of their points' spacing.", min=1e-6),
    ] = None,
    interval: Annotated[float | None, typer.Option(help="Contour a grid at multiples of so many metres.")] = None,
    attribute: Annotated[str | None, typer.Option(help="Property of the lines that holds their height.")] = None,
    unit: Annotated[
        str | None, typer.Option(help="Unit of the map's coordinates and heights: m or ft. Default: metres.")
    ] = None,
    clip: Annotated[
        str | None,
        typer.Option(
            help="Keep a box, west,south,east,north in map coordinates, or the polygon in a file.",
            metavar="BOX|GEOJSON",
        ),
    ] = None,
    contours: Annotated[
        float | None, typer.Option(help="Contours of the smooth ground at so many metres, into a .geojson.", min=1e-6)
    ] = None,
    scale: Annotated[str | None, typer.Option(help="Scale of the model, as 1:25000.")] = None,
    exaggerate: Annotated[float | None, typer.Option(help="Stretch heights by this factor.", min=1e-6)] = None,
    mend: Annotated[
        bool, typer.Option("--mend", help="Leave out contours that repeat another; each is named.")
    ] = False,
    project: Annotated[
        bool, typer.Option("--project", help="Bring a map in degrees to the metres of its UTM zone.")
    ] = False,
    break_lines: Annotated[
        bool,
        typer.Option(
            "--break-lines", help="Take lines whose height changes along them for break lines, not for faulty contours."
        ),
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
    tile: Annotated[
        float | None,
        typer.Option(
            help="Make a large grid by tiles of about so many kilometres, a file each (hill-r0-c0.step).",
            metavar="KM",
            min=1e-6,
        ),
    ] = None,
    only: Annotated[
        str | None,
        typer.Option(
            help="Of the tiles these alone: rows from the north, columns from the west, from 0, as 0-2,4-6.",
            metavar="ROWS,COLUMNS",
        ),
    ] = None,
    join: Annotated[bool, typer.Option("--join", help="The chosen tiles as one shape in one file.")] = False,
    scheduler: Annotated[
        str | None,
        typer.Option(help="With --tile: the workers of a running Dask cluster make the tiles.", metavar="tcp://..."),
    ] = None,
    allow_open: AllowOpen = False,
    **usual: Any,
) -> None:
    """Smooth mountain of G1 faces, or a solid, from contour lines."""
    options = locals() | {"more_endings": (".geojson",)}
    lone = next((name for name in ("only", "join", "scheduler") if options[name]), None)
    if tile is None and lone is not None:
        raise typer.BadParameter("goes with --tile", param_hint=f"--{lone}")
    if tile is None:
        answer("terrain", JOB, options, header_unit="M")
    else:
        answer("terrain", TILES_JOB, options, planned_files=planned_files, header_unit="M")

"""recon fit: the smooth surface of a scan."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from brep_export.app.commands.options import (
    AsJson,
    Debug,
    Force,
    Name,
    Picture,
    ProtocolSchema,
    Quiet,
    Report,
    Schema,
    Timeout,
    UnitOfScans,
)
from brep_export.app.front_desk import answer
from brep_export.app.outputs import ENDINGS

__all__ = ["fit"]

JOB = "brep_export.app.fit_job:fit"


class Surface(StrEnum):
    """Scheme of a fitted surface."""

    LOOP = "loop"


class Update(StrEnum):
    """Rule by which control points move."""

    TANGENT = "tangent"
    LEAST_SQUARES = "least-squares"
    PATENT = "patent"
    BASIS = "basis"
    NESTEROV = "nesterov"
    ANDERSON = "anderson"


def fit(
    inputs: Annotated[Path, typer.Argument(metavar="SCAN", help="Scan as a triangle mesh, open or closed.")],
    outputs: Annotated[
        list[Path] | None,
        typer.Option("-o", "--output", help=f"File to write: .obj control mesh, or {' '.join(ENDINGS)}. Repeatable."),
    ] = None,
    surface: Annotated[Surface, typer.Option(help="Scheme of the surface.")] = Surface.LOOP,
    control_points: Annotated[int | None, typer.Option(help="At most so many control points.", min=4)] = None,
    tolerance: Annotated[
        str | None, typer.Option(help="Largest error: a length, or a share of the diagonal as 0.1%.")
    ] = None,
    update: Annotated[Update, typer.Option(help="Rule by which control points move.")] = Update.TANGENT,
    plain: Annotated[bool, typer.Option(help="All control points at once, six rounds, no refinement.")] = False,
    unit: UnitOfScans = None,
    schema: ProtocolSchema = Schema.AP214,
    name: Name = None,
    picture: Picture = None,
    report: Report = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
    timeout: Timeout = None,
    force: Force = False,
    debug: Debug = False,
) -> None:
    """Subdivision surface of a scan: its control mesh, and its limit surface as a B-rep."""
    answer("fit", JOB, locals(), more_endings=(".obj",))

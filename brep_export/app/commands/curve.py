"""recon curve: the smooth curve of a row of points."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from brep_export.app.commands.options import RUNNING, WRITING, UnitOfScans, takes
from brep_export.app.front_desk import answer
from brep_export.app.outputs import CAD_ENDINGS

__all__ = ["curve"]

JOB = "brep_export.app.curve_job:curve"


class Kind(StrEnum):
    """What the curve is made of."""

    BSPLINE = "bspline"
    CHAIKIN = "chaikin"


class Update(StrEnum):
    """Rule by which control points move."""

    TANGENT = "tangent"
    PATENT = "patent"


@takes(WRITING, RUNNING)
def curve(
    inputs: Annotated[
        Path,
        typer.Argument(metavar="POINTS", help="Points in order, one a line: x y or x y z (.csv .txt .xyz .dat .pts)."),
    ],
    outputs: Annotated[
        list[Path] | None,
        typer.Option("-o", "--output", help=f"File to write ({' '.join(CAD_ENDINGS)} .json). Repeatable."),
    ] = None,
    kind: Annotated[
        Kind, typer.Option(help="B-spline, or Chaikin's scheme: quadratic, with equal breaks.")
    ] = Kind.BSPLINE,
    degree: Annotated[int, typer.Option(help="Degree of a B-spline.", min=1, max=9)] = 3,
    closed: Annotated[
        bool | None,
        typer.Option(
            "--closed/--open", help="Whether the last point is followed by the first. Default: if they are one."
        ),
    ] = None,
    control_points: Annotated[
        int | None, typer.Option(help="At most so many control points; as many as points interpolate.", min=2)
    ] = None,
    tolerance: Annotated[
        str | None, typer.Option(help="Largest error: a length, or a share of the diagonal as 0.1%.")
    ] = None,
    update: Annotated[Update, typer.Option(help="Rule by which control points move.")] = Update.TANGENT,
    unit: UnitOfScans = None,
    **usual: Any,
) -> None:
    """Smooth B-spline curve of a row of points, open or closed, in the plane or in space."""
    answer("curve", JOB, locals(), endings=list(CAD_ENDINGS), more_endings=[".json"])

"""recon fit: the smooth surface of a scan."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from brep_export.app.commands.options import RUNNING, WRITING, UnitOfScans, takes
from brep_export.app.front_desk import answer
from brep_export.app.outputs import ENDINGS

__all__ = ["fit"]

JOB = "brep_export.app.fit_job:fit"
SHEET = "brep_export.app.sheet_job:fit"
CONVERSION = "brep_export.app.control_mesh_job:convert"


class Surface(StrEnum):
    """Scheme of a fitted surface."""

    LOOP = "loop"
    CATMULL_CLARK = "catmull-clark"
    DOO_SABIN = "doo-sabin"
    BSPLINE = "bspline"
    NURBS = "nurbs"


ONE_FACE = (Surface.BSPLINE, Surface.NURBS)


class Update(StrEnum):
    """Rule by which control points move."""

    TANGENT = "tangent"
    LEAST_SQUARES = "least-squares"
    PATENT = "patent"
    BASIS = "basis"
    NESTEROV = "nesterov"
    ANDERSON = "anderson"


@takes(WRITING, RUNNING)
def fit(
    inputs: Annotated[
        Path | None, typer.Argument(metavar="SCAN", help="Scan as a triangle mesh, open or closed.", show_default=False)
    ] = None,
    outputs: Annotated[
        list[Path] | None,
        typer.Option("-o", "--output", help=f"File to write: .obj control mesh, or {' '.join(ENDINGS)}. Repeatable."),
    ] = None,
    surface: Annotated[
        Surface | None,
        typer.Option(help="Scheme, or one spline face; by its faces for a control mesh; quads in rows for a solid."),
    ] = None,
    control_points: Annotated[int | None, typer.Option(help="At most so many control points.", min=4)] = None,
    tolerance: Annotated[
        str | None, typer.Option(help="Largest error: a length, or a share of the diagonal as 0.1%.")
    ] = None,
    degree: Annotated[int, typer.Option(help="Degree of one spline face.", min=1, max=9)] = 3,
    update: Annotated[Update, typer.Option(help="Rule by which control points move.")] = Update.TANGENT,
    control_mesh: Annotated[
        Path | None, typer.Option(help="Fit nothing: the limit surface of this OBJ mesh of quads, triangles or both.")
    ] = None,
    angle: Annotated[
        float, typer.Option(help="Degrees by which tangent planes may differ along smooth edges.", min=1e-9)
    ] = 0.1,
    plain: Annotated[bool, typer.Option(help="All control points at once, no refinement.")] = False,
    rounds: Annotated[
        int | None, typer.Option(help="Rounds on the last control mesh; 6, or 12 of a smooth refined one.", min=1)
    ] = None,
    crease_angle: Annotated[
        float,
        typer.Option(help="Degrees between two faces from which on an edge stays sharp; 180: none.", min=1, max=180),
    ] = 40.0,
    close: Annotated[bool, typer.Option("--close", help="Fill the holes of the scan first.")] = False,
    robust: Annotated[
        bool, typer.Option("--robust", help="Points far off count less: for scans with outliers.")
    ] = False,
    thin: Annotated[
        int | None,
        typer.Option(
            help="Thin the scan to so many points first. Default: to 500,000 from 5,000,000 on.", metavar="N", min=100
        ),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(help="The workers of a running Dask cluster thin a large scan.", metavar="tcp://..."),
    ] = None,
    unit: UnitOfScans = None,
    **usual: Any,
) -> None:
    """Subdivision surface of a scan: its control mesh, and its limit surface as a B-rep; or one B-spline face."""
    options = locals()
    if (inputs is None) == (control_mesh is None):
        raise typer.BadParameter("name a SCAN, or a control mesh by --control-mesh, and not both")
    if control_mesh is not None:
        if surface in ONE_FACE:
            raise typer.BadParameter("a control mesh is read by a scheme, not as one spline face")
        options["inputs"] = control_mesh
    job = JOB if control_mesh is None else CONVERSION
    answer("fit", SHEET if surface in ONE_FACE else job, options, more_endings=(".obj",))

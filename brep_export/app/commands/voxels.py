"""recon voxels: a binary, grey or labelled volume to a solid."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from brep_export.app.commands.options import RUNNING, WRITING, Outputs, takes
from brep_export.app.front_desk import answer

__all__ = ["voxels"]

JOB = "brep_export.app.voxels_job:voxels"


class Features(StrEnum):
    """How feature voxels are protected."""

    NONE = "none"
    PAPER = "paper"


@takes(WRITING, RUNNING)
def voxels(
    inputs: Annotated[
        Path,
        typer.Argument(
            metavar="VOLUME", help="NPZ, NPY, NRRD, NIfTI, MetaImage, VTI, TIFF stack, binvox, or a folder of DICOM."
        ),
    ],
    outputs: Outputs = None,
    threshold: Annotated[float | None, typer.Option(help="Grey volume: voxels from this value on are solid.")] = None,
    label: Annotated[
        str | None,
        typer.Option(help="Labelled volume: the label that is solid, or all: each its own.", metavar="N|all"),
    ] = None,
    spacing: Annotated[
        str | None,
        typer.Option(help="Size of a voxel in place of the file's: one length, or three.", metavar="MM|X,Y,Z"),
    ] = None,
    largest: Annotated[bool, typer.Option("--largest", help="Keep the largest body alone.")] = False,
    min_voxels: Annotated[int, typer.Option(help="Drop bodies of fewer voxels.", min=1)] = 1,
    tolerance: Annotated[
        float, typer.Option(help="Largest distance from the grid's surface, both ways, in voxels.", min=1e-3)
    ] = 0.5,
    faces: Annotated[int | None, typer.Option(help="Stop at this many triangles.", min=4)] = None,
    reduction: Annotated[float | None, typer.Option(help="Stop when this share of the triangles is gone.")] = None,
    fast: Annotated[bool, typer.Option("--fast", help="Bound no error; needs --faces or --reduction.")] = False,
    features: Annotated[
        Features, typer.Option(help="paper: vertices of feature voxels stay, as published.")
    ] = Features.NONE,
    opening: Annotated[float, typer.Option(help="Radius in voxels of the opening for convex features.", min=0.0)] = 3.0,
    closing: Annotated[float, typer.Option(help="Radius in voxels of the closing for concave ones.", min=0.0)] = 2.0,
    smooth: Annotated[
        bool, typer.Option("--smooth", help="Triangles without terraces, edges sharp, every voxel on its side.")
    ] = False,
    analytic: Annotated[
        bool,
        typer.Option("--analytic", help="Recognise planes, cylinders, cones, spheres and rounded edges as true faces."),
    ] = False,
    snap: Annotated[
        float | None,
        typer.Option(
            help="With --analytic: take the roundest multiples of MM that the grid leaves open.", metavar="MM", min=1e-9
        ),
    ] = None,
    **usual: Any,
) -> None:
    """Clean boundary of a volume as a solid: few faces, the error bounded."""
    answer("voxels", JOB, locals())

"""recon formats: which command reads and writes what."""

import json
from typing import Annotated

import typer

__all__ = ["formats"]


def formats(
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else on stdout.")] = False,
) -> None:
    """Which files each command reads and writes, by their endings."""
    table = _table()
    if as_json:
        typer.echo(json.dumps(table))
        return
    for command, row in table.items():
        typer.echo(command)
        for what, endings in row.items():
            typer.echo(f"  {what:<7} {' '.join(endings)}")
    typer.echo("\n.shp .gpkg .tif .hgt need the packages of recon-brep[gis]; DICOM those of recon-brep[volumes].")


def _table() -> dict[str, dict[str, list[str]]]:
    """From the readers and writers themselves, which are loaded here: a list of its own would not stay true."""
    from brep_export.app.outputs import CAD_ENDINGS, ENDINGS
    from brep_export.app.polyhedron_files import POLYHEDRON_ENDINGS
    from brep_export.control_mesh_files import CONTROL_MESH_ENDINGS
    from recon.readers.contours import CONTOUR_ENDINGS
    from recon.readers.height_grids import GRID_ENDINGS
    from recon.readers.meshes import MESH_ENDINGS
    from recon.readers.point_rows import POINT_ENDINGS
    from recon.readers.views import VIEW_ENDINGS
    from recon.readers.volumes import VOLUME_ENDINGS

    rows = {
        "patch": (MESH_ENDINGS, ENDINGS),
        "fit": (MESH_ENDINGS, (*ENDINGS, *CONTROL_MESH_ENDINGS)),
        "curve": (POINT_ENDINGS, (*CAD_ENDINGS, ".json")),
        "terrain": ((*CONTOUR_ENDINGS, *GRID_ENDINGS), (*ENDINGS, ".geojson")),
        "voxels": (VOLUME_ENDINGS, ENDINGS),
        "views": (VIEW_ENDINGS, (*ENDINGS, *POLYHEDRON_ENDINGS)),
        "check": (CAD_ENDINGS, ()),
    }
    beside = (".png", ".html")
    return {
        command: {"reads": [*reads], "writes": list(dict.fromkeys((*writes, *beside)))}
        for command, (reads, writes) in rows.items()
    }

"""The job behind `recon terrain`: contours, or a grid to contour first, to a mountain, through the gate, to files."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from OCP.TopoDS import TopoDS_Shape

from brep_export.app.deliver import gate, write_files
from brep_export.app.result import result
from brep_export.app.workshop import Bench, Exit
from brep_export.blocks import block_solid
from brep_export.check import CheckReport, ShapeKind
from brep_export.shells import network_shell
from recon.errors import BadOption
from recon.geometry.contour_map import ContourMap, HeightGrid
from recon.geometry.patches import PatchNetwork
from recon.readers.contours import CONTOUR_ENDINGS, read_contours
from recon.readers.height_grids import GRID_ENDINGS, read_height_grid
from recon.terrain.contouring import contour_grid
from recon.terrain.evaluation import contour_distances, elevations
from recon.terrain.network import terrain_network
from recon.terrain.pipeline import Terrain, TerrainOptions, terrain_surface
from recon.tolerance import Tolerance

__all__ = ["terrain"]

Answer = tuple[Exit, dict[str, Any], tuple[str, ...]]

# a hundredth of a metre: far below what a map resolves, far above what the shared edges need
TOLERANCE = Tolerance(merge=1e-5, fit=0.01)


def terrain(request: Mapping[str, Any], bench: Bench) -> Answer:
    """Read the map, make the ground, close it if asked, prove it, write it."""
    with bench.phase("read", "reading the map"):
        contours = _read(request)
        against = None if request["against"] is None else read_height_grid(request["against"])
    with bench.phase("reconstruct", "following the contours"):
        ground = terrain_surface(contours, TerrainOptions(tolerance=request["tolerance"]), doing=bench.doing)
        room = _figures(contours, ground, against)
    for note in ground.notes:
        bench.note(note)
    with bench.phase("brep", "building the shape"):
        shape, kind = _shape(ground, request)
    report = gate(shape, TOLERANCE, kind, bench)
    report, written = write_files(
        shape, report, dict(request) | {"name": request["name"] or "terrain"}, bench, paint=partial(_paint, report)
    )
    reasons = tuple(str(defect) for defect in report.defects)
    answer = result(
        "terrain",
        inputs=request["inputs"],
        outputs=written,
        reasons=reasons,
        kernel=report.as_json(),
        seconds=bench.seconds | {"total": bench.elapsed()},
        room=room,
        notes=bench.notes,
    )
    return (Exit.REFUSED if reasons else Exit.WRITTEN), answer, reasons


def _read(request: Mapping[str, Any]) -> ContourMap:
    path = request["inputs"][0]
    if Path(path).suffix.lower() in GRID_ENDINGS:
        if request["interval"] is None:
            raise BadOption("--interval", f"{path} is a grid; say at which interval in metres to contour it")
        return contour_grid(read_height_grid(path), request["interval"])
    if request["interval"] is not None:
        raise BadOption(
            "--interval", f"{path} holds contours already; only a grid ({' '.join(GRID_ENDINGS)}) is contoured"
        )
    if Path(path).suffix.lower() not in CONTOUR_ENDINGS:
        raise BadOption("contours", f"{path}: give {' '.join(CONTOUR_ENDINGS)}, or a grid {' '.join(GRID_ENDINGS)}")
    return read_contours(path, attribute=request["attribute"])


def _shape(ground: Terrain, request: Mapping[str, Any]) -> tuple[TopoDS_Shape, ShapeKind]:
    """The open shell of the ground, or the solid above the base that was asked for."""
    depth, level = request["base_depth"], request["base_level"]
    if depth is not None and level is not None:
        raise BadOption("--base-level", "say how deep the base lies or at which height, not both")
    network = terrain_network(ground)
    if depth is None and level is None:
        return network_shell(network, TOLERANCE), ShapeKind.SHELL
    lowest = _lowest(network)
    if level is not None and level >= lowest:
        raise BadOption("--base-level", f"must lie below the lowest ground, which is at {lowest:.2f} m")
    return block_solid(network, lowest - depth if level is None else level, TOLERANCE), ShapeKind.SOLID


def _lowest(network: PatchNetwork) -> float:
    """Height below which no patch reaches: the lowest control point."""
    return min(float(patch.control_net[..., 2].min()) for patch in network.patches)


def _figures(contours: ContourMap, ground: Terrain, against: HeightGrid | None) -> dict[str, Any]:
    sides = ground.tiling.contour_sides()
    distance = contour_distances(ground, contours)
    free = len(ground.tiling.points) - ground.tiling.curves.n_vertices
    figures: dict[str, Any] = {
        "contours": len(contours.lines),
        "vertices": ground.tiling.curves.n_vertices,
        "free_vertices": free,
        "quads": int((~ground.layout.is_triangle).sum()),
        "sleeves": int((sides == 1).sum()),
        "terminals": int((sides == 2).sum()),
        "junctions": int((sides == 0).sum()),
        "patches": ground.n_patches,
        "tolerance": ground.tolerance,
        "contour_error": {"mean": float(distance.mean()), "max": float(distance.max())},
        "origin": [float(x) for x in ground.origin],
        "crs": contours.crs or None,
    }
    if against is not None:
        places, heights = against.places()
        miss = elevations(ground, places)[0] - heights
        inside = np.isfinite(miss)
        if not inside.any():
            raise BadOption("--against", "the grid and the contours have no place in common")
        figures["rmse"] = float(np.sqrt((miss[inside] ** 2).mean()))
    return figures


def _paint(report: CheckReport, path: Path) -> None:
    from brep_export.app.pictures import CLAY, Part, View, draw

    ground = Part(report.triangles(), CLAY[0], smooth=False)
    draw(
        path, [View("from the south", (ground,), (0.3, -1.4, 0.9)), View("raking light", (ground,), (-1.6, -0.4, 0.35))]
    )

"""The job behind `recon voxels`: a volume to the boundary of its solid voxels, through the gate, to files."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from OCP.TopoDS import TopoDS_Compound, TopoDS_Shape

from brep_export.app.deliver import gate, write_files
from brep_export.app.result import result, statistics
from brep_export.app.workshop import Bench, Exit
from brep_export.check import CheckReport, ShapeKind
from brep_export.faces import BUILDER
from brep_export.solids import mesh_solid, triangle_solid
from recon.errors import BadOption, NotManifold
from recon.geometry.mesh import TriangleMesh
from recon.geometry.voxel_grid import Volume, VoxelGrid, binary_grid, volume_labels
from recon.readers.volumes import read_volume
from recon.tolerance import Tolerance
from recon.voxel_mesh.pipeline import VoxelBoundary, VoxelOptions, voxel_boundary
from recon.voxel_mesh.topology import kept_bodies

__all__ = ["voxels"]

Answer = tuple[Exit, dict[str, Any], tuple[str, ...]]

FLAT = 1e-3  # voxels: triangles this near to one plane become one face
FIT = 0.05  # voxels: how far edges may lie from their faces


def voxels(request: Mapping[str, Any], bench: Bench) -> Answer:
    """Read the volume, find the boundary, build the solid, prove it, write it."""
    options = _options(request)
    with bench.phase("read", "reading the volume"):
        volume = read_volume(request["inputs"][0], spacing=_spacing(request["spacing"]))
        grids = [_cleaned(grid, request, bench) for grid in _grids(volume, request)]
    with bench.phase("reconstruct", "finding the boundary"):
        found = [voxel_boundary(grid, options, doing=bench.doing) for grid in grids]
    with bench.phase("brep", "building the solid"):
        tolerance = Tolerance(merge=FLAT * grids[0].voxel, fit=FIT * grids[0].voxel)
        shape = _together([_solid(boundary.mesh, tolerance, bench) for boundary in found])
    report = gate(shape, tolerance, ShapeKind.SOLID, bench)
    named = dict(request) | {"name": request["name"] or Path(request["inputs"][0]).name.split(".")[0]}
    report, written = write_files(shape, report, named, bench, paint=partial(_paint, report))
    reasons = tuple(str(defect) for defect in report.defects)
    answer = result(
        "voxels",
        inputs=request["inputs"],
        outputs=written,
        reasons=reasons,
        kernel=report.as_json(),
        error=statistics(
            np.concatenate([boundary.errors * grid.voxel for boundary, grid in zip(found, grids)]),
            unit="mm",
            against="the marching cubes surface of the grid, both ways",
        ),
        seconds=bench.seconds | {"total": bench.elapsed()},
        room=_figures(grids, found),
        notes=bench.notes,
    )
    return (Exit.REFUSED if reasons else Exit.WRITTEN), answer, reasons


def _options(request: Mapping[str, Any]) -> VoxelOptions:
    return VoxelOptions(
        tolerance=None if request["fast"] else request["tolerance"],
        n_faces=request["faces"],
        reduction=request["reduction"],
        features=request["features"] == "paper",
        opening=request["opening"],
        closing=request["closing"],
    )


def _spacing(text: str | None) -> NDArray[np.float64] | None:
    if text is None:
        return None
    try:
        lengths = [float(word) for word in text.replace(",", " ").split()]
    except ValueError:
        raise BadOption("--spacing", f"needs one length, or three as X,Y,Z, not {text!r}") from None
    return np.array(lengths * 3 if len(lengths) == 1 else lengths)


def _grids(volume: Volume, request: Mapping[str, Any]) -> list[VoxelGrid]:
    """The binary grid that was asked for, or one a label."""
    label = request["label"]
    if label == "all":
        if request["threshold"] is not None:
            raise BadOption("--label", "give a threshold or labels, not both")
        labels = volume_labels(volume)
        if len(labels) > 1000:
            raise BadOption(
                "--label", f"{volume.name} has {len(labels)} values; that is a grey volume, give a threshold"
            )
        return [binary_grid(volume, label=float(value)) for value in labels]
    try:
        number = None if label is None else float(label)
    except ValueError:
        raise BadOption("--label", f"needs a number or all, not {label!r}") from None
    return [binary_grid(volume, threshold=request["threshold"], label=number)]


def _cleaned(grid: VoxelGrid, request: Mapping[str, Any], bench: Bench) -> VoxelGrid:
    """The grid without the bodies that are not wanted; what is dropped is said."""
    if not request["largest"] and request["min_voxels"] <= 1:
        return grid
    solid, dropped = kept_bodies(grid.solid, largest=request["largest"], min_voxels=request["min_voxels"])
    if not solid.any():
        raise BadOption("--min-voxels", f"leaves nothing of {grid.name}; its largest body has {dropped[0]} voxels")
    if len(dropped):
        bench.note(
            f"dropped {len(dropped)} bodies of {grid.name}, {int(dropped.sum())} voxels in all, the largest of"
            f" {int(dropped[0])}; kept {int(solid.sum())} voxels"
        )
    return grid.with_solid(solid)


def _solid(mesh: TriangleMesh, tolerance: Tolerance, bench: Bench) -> TopoDS_Shape:
    """Kernel solid with one face a flat region; one a triangle where flats are too small to tell apart."""
    try:
        return mesh_solid(mesh, tolerance)
    except NotManifold as problem:
        bench.note(f"coplanar triangles were not merged ({problem})")
        return triangle_solid(mesh)


def _together(shapes: list[TopoDS_Shape]) -> TopoDS_Shape:
    if len(shapes) == 1:
        return shapes[0]
    compound = TopoDS_Compound()
    BUILDER.MakeCompound(compound)
    for shape in shapes:
        BUILDER.Add(compound, shape)
    return compound


def _figures(grids: list[VoxelGrid], found: list[VoxelBoundary]) -> dict[str, Any]:
    figures = found[0].figures()
    if len(found) > 1:
        for key in ("faces_marching_cubes", "faces", "bodies", "cavities", "genus"):
            figures[key] = sum(boundary.figures()[key] for boundary in found)
        for key in ("max_error_voxels", "rms_error_voxels"):
            figures[key] = max(boundary.figures()[key] for boundary in found)
        figures["reduction"] = 1.0 - figures["faces"] / figures["faces_marching_cubes"]
    return {
        "voxels": sum(int(grid.solid.sum()) for grid in grids),
        "shape": list(grids[0].solid.shape),
        "spacing": grids[0].spacing.tolist(),
        **figures,
    }


def _paint(report: CheckReport, path: Path) -> None:
    from brep_export.app.pictures import draw, views_around

    draw(path, views_around(report.triangles(), [np.array(line) for line in report.free_edges]))

"""The job behind `recon voxels`: a volume to the boundary of its solid voxels, through the gate, to files."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from OCP.TopoDS import TopoDS_Shape

from brep_export.app.deliver import gate, write_files
from brep_export.app.result import result, statistics
from brep_export.app.scene import Measured, mesh_part
from brep_export.app.voxel_blocks import block_bodies, block_size, solid_sources
from brep_export.app.voxel_bodies import VoxelBody, analytic_body, dropped_bodies, faceted_body, smooth_body
from brep_export.app.voxel_proof import DEFLECTION, FIT, FLAT
from brep_export.app.workshop import Bench, Exit
from brep_export.check import CheckReport, ShapeKind
from brep_export.compounds import one_or_compound
from brep_export.faceted_step import faceted_step_size, write_faceted_step
from brep_export.file_header import FileHeader
from brep_export.measures import measure
from brep_export.read_back import STEP_ENDINGS
from brep_export.triangulation import triangulate
from recon.errors import BadOption, NotWritten
from recon.geometry.voxel_grid import PlacedGrid, Volume, VoxelGrid, binary_grid, volume_labels
from recon.numerics.distance import closest_points
from recon.readers.volume_windows import open_volume
from recon.readers.volumes import read_volume
from recon.tolerance import Tolerance
from recon.voxel_mesh.marching_cubes import marching_cubes
from recon.voxel_mesh.pipeline import VoxelOptions
from recon.voxel_mesh.topology import kept_bodies

__all__ = ["voxels"]

Answer = tuple[Exit, dict[str, Any], tuple[str, ...]]

OFF = "distance of the grid's surface from the solid, mm"
LARGE = 5_000  # planar faces from which on the kernel's own STEP writer is passed by


def voxels(request: Mapping[str, Any], bench: Bench) -> Answer:
    """Read the volume, find the boundary, build the solid, prove it, write it."""
    options = _options(request)
    if request["snap"] is not None and not request["analytic"]:
        raise BadOption("--snap", "is for true faces; ask for them with --analytic")
    if request["smooth"] and (request["faces"] or request["reduction"] is not None or request["fast"]):
        raise BadOption("--smooth", "stops at its own --tolerance; leave --faces, --reduction and --fast out")
    block = block_size(request, bench)
    made = _by_blocks(request, options, block, bench) if block else _as_a_whole(request, options, bench)
    solids = made.bodies
    tolerance = Tolerance(merge=FLAT * made.voxel, fit=FIT * made.voxel)
    shape = one_or_compound([body.shape for body in solids])
    report = gate(shape, tolerance, ShapeKind.SOLID, bench)
    named = dict(request) | {"name": request["name"] or Path(request["inputs"][0]).name.split(".")[0]}
    straight = _written_straight(solids, named, report, bench)
    report, written = write_files(
        shape,
        report,
        named | {"outputs": [path for path in named["outputs"] if path not in straight]},
        bench,
        paint=partial(_paint, report),
        beside=straight,
        measured=partial(made.measured, shape),
    )
    reasons = tuple(str(defect) for defect in report.defects)
    answer = result(
        "voxels",
        inputs=request["inputs"],
        outputs=written,
        reasons=reasons,
        kernel=report.as_json(),
        error=statistics(
            np.concatenate([body.errors for body in solids]),
            unit="mm",
            against="the marching cubes surface of the grid, both ways",
        ),
        seconds=bench.seconds | {"total": bench.elapsed()},
        room=made.figures | _figures(solids),
        notes=bench.notes,
    )
    return (Exit.REFUSED if reasons else Exit.WRITTEN), answer, reasons


@dataclass(frozen=True, eq=False)
class _Made:
    """Bodies, the length of a voxel, figures of the volume, and what of it is shown beside a shape."""

    bodies: list[VoxelBody]
    voxel: float
    figures: dict[str, Any]
    measured: Callable[[TopoDS_Shape], Measured] = lambda shape: Measured()


def _as_a_whole(request: Mapping[str, Any], options: VoxelOptions, bench: Bench) -> _Made:
    with bench.phase("read", "reading the volume"):
        volume = read_volume(request["inputs"][0], spacing=_spacing(request["spacing"]))
        grids = [_cleaned(grid, request, bench) for grid in _grids(volume, request)]
    if request["analytic"]:
        bodies = [analytic_body(grid, options, snap=request["snap"], bench=bench) for grid in grids]
    elif request["smooth"]:
        bodies = [smooth_body(grid, options, bench=bench) for grid in grids]
    else:
        bodies = [faceted_body(grid, options, bench=bench) for grid in grids]
    figures = _places(grids[0], sum(int(grid.solid.sum()) for grid in grids), grids[0].solid.shape)
    return _Made(bodies, grids[0].voxel, figures, partial(_measured, grids))


def _by_blocks(request: Mapping[str, Any], options: VoxelOptions, size: int, bench: Bench) -> _Made:
    with bench.phase("read", "looking through the volume"):
        source = open_volume(request["inputs"][0], spacing=_spacing(request["spacing"]))
        solids = solid_sources(source, request)
    bodies = block_bodies(solids, options, size, request, bench)
    return _Made(bodies, source.voxel, _places(source, sum(body.figures["voxels"] for body in bodies), source.shape))


def _places(grid: PlacedGrid, n_solid: int, shape: Sequence[int]) -> dict[str, Any]:
    return {"voxels": n_solid, "shape": list(shape), "spacing": grid.spacing.tolist()}


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
        bench.note(dropped_bodies(grid.name, dropped, int(solid.sum())), name="dropped")
    return grid.with_solid(solid)


def _written_straight(
    solids: list[VoxelBody], request: Mapping[str, Any], report: CheckReport, bench: Bench
) -> dict[str, Callable[[Path], None]]:
    """STEP files that are written from arrays, each with what writes it: those of one large faceted solid."""
    polyhedron = solids[0].polyhedron
    if len(solids) > 1 or polyhedron is None or len(polyhedron.faces) < LARGE:
        return {}
    paths = [path for path in request["outputs"] if Path(path).suffix.lower() in STEP_ENDINGS]
    if paths:
        size = faceted_step_size(polyhedron) / 2**20
        bench.note(f"a STEP file of {len(polyhedron.faces)} planar faces: about {size:.0f} MB", name="large-file")
    measures = report.measures or measure(solids[0].shape)

    def write(path: Path) -> None:
        back = write_faceted_step(polyhedron, path, header=FileHeader(name=request["name"]), measures=measures)
        if back.defects and not request["force"]:
            raise NotWritten(str(path), "; ".join(str(defect) for defect in back.defects))

    return dict.fromkeys(paths, write)


def _figures(solids: list[VoxelBody]) -> dict[str, Any]:
    """Sums over the labels where something is counted, the worst where something is measured."""
    figures = dict(solids[0].figures)
    for body in solids[1:]:
        for key in ("faces_marching_cubes", "faces", "bodies", "cavities", "genus"):
            figures[key] += body.figures[key]
        for key in ("max_error_voxels", "rms_error_voxels"):
            figures[key] = max(figures[key], body.figures[key])
    figures["reduction"] = 1.0 - figures["faces"] / figures["faces_marching_cubes"]
    figures.pop("voxels", None)  # summed over the labels elsewhere
    return figures


def _measured(grids: list[VoxelGrid], shape: TopoDS_Shape) -> Measured:
    """The grids' surface, each of its points coloured by its distance from the shape.

    Not the other way round: a large flat face has corners alone, and they say nothing of its middle.
    """
    from brep_export.app.pictures import CLAY

    made = triangulate(shape, DEFLECTION * grids[0].voxel).mesh
    parts = []
    for number, grid in enumerate(grids, 1):
        found = marching_cubes(grid)
        surface = grid.placed(found.vertices, found.face_vertices)
        off = closest_points(surface.vertices, made.vertices, made.face_vertices).distances
        name = "surface of the grid" + (f" {number}" if len(grids) > 1 else "")
        parts.append(mesh_part(name, surface, CLAY[0], values=off, scale=OFF, shown=False))
    return Measured(parts)


def _paint(report: CheckReport, path: Path) -> None:
    from brep_export.app.pictures import draw, views_around

    draw(path, views_around(report.triangles(), [np.array(line) for line in report.free_edges]))

"""The job behind `recon fit`: a scan to a subdivision surface: its control mesh and, if asked for, a kernel shape."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from OCP.TopoDS import TopoDS_Shape

from brep_export.app.deliver import gate, write_files
from brep_export.app.lengths import tolerance_length
from brep_export.app.result import result, statistics
from brep_export.app.workshop import Bench, Exit
from brep_export.check import CheckReport, ShapeKind
from brep_export.control_mesh_files import CONTROL_MESH_ENDINGS, write_control_mesh
from brep_export.shells import network_shell
from brep_export.solids import network_solid
from brep_export.staging import staged
from recon.errors import BadOption
from recon.geometric_fit.pipeline import FitOptions, FittedSurface, fit_surface
from recon.geometric_fit.updates import Update
from recon.geometry.mesh import TriangleMesh
from recon.numerics.distance import closest_points
from recon.readers.meshes import read_mesh
from recon.subdivision.limit_surface import Scheme, limit_patches, tessellate
from recon.subdivision.patch_network import limit_network
from recon.tolerance import Tolerance

__all__ = ["fit"]

Answer = tuple[Exit, dict[str, Any], tuple[str, ...]]

MERGE, FIT = 1e-7, 1e-4  # tolerances of the kernel shape, as shares of the diagonal


def fit(request: Mapping[str, Any], bench: Bench) -> Answer:
    """Read the scan, fit, prove the kernel shape where one is asked for, write."""
    nets = [path for path in request["outputs"] if Path(path).suffix.lower() in CONTROL_MESH_ENDINGS]
    others = [path for path in request["outputs"] if path not in nets]
    if others and request["surface"] != Scheme.LOOP:
        raise BadOption("--output", f"a {request['surface']} surface is written as its control mesh (.obj) so far")
    with bench.phase("read", "reading the scan"):
        file = read_mesh(request["inputs"][0], unit=request["unit"])
    for note in file.notes:
        bench.note(f"{request['inputs'][0]}: {note}")
    options = FitOptions(
        scheme=Scheme(request["surface"]),
        control_points=request["control_points"],
        tolerance=tolerance_length(request["tolerance"], file.mesh.vertices),
        update=Update(request["update"]),
        plain=request["plain"],
        rounds=request["rounds"],
        crease_angle=np.radians(request["crease_angle"]),
        close=request["close"],
        robust=request["robust"],
    )
    with bench.phase("reconstruct", "fitting the surface"):
        fitted = fit_surface(file.mesh, options, doing=bench.doing)
    if fitted.n_closed:
        bench.note(f"closed {fitted.n_closed} holes of the scan before the fit, as asked.")
    if fitted.folds:
        bench.note(f"the surface folds at {fitted.folds} control points; more of them would keep it smooth.")
    kernel, reasons, written = _shape_written(file.mesh, fitted, {**request, "outputs": others}, bench)
    if nets and (not reasons or request["force"]):
        with bench.phase("write", "writing the control mesh"), staged(*nets, announce=bench.staged) as temporary:
            for path in temporary:
                write_control_mesh(fitted.mesh, path, scheme=request["surface"])
        written = [*nets, *written]
    answer = result(
        "fit",
        inputs=request["inputs"],
        outputs=written,
        reasons=reasons,
        kernel=kernel,
        seconds=bench.seconds | {"total": bench.elapsed()},
        error=statistics(fitted.distances, unit="mm", against="every point of the scan, exact foot points"),
        room=_figures(fitted, request),
        notes=bench.notes,
    )
    return (Exit.REFUSED if reasons else Exit.WRITTEN), answer, reasons


def _shape_written(
    scan: TriangleMesh, fitted: FittedSurface, request: Mapping[str, Any], bench: Bench
) -> tuple[dict[str, Any], tuple[str, ...], list[str]]:
    """Figures of the kernel shape, the reasons against it, and the files written; no shape where none is asked for."""
    if not request["outputs"]:
        return {}, (), _picture_alone(scan, fitted, request, bench)
    tolerance = Tolerance(merge=MERGE * fitted.diagonal, fit=FIT * fitted.diagonal)
    with bench.phase("brep", "building the shape"):
        shape, kind = _kernel_shape(fitted, tolerance, bench)
    report: CheckReport = gate(shape, tolerance, kind, bench)
    named = {**request, "name": request["name"] or "fitted surface"}
    report, written = write_files(shape, report, named, bench, paint=partial(_paint, scan, fitted))
    return report.as_json(), tuple(str(defect) for defect in report.defects), written


def _kernel_shape(fitted: FittedSurface, tolerance: Tolerance, bench: Bench) -> tuple[TopoDS_Shape, ShapeKind]:
    patches = limit_patches(fitted.mesh)
    network, misfit = limit_network(fitted.mesh, patches)
    bench.note(
        f"patches at irregular vertices are off the limit surface by at most {misfit:.3g}; all others are exact."
    )
    if (patches.sheets.across >= 0).all():
        return network_solid(network, tolerance), ShapeKind.SOLID
    return network_shell(network, tolerance), ShapeKind.SHELL


def _picture_alone(scan: TriangleMesh, fitted: FittedSurface, request: Mapping[str, Any], bench: Bench) -> list[str]:
    if request["picture"] is None:
        return []
    with bench.phase("write", "drawing"), staged(request["picture"], announce=bench.staged) as (temporary,):
        _paint(scan, fitted, temporary)
    return [request["picture"]]


def _figures(fitted: FittedSurface, request: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "scheme": request["surface"],
        "update": request["update"],
        "data_points": len(fitted.distances),
        "control_points": fitted.mesh.n_vertices,
        "rounds": len(fitted.rounds),
        "e_mean_percent": fitted.errors.mean,
        "e_rms_percent": fitted.errors.rms,
        "e_max_percent": fitted.errors.maximum,
        "stopped_by": str(fitted.stopped_by),
        "folds": fitted.folds,
        "closed_holes": fitted.n_closed,
        "crease_edges": len(fitted.mesh.crease_edges),
    }


def _paint(scan: TriangleMesh, fitted: FittedSurface, path: Path) -> None:
    from brep_export.app.pictures import CLAY, MADE, Part, View, draw

    surface = tessellate(fitted.mesh, scheme=fitted.scheme, halvings=2)
    away = closest_points(surface.vertices, scan.vertices, scan.face_vertices).distances
    toward = (1.0, -1.6, 0.9)
    draw(
        path,
        (
            View("scan", (Part(scan, CLAY[0], smooth=False),), toward),
            View("control mesh", (Part(fitted.mesh.triangle_mesh(), MADE, smooth=False),), toward),
            View("limit surface", (Part(surface, MADE),), toward),
            View("distance from the scan", (Part(surface, MADE, values=away),), toward),
        ),
    )

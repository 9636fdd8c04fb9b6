"""The job behind `recon fit`: a scan to a subdivision surface: its control mesh and, if asked for, a kernel shape."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brep_export.app.deliver import exhibit, gate, write_files
from brep_export.app.large_scan import read_scan
from brep_export.app.lengths import tolerance_length
from brep_export.app.limit_shape import limit_shape
from brep_export.app.result import result, statistics
from brep_export.app.scene import Measured, ScenePart, mesh_part, net_part
from brep_export.app.workshop import Bench, Exit
from brep_export.check import CheckReport
from brep_export.control_mesh_files import CONTROL_MESH_ENDINGS, write_control_mesh
from brep_export.staging import staged
from recon.geometric_fit.pipeline import FitOptions, FittedSurface, fit_surface
from recon.geometric_fit.row_fit import fit_rows
from recon.geometric_fit.updates import Update
from recon.geometry.mesh import TriangleMesh
from recon.numerics.distance import closest_points
from recon.subdivision.limit_surface import Scheme, tessellate

__all__ = ["fit"]

Answer = tuple[Exit, dict[str, Any], tuple[str, ...]]

CLOSE_CAPS = 2e-4  # mean edges off the limit: on scans, caps ten times as far off cut each other at small quads


def fit(request: Mapping[str, Any], bench: Bench) -> Answer:
    """Read the scan, fit, prove the kernel shape where one is asked for, write."""
    nets = [path for path in request["outputs"] if Path(path).suffix.lower() in CONTROL_MESH_ENDINGS]
    others = [path for path in request["outputs"] if path not in nets]
    scan = read_scan(request, bench)
    remeshed = request["surface"] is None and bool(others)
    request = {**request, "surface": request["surface"] or ("catmull-clark" if remeshed else "loop")}
    options = FitOptions(
        scheme=Scheme(request["surface"]),
        control_points=request["control_points"],
        tolerance=tolerance_length(request["tolerance"], scan.mesh.vertices),
        update=Update(request["update"]),
        plain=request["plain"],
        rounds=request["rounds"],
        crease_angle=np.radians(request["crease_angle"]),
        close=request["close"],
        robust=request["robust"],
    )
    with bench.phase("reconstruct", "fitting the surface"):
        fit = fit_rows if remeshed else fit_surface
        fitted = fit(scan.mesh, options, doing=bench.doing)
    if fitted.n_closed:
        bench.note(f"closed {fitted.n_closed} holes of the scan before the fit, as asked.", name="closed-holes")
    if fitted.folds:
        folded = f"the surface folds at {fitted.folds} control points; more of them would keep it smooth."
        bench.note(folded, name="folds")
    kernel, reasons, written = _shape_written(scan.mesh, fitted, {**request, "outputs": others}, bench)
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
        error=statistics(fitted.distances, unit="mm", against=f"{scan.against}, exact foot points"),
        room=_figures(fitted, request) | {"thinned": scan.thinned},
        notes=bench.notes,
    )
    return (Exit.REFUSED if reasons else Exit.WRITTEN), answer, reasons


def _shape_written(
    scan: TriangleMesh, fitted: FittedSurface, request: Mapping[str, Any], bench: Bench
) -> tuple[dict[str, Any], tuple[str, ...], list[str]]:
    """Figures of the kernel shape, the reasons against it, and the files written; no shape where none is asked for."""
    if not request["outputs"]:
        return {}, (), _picture_alone(scan, fitted, request, bench)
    made = limit_shape(fitted.mesh, fitted.scheme, request["angle"], bench, accuracy=CLOSE_CAPS)
    report: CheckReport = gate(made.shape, made.tolerance, made.kind, bench)
    named = {**request, "name": request["name"] or "fitted surface"}
    paint, measured = partial(_paint, scan, fitted), partial(_measured, scan, fitted)
    report, written = write_files(made.shape, report, named, bench, paint=paint, measured=measured)
    return report.as_json(), tuple(str(defect) for defect in report.defects), written


def _picture_alone(scan: TriangleMesh, fitted: FittedSurface, request: Mapping[str, Any], bench: Bench) -> list[str]:
    exhibit(request, bench, partial(_surface_alone, scan, fitted), [partial(_paint, scan, fitted)])
    if request["picture"] is None:
        return []
    with bench.phase("write", "drawing"), staged(request["picture"], announce=bench.staged) as (temporary,):
        _paint(scan, fitted, temporary)
    return [request["picture"]]


def _surface_alone(scan: TriangleMesh, fitted: FittedSurface) -> list[ScenePart]:
    """The limit surface as triangles, where no kernel shape is made of it."""
    from brep_export.app.pictures import MADE

    surface, measured = tessellate(fitted.mesh, scheme=fitted.scheme, halvings=2), _measured(scan, fitted)
    away = None if measured.deviation is None else measured.deviation(surface.vertices)
    made = mesh_part("limit surface", surface, MADE, values=away, scale=measured.scale, result=True)
    return [*measured.parts, made]


def _measured(scan: TriangleMesh, fitted: FittedSurface) -> Measured:
    from brep_export.app.pictures import CLAY

    def away(points: NDArray[np.float64]) -> NDArray[np.float64]:
        return closest_points(points, scan.vertices, scan.face_vertices).distances

    known = fitted.distances if len(fitted.distances) == scan.n_vertices else None
    off = "distance of the scan's points from the surface, mm"
    measured = mesh_part("scan", scan, CLAY[0], values=known, scale=off, shown=False)
    net = net_part("control mesh", fitted.mesh, "#777777", shown=False)
    return Measured([measured, net], away, "distance from the scan, mm")


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

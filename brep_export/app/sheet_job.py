"""The job behind `recon fit --surface bspline|nurbs`: a scan to one spline face, cut along its borders."""

from collections.abc import Mapping
from functools import partial
from math import radians
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from OCP.TopoDS import TopoDS_Shape

from brep_export.app.deliver import gate, write_files
from brep_export.app.large_scan import read_scan
from brep_export.app.lengths import tolerance_length
from brep_export.app.result import result, statistics
from brep_export.app.workshop import Bench, Exit
from brep_export.check import CheckReport, ShapeKind
from brep_export.control_mesh_files import CONTROL_MESH_ENDINGS
from brep_export.sheets import pierced_shell, trimmed_shell
from brep_export.shells import network_shell
from brep_export.solids import network_solid
from brep_export.staging import staged
from recon.errors import BadOption
from recon.geometric_fit.scan_kind import ScanKind
from recon.geometric_fit.spline_fit import FittedSheet, SplineKind, SplineOptions, fit_sheet
from recon.geometric_fit.trimming import end_caps, trimmed_sheet
from recon.geometric_fit.updates import Update
from recon.geometry.mesh import TriangleMesh
from recon.geometry.patches import connect
from recon.geometry.trimmed import TrimmedSurface
from recon.numerics.distance import closest_points
from recon.numerics.halfedges import free_edges
from recon.tolerance import Tolerance

__all__ = ["fit"]

MERGE, FIT = 1e-7, 5e-5  # tolerances of the kernel shape, as shares of the diagonal
NO_CREASE = 40.0  # what --crease-angle is where nobody names it
DRAWN = 2  # of half a span, cells in a picture


class Made(NamedTuple):
    """A kernel shape, what the gate is to expect of it, and its tolerance."""

    shape: TopoDS_Shape
    kind: ShapeKind
    tolerance: Tolerance


def fit(request: Mapping[str, Any], bench: Bench) -> tuple[Exit, dict[str, Any], tuple[str, ...]]:
    """Read the scan, fit, prove the face where one is asked for, write."""
    _refuse_foreign(request)
    scan = read_scan(request, bench)
    options = SplineOptions(
        kind=SplineKind(request["surface"]),
        degree=request["degree"],
        control_points=request["control_points"],
        tolerance=tolerance_length(request["tolerance"], scan.mesh.vertices),
        update=Update(request["update"]),
        plain=request["plain"],
        rounds=request["rounds"] or SplineOptions.rounds,
        robust=request["robust"],
    )
    with bench.phase("reconstruct", "fitting the surface"):
        fitted = fit_sheet(scan.mesh, options, doing=bench.doing)
    if fitted.folds:
        bench.note(
            f"the surface folds at {fitted.folds} control points: the scan is stretched {fitted.stretch:.1f} times "
            "to be unrolled, and --surface loop does not unroll it.",
            name="folds",
        )
    kernel, reasons, written = _shape_written(scan.mesh, fitted, request, bench)
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


def _refuse_foreign(request: Mapping[str, Any]) -> None:
    """Raise BadOption for what only subdivision surfaces have."""
    if any(Path(path).suffix.lower() in CONTROL_MESH_ENDINGS for path in request["outputs"]):
        raise BadOption("--output", "a spline face has no control mesh; name a CAD or mesh file, or --surface loop")
    if request["crease_angle"] not in (NO_CREASE, 180.0):
        raise BadOption("--crease-angle", "a spline face has no sharp edges; leave it out, or take --surface loop")


def _shape_written(
    scan: TriangleMesh, fitted: FittedSheet, request: Mapping[str, Any], bench: Bench
) -> tuple[dict[str, Any], tuple[str, ...], list[str]]:
    """Figures of the kernel shape, the reasons against it, and the files written; no shape where none is asked for."""
    paint = partial(_paint, scan, fitted, request["close"])
    if not request["outputs"]:
        return {}, (), _picture_alone(paint, request, bench)
    with bench.phase("brep", "building the face"):
        made = _made(fitted, request, bench)
    report: CheckReport = gate(made.shape, made.tolerance, made.kind, bench)
    named = {**request, "name": request["name"] or "fitted surface"}
    report, written = write_files(made.shape, report, named, bench, paint=paint)
    return report.as_json(), tuple(str(defect) for defect in report.defects), written


def _made(fitted: FittedSheet, request: Mapping[str, Any], bench: Bench) -> Made:
    """A solid of a torus, or of a tube whose ends are to be closed; else an open shell."""
    size, close = fitted.diagonal, request["close"]
    tolerance = Tolerance(merge=MERGE * size, fit=FIT * size, angle=radians(request["angle"]))
    trimmed = trimmed_sheet(fitted, with_holes=not close)
    if trimmed.loops:
        bench.note(
            f"the face is cut along the borders of the scan, within {trimmed.off:.2g} mm of them.", name="trimmed"
        )
    if trimmed.n_lost:
        bench.note(
            f"{trimmed.n_lost} holes of the scan are too narrow to be cut out of the face.", name="hole-left-out"
        )
    if fitted.sheet.kind is ScanKind.DISC:
        shape = trimmed_shell(TrimmedSurface(trimmed.surface, trimmed.loops), tolerance)
        return Made(shape, ShapeKind.SHELL, tolerance)
    if trimmed.loops:
        network = connect([trimmed.surface], tolerance.merge)
        return Made(pierced_shell(network, trimmed.loops, tolerance), ShapeKind.SHELL, tolerance)
    if fitted.sheet.kind is ScanKind.CYLINDER and not close:
        return Made(network_shell(connect([trimmed.surface], tolerance.merge), tolerance), ShapeKind.SHELL, tolerance)
    caps = end_caps(trimmed.surface) if fitted.sheet.kind is ScanKind.CYLINDER else ()
    if caps:
        bench.note(
            "both ends of the tube are closed by a cone to the middle of the rim, as asked.", name="closed-holes"
        )
    network = connect([trimmed.surface, *caps], tolerance.merge)
    return Made(network_solid(network, tolerance), ShapeKind.SOLID, tolerance)


def _picture_alone(paint: Any, request: Mapping[str, Any], bench: Bench) -> list[str]:
    if request["picture"] is None:
        return []
    with bench.phase("write", "drawing"), staged(request["picture"], announce=bench.staged) as (temporary,):
        paint(temporary)
    return [request["picture"]]


def _figures(fitted: FittedSheet, request: Mapping[str, Any]) -> dict[str, Any]:
    n_holes = len(fitted.sheet.holes) + (2 if fitted.sheet.kind is ScanKind.CYLINDER else 0)
    return {
        "scheme": request["surface"],
        "kind": str(fitted.sheet.kind),
        "degree": request["degree"],
        "update": request["update"],
        "data_points": len(fitted.distances),
        "control_points": fitted.space.n_control,
        "control_net": list(fitted.space.shape),
        "rounds": len(fitted.rounds),
        "e_mean_percent": fitted.errors.mean,
        "e_rms_percent": fitted.errors.rms,
        "e_max_percent": fitted.errors.maximum,
        "stopped_by": str(fitted.stopped_by),
        "folds": fitted.folds,
        "stretch": fitted.stretch,
        "closed_holes": n_holes if request["close"] else 0,
    }


def _paint(scan: TriangleMesh, fitted: FittedSheet, close: bool, path: Path) -> None:
    from brep_export.app.pictures import CLAY, MADE, Part, View, draw

    net = fitted.surface.control_net
    drawn = fitted.drawn(DRAWN)
    if not close:
        drawn = _cut_along_border(drawn, scan)
    away = closest_points(drawn.vertices, scan.vertices, scan.face_vertices).distances
    share = np.minimum(100.0 * away / fitted.diagonal, fitted.errors.maximum)  # over holes it may be far from the scan
    toward = _front(scan)
    up = (0.0, 0.0, 1.0) if abs(toward[2]) < 0.8 else (0.0, 1.0, 0.0)
    draw(
        path,
        (
            View("scan", (Part(scan, CLAY[0], smooth=False),), toward, up),
            View("control net", (Part(_net_mesh(net), MADE, smooth=False),), toward, up),
            View("surface", (Part(drawn, MADE),), toward, up),
            View("distance from the scan", (Part(drawn, MADE, values=share, scale="% of the diagonal"),), toward, up),
        ),
    )


def _cut_along_border(drawn: TriangleMesh, scan: TriangleMesh) -> TriangleMesh:
    """The triangles of the surface, as far as the scan is not nearest on its border: there the face is cut away."""
    import pyvista

    border = free_edges(scan.face_vertices)
    if len(border) == 0:
        return drawn
    away = closest_points(drawn.vertices, scan.vertices, scan.face_vertices).distances
    from_border = closest_points(drawn.vertices, scan.vertices, border[:, [0, 1, 1]]).distances
    surface = pyvista.PolyData.from_regular_faces(drawn.vertices, drawn.face_vertices)
    surface["inside"] = np.where(from_border <= (1.0 + 1e-9) * away, -from_border, from_border)
    cut = surface.clip_scalar("inside", invert=False, value=0.0).triangulate()
    return TriangleMesh(cut.points, cut.regular_faces, drawn.name)


def _front(scan: TriangleMesh) -> tuple[float, float, float]:
    """The side to which the scan faces; a corner where it faces all sides."""
    facing = scan.area_vectors()
    mean, total = facing.sum(axis=0), float(np.linalg.norm(facing, axis=1).sum())
    if np.linalg.norm(mean) < 0.3 * total:
        return (1.0, -1.6, 0.9)
    x, y, z = (mean / np.linalg.norm(mean)).tolist()
    return x, y, z


def _net_mesh(net: np.ndarray) -> TriangleMesh:
    """Two triangles for every four neighbouring control points."""
    n, m = net.shape[:2]
    a = np.arange(n * m).reshape(n, m)[:-1, :-1].ravel()
    faces = np.concatenate([np.stack([a, a + m, a + m + 1], axis=1), np.stack([a, a + m + 1, a + 1], axis=1)])
    return TriangleMesh(net.reshape(-1, 3), faces, "control net")

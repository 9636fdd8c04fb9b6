"""The job behind `recon curve`: a row of points to a B-spline curve, as a kernel edge and as plain numbers."""

import json
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brep_export.app.deliver import gate, write_files
from brep_export.app.lengths import tolerance_length
from brep_export.app.result import result, statistics
from brep_export.app.scene import Measured, line_part, point_part
from brep_export.app.workshop import Bench, Exit
from brep_export.check import ShapeKind
from brep_export.wires import curve_edge
from recon.geometric_fit.curve_fit import CurveKind, CurveOptions, CurveUpdate, FittedCurve, fit_curve
from recon.geometry.bspline import BSplineCurve
from recon.readers.meshes import MILLIMETRES
from recon.readers.point_rows import read_point_row
from recon.tolerance import Tolerance

__all__ = ["curve"]

Floats = NDArray[np.float64]

NUMBERS = ".json"
FIT = 1e-6  # tolerance of the kernel edge as a share of the diagonal: nothing is approximated in it


def curve(request: Mapping[str, Any], bench: Bench) -> tuple[Exit, dict[str, Any], tuple[str, ...]]:
    """Read the points, fit, prove the edge, write."""
    with bench.phase("read", "reading the points"):
        points = read_point_row(request["inputs"][0]) * MILLIMETRES[request["unit"] or "mm"]
    closed = _is_closed(points) if request["closed"] is None else request["closed"]
    options = CurveOptions(
        kind=CurveKind(request["kind"]),
        degree=request["degree"],
        closed=closed,
        tolerance=tolerance_length(request["tolerance"], points),
        control_points=request["control_points"],
        update=CurveUpdate(request["update"]),
    )
    with bench.phase("reconstruct", "fitting the curve"):
        fitted = fit_curve(points, options, doing=bench.doing)
    with bench.phase("brep", "building the edge"):
        edge = curve_edge(fitted.curve)
    report = gate(edge, Tolerance(fit=max(FIT * fitted.diagonal, 1e-6)), ShapeKind.EDGE, bench)
    numbers = [path for path in request["outputs"] if Path(path).suffix.lower() == NUMBERS]
    files = {
        **request,
        "outputs": [path for path in request["outputs"] if path not in numbers],
        "name": request["name"] or "fitted curve",
    }
    beside = {path: partial(_write_numbers, fitted.curve) for path in numbers}
    paint, measured = partial(_paint, points, fitted), partial(_measured, points, fitted)
    report, written = write_files(edge, report, files, bench, paint=paint, beside=beside, measured=measured)
    reasons = tuple(str(defect) for defect in report.defects)
    answer = result(
        "curve",
        inputs=request["inputs"],
        outputs=written,
        reasons=reasons,
        kernel=report.as_json(),
        seconds=bench.seconds | {"total": bench.elapsed()},
        error=statistics(fitted.distances, unit="mm", against="every point of the row, exact foot points"),
        room=_figures(fitted, options),
        notes=bench.notes,
    )
    return (Exit.REFUSED if reasons else Exit.WRITTEN), answer, reasons


def _is_closed(points: Floats) -> bool:
    return len(points) > 3 and bool((points[0] == points[-1]).all())


def _figures(fitted: FittedCurve, options: CurveOptions) -> dict[str, Any]:
    return {
        "scheme": str(options.kind),
        "update": str(options.update),
        "degree": fitted.curve.degree,
        "closed_row": options.closed,
        "data_points": len(fitted.distances),
        "control_points": len(fitted.polygon),
        "rounds": len(fitted.rounds),
        "e_mean_percent": fitted.errors.mean,
        "e_rms_percent": fitted.errors.rms,
        "e_max_percent": fitted.errors.maximum,
        "stopped_by": str(fitted.stopped_by),
    }


def _write_numbers(curve: BSplineCurve, path: Path) -> None:
    numbers = {
        "degree": curve.degree,
        "knots": curve.knots.tolist(),
        "control_points": curve.control_points.tolist(),
        "unit": "mm",
    }
    path.write_text(json.dumps(numbers), encoding="utf-8")


def _measured(points: Floats, fitted: FittedCurve) -> Measured:
    from brep_export.app.pictures import CLAY

    given = point_part("points", points, CLAY[1], values=fitted.distances, scale="distance from the curve, mm")
    return Measured([given, line_part("control polygon", [fitted.polygon], "#888888", shown=False)])


def _paint(points: Floats, fitted: FittedCurve, path: Path) -> None:
    from brep_export.app.curve_picture import draw_curve

    draw_curve(path, points, fitted)

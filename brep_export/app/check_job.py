"""The job behind `recon check`: the gate alone, on a file of any origin."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from brep_export.app.deliver import Parcel, exhibit, gate
from brep_export.app.result import result
from brep_export.app.workshop import Bench, Exit
from brep_export.check import CheckReport, ShapeKind
from brep_export.measures import kind_of
from brep_export.read_back import read_cad
from brep_export.staging import staged
from recon.tolerance import Tolerance

__all__ = ["check_file"]


def check_file(request: Mapping[str, Any], bench: Bench) -> tuple[Exit, dict[str, Any], tuple[str, ...]]:
    """Read a CAD file and draw every line of the gate; with `allow_open` a face or shell is measured as what it is."""
    with bench.phase("read", "reading the file"):
        shape = read_cad(request["inputs"][0])
    expect = kind_of(shape) if request["allow_open"] else ShapeKind.SOLID
    report = gate(shape, Tolerance(fit=request["tolerance"]), expect, bench)
    written = []
    if request["picture"] is not None and report.triangulation is not None:
        with bench.phase("write", "drawing"), staged(request["picture"], announce=bench.staged) as (temporary,):
            _paint(report, temporary)
        written = [request["picture"]]
    shown = Parcel(shape, report, (), request["picture"], partial(_paint, report), title="shape")
    exhibit(request, bench, shown.scene, [shown.painter()])
    reasons = tuple(str(defect) for defect in report.defects)
    answer = result(
        "check",
        inputs=request["inputs"],
        outputs=written,
        reasons=reasons,
        kernel=report.as_json(),
        seconds=bench.seconds | {"total": bench.elapsed()},
    )
    return (Exit.REFUSED if reasons else Exit.WRITTEN), answer, reasons


def _paint(report: CheckReport, path: Path) -> None:
    from brep_export.app.pictures import draw, views_around

    draw(path, views_around(report.triangles(), [np.array(line) for line in report.free_edges]))

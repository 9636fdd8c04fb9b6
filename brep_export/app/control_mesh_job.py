"""The job behind `recon fit --control-mesh`: a control mesh to the B-rep of its limit surface, nothing fitted."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from brep_export.app.deliver import gate, write_files
from brep_export.app.limit_shape import limit_shape
from brep_export.app.result import result
from brep_export.app.scene import Measured, net_part
from brep_export.app.workshop import Bench, Exit
from brep_export.check import CheckReport
from brep_export.control_mesh_files import CONTROL_MESH_ENDINGS
from recon.errors import BadOption
from recon.geometry.control_mesh import ControlMesh
from recon.readers.control_meshes import read_control_mesh
from recon.subdivision.limit_faces import natural_scheme
from recon.subdivision.limit_surface import Scheme
from recon.subdivision.semi_sharp import refuse_cones

__all__ = ["convert"]


def convert(request: Mapping[str, Any], bench: Bench) -> tuple[Exit, dict[str, Any], tuple[str, ...]]:
    """Read the control mesh, lay faces over its limit surface, prove the shape, write."""
    if any(Path(path).suffix.lower() in CONTROL_MESH_ENDINGS for path in request["outputs"]):
        raise BadOption("--output", "the control mesh is there already; name a CAD or mesh file")
    with bench.phase("read", "reading the control mesh"):
        mesh = read_control_mesh(request["inputs"][0])
        refuse_cones(mesh)
    scheme = Scheme(request["surface"]) if request["surface"] else natural_scheme(mesh)
    made = limit_shape(mesh, scheme, request["angle"], bench)
    report: CheckReport = gate(made.shape, made.tolerance, made.kind, bench)
    named = {**request, "name": request["name"] or "limit surface"}
    paint, measured = partial(_paint, mesh, report), partial(_measured, mesh)
    report, written = write_files(made.shape, report, named, bench, paint=paint, measured=measured)
    reasons = tuple(str(defect) for defect in report.defects)
    answer = result(
        "fit",
        inputs=request["inputs"],
        outputs=written,
        reasons=reasons,
        kernel=report.as_json(),
        seconds=bench.seconds | {"total": bench.elapsed()},
        room={"scheme": str(scheme), "control_points": mesh.n_vertices, **made.figures(mesh)},
        notes=bench.notes,
    )
    return (Exit.REFUSED if reasons else Exit.WRITTEN), answer, reasons


def _measured(mesh: ControlMesh) -> Measured:
    return Measured([net_part("control mesh", mesh, "#777777")])


def _paint(mesh: ControlMesh, report: CheckReport, path: Path) -> None:
    from brep_export.app.pictures import CLAY, MADE, Part, View, draw

    toward = (1.0, -1.6, 0.9)
    draw(
        path,
        (
            View("control mesh", (Part(mesh.triangle_mesh(), CLAY[0], smooth=False),), toward),
            View("limit surface", (Part(report.triangles(), MADE),), toward),
        ),
    )

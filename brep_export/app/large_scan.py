"""The scan that `recon fit` is given, thinned first where it has more points than a fit can hold in memory."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from brep_export.app.cluster_calls import Each, calls
from brep_export.app.workshop import Bench
from recon.geometric_fit.scan_cells import thinned_scan
from recon.geometry.mesh import TriangleMesh
from recon.geometry.mesh_source import MeshSource
from recon.readers.mesh_windows import open_mesh
from recon.readers.meshes import read_mesh

__all__ = ["Scan", "read_scan"]

LARGE, LEFT = 5_000_000, 500_000  # points from which on a scan is thinned by itself, and to how many


@dataclass(frozen=True, eq=False)
class Scan:
    """What is fitted, what errors are measured against, and figures of the thinning, or None where there was none."""

    mesh: TriangleMesh
    against: str
    thinned: dict[str, Any] | None = None


def read_scan(request: Mapping[str, Any], bench: Bench) -> Scan:
    """The scan as it is, or thinned: to `thin` points where that is asked for, by itself where it is very large.

    Raises  as `read_mesh` and `thinned_scan`.
    """
    path, asked, scheduler = request["inputs"][0], request.get("thin"), request.get("scheduler")
    with bench.phase("read", "reading the scan"):
        large = open_mesh(path, unit=request["unit"], least=LARGE if asked is None else asked)
        if large is None:
            file = read_mesh(path, unit=request["unit"])
            for note in file.notes:
                bench.note(f"{path}: {note}", name="reading")
            if asked is None or asked >= file.mesh.n_vertices:
                return Scan(file.mesh, "every point of the scan")
            large = MeshSource.of(file.mesh.vertices, file.mesh.face_vertices, file.mesh.name)
        for note in large.notes:
            bench.note(f"{path}: {note}", name="reading")
    with bench.phase("reconstruct", "thinning the scan"), calls(scheduler) as each:
        return _thinned(large, asked or LEFT, each, bench)


def _thinned(scan: MeshSource, n_left: int, each: Each, bench: Bench) -> Scan:
    found = thinned_scan(scan, n_left, each=each, doing=bench.doing)
    rms, worst = float(np.sqrt((found.distances**2).mean())), float(found.distances.max())
    bench.note(
        f"{scan.n_vertices} points were thinned to {found.mesh.n_vertices}, all of them within {worst:.3g} mm of what"
        f" is left, {rms:.2g} in the mean square; errors of the fit are against what is left; --thin sets how many",
        name="thinned",
    )
    figures = {"points": scan.n_vertices, "left": found.mesh.n_vertices, "rms": rms, "max": worst}
    return Scan(found.mesh, "every point of the thinned scan", figures)

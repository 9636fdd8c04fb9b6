"""Solids of limit surfaces: faces, size of the file, angle, distance, processor seconds, by number of control faces.

    python benchmarks/limit_solids.py [SCAN...]

Without scans: a wavy torus of growing size, some of its quads turned into irregular ones. With scans: their remeshes,
and the smaller of them with a face for every quadrilateral.
"""

import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from brep_export.check import ShapeKind, check
from brep_export.file_header import FileHeader
from brep_export.mosaics import mosaic_shape
from brep_export.step import write_step
from recon.geometric_fit.quad_remesh import remeshed_quads
from recon.geometry.control_mesh import ControlMesh
from recon.readers.meshes import read_mesh
from recon.subdivision.limit_faces import limit_faces, mean_edge
from recon.subdivision.limit_surface import Scheme
from recon.subdivision.quad_faces import LimitFaces, catmull_clark_faces
from recon.tolerance import Tolerance
from tables import Table, machine

SIZES = (400, 2500, 10000)
SCAN_QUADS = (1600, 6300)
COLUMNS = {
    "mesh": "12",
    "scheme": "13",
    "control faces": "13,d",
    "irregular": "9.1%",
    "faces": "6,d",
    "each": "6.3f",
    "kB a face": "9.1f",
    "angle, °": "9.1e",
    "off / edge": "10.1e",
    "lay": "6.1f",
    "build": "6.1f",
    "gate": "6.1f",
    "STEP": "6.1f",
    "seconds": "7.1f",
    "verdict": "6",
    "read back": "9",
}


def torus(n_quads: int) -> ControlMesh:
    """A wavy torus in which a few hundredths of the edges between regular quads are turned."""
    n = round(np.sqrt(n_quads / 2))
    i, j = (x.ravel() for x in np.meshgrid(np.arange(2 * n), np.arange(n), indexing="ij"))
    a, b = np.pi * i / n, 2 * np.pi * j / n
    radius = 1.0 + 0.15 * np.sin(5 * a) * np.cos(2 * b)
    points = np.column_stack(
        [(3 + radius * np.cos(b)) * np.cos(a), (3 + radius * np.cos(b)) * np.sin(a), radius * np.sin(b)]
    )
    right = (i + 1) % (2 * n)
    quads = np.stack([i * n + j, right * n + j, right * n + (j + 1) % n, i * n + (j + 1) % n], axis=1)
    for f in range(0, len(quads), 67):  # two quads side by side: their common edge, turned
        a0, b0, c0, d0 = quads[f]
        beyond = np.flatnonzero((quads[:, 0] == b0) & (quads[:, 3] == c0))
        if len(beyond) and (f % n) and beyond[0] % 67:
            _, e0, f0, _ = quads[beyond[0]]
            quads[f], quads[beyond[0]] = (a0, b0, e0, d0), (d0, e0, f0, c0)
    return ControlMesh.from_faces(points, quads)


def halved(mesh: ControlMesh) -> ControlMesh:
    """Every quadrilateral as two triangles."""
    quads = mesh.faces_of(4)
    return ControlMesh.from_faces(mesh.vertices, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]))


def solid_row(name: str, mesh: ControlMesh, scheme: Scheme) -> list[object]:
    """A row of the table."""
    start = time.process_time()
    faces = limit_faces(mesh, scheme)
    return row((name, scheme), mesh, faces, time.process_time() - start)


def row(names: tuple[str, str], mesh: ControlMesh, faces: LimitFaces, seconds: float) -> list[object]:
    """A row, from faces laid in so many seconds."""
    size = float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))
    tolerance = Tolerance(merge=1e-7 * size, fit=1e-5 * size)
    clock = [time.process_time()]
    shape = mosaic_shape(faces.mosaic, tolerance)
    clock.append(time.process_time())
    report = check(shape, tolerance, expect=ShapeKind.SOLID)
    clock.append(time.process_time())
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "solid.step"
        back = write_step(shape, path, header=FileHeader(name=names[0]))
        kilobytes = path.stat().st_size / 1e3
    clock.append(time.process_time())
    corners = mesh.face_corners.reshape(mesh.n_faces, -1)
    wanted = 4 if corners.shape[1] == 4 else 6
    irregular = (np.bincount(corners.ravel(), minlength=mesh.n_vertices) != wanted)[corners].any(axis=1).mean()
    n = len(faces.mosaic.patches)
    angle = np.degrees(report.max_smooth_edge_angle or 0.0)
    sizes = mesh.n_faces, irregular, n, n / mesh.n_faces, kilobytes / n
    spent = seconds, *np.diff(clock), seconds + clock[-1] - clock[0]
    said = report.verdict, "same" if back.same else "other"
    return [*names, *sizes, angle, faces.off / mean_edge(mesh), *spent, *said]


def scan_rows(path: str, table: Table) -> None:
    """Print what remeshes of a scan become, and the first of them without grouping."""
    scan = read_mesh(path).mesh
    for count in SCAN_QUADS:
        mesh = remeshed_quads(scan, count)
        table.row(*solid_row(Path(path).stem, mesh, Scheme.CATMULL_CLARK))
        if count == SCAN_QUADS[0]:
            start = time.process_time()
            single = catmull_clark_faces(mesh, grouped=False)
            names = "ungrouped", Scheme.CATMULL_CLARK
            table.row(*row(names, mesh, single, time.process_time() - start))


def main() -> None:
    """Print the table."""
    print(f"{machine('cadquery-ocp')}; processor time\n")
    table = Table(COLUMNS)
    catmull_clark_faces(torus(100))  # compile
    if len(sys.argv) == 1:
        for size in SIZES:
            table.row(*solid_row("torus", torus(size), Scheme.CATMULL_CLARK))
        table.row(*solid_row("torus", torus(SIZES[-1]), Scheme.DOO_SABIN))
        table.row(*solid_row("torus halved", halved(torus(SIZES[-1] // 2)), Scheme.LOOP))
    for path in sys.argv[1:]:
        scan_rows(path, table)


if __name__ == "__main__":
    main()

"""The missing piece: how near and how fast, the default beside the published route.

python benchmarks/hole_patch.py [FOLDER]     FOLDER: scanned vessels, default ../shared/data/vessels

Vessels: two that the package makes and breaks, and the scanned ones. Distances in millimetres, mean and largest: of the
hole's scanned edge from the surface, and inside the hole of the surface from the vessel before its relief was pressed.
`common`: volume of the piece and the lost sherd in common, over that of their union.
"""

import sys
import time
from collections.abc import Sequence
from itertools import chain
from pathlib import Path

from brep_export.app.demo_job import common_over_union
from brep_export.app.patch_job import kernel_piece
from brep_export.triangulation import triangulate
from recon.errors import ReconError
from recon.geometry.mesh import TriangleMesh
from recon.geometry.trimmed import TrimmedSurface
from recon.hole_patch.pipeline import PatchMethod, PatchOptions, patch_hole
from tables import Table, machine
from vessels.cases import DEFLECTION, SCANNED, Case, deviation, made_cases, outer_face, scanned_cases


def row(case: Case, scan: str, sherds: Sequence[TriangleMesh], method: PatchMethod) -> tuple[object, ...]:
    """The cells of a row, from the method on."""
    start = time.perf_counter()
    try:
        piece = patch_hole(sherds, PatchOptions(method=method))
    except ReconError as refusal:
        return str(method), f"refused: {refusal}"
    spent = time.perf_counter() - start
    edge, inside = piece.outer.edge_distance, deviation(outer_face(piece), case.plain)
    common = None
    if not isinstance(piece.shape, TrimmedSurface):
        common = common_over_union(triangulate(kernel_piece(piece)[0], DEFLECTION).mesh, case.lost)
    faces = sum(sherd.n_faces for sherd in sherds)
    return str(method), faces, edge.mean(), edge.max(), inside.mean, inside.maximum, common, spent


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else SCANNED
    distances = dict.fromkeys(("edge mean", "edge max", "inside mean", "inside max", "common"), "8.3f")
    print(f"{machine()}\n")
    table = Table({"vessel": "22", "method": "6", "faces": "9,"} | distances | {"seconds": "8.2f"})
    for case in chain(made_cases(), scanned_cases(folder)):
        for scan, sherds in (("closed", case.closed), ("outer", case.outer)):
            for method in PatchMethod:
                table.row(f"{case.name}, {scan}", *row(case, scan, sherds, method))


if __name__ == "__main__":
    main()

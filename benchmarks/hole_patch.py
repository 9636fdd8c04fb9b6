"""The missing piece: how near and how fast, the default beside the published route.

python benchmarks/hole_patch.py

Vessels: one that the package makes and breaks, and the scanned ones where they lie beside the checkout. Distances in
millimetres, mean and largest: of the hole's scanned edge from the surface, and inside the hole of the surface from the
vessel before its relief was pressed.
"""

import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from brep_export.app.demo_job import common_over_union
from brep_export.app.patch_job import TOLERANCE, kernel_piece
from brep_export.faces import trimmed_face
from brep_export.triangulation import triangulate
from recon.errors import ReconError
from recon.geometry.mesh import TriangleMesh
from recon.geometry.trimmed import TrimmedSurface
from recon.hole_patch.pipeline import MissingPiece, PatchMethod, PatchOptions, patch_hole
from recon.hole_patch.sample_vessel import VesselOptions, broken_vessel
from recon.numerics.distance import TriangleTree, sample_surface
from recon.readers.meshes import read_mesh

VESSELS = Path(__file__).parents[2] / "shared" / "data" / "vessels"

Case = tuple[str, Sequence[TriangleMesh], TriangleMesh, TriangleMesh]


def cases() -> Iterator[Case]:
    """Name, sherds, the vessel without relief, the lost piece."""
    vessel = broken_vessel()
    yield "made, closed", vessel.sherds, vessel.plain, vessel.lost
    yield "made, outer", vessel.outer_walls, vessel.plain, vessel.lost
    for name, bead in (("rim", 0.5), ("bead", 0.9)):
        vessel = broken_vessel(VesselOptions(lost_at_rim=True, bead=bead))
        yield f"made {name}, closed", vessel.sherds, vessel.plain, vessel.lost
        yield f"made {name}, outer", vessel.outer_walls, vessel.plain, vessel.lost
    for folder in sorted(VESSELS.glob("*")):
        truth = [read_mesh(folder / "truth" / name).mesh for name in ("plain.ply", "piece.ply")]
        for kind in ("solid", "outer"):
            sherds = [read_mesh(path).mesh for path in sorted((folder / kind).glob("*.ply"))]
            yield f"{folder.name}, {kind}", sherds, *truth


def inside(piece: MissingPiece, plain: TriangleMesh) -> np.ndarray:
    """Distances of the outer face, at points spread evenly over it, from the plain vessel."""
    mesh = triangulate(trimmed_face(piece.outer.trimmed, TOLERANCE), 0.02).mesh
    return (
        TriangleTree(plain.vertices, plain.face_vertices)
        .closest(sample_surface(mesh.vertices, mesh.face_vertices, 5000))
        .distances
    )


def row(case: Case, method: PatchMethod) -> str:
    name, sherds, plain, lost = case
    start = time.perf_counter()
    try:
        piece = patch_hole(sherds, PatchOptions(method=method))
    except ReconError as refusal:
        return f"{name:18} {method:6} refused: {refusal}"
    spent = time.perf_counter() - start
    edge, deep = piece.outer.edge_distance, inside(piece, plain)
    common = "-"
    if not isinstance(piece.shape, TrimmedSurface):
        common = f"{common_over_union(triangulate(kernel_piece(piece)[0], 0.02).mesh, lost):.3f}"
    faces = sum(sherd.n_faces for sherd in sherds)
    distances = "".join(f"{d:8.3f}" for d in (edge.mean(), edge.max(), deep.mean(), deep.max()))
    return f"{name:18} {method:6} {faces:9,}{distances}{common:>8}{spent:8.2f}"


def main() -> None:
    titles = ("edge", "max", "inside", "max", "common", "s")
    print(f"{'vessel':18} {'method':6} {'faces':>9}" + "".join(f"{title:>8}" for title in titles))
    for case in cases():
        for method in PatchMethod:
            print(row(case, method), flush=True)


if __name__ == "__main__":
    main()

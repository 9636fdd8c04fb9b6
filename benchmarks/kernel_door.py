"""How fast closed triangle meshes become kernel solids, beside the kernel's own ways.

python benchmarks/kernel_door.py            ten seconds
python benchmarks/kernel_door.py --slow     with the kernel's unification of all the triangles of the part as well

Two jobs: a solid with one face a triangle, beside sewing the same triangles; and a part of 14 faces and 38 edges
out of fine triangles, exact and with noise, beside building every triangle and unifying the faces afterwards.

    the part   a slab with a beam across one corner and a square tunnel that comes out beside the beam; its counts by
               hand: 25 corners (one of them with four edges), 38 edges, 14 faces, one of which carries a ring:
               25 - 38 + 14 - 1 = 2 - 2 x 1 tunnel
"""

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace, BRepBuilderAPI_MakePolygon, BRepBuilderAPI_Sewing
from OCP.gp import gp_Pnt
from OCP.ShapeUpgrade import ShapeUpgrade_UnifySameDomain
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopExp import TopExp
from OCP.TopTools import TopTools_IndexedMapOfShape

sys.path.insert(0, str(Path(__file__).parents[1]))

from brep_export.solids import mesh_solid, triangle_solid
from recon.geometry.mesh import TriangleMesh
from recon.tolerance import Tolerance
from tables import Table, machine

NOISE = 1e-6
FACES_AND_EDGES = (14, 38)


def lattice_sphere(n: int) -> TriangleMesh:
    """A sphere of 4 n (n - 1) triangles."""
    turn, tilt = np.meshgrid(np.arange(2 * n) * np.pi / n, np.arange(1, n) * np.pi / n)
    ring = np.stack([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)], axis=-1)
    at = np.arange((n - 1) * 2 * n).reshape(n - 1, 2 * n)
    after = np.roll(at, -1, axis=1)
    a, b, c, d = (x.ravel() for x in (at[:-1], at[1:], after[1:], after[:-1]))
    top, bottom = np.full(2 * n, at.size), np.full(2 * n, at.size + 1)
    parts = [(a, b, c), (a, c, d), (top, at[0], after[0]), (bottom, after[-1], at[-1])]
    faces = np.concatenate([np.stack(part, axis=1) for part in parts])
    return TriangleMesh(np.concatenate([ring.reshape(-1, 3), [[0, 0, 1], [0, 0, -1]]]), faces)


def sample_part(n: int, noise: float = 0.0) -> TriangleMesh:
    """The part, each of its cells n x n x n finer cells, of which the outer sides are two triangles each."""
    solid = np.zeros((5, 5, 3), dtype=bool)
    solid[2:, :4, :] = solid[:4, 3:, 1:] = True
    solid[2:, 2, 1] = False
    solid = np.pad(np.kron(solid, np.ones((n, n, n), dtype=bool)), 1)
    return _surface(solid, noise)


def _surface(solid: np.ndarray, noise: float) -> TriangleMesh:
    shape = np.array(solid.shape) + 1
    points = np.stack(np.meshgrid(*(np.arange(s, dtype=float) for s in shape), indexing="ij"), axis=-1).reshape(-1, 3)
    unit, quads = np.eye(3, dtype=int), []
    for axis in range(3):
        u, v = unit[(axis + 1) % 3], unit[(axis + 2) % 3]
        for way in (1, -1):
            base = np.argwhere(solid & ~np.roll(solid, -way, axis=axis)) + (unit[axis] if way > 0 else 0)
            corners = [base, base + u, base + u + v, base + v][::way]
            quads.append(np.stack([np.ravel_multi_index(tuple(c.T), tuple(shape)) for c in corners], axis=1))
    q = np.concatenate(quads)
    mesh = TriangleMesh(points, np.concatenate([q[:, [0, 1, 2]], q[:, [0, 2, 3]]])).part(np.s_[:])
    shift = np.random.default_rng(1).uniform(-noise, noise, mesh.vertices.shape)
    return TriangleMesh(mesh.vertices + shift, mesh.face_vertices, "part")


def sewn(mesh: TriangleMesh) -> Any:
    """The kernel's way: a face for every triangle, then sewing."""
    sewing = BRepBuilderAPI_Sewing(1e-6)
    for corners in mesh.corners().tolist():
        polygon = BRepBuilderAPI_MakePolygon(*(gp_Pnt(*p) for p in corners), True)
        sewing.Add(BRepBuilderAPI_MakeFace(polygon.Wire(), True).Face())
    sewing.Perform()
    return sewing.SewedShape()


def unified(mesh: TriangleMesh) -> Any:
    """The kernel's way: every triangle a face, then faces on one plane and edges on one line made one."""
    unify = ShapeUpgrade_UnifySameDomain(triangle_solid(mesh), True, True, False)
    unify.SetLinearTolerance(10 * NOISE)
    unify.Build()
    return unify.Shape()


def merged(mesh: TriangleMesh) -> Any:
    return mesh_solid(mesh, Tolerance(merge=10 * NOISE))


def counts(shape: Any) -> tuple[int, int]:
    found = []
    for kind in (TopAbs_ShapeEnum.TopAbs_FACE, TopAbs_ShapeEnum.TopAbs_EDGE):
        shapes = TopTools_IndexedMapOfShape()
        TopExp.MapShapes_s(shape, kind, shapes)
        found.append(shapes.Extent())
    return found[0], found[1]


def seconds(job: Callable[[TriangleMesh], Any], mesh: TriangleMesh, runs: int) -> tuple[float, Any]:
    """Least processor time of several runs, and the last result."""
    best = np.inf
    for _ in range(runs):
        start = time.process_time()
        result = job(mesh)
        best = min(best, time.process_time() - start)
    return best, result


def row(table: Table, name: str, mesh: TriangleMesh, measured: tuple[float, Any], per: float | None = None) -> float:
    spent, shape = measured
    ratio = None if per is None else spent / per
    table.row(name, mesh.n_faces, spent, spent / mesh.n_faces * 1e6, *counts(shape), ratio)
    return spent


def main() -> None:
    slow = "--slow" in sys.argv[1:]
    print(f"{machine('cadquery-ocp')}; processor time, best of several runs\n")
    table = Table(
        {"method": "42", "triangles": "9,", "seconds": "9.3f", "µs each": "9.1f"}
        | {"faces": "8,", "edges": "8,", "times ours": "8.1f"}
    )
    sphere = lattice_sphere(32)
    triangle_solid(sphere), merged(lattice_sphere(4))  # what is loaded on first use counts for nobody
    ours = row(table, "triangles, shared edges (ours)", sphere, seconds(triangle_solid, sphere, 7))
    row(table, "triangles sewn (kernel)", sphere, seconds(sewn, sphere, 1), ours)
    for noise in (0.0, NOISE):
        what = f"noise {noise:g}" if noise else "exact"
        small, large = sample_part(6, noise), sample_part(16, noise)
        ours = row(table, f"part, {what}, merged and built (ours)", large, seconds(merged, large, 3))
        assert counts(merged(large)) == FACES_AND_EDGES
        few = row(table, f"part, {what}, merged and built (ours)", small, seconds(merged, small, 3))
        peer = large if slow else small
        row(table, f"part, {what}, built, unified (kernel)", peer, seconds(unified, peer, 1), ours if slow else few)


if __name__ == "__main__":
    main()

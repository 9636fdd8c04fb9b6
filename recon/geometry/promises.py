"""Defects: what a shape promises and does not keep, each with its place and its measure."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.geometry.mesh import TriangleMesh
from recon.numerics.self_intersection import crossing_triangles

__all__ = ["Defect", "crowded_pairs", "cutting_pairs", "triangle_mesh_defects"]


@dataclass(frozen=True)
class Defect:
    """One broken promise.

    code      a stable word, as `free-edge`, for programs and tests
    what      the sentence for a person
    where     a point (x, y, z) where it can be seen, or None
    measured  the value found, or None
    allowed   the value that would have passed, or None
    """

    code: str
    what: str
    where: tuple[float, float, float] | None = None
    measured: float | None = None
    allowed: float | None = None

    def __str__(self) -> str:
        place = "" if self.where is None else f" near ({', '.join(f'{x:.4g}' for x in self.where)})"
        figures = "" if self.measured is None else f": {self.measured:.4g}"
        if self.measured is not None and self.allowed is not None:
            figures += f", allowed {self.allowed:.4g}"
        return f"{self.code}: {self.what}{place}{figures}"


def triangle_mesh_defects(mesh: TriangleMesh, *, closed: bool = True, margin: float | None = None) -> list[Defect]:
    """What keeps a mesh from being the oriented boundary of a body: open or shared edges, turned faces, cuts.

    closed    whether edges with one face are defects
    margin    length below which an overlap of two triangles is touching; 1e-9 of the mesh's extent when None
    Returns   at most one defect of each code: mesh-free-edge, mesh-edge-overused, mesh-face-flipped, mesh-cuts-itself.
    """
    faces = mesh.face_vertices
    if len(faces) == 0:
        return [Defect("mesh-empty", "the mesh has no triangles")]
    directed = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    edges, slot = np.unique(np.sort(directed, axis=1), axis=0, return_inverse=True)
    uses = np.bincount(slot.ravel(), minlength=len(edges))
    forward = np.bincount(slot.ravel()[directed[:, 0] < directed[:, 1]], minlength=len(edges))
    broken = (
        ("mesh-free-edge", "edges of the triangulation with one triangle", (uses == 1) & closed),
        ("mesh-edge-overused", "edges of the triangulation with more than two triangles", uses > 2),
        ("mesh-face-flipped", "neighbouring triangles that face opposite ways", (uses == 2) & (forward != 1)),
    )
    defects = [
        _counted(code, what, mesh.vertices[edges[rows]].mean(axis=1)) for code, what, rows in broken if rows.any()
    ]
    _, places = crossing_triangles(mesh.vertices, faces, margin=margin)
    return defects + (
        [_counted("mesh-cuts-itself", "pairs of triangles that cut each other", places)] if len(places) else []
    )


def cutting_pairs(mesh: TriangleMesh) -> NDArray[np.int64]:
    """(n, 2) pairs of triangles that cut each other."""
    return crossing_triangles(mesh.vertices, mesh.face_vertices)[0]


def crowded_pairs(mesh: TriangleMesh) -> NDArray[np.int64]:
    """(n, 2) pairs of triangles on the same edge, where that has more than two; the first of them is in every pair."""
    faces = mesh.face_vertices
    sides = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    slot, uses = np.unique(sides, axis=0, return_inverse=True, return_counts=True)[1:]
    order = np.argsort(slot.ravel(), kind="stable")
    first = np.repeat(order[np.cumsum(uses) - uses], uses)
    crowded = np.repeat(uses > 2, uses) & (first != order)
    return np.column_stack([first, order])[crowded] % len(faces)


def _counted(code: str, what: str, places: NDArray[np.float64]) -> Defect:
    x, y, z = places[0].tolist()
    return Defect(code, what, (x, y, z), float(len(places)), 0.0)

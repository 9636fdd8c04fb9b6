"""The control mesh to start from: the scan simplified by quadric error, which keeps the features.

The border of an open scan is no feature to the quadrics: a flat sheet may lose its corners at no cost. So a wall is
built along the border for the time being, square to the surface, which makes a feature of it:

    surface ___________
                      |  wall            its faces are followed through the collapses, and taken away afterwards

Paper  [garland1997], the error of a collapse as a quadric; [maekawa2009], its use as initial control mesh.
"""

from typing import NamedTuple

import fast_simplification
import numpy as np
from numpy.typing import NDArray

from recon.errors import Refusal
from recon.geometry.control_mesh import ControlMesh
from recon.geometry.mesh import TriangleMesh
from recon.numerics.halfedges import edge_table, free_edges, opposite_sides, vertex_normals

__all__ = ["NoControlMesh", "initial_mesh"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

BOX = 100.0  # the simplifier compares errors with absolute numbers: scans come to it in one size
PACES = (3.0, 5.0, 7.0)  # how fast it raises the error it allows; a slower one may end before the count is reached
SHARES = (1.0, 0.99, 0.97, 0.94, 0.9, 0.8, 0.7)  # of the count, tried in turn where the last left a tangle
WALL = 2.0  # height of the walls in border edges
WALL_PASSES = 5  # more attempts where part of each goes into the walls
SPARE = 4  # times the count to which all attempts share the way


class NoControlMesh(Refusal):
    """No sound control mesh of the size asked for was found."""


def initial_mesh(scan: TriangleMesh, n_vertices: int) -> ControlMesh:
    """A manifold triangle mesh of about `n_vertices` (never more) with the shape of the scan.

    Raises  NoControlMesh when every attempt left edges or vertices that are no surface.
    """
    low, high = scan.vertices.min(axis=0), scan.vertices.max(axis=0)
    scale = BOX / max(float((high - low).max()), 1e-300)
    boxed = _simplified(_walled((scan.vertices - low) * scale, scan.face_vertices), SPARE * n_vertices)
    for share in SHARES:
        found = _simplified(boxed, max(int(share * n_vertices), 4))
        used, renumbered = np.unique(found.surface(), return_inverse=True)
        faces = renumbered.reshape(-1, 3)
        if len(used) <= n_vertices and _is_manifold(faces):
            return ControlMesh.from_faces(found.vertices[used] / scale + low, faces)
    raise NoControlMesh(f"the scan cannot be simplified to {n_vertices} control points; ask for more.")


class _Walled(NamedTuple):
    """A surface with walls along its border.

    vertices (V, 3), faces (F, 3), on_wall (F,)
    """

    vertices: Floats
    faces: Ints
    on_wall: Bools

    def surface(self) -> Ints:
        """The faces that are no wall."""
        return self.faces[~self.on_wall]


def _walled(vertices: Floats, faces: Ints) -> _Walled:
    border = free_edges(faces)
    if len(border) == 0:
        return _Walled(vertices, faces, np.zeros(len(faces), dtype=np.bool_))
    height = WALL * float(np.linalg.norm(vertices[border[:, 0]] - vertices[border[:, 1]], axis=1).mean())
    top, place = np.unique(border, return_inverse=True)
    feet = len(vertices) + place.reshape(-1, 2)
    wall = np.concatenate(
        [
            np.stack([border[:, 1], border[:, 0], feet[:, 0]], axis=1),
            np.stack([border[:, 1], feet[:, 0], feet[:, 1]], axis=1),
        ]
    )
    lowered = vertices[top] - height * vertex_normals(vertices, faces)[top]
    on_wall = np.arange(len(faces) + len(wall)) >= len(faces)
    return _Walled(np.concatenate([vertices, lowered]), np.concatenate([faces, wall]), on_wall)


def _simplified(mesh: _Walled, n_vertices: int) -> _Walled:
    """Collapse until the surface has few enough vertices, slowly first, or until that leads no further."""
    for pace in (*PACES, *[PACES[-1]] * (WALL_PASSES if mesh.on_wall.any() else 1)):
        used = len(np.unique(mesh.surface()))
        if used <= n_vertices:
            break
        # a collapse takes a vertex and two faces
        mesh = _collapsed(mesh, max(len(mesh.faces) - 2 * (used - n_vertices), 4), pace)
    return mesh


def _collapsed(mesh: _Walled, target: int, pace: float) -> _Walled:
    arguments = (mesh.vertices, mesh.faces.copy())
    if not mesh.on_wall.any():
        found, triangles = fast_simplification.simplify(*arguments, target_count=int(target), agg=pace)
        return _Walled(found, triangles.astype(np.int64), np.zeros(len(triangles), dtype=np.bool_))
    found, triangles, collapses = fast_simplification.simplify(
        *arguments, target_count=int(target), agg=pace, return_collapses=True
    )
    into = np.arange(len(mesh.vertices))
    into[collapses[:, 1]] = collapses[:, 0]
    while (further := into[into] != into).any():
        into[further] = into[into[further]]
    corners = into[mesh.faces]
    kept = (corners != np.roll(corners, 1, axis=1)).all(axis=1)
    if kept.sum() != len(triangles):
        raise NoControlMesh("the scan cannot be simplified: its border is lost on the way.")
    return _Walled(found, triangles.astype(np.int64), mesh.on_wall[kept])


def _is_manifold(faces: Ints) -> bool:
    """Whether there are faces with three corners each, and every edge has at most two, opposite in direction."""
    if len(faces) == 0 or (faces == np.roll(faces, 1, axis=1)).any():
        return False
    table = edge_table(faces)
    return not ((opposite_sides(faces) < 0) & (table.uses[table.face_edges] > 1)).any()

"""The control mesh to start from: the scan simplified by quadric error, which keeps the features.

The border of an open scan is no feature to the quadrics: a flat sheet may lose its corners at no cost. So a wall is
built along the border for the time being, square to the surface, which makes a feature of it:

    surface ___________
                      |  wall            its faces are followed through the collapses, and taken away afterwards

The simplifier needs five times the memory of what it simplifies, and keeps it. So a large scan is first thinned block
by block, the edges between blocks as they are, to a mesh of some times the points asked for.

Paper  [garland1997], the error of a collapse as a quadric; [maekawa2009], its use as initial control mesh.
"""

from typing import NamedTuple

import fast_simplification
import numpy as np
from numpy.typing import NDArray

from recon.errors import Refusal
from recon.geometry.control_mesh import ControlMesh
from recon.geometry.mesh import TriangleMesh
from recon.numerics.halfedges import FREE, TANGLED, paired_sides, vertex_normals

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
BLOCK = 25_000  # faces simplified at once
THINNED, THINNING_PACE = 8, 5.0  # times the count that is left of all blocks, and the pace on the way there


class NoControlMesh(Refusal):
    """No sound control mesh of the size asked for was found."""


def initial_mesh(scan: TriangleMesh, n_vertices: int) -> ControlMesh:
    """A manifold triangle mesh of about `n_vertices` (never more) with the shape of the scan.

    Raises  NoControlMesh when every attempt left edges or vertices that are no surface.
    """
    low, high = scan.vertices.min(axis=0), scan.vertices.max(axis=0)
    scale = BOX / max(float((high - low).max()), 1e-300)
    whole = _thinned(_walled((scan.vertices - low) * scale, scan.face_vertices), THINNED * n_vertices)
    boxed = _simplified(whole, SPARE * n_vertices)
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
    face, side = np.nonzero(paired_sides(faces) == FREE)
    border = np.stack([faces[face, side], faces[face, (side + 1) % 3]], axis=1)
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


def _thinned(mesh: _Walled, n_vertices: int) -> _Walled:
    """The mesh simplified block by block, to about so many vertices; edges between blocks stay as they are."""
    if len(mesh.faces) <= 2 * BLOCK or len(mesh.vertices) <= n_vertices:
        return mesh
    number = np.full(len(mesh.vertices), -1)
    blocks = _blocks(mesh.vertices[mesh.faces[:, 0]].astype(np.float32))
    vertices, faces, on_wall, n_found = [], [], [], 0
    for block in blocks:
        used, place = np.unique(mesh.faces[block], return_inverse=True)
        part = _Walled(mesh.vertices[used], place.reshape(-1, 3), mesh.on_wall[block])
        n_kept = int((paired_sides(part.faces) == FREE).sum())
        left = _followed(part, 2 * n_vertices // len(blocks) + n_kept, THINNING_PACE, preserve_border=True)
        survivors = used[left.survivors]
        new = number[survivors] < 0  # what lies between blocks has kept its place, and comes once
        number[survivors[new]] = n_found + np.arange(new.sum())
        n_found += int(new.sum())
        vertices.append(left.mesh.vertices[new])
        faces.append(number[survivors][left.mesh.faces])
        on_wall.append(left.mesh.on_wall)
    return _Walled(np.concatenate(vertices), np.concatenate(faces), np.concatenate(on_wall))


def _blocks(places: NDArray[np.float32]) -> list[Ints]:
    """Numbers of the places (n, 3), halved across their longest way until none has more than BLOCK."""
    done, waiting = [], [np.arange(len(places))]
    while waiting:
        block = waiting.pop()
        if len(block) <= BLOCK:
            done.append(np.sort(block))
            continue
        at = places[block]
        half = len(block) // 2
        sizes = [np.ptp(at[:, axis]) for axis in range(3)]
        order = np.argpartition(at[:, np.argmax(sizes)], half)
        waiting += [block[order[:half]], block[order[half:]]]
    return done


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
    if mesh.on_wall.any():
        return _followed(mesh, target, pace).mesh
    faces = mesh.faces.astype(np.int32)  # a copy, which may be written to
    found, triangles = fast_simplification.simplify(mesh.vertices, faces, target_count=int(target), agg=pace)
    return _Walled(found, triangles.astype(np.int64), np.zeros(len(triangles), dtype=np.bool_))


class _Followed(NamedTuple):
    """A mesh after collapses, and which vertices of the one before are left, in order."""

    mesh: _Walled
    survivors: Bools


def _followed(mesh: _Walled, target: int, pace: float, *, preserve_border: bool = False) -> _Followed:
    """As _collapsed, and it is known what became of every vertex and face."""
    found, triangles, collapses = fast_simplification.simplify(
        mesh.vertices,
        mesh.faces.astype(np.int32),
        target_count=int(min(target, len(mesh.faces))),
        agg=pace,
        return_collapses=True,
        preserve_border=preserve_border,
    )
    into = np.arange(len(mesh.vertices))
    into[collapses[:, 1]] = collapses[:, 0]
    while (further := into[into] != into).any():
        into[further] = into[into[further]]
    corners = into[mesh.faces]
    kept = (corners != np.roll(corners, 1, axis=1)).all(axis=1)
    survivors = np.zeros(len(into), dtype=np.bool_)
    survivors[corners[kept]] = True
    if kept.sum() != len(triangles) or survivors.sum() != len(found):
        raise NoControlMesh("the scan cannot be simplified: its border is lost on the way.")
    return _Followed(_Walled(found, triangles.astype(np.int64), mesh.on_wall[kept]), survivors)


def _is_manifold(faces: Ints) -> bool:
    """Whether there are faces with three corners each, and every edge has at most two, opposite in direction."""
    if len(faces) == 0 or (faces == np.roll(faces, 1, axis=1)).any():
        return False
    return not (paired_sides(faces) == TANGLED).any()

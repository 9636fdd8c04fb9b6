"""A control mesh cut along its creases into sheets that are smooth inside.

The limit surface on one side of a crease depends on the control points of that side alone, so a crease is two borders
that happen to share their control points. After the cut only vertices have to be told apart:

    SMOOTH  no sharp edge at it            BORDER  two sharp edges: the limit curve runs smoothly through
    DART    one sharp edge, which ends     CORNER  any other number, or marked: the limit surface passes through it

       o-------o-------o          o-------o o-------o
       |       #       |          |       | |       |      # crease
       |       #       |   -->    |       | |       |      the dart keeps one copy, its crease neighbour two
       o-------d-------o          o-------d-------o

W    numbers of vertices after the cut; copies of one control vertex have numbers of their own
k    corners a face, 3 or 4
"""

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from recon.errors import BadGeometry, NotManifold
from recon.geometry.control_mesh import ControlMesh
from recon.numerics.halfedges import edge_table, opposite_sides

__all__ = ["Refinement", "Sheets", "VertexKind", "cut_along_creases", "edge_numbers", "fan_corners"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class VertexKind(IntEnum):
    """By which rule a vertex moves under subdivision."""

    SMOOTH = 0
    BORDER = 1
    CORNER = 2
    DART = 3


class Sheets(NamedTuple):
    """A mesh of triangles or quadrilaterals whose sharp edges are all borders.

    faces   (F, k) vertex numbers
    across  (F, k) the side across each side, k f + i, or -1 on a border
    kinds   (W,) VertexKind of every vertex
    """

    faces: Ints
    across: Ints
    kinds: Ints


class Refinement(NamedTuple):
    """The mesh after one step, and the matrix (W', W) that takes the old points to the new."""

    sheets: Sheets
    matrix: sparse.csr_array


def edge_numbers(across: Ints) -> tuple[Ints, int]:
    """(F, k) number of the edge under each side, the same for both sides of an inner edge, and how many there are."""
    own = np.arange(across.size).reshape(across.shape)
    representative = np.where(across < 0, own, np.minimum(own, across))
    first, edge = np.unique(representative, return_inverse=True)
    return edge.reshape(across.shape).astype(np.int64), len(first)


def cut_along_creases(mesh: ControlMesh, n_corners: int) -> tuple[Sheets, Ints]:
    """The sheets of a control mesh whose faces have `n_corners` each, and (W,) the control vertex behind each vertex.

    Raises  BadGeometry when a face has another number of corners or a crease is semi-sharp; NotManifold when an edge has
            more than two faces, or two faces disagree about what is outside.
    """
    if mesh.is_semi_sharp:
        raise BadGeometry("control mesh", "semi-sharp creases have no limit patches before they are refined away")
    faces = mesh.faces_of(n_corners)
    across = opposite_sides(faces)
    _refuse_tangles(mesh, faces, across)
    sharp = (across < 0) | _on_creases(mesh, faces)
    across = np.where(sharp, -1, across)
    corner_copy = fan_corners(across)
    copies, first, cut_faces = np.unique(corner_copy, return_index=True, return_inverse=True)
    behind = faces.ravel()[first]
    cut_faces = cut_faces.reshape(faces.shape).astype(np.int64)
    kinds = _kinds(mesh, faces, sharp)[behind]
    on_border = np.zeros(len(copies), dtype=bool)
    on_border[cut_faces[sharp]] = on_border[np.roll(cut_faces, -1, axis=1)[sharp]] = True
    kinds[~on_border] = VertexKind.SMOOTH
    return Sheets(cut_faces, across, kinds), behind.astype(np.int64)


def _refuse_tangles(mesh: ControlMesh, faces: Ints, across: Ints) -> None:
    table = edge_table(faces)
    tangled = (across < 0) & (table.uses[table.face_edges] > 1)
    if tangled.any():
        face, side = (int(i) for i in np.argwhere(tangled)[0])
        edge = faces[face, [side, (side + 1) % faces.shape[1]]]
        problem = "an edge has more than two faces, or two that face opposite ways"
        raise NotManifold("control mesh", problem, mesh.vertices[edge].mean(axis=0).tolist())


def _on_creases(mesh: ControlMesh, faces: Ints) -> NDArray[np.bool_]:
    n = mesh.n_vertices
    creases = np.sort(mesh.crease_edges, axis=1)
    ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2), axis=2)
    return np.isin(ends[..., 0] * n + ends[..., 1], creases[:, 0] * n + creases[:, 1])


def fan_corners(across: Ints) -> Ints:
    """(F k,) a number for each face corner: corners have the same one when inner edges lead from one to the other."""
    k = across.shape[1]
    side = np.flatnonzero(across.ravel() >= 0)
    other = across.ravel()[side]
    following = side - side % k + (side + 1) % k
    # the side runs opposite to the one across: each begins where the other ends
    beside = other - other % k + (other + 1) % k
    rows, columns = np.concatenate([side, following]), np.concatenate([beside, other])
    graph = sparse.coo_array((np.ones(len(rows), dtype=np.int8), (rows, columns)), shape=(across.size, across.size))
    return csgraph.connected_components(graph, directed=False)[1].astype(np.int64)


def _kinds(mesh: ControlMesh, faces: Ints, sharp: NDArray[np.bool_]) -> Ints:
    """(V,) kind of every control vertex by the number of sharp edges that meet in it."""
    ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2)[sharp], axis=1)
    edges = np.unique(ends, axis=0)
    n_sharp = np.bincount(edges.ravel(), minlength=mesh.n_vertices)
    kinds = np.full(mesh.n_vertices, int(VertexKind.CORNER))
    kinds[n_sharp == 0], kinds[n_sharp == 1], kinds[n_sharp == 2] = (
        VertexKind.SMOOTH,
        VertexKind.DART,
        VertexKind.BORDER,
    )
    marked = np.zeros(mesh.n_vertices, dtype=bool)
    marked[mesh.corner_vertices] = True
    if faces.shape[1] == 4:
        # a border running smoothly through the only face of a vertex would leave the surface no tangent plane there
        marked[np.bincount(faces.ravel(), minlength=mesh.n_vertices) == 1] = True
    kinds[marked & (n_sharp > 0)] = VertexKind.CORNER
    return kinds

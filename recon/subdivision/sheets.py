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

__all__ = [
    "PolygonSheets",
    "Refinement",
    "Sheets",
    "VertexKind",
    "cut_along_creases",
    "cut_polygons",
    "edge_numbers",
    "fan_corners",
]

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


class PolygonSheets(NamedTuple):
    """A mesh of faces of any size whose sharp edges are all borders; its H corners stand face after face.

    corners    (H,) vertex numbers
    following  (H,) the corner after each around its face
    across     (H,) the side across the one from each corner to the next, named by its first corner; -1 on a border
    kinds      (W,) VertexKind of every vertex
    """

    corners: Ints
    following: Ints
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

    Raises  BadGeometry when a face has another number of corners or a crease is semi-sharp; NotManifold when an edge
            has more than two faces, or two faces disagree about what is outside.
    """
    faces = mesh.faces_of(n_corners)
    across = opposite_sides(faces)
    table = edge_table(faces)
    _refuse_tangles(mesh, across.ravel(), table.uses[table.face_edges].ravel())
    polygons, behind = _cut(mesh, across.ravel())
    return Sheets(polygons.corners.reshape(faces.shape), polygons.across.reshape(faces.shape), polygons.kinds), behind


def cut_polygons(mesh: ControlMesh) -> tuple[PolygonSheets, Ints]:
    """The sheets of any control mesh, and (W,) the control vertex behind each vertex; raises as `cut_along_creases`."""
    start, end = mesh.face_corners, mesh.face_corners[mesh.next_corners()]
    keys = np.minimum(start, end) * mesh.n_vertices + np.maximum(start, end)
    order = np.argsort(keys, kind="stable")
    _, edge, uses = np.unique(keys, return_inverse=True, return_counts=True)
    one, two = order[:-1], order[1:]
    pair = (keys[one] == keys[two]) & (uses[edge[one]] == 2) & (start[one] == end[two])
    across = np.full(len(keys), -1)
    across[one[pair]], across[two[pair]] = two[pair], one[pair]
    _refuse_tangles(mesh, across, uses[edge])
    return _cut(mesh, across)


def _cut(mesh: ControlMesh, across: Ints) -> tuple[PolygonSheets, Ints]:
    """The sheets, from the sides (H,) across all sides of the faces."""
    if mesh.is_semi_sharp:
        raise BadGeometry("control mesh", "semi-sharp creases have no limit patches before they are refined away")
    following = mesh.next_corners()
    ends = np.sort(np.stack([mesh.face_corners, mesh.face_corners[following]], axis=1), axis=1)
    creases = np.sort(mesh.crease_edges, axis=1) @ [mesh.n_vertices, 1]
    sharp = (across < 0) | np.isin(ends @ [mesh.n_vertices, 1], creases)
    across = np.where(sharp, -1, across)
    copies, first, corners = np.unique(fan_numbers(across, following), return_index=True, return_inverse=True)
    behind = mesh.face_corners[first]
    kinds = _kinds(mesh, ends[sharp])[behind]
    on_border = np.zeros(len(copies), dtype=bool)
    on_border[corners[sharp]] = on_border[corners[following[sharp]]] = True
    kinds[~on_border] = VertexKind.SMOOTH
    return PolygonSheets(corners.astype(np.int64), following, across, kinds), behind


def _refuse_tangles(mesh: ControlMesh, across: Ints, uses: Ints) -> None:
    """Raise NotManifold for a side that has none across though its edge, used so often, has other faces."""
    tangled = (across < 0) & (uses > 1)
    if tangled.any():
        side = int(np.argmax(tangled))
        edge = mesh.face_corners[[side, mesh.next_corners()[side]]]
        problem = "an edge has more than two faces, or two that face opposite ways"
        raise NotManifold("control mesh", problem, mesh.vertices[edge].mean(axis=0).tolist())


def fan_corners(across: Ints) -> Ints:
    """(F k,) a number for each face corner: corners have the same one when inner edges lead from one to the other."""
    k, own = across.shape[1], np.arange(across.size)
    return fan_numbers(across.ravel(), own - own % k + (own + 1) % k)


def fan_numbers(across: Ints, following: Ints) -> Ints:
    """(H,) as `fan_corners`, of faces of any size; following (H,) the corner after each around its face."""
    side = np.flatnonzero(across >= 0)
    other = across[side]
    # the side runs opposite to the one across: each begins where the other ends
    rows, columns = np.concatenate([side, following[side]]), np.concatenate([following[other], other])
    graph = sparse.coo_array((np.ones(len(rows), dtype=np.int8), (rows, columns)), shape=(across.size, across.size))
    return csgraph.connected_components(graph, directed=False)[1].astype(np.int64)


def _kinds(mesh: ControlMesh, sharp_sides: Ints) -> Ints:
    """(V,) kind of every control vertex by the sharp edges that meet in it; sharp_sides (m, 2), the lower end first."""
    edges = np.unique(sharp_sides, axis=0)
    n_sharp = np.bincount(edges.ravel(), minlength=mesh.n_vertices)
    kinds = np.full(mesh.n_vertices, int(VertexKind.CORNER))
    kinds[n_sharp == 0], kinds[n_sharp == 1], kinds[n_sharp == 2] = (
        VertexKind.SMOOTH,
        VertexKind.DART,
        VertexKind.BORDER,
    )
    marked = np.zeros(mesh.n_vertices, dtype=bool)
    marked[mesh.corner_vertices] = True
    if (np.diff(mesh.face_starts) != 3).any():
        # a border running smoothly through the only face of a vertex would leave the surface no tangent plane there
        marked[np.bincount(mesh.face_corners, minlength=mesh.n_vertices) == 1] = True
    kinds[marked & (n_sharp > 0)] = VertexKind.CORNER
    return kinds

"""Catmull-Clark's scheme on quadrilaterals: masks of one refinement, and the rings that make a bicubic patch.

    face      1/4 of each corner                                            border edge    1/2 of its ends
    edge      3/8 of its ends, 1/16 of the four vertices beside             BORDER vertex  3/4, and 1/8 of the two
    SMOOTH    1 - 7 / 4n of itself, 3 / 2n² of each of n neighbours,                       border neighbours
              1 / 4n² of each vertex opposite in a face                     CORNER vertex  stays
    DART      as SMOOTH; its crease neighbour has two copies, which count half each

    3---e2---2       face f gives faces 4 f + i, corner i first: (i, e_i, f, e_(i-1));
    |   |    |       after one refinement a face has at most one corner that is not regular, its first
    e3--f---e1
    |   |    |       a border vertex of a single face is a corner of the surface, marked or not: a border that
    0---e0---1       ran smoothly through it would leave the surface no tangent plane there

Paper  [catmull1978], masks; [derose1998], sharp edges; [biermann2000], borders and corners.
"""

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from recon.subdivision.sheets import Refinement, Sheets, VertexKind, edge_numbers

__all__ = ["REGULAR_FACES", "child_sides", "extended", "refine", "regular_rings", "split_faces"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

REGULAR_FACES = (4, 2, 1, 0)  # faces around a vertex of a regular mesh, by its kind; a dart is never regular


def refine(sheets: Sheets) -> Refinement:
    """Split every face into four; new vertices are the old ones, one on each edge, one in each face."""
    side_edge, n_edges = edge_numbers(sheets.across)
    faces = np.arange(len(sheets.faces))
    own = sparse.coo_array(
        (np.full(sheets.faces.size, 0.25), (np.repeat(faces, 4), sheets.faces.ravel())),
        shape=(len(faces), len(sheets.kinds)),
    )
    matrix = sparse.vstack([_vertex_rows(sheets), _edge_rows(sheets, side_edge, n_edges), own], format="csr")
    return Refinement(split_faces(sheets), sparse.csr_array(matrix))


def split_faces(sheets: Sheets) -> Sheets:
    """The connections of the refined mesh."""
    faces, across, kinds = sheets
    side_edge, n_edges = edge_numbers(across)
    e = len(kinds) + side_edge
    middle = np.broadcast_to((len(kinds) + n_edges + np.arange(len(faces)))[:, None], faces.shape)
    children = np.stack([faces, e, middle, np.roll(e, 1, axis=1)], axis=2).reshape(-1, 4)
    edge_kinds = np.full(n_edges, int(VertexKind.SMOOTH))
    edge_kinds[side_edge[across < 0]] = VertexKind.BORDER
    all_kinds = np.concatenate([kinds, edge_kinds, np.full(len(faces), int(VertexKind.SMOOTH))])
    return Sheets(children, child_sides(across), all_kinds)


def child_sides(across: Ints) -> Ints:
    """(4 F, 4) the sides across of the refined faces: side i of the old face is side 0 of child i, side 3 of i + 1."""
    n = len(across)
    face, i = np.arange(n)[:, None], np.arange(4)
    inner, other_face, other_side = across >= 0, across // 4, across % 4
    children = np.empty((n, 4, 4), dtype=np.int64)
    children[:, i, 0] = np.where(inner, 4 * (4 * other_face + (other_side + 1) % 4) + 3, -1)
    children[:, (i + 1) % 4, 3] = np.where(inner, 4 * (4 * other_face + other_side), -1)
    children[:, i, 1] = 4 * (4 * face + (i + 1) % 4) + 2
    children[:, i, 2] = 4 * (4 * face + (i + 3) % 4) + 1
    return children.reshape(-1, 4)


def _vertex_rows(sheets: Sheets) -> sparse.csr_array:
    faces, across, kinds = sheets
    n = len(kinds)
    start, end, opposite = (np.roll(faces, -i, axis=1).ravel() for i in range(3))
    free = across.ravel() < 0
    n_faces = np.maximum(np.bincount(start, minlength=n), 1)
    smooth = (kinds == VertexKind.SMOOTH) | (kinds == VertexKind.DART)
    border = kinds == VertexKind.BORDER
    spoke = np.where(smooth, 1.5 / n_faces**2, 0.0)
    diagonal = np.where(smooth, 0.25 / n_faces**2, 0.0)
    # each edge at a smooth vertex is met as a side that leaves it; a dart's last one only as a side that arrives
    outward = np.where(free & smooth[start], 0.5, 1.0) * spoke[start]
    arriving = np.where(free & smooth[end], 0.5 * spoke[end], 0.0)
    along = np.where(free, 0.125, 0.0)
    own = np.select([smooth, border], [1.0 - 1.75 / n_faces, 0.75], 1.0)
    rows = np.concatenate([start, end, start, start, end, np.arange(n)])
    columns = np.concatenate([end, start, opposite, end, start, np.arange(n)])
    values = np.concatenate([outward, arriving, diagonal[start], along * border[start], along * border[end], own])
    matrix = sparse.csr_array(sparse.coo_array((values, (rows, columns)), shape=(n, n)))
    matrix.eliminate_zeros()
    return matrix


def _edge_rows(sheets: Sheets, side_edge: Ints, n_edges: int) -> sparse.csr_array:
    corners = [np.roll(sheets.faces, -i, axis=1).ravel() for i in range(4)]
    edge, free = side_edge.ravel(), sheets.across.ravel() < 0
    ends, beside = np.where(free, 0.5, 0.1875), np.where(free, 0.0, 0.0625)
    values = np.concatenate([ends, ends, beside, beside])
    shape = (n_edges, len(sheets.kinds))
    matrix = sparse.csr_array(sparse.coo_array((values, (np.tile(edge, 4), np.concatenate(corners))), shape=shape))
    matrix.eliminate_zeros()
    return matrix


def extended(sheets: Sheets) -> Refinement:
    """Reflect the faces along borders, so that patches at a regular border vertex have a full ring.

         d----c           g1 .. g0     across a border edge a-b:   g0 = 2 a - d    g1 = 2 b - c
         |    |           |      |     at a corner of one face  d' = 4 a - 2 b - 2 d + c
         a----b           b -<-- a

    Repeated refinement of the completed ring gives the border masks again, so nothing but the bookkeeping changes.
    The new faces come after the old ones, the new vertices likewise; `matrix` (W', W) makes their points.
    """
    faces, across, kinds = sheets
    n, n_faces = len(kinds), len(faces)
    free = np.flatnonzero(across.ravel() < 0)
    if len(free) == 0:
        return Refinement(sheets, sparse.csr_array(sparse.eye_array(n)))
    a, b, c, d = (np.roll(faces, -i, axis=1).ravel()[free] for i in range(4))
    ghost = n + np.arange(len(free))
    ghost_end = ghost + len(free)
    mirrored = np.stack([b, a, ghost, ghost_end], axis=1)
    arriving = np.full(n, -1)
    arriving[b] = np.arange(len(free))
    counts = np.bincount(faces.ravel(), minlength=n)
    met = arriving[a] >= 0
    passing = np.flatnonzero(met & (kinds[a] == VertexKind.BORDER) & (counts[a] == REGULAR_FACES[VertexKind.BORDER]))
    turning = np.flatnonzero(met & (kinds[a] == VertexKind.CORNER) & (counts[a] == REGULAR_FACES[VertexKind.CORNER]))
    diagonal = n + 2 * len(free) + np.arange(len(turning))
    corner_faces = np.stack([a[turning], ghost_end[arriving[a[turning]]], diagonal, ghost[turning]], axis=1)
    rows = np.concatenate([np.arange(n), np.repeat(ghost, 2), np.repeat(ghost_end, 2), np.repeat(diagonal, 4)])
    four = np.stack([a, b, d, c], axis=1)[turning].ravel()
    columns = np.concatenate([np.arange(n), np.stack([a, d], 1).ravel(), np.stack([b, c], 1).ravel(), four])
    values = np.concatenate(
        [np.ones(n), np.tile([2.0, -1.0], 2 * len(free)), np.tile([4.0, -2.0, -2.0, 1.0], len(turning))]
    )
    n_all = n + 2 * len(free) + len(turning)
    matrix = sparse.csr_array(sparse.coo_array((values, (rows, columns)), shape=(n_all, n)))
    grown = _extended_across(across, free, (passing, arriving[a[passing]]), (turning, arriving[a[turning]]), n_faces)
    all_kinds = np.concatenate([kinds, np.full(n_all - n, int(VertexKind.BORDER))])
    return Refinement(Sheets(np.concatenate([faces, mirrored, corner_faces]), grown, all_kinds), matrix)


def _extended_across(
    across: Ints, free: Ints, passing: tuple[Ints, Ints], turning: tuple[Ints, Ints], n_faces: int
) -> Ints:
    """Sides across of old, mirrored and corner faces; a mirrored face's sides: border edge, start, outer, end.

    passing, turning  free sides that leave a border or corner vertex, and those that arrive there
    """
    grown = np.full((n_faces + len(free) + len(turning[0]), 4), -1)
    grown[:n_faces] = across
    mirrored = n_faces + np.arange(len(free))
    grown[free // 4, free % 4] = 4 * mirrored
    grown[mirrored, 0] = free
    leave, arrive = mirrored[passing[0]], mirrored[passing[1]]
    grown[leave, 1], grown[arrive, 3] = 4 * arrive + 3, 4 * leave + 1
    leave, arrive = mirrored[turning[0]], mirrored[turning[1]]
    corner = n_faces + len(free) + np.arange(len(turning[0]))
    # the corner face (a, end ghost of the arriving side, diagonal, start ghost of the leaving side)
    grown[corner, 0], grown[arrive, 3] = 4 * arrive + 3, 4 * corner
    grown[corner, 3], grown[leave, 1] = 4 * leave + 1, 4 * corner + 3
    return grown


def regular_rings(sheets: Sheets, chosen: Ints) -> Ints:
    """(n, 16) the vertices of the chosen faces and around them, row 4 j + i of the grid below; all corners are regular.

    j = 3   .   .   .   .        D at corner k: the vertex opposite to it in the face opposite
    j = 2   .   3 - 2   .        A, B across side k: beyond its start, beyond its end
    j = 1   B3  0 - 1   .
    j = 0   D0  A0  B0  .
          i = 0   1   2   3
    """
    flat, across = sheets.faces.ravel(), sheets.across.ravel()
    ring = np.empty((len(chosen), 16), dtype=np.int64)
    places = np.array([[5, 1, 2, 0], [6, 7, 11, 3], [10, 14, 13, 15], [9, 8, 4, 12]])  # corner, A, B, D
    for k in range(4):
        own = 4 * chosen + k
        beside = across[own]
        first = beside - beside % 4
        after = across[first + (beside + 1) % 4]
        ring[:, places[k, 0]] = flat[own]
        ring[:, places[k, 1]] = flat[first + (beside + 2) % 4]
        ring[:, places[k, 2]] = flat[first + (beside + 3) % 4]
        ring[:, places[k, 3]] = flat[after - after % 4 + (after + 3) % 4]
    return ring

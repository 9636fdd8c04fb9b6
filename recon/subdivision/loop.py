"""Loop's scheme on triangles: masks of one refinement, and the rings that make a regular limit patch.

    inner edge            3/8 of its ends, 1/8 of the two vertices across     border edge    1/2 of its ends
    SMOOTH vertex         1 - n b of itself, b of each of n neighbours        BORDER vertex  3/4, and 1/8 of the two
    DART vertex           as SMOOTH; its crease neighbour has two copies,                    border neighbours
                          which count half each                               CORNER vertex  stays

           2                   face f gives faces 4 f + i (corner i first, i = 0, 1, 2) and 4 f + 3 in the middle;
          / \\                  after one refinement a face has at most one corner that is not regular, its first
         e2--e1
        / \\ / \\                b = (5/8 - (3/8 + cos(2 pi / n) / 4)^2) / n
       0---e0--1

Paper  [loop1987], masks; [hoppe1994], sharp edges; [schweitzer1996], reflected border points.
"""

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from recon.subdivision.sheets import Refinement, Sheets, VertexKind, edge_numbers

__all__ = ["REGULAR_FACES", "extended", "refine", "regular_rings", "vertex_weight"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

REGULAR_FACES = (6, 3, 0, 0)  # faces around a vertex of a regular mesh, by its kind; corners and darts never are


def vertex_weight(valence: Ints) -> Floats:
    """Weight b of each neighbour of a smooth vertex, by its valence."""
    return (0.625 - (0.375 + 0.25 * np.cos(2 * np.pi / valence)) ** 2) / valence


def refine(sheets: Sheets) -> Refinement:
    """Split every face into four; new vertices are the old ones, then one on each edge."""
    faces, across, kinds = sheets
    n_old = len(kinds)
    side_edge, n_edges = edge_numbers(across)
    matrix = sparse.vstack([_vertex_rows(sheets), _edge_rows(sheets, side_edge, n_edges)], format="csr")
    e = n_old + side_edge
    children = np.stack(
        [
            np.stack([faces[:, 0], e[:, 0], e[:, 2]], axis=1),
            np.stack([faces[:, 1], e[:, 1], e[:, 0]], axis=1),
            np.stack([faces[:, 2], e[:, 2], e[:, 1]], axis=1),
            e,
        ],
        axis=1,
    ).reshape(-1, 3)
    edge_kinds = np.zeros(n_edges, dtype=np.int64)
    edge_kinds[side_edge[across < 0]] = VertexKind.BORDER
    return Refinement(Sheets(children, _child_sides(across), np.concatenate([kinds, edge_kinds])), matrix)


def _child_sides(across: Ints) -> Ints:
    """(4 F, 3) the sides across of the refined faces, from those of the old ones.

    Side i of the old face becomes side 0 of child i and side 2 of child i + 1; side 1 of child i meets the middle.
    """
    n = len(across)
    children = np.full((n, 4, 3), -1)
    face, following = np.arange(n)[:, None], (np.arange(3) + 1) % 3
    other_face, other_side = across // 3, across % 3
    inner = across >= 0
    children[:, :3, 0] = np.where(inner, 3 * (4 * other_face + (other_side + 1) % 3) + 2, -1)
    back = np.where(inner, 3 * (4 * other_face + other_side), -1)
    children[:, following, 2] = back
    # the middle's side i runs from e_i to e_(i+1), across corner i + 1
    children[:, 3, :] = 3 * (4 * face + following) + 1
    children[:, following, 1] = 3 * (4 * face + 3) + np.arange(3)
    return children.reshape(-1, 3)


def _vertex_rows(sheets: Sheets) -> sparse.csr_array:
    faces, across, kinds = sheets
    n = len(kinds)
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    free = across.ravel() < 0
    n_faces = np.bincount(start, minlength=n)
    smooth = (kinds == VertexKind.SMOOTH) | (kinds == VertexKind.DART)
    b = np.where(smooth, vertex_weight(np.maximum(n_faces, 1)), 0.0)
    # each edge at a smooth vertex is met as a side that leaves it; a dart's last one only as a side that arrives
    outward = np.where(free & smooth[start], 0.5, 1.0) * b[start]
    arriving = np.where(free & smooth[end], 0.5 * b[end], 0.0)
    along = np.where(free, 0.125, 0.0)
    border = kinds == VertexKind.BORDER
    rows = np.concatenate([start, end, start, end, np.arange(n)])
    columns = np.concatenate([end, start, end, start, np.arange(n)])
    own = np.select([smooth, border], [1.0 - n_faces * b, 0.75], 1.0)
    values = np.concatenate([outward, arriving, along * border[start], along * border[end], own])
    rows_matrix = sparse.csr_array(sparse.coo_array((values, (rows, columns)), shape=(n, n)))
    rows_matrix.eliminate_zeros()
    return rows_matrix


def _edge_rows(sheets: Sheets, side_edge: Ints, n_edges: int) -> sparse.csr_array:
    faces, across, kinds = sheets
    start, end, tip = faces.ravel(), np.roll(faces, -1, axis=1).ravel(), np.roll(faces, -2, axis=1).ravel()
    edge, free = side_edge.ravel(), across.ravel() < 0
    ends = np.where(free, 0.5, 0.1875)
    rows = np.concatenate([edge, edge, edge])
    columns = np.concatenate([start, end, tip])
    values = np.concatenate([ends, ends, np.where(free, 0.0, 0.125)])
    matrix = sparse.csr_array(sparse.coo_array((values, (rows, columns)), shape=(n_edges, len(kinds))))
    matrix.eliminate_zeros()
    return matrix


def extended(sheets: Sheets) -> Refinement:
    """Reflect the faces along borders, so that patches at a regular border vertex have a full ring.

               c1----c2          the point across a border edge a-p is a + p - c1: repeated refinement of the
              /  \\  /  \\         completed ring gives the border masks again, so nothing but the bookkeeping changes
             a----p----b
              \\  /  \\  /
               g1----g2

    The new faces come after the old ones, the new vertices likewise; `matrix` (W', W) makes their points.
    """
    faces, across, kinds = sheets
    n, n_faces = len(kinds), len(faces)
    free = np.flatnonzero(across.ravel() < 0)
    if len(free) == 0:
        return Refinement(sheets, sparse.csr_array(sparse.eye_array(n)))
    start, end, tip = (np.roll(faces, -i, axis=1).ravel()[free] for i in range(3))
    ghost = n + np.arange(len(free))
    mirrored = np.stack([end, start, ghost], axis=1)
    arriving = np.full(n, -1)
    arriving[end] = np.arange(len(free))
    regular = (kinds == VertexKind.BORDER) & (
        np.bincount(faces.ravel(), minlength=n) == REGULAR_FACES[VertexKind.BORDER]
    )
    leaving = np.flatnonzero(regular[start] & (arriving[start] >= 0))
    between = np.stack([start[leaving], ghost[arriving[start[leaving]]], ghost[leaving]], axis=1)
    rows = np.concatenate([np.arange(n), np.repeat(ghost, 3)])
    columns = np.concatenate([np.arange(n), np.stack([start, end, tip], axis=1).ravel()])
    values = np.concatenate([np.ones(n), np.tile([1.0, 1.0, -1.0], len(free))])
    matrix = sparse.csr_array(sparse.coo_array((values, (rows, columns)), shape=(n + len(free), n)))
    all_faces = np.concatenate([faces, mirrored, between])
    grown = _extended_across(across, free, leaving, arriving[start[leaving]], n_faces)
    all_kinds = np.concatenate([kinds, np.full(len(free), int(VertexKind.BORDER))])
    return Refinement(Sheets(all_faces, grown, all_kinds), matrix)


def _extended_across(across: Ints, free: Ints, leaving: Ints, arriving: Ints, n_faces: int) -> Ints:
    """Sides across of old, mirrored and connecting faces; a mirrored face's sides: the border edge, start, end."""
    n_mirrored = len(free)
    grown = np.full((n_faces + n_mirrored + len(leaving), 3), -1)
    grown[:n_faces] = across
    mirrored = n_faces + np.arange(n_mirrored)
    grown[free // 3, free % 3] = 3 * mirrored
    grown[mirrored, 0] = free
    between = n_faces + n_mirrored + np.arange(len(leaving))
    # connecting face (p, g of the arriving edge, g of the leaving edge)
    grown[between, 0] = 3 * mirrored[arriving] + 2
    grown[mirrored[arriving], 2] = 3 * between
    grown[between, 2] = 3 * mirrored[leaving] + 1
    grown[mirrored[leaving], 1] = 3 * between + 2
    return grown


def regular_rings(sheets: Sheets, chosen: Ints) -> Ints:
    """(n, 12) the vertices of the chosen faces and around them; all three corners have six faces.

    [0 1 2 | across 01, 12, 20 | two more around 0, around 1, around 2], each counter-clockwise.
    """
    flat_faces, flat_across = sheets.faces.ravel(), sheets.across.ravel()
    ring = np.empty((len(chosen), 12), dtype=np.int64)
    for corner in range(3):
        side = 3 * chosen + corner
        spoke = side
        tips = []
        for _ in range(5):
            spoke = flat_across[spoke - spoke % 3 + (spoke + 2) % 3]
            tips.append(flat_faces[spoke - spoke % 3 + (spoke + 1) % 3])
        # spokes counter-clockwise: next corner, previous corner, across the side before, two more, across this side
        ring[:, corner] = flat_faces[side]
        ring[:, 3 + corner] = tips[4]
        ring[:, 6 + 2 * corner], ring[:, 7 + 2 * corner] = tips[2], tips[3]
    return ring

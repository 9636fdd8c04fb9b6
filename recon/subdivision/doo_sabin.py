"""Doo-Sabin's scheme on quadrilaterals: its surface is the dual of Catmull-Clark's mesh, a patch around every point.

    .---.---.      a refined point stands for one corner of one old face and is the middle of a bi-quadratic patch
    | p | p |      with nine points; the patch has its corners at the middle of the old face, at the middles of two
    .---o---.      old edges, and at the old vertex: patch 4 f + i has the corners (vertex i, e_i, f, e_(i-1)) of the
    | p | p |      mesh that Catmull-Clark's split makes. Corner 0 is irregular where the vertex has not four faces.
    .---.---.

    refined point of corner i in a face of n corners: sum of c_(i-j) P_j,  c_0 = (n + 5) / 4n,
    c_k = (3 + 2 cos(2 pi k / n)) / 4n

A border is completed by faces of no width, every border vertex twice (at a corner four times): the surface then ends
at the quadratic B-spline of the border's points, and in the corners. Refinement keeps such faces as they are.

Paper  [doo1978], masks; [nasri1987], borders.
"""

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from recon.errors import BadGeometry
from recon.subdivision.catmull_clark import split_faces
from recon.subdivision.evaluation import MAX_SUPPORT, PatchArrays
from recon.subdivision.limit_tables import CornerTable, nested_levels, table_arrays
from recon.subdivision.sheets import Refinement, Sheets, VertexKind

__all__ = ["corner_weights", "doo_sabin_patches", "face_table"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def corner_weights(n: int) -> Floats:
    """(n, n) refined points of a face over its corners."""
    i = np.arange(n)
    weights = (3.0 + 2.0 * np.cos(2.0 * np.pi * i / n)) / (4.0 * n)
    weights[0] = (n + 5.0) / (4.0 * n)
    return weights[(i[:, None] - i) % n]


def doo_sabin_patches(sheets: Sheets) -> tuple[PatchArrays, sparse.csr_array, Sheets]:
    """Patches of the surface, the matrix (R, W) that makes their points, and the patches as faces of a mesh.

    Raises  BadGeometry when a crease ends inside a face of the surface, or a vertex has too many faces.
    """
    if (sheets.kinds == VertexKind.DART).any():
        raise BadGeometry("control mesh", "a crease that ends inside the surface has no meaning in Doo-Sabin's scheme")
    whole = _completed(sheets)
    n = len(whole.sheets.faces)
    rows = np.repeat(np.arange(4 * n), 4)
    columns = np.repeat(whole.sheets.faces, 4, axis=0).ravel()
    refine = sparse.csr_array(
        sparse.coo_array((np.tile(corner_weights(4).ravel(), n), (rows, columns)), (4 * n, len(whole.sheets.kinds)))
    )
    split = split_faces(whole.sheets)
    kept = np.flatnonzero(whole.sheets.faces.ravel() < len(sheets.kinds))
    arrays = _dual_patches(split, kept)
    return arrays, sparse.csr_array(refine @ whole.matrix), Sheets(split.faces[kept], arrays.across, split.kinds)


def _completed(sheets: Sheets) -> Refinement:
    """The mesh with faces of no width along its borders: (b, a, a', b') across a-b, (a, a', a'', a') at a corner."""
    faces, across, kinds = sheets
    n, n_faces = len(kinds), len(faces)
    free = np.flatnonzero(across.ravel() < 0)
    a, b = faces.ravel()[free], np.roll(faces, -1, axis=1).ravel()[free]
    arriving = np.full(n, -1)
    arriving[b] = np.arange(len(free))
    incoming = arriving[a]
    turning = np.flatnonzero(kinds[a] == VertexKind.CORNER)
    ghost = n + np.arange(len(free))
    ghost_end = np.empty(len(free), dtype=np.int64)
    ghost_end[incoming] = ghost  # one copy serves both sides, but not at a corner
    ghost_end[incoming[turning]] = n + len(free) + np.arange(len(turning))
    last = n + len(free) + len(turning) + np.arange(len(turning))
    mirrored = np.stack([b, a, ghost, ghost_end], axis=1)
    corner_faces = np.stack([a[turning], ghost_end[incoming[turning]], last, ghost[turning]], axis=1)
    grown = np.full((n_faces + len(free) + len(turning), 4), -1)
    grown[:n_faces] = across
    strip, corner = n_faces + np.arange(len(free)), n_faces + len(free) + np.arange(len(turning))
    grown[free // 4, free % 4], grown[strip, 0] = 4 * strip, free
    before = strip[incoming]
    grown[strip, 1], grown[before, 3] = 4 * before + 3, 4 * strip + 1
    grown[strip[turning], 1], grown[corner, 3] = 4 * corner + 3, 4 * strip[turning] + 1
    grown[before[turning], 3], grown[corner, 0] = 4 * corner, 4 * before[turning] + 3
    behind = np.concatenate([np.arange(n), a, a[turning], a[turning]])
    matrix = sparse.csr_array((np.ones(len(behind)), behind, np.arange(len(behind) + 1)), shape=(len(behind), n))
    return Refinement(Sheets(np.concatenate([faces, mirrored, corner_faces]), grown, kinds[behind]), matrix)


def _dual_patches(split: Sheets, kept: Ints) -> PatchArrays:
    """Patches around the kept points; a point is the face of the split mesh that its patch is."""
    across = split.across.ravel()
    fan, counts = _fans(across, kept)
    irregular = counts != 4
    if counts.max(initial=0) + 5 > MAX_SUPPORT:
        room = MAX_SUPPORT - 5
        raise BadGeometry("control mesh", f"vertex with {counts.max()} faces; a limit patch has room for {room}")
    beside = across[4 * kept[:, None] + np.arange(4)] // 4  # across each side
    turned = across[4 * kept[:, None] + np.arange(4)]
    diagonal = across[turned - turned % 4 + (turned + 1) % 4] // 4  # opposite at each corner
    rows = [diagonal[:, 0], beside[:, 0], diagonal[:, 1], beside[:, 3], kept, beside[:, 1], diagonal[:, 3]]
    ring = np.stack([*rows, beside[:, 2], diagonal[:, 2]], axis=1)
    sizes = np.where(irregular, counts + 5, 9)
    starts = np.concatenate([[0], np.cumsum(sizes)])
    support = np.empty(starts[-1], dtype=np.int64)
    support[starts[:-1][~irregular][:, None] + np.arange(9)] = ring[~irregular]
    outer = ring[:, [2, 5, 8, 7, 6]]
    at, inside = starts[:-1][irregular], np.arange(fan.shape[1]) < counts[irregular][:, None]
    support[(at[:, None] + np.arange(fan.shape[1]))[inside]] = fan[irregular][inside]
    support[(at + counts[irregular])[:, None] + np.arange(5)] = outer[irregular]
    valences, number = np.unique(counts[irregular], return_inverse=True)
    tables = np.full(len(kept), -1)
    tables[irregular] = number
    new = np.full(len(split.faces), -1)
    new[kept] = np.arange(len(kept))
    old_sides = split.across[kept]
    sides = np.where(old_sides < 0, -1, 4 * new[old_sides // 4] + old_sides % 4)
    sides[(old_sides < 0) | (new[old_sides // 4] < 0)] = -1
    made = [face_table(int(n)) for n in valences]
    return PatchArrays(starts, support, tables, sides, np.eye(9), *table_arrays(made))


def _fans(across: Ints, kept: Ints) -> tuple[Ints, Ints]:
    """(n, m) the patches around corner 0 of each kept one, itself first, counter-clockwise, and (n,) how many."""
    rows, at = [kept], kept
    counts = np.zeros(len(kept), dtype=np.int64)
    while (counts == 0).any():
        at = across[4 * at + 3] // 4  # corner 0 is corner 0 there too: it is the old vertex
        counts[(at == kept) & (counts == 0)] = len(rows)
        rows.append(at)
        if len(rows) > MAX_SUPPORT:
            break
    return np.stack(rows, axis=1), np.where(counts == 0, MAX_SUPPORT, counts)


def face_table(n: int) -> CornerTable:
    """Weights of a patch at the middle of a face of n points, itself the first; then its five other neighbours.

    The neighbours run around the patch from its corner 1, counter-clockwise, to its corner 3.
    """
    size = n + 5
    c1, s1, c2, s2, c3 = range(n, size)
    first, last = 1, n - 1
    unit = np.eye(size)

    def near(own: int, one: int, two: int, opposite: int) -> Floats:
        return (9.0 * unit[own] + 3.0 * (unit[one] + unit[two]) + unit[opposite]) / 16.0

    # points of the four faces around the patch's own point, named by the old point and the corner of the patch
    face = corner_weights(n) @ unit[:n]
    own1, own2, own3 = near(0, last, s1, c1), near(0, s1, s2, c2), near(0, s2, first, c3)
    last1, c1_1, s1_1 = near(last, c1, 0, s1), near(c1, s1, last, 0), near(s1, 0, c1, last)
    s1_2, c2_2, s2_2 = near(s1, c2, 0, s2), near(c2, s2, s1, 0), near(s2, 0, c2, s1)
    s2_3, c3_3, first3 = near(s2, c3, 0, first), near(c3, first, s2, 0), near(first, 0, c3, s2)
    shrink = np.concatenate([face, [last1, own1, own2, own3, first3]])
    subs = np.array(
        [
            [face[last], last1, c1_1, face[0], own1, s1_1, own3, own2, s1_2],
            [face[0], own1, s1_1, own3, own2, s1_2, s2_3, s2_2, c2_2],
            [face[first], face[0], own1, first3, own3, own2, c3_3, s2_3, s2_2],
        ]
    )
    limit = np.concatenate([np.full(n, 1.0 / n), np.zeros(5)])
    values, right = np.linalg.eig(shrink)
    order = np.argsort(-np.abs(values))[1:3]
    plane = (right[:, order] @ np.linalg.inv(right)[order]).real
    tangents = np.stack([plane[0] + plane[last], plane[0] + plane[first]])
    return CornerTable(limit, tangents, nested_levels(shrink, limit, subs))

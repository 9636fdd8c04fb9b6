"""Doo-Sabin's scheme on faces of any size: its surface is the dual of a mesh of quadrilaterals, a patch a point.

    .---.---.      a refined point stands for one corner of one old face and is the middle of a bi-quadratic patch
    | p | p |      with nine points; the patch has its corners at the middle of the old face, at the middles of two
    .---o---.      old edges, and at the old vertex: patch h, of corner h of the mesh, is the quadrilateral
    | p | p |      (vertex, e, f, e') with e the edge after the corner, f its face and e' the edge before. The dual mesh
    .---.---.      is that of these quadrilaterals.

    refined point of corner i in a face of n corners: sum of c_(i-j) P_j,  c_0 = (n + 5) / 4n,
    c_k = (3 + 2 cos(2 pi k / n)) / 4n

A corner of a patch is irregular where the vertex has not four faces or the face not four corners, and is put first. A
patch with two such corners is refined: a point for each corner of each quadrilateral of the dual, which is the refined
point of that face of the mesh; then only the middles of faces are irregular.

A border is completed by faces of no width, every border vertex twice (at a corner four times): the surface then ends
at the quadratic B-spline of the border's points, and in the corners. Refinement keeps such faces as they are.

A corner lies in one patch, between the two sharp edges that leave it, and that patch covers less than two right angles:
at a concave corner the surface folds, unless creases divide it. A crease may end inside the surface: both its sides run
along the same line there and back, and beyond its end the surface is smooth.

Paper  [doo1978], masks; [nasri1987], borders.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from recon.errors import BadGeometry
from recon.geometry.control_mesh import ControlMesh
from recon.subdivision import catmull_clark
from recon.subdivision.evaluation import MAX_SUPPORT, PatchArrays
from recon.subdivision.layout import turned_faces
from recon.subdivision.limit_tables import CornerTable, nested_levels, table_arrays
from recon.subdivision.sheets import PolygonSheets, Sheets, VertexKind, cut_polygons

__all__ = ["DualPatches", "corner_weights", "doo_sabin_patches"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class DualPatches(NamedTuple):
    """The surface as patches, which are the faces of a mesh of quadrilaterals.

    arrays  the patches; of a mesh of quadrilaterals alone, patch 4 f + i is the one at corner i of control face f, and
            further ones along the border come after these
    rings   (n, 9) points of the grid around each, row by row; entry 0 is not used where corner 0 is irregular
    points  (R, V) sparse, control points -> points
    sheets  the patches' corners, and the sides across
    joined  (n, 4) the sides across where creases part nothing
    """

    arrays: PatchArrays
    rings: Ints
    points: sparse.csr_array
    sheets: Sheets
    joined: Ints


class _Completed(NamedTuple):
    """A mesh with faces of no width along its borders; those across free sides, then those at corners, come last.

    matrix   (W', W) makes its points
    n_inner  corners of the faces that were there before
    strips   (m,) the first corner of the face across each free side, and `free` (m,) those sides
    turning  (m,) the first corner of the face at the start of the free side; -1 where that is no corner
    """

    mesh: PolygonSheets
    matrix: sparse.csr_array
    n_inner: int
    free: Ints
    strips: Ints
    turning: Ints


def corner_weights(n: int) -> Floats:
    """(n, n) refined points of a face over its corners."""
    i = np.arange(n)
    weights = (3.0 + 2.0 * np.cos(2.0 * np.pi * i / n)) / (4.0 * n)
    weights[0] = (n + 5.0) / (4.0 * n)
    return weights[(i[:, None] - i) % n]


def doo_sabin_patches(mesh: ControlMesh) -> DualPatches:
    """Patches of the surface.

    Raises  BadGeometry when a crease is semi-sharp, or a vertex has too many faces or under three; NotManifold.
    """
    if mesh.is_semi_sharp:
        raise BadGeometry("control mesh", "semi-sharp creases have no meaning in Doo-Sabin's scheme; make them sharp")
    sheets, behind = cut_polygons(mesh)
    whole = _completed(sheets)
    dual = _dual(whole.mesh)
    kept = np.flatnonzero(whole.mesh.corners < len(sheets.kinds))
    joined = _across_creases(_sides(dual, kept), kept, whole, sheets, _uncut(mesh))
    copies = sparse.csr_array(
        (np.ones(len(behind)), behind, np.arange(len(behind) + 1)), shape=(len(behind), mesh.n_vertices)
    )
    points = sparse.csr_array(_face_points(whole.mesh) @ (whole.matrix @ copies))
    if (_irregular(dual, kept).sum(axis=1) > 1).any():
        points = sparse.csr_array(_refined_points(dual) @ points)
        dual, joined = Sheets(*catmull_clark.split_faces(dual)), catmull_clark.child_sides(joined)
        kept = (4 * kept[:, None] + np.arange(4)).ravel()
    turns = np.zeros(len(dual.faces), dtype=np.int64)
    turns[kept] = _irregular(dual, kept).argmax(axis=1)
    dual = Sheets(*turned_faces(dual.faces, dual.across, turns), dual.kinds)
    joined = turned_faces(joined, joined, turns[kept])[1]
    arrays, rings = _patches(dual, kept)
    return DualPatches(arrays, rings, points, Sheets(dual.faces[kept], arrays.across, dual.kinds), joined)


def _completed(sheets: PolygonSheets) -> _Completed:
    """The mesh with faces (b, a, a', b') across borders a-b, and (a, a', a'', a') at a corner."""
    corners, following, across, kinds = sheets
    n, n_inner = len(kinds), len(corners)
    free = np.flatnonzero(across < 0)
    a, b = corners[free], corners[following[free]]
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
    added = np.concatenate([mirrored, corner_faces]).ravel()
    own = n_inner + np.arange(len(added))
    grown = np.concatenate([across, np.full(len(added), -1)])
    strips = n_inner + 4 * np.arange(len(free))
    turns = np.full(len(free), -1)
    turns[turning] = n_inner + 4 * (len(free) + np.arange(len(turning)))
    before = strips[incoming]
    beside = ((free, strips), (strips + 1, before + 3))
    at_corners = ((strips[turning] + 1, turns[turning] + 3), (before[turning] + 3, turns[turning]))
    for one, other in beside + at_corners:
        grown[one], grown[other] = other, one
    behind = np.concatenate([np.arange(n), a, a[turning], a[turning]])
    matrix = sparse.csr_array((np.ones(len(behind)), behind, np.arange(len(behind) + 1)), shape=(len(behind), n))
    around = np.concatenate([following, own - (own - n_inner) % 4 + (own - n_inner + 1) % 4])
    mesh = PolygonSheets(np.concatenate([corners, added]), around, grown, kinds[behind])
    return _Completed(mesh, matrix, n_inner, free, strips, turns)


def _dual(mesh: PolygonSheets) -> Sheets:
    """The quadrilateral (vertex, e, f, e') of every corner of the mesh."""
    corners, following, across, kinds = mesh
    own = np.arange(len(corners))
    previous = np.empty_like(following)
    previous[following] = own
    _, edge = np.unique(np.where(across < 0, own, np.minimum(own, across)), return_inverse=True)
    face = sparse.csgraph.connected_components(
        sparse.coo_array((np.ones(len(own), dtype=np.int8), (own, following)), shape=(len(own), len(own))),
        directed=False,
    )[1]
    edge, face = len(kinds) + edge, len(kinds) + int(edge.max()) + 1 + face
    faces = np.stack([corners, edge, face, edge[previous]], axis=1)
    inner, back = across >= 0, across[previous]
    sides = np.stack(
        [
            np.where(inner, 4 * following[across] + 3, -1),
            4 * following + 2,
            4 * previous + 1,
            np.where(back >= 0, 4 * back, -1),
        ],
        axis=1,
    )
    return Sheets(faces, sides, np.zeros(int(faces.max()) + 1, dtype=np.int64))


def _face_points(mesh: PolygonSheets) -> sparse.csr_array:
    """(H, W) the refined point of every corner of every face."""
    own, at = np.arange(len(mesh.corners)), np.arange(len(mesh.corners))
    ring = [own]
    sizes = np.zeros(len(own), dtype=np.int64)
    while (sizes == 0).any():
        at = mesh.following[at]
        sizes[(at == own) & (sizes == 0)] = len(ring)
        ring.append(at)
    return _ring_means(np.stack(ring, axis=1), sizes, mesh.corners, len(mesh.kinds))


def _ring_means(ring: Ints, sizes: Ints, columns: Ints, n: int) -> sparse.csr_array:
    """(m, n) refined points of the corners ring[i, 0] of faces with the corners ring[i, : sizes[i]]."""
    inside = np.arange(ring.shape[1]) < sizes[:, None]
    weights = np.zeros(ring.shape)
    for size in np.unique(sizes[sizes > 0]).tolist():
        weights[np.ix_(sizes == size, np.arange(size))] = corner_weights(size)[0]
    rows = np.broadcast_to(np.arange(len(ring))[:, None], ring.shape)
    return sparse.csr_array(
        sparse.coo_array((weights[inside], (rows[inside], columns[ring[inside]])), shape=(len(ring), n))
    )


def _refined_points(dual: Sheets) -> sparse.csr_array:
    """(4 Q, Q) the next points, one a corner of every quadrilateral; nothing where its faces do not close around it."""
    ring, sizes = _fans(dual.across, np.arange(dual.across.size))
    return _ring_means(ring, sizes, np.arange(len(dual.faces)), len(dual.faces))


def _fans(across: Ints, sides: Ints) -> tuple[Ints, Ints]:
    """(n, m) the quadrilaterals around the start of each side, its own first, and (n,) how many; 0 at a border."""
    flat = across.ravel()
    rows, at = [sides // 4], sides
    counts = np.zeros(len(sides), dtype=np.int64)
    walking = np.ones(len(sides), dtype=bool)
    while walking.any():
        back = flat[at - at % 4 + (at + 3) % 4]
        at = np.where(back < 0, at, back)
        closed = walking & (at == sides) & (back >= 0)
        counts[closed] = len(rows)
        walking &= (back >= 0) & ~closed & (len(rows) < MAX_SUPPORT)
        rows.append(at // 4)
    return np.stack(rows, axis=1), counts


def _irregular(dual: Sheets, kept: Ints) -> NDArray[np.bool_]:
    """(n, 4) whether the corners of the kept quadrilaterals have not four around them."""
    counts = np.bincount(dual.faces.ravel())
    few = counts[dual.faces[kept]] < 3
    if few.any():
        raise BadGeometry("control mesh", "a vertex inside the surface has under three faces: remove it")
    return np.asarray(counts[dual.faces[kept]] != 4)


def _sides(dual: Sheets, kept: Ints) -> Ints:
    """(n, 4) the sides across of the kept quadrilaterals, numbered among these; -1 where the others begin."""
    place = np.full(len(dual.faces), -1)
    place[kept] = np.arange(len(kept))
    old = dual.across[kept]
    new = place[old // 4]
    return np.where((old < 0) | (new < 0), -1, 4 * new + old % 4)


def _uncut(mesh: ControlMesh) -> Ints:
    """(H,) the sides across, creases or not."""
    return cut_polygons(ControlMesh(mesh.vertices, mesh.face_corners, mesh.face_starts))[0].across


def _across_creases(across: Ints, kept: Ints, whole: _Completed, sheets: PolygonSheets, uncut: Ints) -> Ints:
    """(n, 4) sides across the patches, those of creases, which are borders to both sides, joined."""
    joined = across.copy()
    place = np.full(len(whole.mesh.corners), -1)
    place[kept] = np.arange(len(kept))
    number = np.full(len(sheets.corners), -1)
    number[whole.free] = np.arange(len(whole.free))
    other = np.where(uncut[whole.free] >= 0, number[uncut[whole.free]], -1)
    mine = np.flatnonzero(other >= 0)
    its = other[mine]
    # a strip (b, a, a', b'): its patch at a ends along side 1, that at b along side 2; the one across runs backwards
    pairs = [(place[whole.strips[mine] + 1], 1, place[whole.strips[its]], 2)]
    leaving = np.full(len(sheets.kinds), -1)
    leaving[sheets.corners[whole.free]] = whole.turning
    corner = leaving[sheets.corners[whole.free[mine]]]
    opposite = leaving[sheets.corners[sheets.following[whole.free[its]]]]
    both = (corner >= 0) & (opposite >= 0)
    pairs.append((place[corner[both]], 2, place[opposite[both]], 1))
    for one, side, two, its_side in pairs:
        joined[one, side], joined[two, its_side] = 4 * two + its_side, 4 * one + side
    return joined


def _patches(dual: Sheets, kept: Ints) -> tuple[PatchArrays, Ints]:
    """Patches around the kept points, and (n, 9) the points of the grid around each, row by row.

    A point is the quadrilateral of the dual that its patch is; only corner 0 may be irregular.
    """
    across = dual.across.ravel()
    fan, counts = _fans(dual.across, 4 * kept)
    irregular = counts != 4
    if (counts == 0).any() or counts.max(initial=0) + 5 > MAX_SUPPORT:
        raise BadGeometry("control mesh", f"vertex with over {MAX_SUPPORT - 5} faces; a limit patch has no room for it")
    beyond = across[4 * kept[:, None] + np.arange(4)]
    beside = beyond // 4  # across each side
    diagonal = across[beyond - beyond % 4 + (beyond + 1) % 4] // 4  # opposite at each corner
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
    made = [face_table(int(n)) for n in valences]
    return PatchArrays(starts, support, tables, _sides(dual, kept), np.eye(9), *table_arrays(made)), ring


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

"""The limit surface of a control mesh: patches once refined, evaluated anywhere.

    control mesh --cut--> sheets --refine--> four patches a face --extend--> points that every patch depends on

Everything that depends on the connections alone is made once (`LimitPatches`); moving the control points costs one
sparse product. A place is (face, v, w): barycentric (1 - v - w, v, w) in a triangle, the unit square in a
quadrilateral.
"""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from recon.errors import BadGeometry
from recon.geometry.control_mesh import ControlMesh
from recon.geometry.mesh import TriangleMesh
from recon.subdivision.doo_sabin import doo_sabin_patches
from recon.subdivision.evaluation import MAX_SUPPORT, PatchArrays, points_at
from recon.subdivision.limit_tables import CATMULL_CLARK, LOOP, Rules, corner_table, table_arrays
from recon.subdivision.rings import MAX_RING, face_rings, fan_places
from recon.subdivision.sheets import Sheets, VertexKind, cut_along_creases

__all__ = [
    "LimitPatches",
    "Scheme",
    "TooCoarse",
    "limit_patches",
    "limit_points",
    "patch_arrays",
    "tessellate",
    "tessellation_places",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Scheme(StrEnum):
    """Whose surface a control mesh stands for."""

    LOOP = "loop"
    CATMULL_CLARK = "catmull-clark"
    DOO_SABIN = "doo-sabin"


class TooCoarse(BadGeometry):
    """A mesh of so few faces that those around neighbouring vertices are the same; once refined it is none."""


@dataclass(frozen=True, eq=False)
class LimitPatches:
    """What a limit surface owes to the connections of its control mesh.

    arrays  the patches: child i of control face f is patch 4 f + i, a triangle's middle one 4 f + 3; a Doo-Sabin
            surface that is open has further patches along its border, after these
    points  (R, V) sparse, control points -> the points that the patches depend on
    sheets  the patches as faces of a mesh: their corners, the sides across, the kinds of the corners
    """

    arrays: PatchArrays
    points: sparse.csr_array
    sheets: Sheets


def limit_patches(mesh: ControlMesh, scheme: Scheme = Scheme.LOOP) -> LimitPatches:
    """Patches of the limit surface: of triangles by Loop's scheme, of quadrilaterals by the other two.

    Raises  BadGeometry when a face has another number of corners or a vertex too many faces; NotManifold.
    """
    if scheme == Scheme.DOO_SABIN:
        dual = doo_sabin_patches(mesh)
        return LimitPatches(dual.arrays, dual.points, dual.sheets)
    sheets, behind = cut_along_creases(mesh, 3 if scheme == Scheme.LOOP else 4)
    copies = sparse.csr_array(
        (np.ones(len(behind)), behind, np.arange(len(behind) + 1)), shape=(len(behind), mesh.n_vertices)
    )
    rules = LOOP if scheme == Scheme.LOOP else CATMULL_CLARK
    step = rules.refine(sheets)
    whole = rules.extended(step.sheets)
    arrays = patch_arrays(rules, step.sheets, whole.sheets)
    return LimitPatches(arrays, sparse.csr_array(whole.matrix @ (step.matrix @ copies)), step.sheets)


def patch_arrays(rules: Rules, sheets: Sheets, whole: Sheets, chosen: Ints | None = None) -> PatchArrays:
    """Patches of all faces of a mesh, or of the chosen ones alone; corner 0 is the only one that may be irregular.

    whole   the mesh with what is reflected in its borders
    Raises  TooCoarse; BadGeometry when a vertex has too many faces.
    """
    faces, across, kinds = sheets
    n_faces = np.bincount(faces.ravel(), minlength=len(kinds))
    wanted = np.array(rules.regular_faces)
    asked = np.zeros(len(faces), dtype=bool)
    asked[slice(None) if chosen is None else chosen] = True
    is_irregular = (n_faces != wanted[kinds])[faces[:, 0]]
    irregular, regular = np.flatnonzero(asked & is_irregular), np.flatnonzero(asked & ~is_irregular)
    rings, lengths = face_rings(faces, across, irregular)
    if lengths.max(initial=0) > min(MAX_RING, MAX_SUPPORT):
        most = int(n_faces[faces[irregular, 0]].max())
        room = 60 if rules.n_corners == 3 else 35
        raise BadGeometry("control mesh", f"vertex with {most} faces; a limit patch has room for {room}")
    keys, number = _table_keys(sheets, irregular)
    made = [corner_table(rules, VertexKind(k), n, p) for k, n, p in keys.tolist()]
    if any(len(made[t].limit) != k for t, k in zip(number.tolist(), lengths.tolist())):
        raise TooCoarse("control mesh", "the faces around two neighbouring vertices are the same: refine it first")
    n_regular = rules.basis().shape[1]
    counts = np.zeros(len(faces), dtype=np.int64)
    counts[regular], counts[irregular] = n_regular, lengths
    starts = np.concatenate([[0], np.cumsum(counts)])
    support = np.empty(starts[-1], dtype=np.int64)
    support[starts[regular][:, None] + np.arange(n_regular)] = rules.regular_rings(whole, regular)
    filled = np.arange(rings.shape[1]) < lengths[:, None]
    support[(starts[irregular][:, None] + np.arange(rings.shape[1]))[filled]] = rings[filled]
    tables = np.full(len(faces), -1)
    tables[irregular] = number
    return PatchArrays(starts, support, tables, across, rules.basis(), *table_arrays(made))


def _table_keys(sheets: Sheets, irregular: Ints) -> tuple[Ints, Ints]:
    """(T, 3) kind of corner 0, faces around it, place among them, each once; (n,) the row of every irregular patch."""
    around, place = fan_places(sheets.across, irregular)
    keys = np.stack([sheets.kinds[sheets.faces[irregular, 0]], around, place], axis=1)
    found, number = np.unique(keys, axis=0, return_inverse=True)
    return found, number.ravel()


def limit_points(
    mesh: ControlMesh,
    places: tuple[Ints, Floats, Floats],
    *,
    scheme: Scheme = Scheme.LOOP,
    n_derivatives: int = 0,
    patches: LimitPatches | None = None,
) -> Floats:
    """Points, and first or second derivatives, of the limit surface at places on the control mesh.

    places         face (n,), v (n,), w (n,) on the control mesh
    n_derivatives  0, 1 or 2
    patches        the patches of the mesh where they are there already
    Returns        (n, 1, 3), (n, 3, 3) or (n, 6, 3): point | by v, by w | by vv, vw, ww
    Promises       exact to rounding. At a vertex that is not regular the first derivatives are the limit tangents up to
                   a common factor, and the second, which do not exist, are not numbers.
    """
    found = patches or limit_patches(mesh, scheme)
    face, v, w = (np.atleast_1d(np.asarray(x)) for x in places)
    in_child = _in_child if found.arrays.across.shape[1] == 3 else _in_quadrant
    patch, (a, c), jacobian = in_child(face.astype(np.int64), v.astype(np.float64), w.astype(np.float64))
    n_rows = (1, 3, 6)[n_derivatives]
    local = points_at(found.arrays, found.points @ mesh.vertices, patch, a, c, n_rows)
    if n_rows == 1:
        return local
    out = np.empty_like(local)
    out[:, 0] = local[:, 0]
    out[:, 1:3] = np.einsum("nij,nik->njk", jacobian, local[:, 1:3])
    if n_rows == 6:
        second = local[:, [3, 4, 4, 5]].reshape(-1, 2, 2, 3)
        turned = np.einsum("nia,nijk,njb->nabk", jacobian, second, jacobian)
        out[:, 3], out[:, 4], out[:, 5] = turned[:, 0, 0], turned[:, 0, 1], turned[:, 1, 1]
    return out


def _in_quadrant(face: Ints, v: Floats, w: Floats) -> tuple[Ints, tuple[Floats, Floats], Floats]:
    """As `_in_child`, for a quadrilateral: the child at corner i is turned i quarters."""
    right, upper = v > 0.5, w > 0.5
    corner = np.where(upper, np.where(right, 2, 3), right.astype(np.int64))
    from_v, from_w = 2.0 * np.where(right, 1.0 - v, v), 2.0 * np.where(upper, 1.0 - w, w)
    swapped = corner % 2 == 1
    a, c = np.where(swapped, from_w, from_v), np.where(swapped, from_v, from_w)
    along_v, along_w = np.where(right, -2.0, 2.0), np.where(upper, -2.0, 2.0)
    jacobian = np.zeros((len(face), 2, 2))
    jacobian[:, 0, 0], jacobian[:, 1, 1] = np.where(swapped, 0.0, along_v), np.where(swapped, 0.0, along_w)
    jacobian[:, 0, 1], jacobian[:, 1, 0] = np.where(swapped, along_w, 0.0), np.where(swapped, along_v, 0.0)
    return 4 * face + corner, (a, c), jacobian


def _in_child(face: Ints, v: Floats, w: Floats) -> tuple[Ints, tuple[Floats, Floats], Floats]:
    """The patch in which a place of a control face lies, its coordinates there, and their derivatives (n, 2, 2)."""
    bary = np.stack([1.0 - v - w, v, w], axis=1)
    slope = np.array([[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]])
    corner = bary.argmax(axis=1)
    outer = bary[np.arange(len(face)), corner] >= 0.5
    child = np.where(outer, corner, 3)
    first, second = (corner + 1) % 3, (corner + 2) % 3
    row = np.arange(len(face))
    a = np.where(outer, 2.0 * bary[row, first], 1.0 - 2.0 * bary[:, 0])
    c = np.where(outer, 2.0 * bary[row, second], 1.0 - 2.0 * bary[:, 1])
    jacobian = np.empty((len(face), 2, 2))
    jacobian[:, 0] = np.where(outer[:, None], 2.0 * slope[first], -2.0 * slope[0])
    jacobian[:, 1] = np.where(outer[:, None], 2.0 * slope[second], -2.0 * slope[1])
    return 4 * face + child, (a, c), jacobian


def tessellate(
    mesh: ControlMesh, *, scheme: Scheme = Scheme.LOOP, halvings: int = 2, patches: LimitPatches | None = None
) -> TriangleMesh:
    """The limit surface as triangles whose corners lie on it; each control face is halved `halvings` times, 1 or more.

    Vertices on creases come once for each side.
    """
    found = patches or limit_patches(mesh, scheme)
    face, v, w, triangles = tessellation_places(found.sheets, halvings - 1)
    points = points_at(found.arrays, found.points @ mesh.vertices, face, v, w, 1)[:, 0]
    return TriangleMesh(points, triangles, "limit surface")


def tessellation_places(sheets: Sheets, halvings: int) -> tuple[Ints, Floats, Floats, Ints]:
    """Places (patch, v, w), one a vertex, and (T, 3) triangles over them."""
    n, k = 1 << halvings, sheets.faces.shape[1]
    i, j = (x.ravel() for x in np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij"))
    inside = i + j <= n if k == 3 else i >= 0
    i, j = i[inside], j[inside]
    local = _grid_triangles(i, j, n, k)
    keys = _shared_keys(sheets, i, j, n)
    _, first, vertex = np.unique(keys, return_index=True, return_inverse=True)
    patch, place = np.divmod(first, len(i))
    triangles = vertex.reshape(len(sheets.faces), len(i))[:, local].reshape(-1, 3)
    return patch, i[place] / n, j[place] / n, triangles.astype(np.int64)


def _grid_triangles(i: Ints, j: Ints, n: int, k: int) -> Ints:
    number = np.full((n + 1, n + 1), -1)
    number[i, j] = np.arange(len(i))
    cells = [(a, b, a + b < n - 1 or k == 4) for a in range(n) for b in range(n) if a + b < n or k == 4]
    up = [(number[a, b], number[a + 1, b], number[a, b + 1]) for a, b, _ in cells]
    down = [(number[a + 1, b], number[a + 1, b + 1], number[a, b + 1]) for a, b, whole in cells if whole]
    return np.array(up + down, dtype=np.int64)


def _shared_keys(sheets: Sheets, i: Ints, j: Ints, n: int) -> Ints:
    """(C, m) the same number for the same place of neighbouring patches: by vertex, by edge and share, by patch.

    i, j  (m,) place on the grid of n steps
    """
    n_patches, n_vertices, k = len(sheets.faces), len(sheets.kinds), sheets.faces.shape[1]
    after_edges = n_vertices + sheets.across.size * (n + 1)
    keys = after_edges + np.arange(n_patches * len(i)).reshape(n_patches, -1)
    own = np.arange(sheets.across.size).reshape(sheets.across.shape)
    # which places lie on each side, and how far along it they are
    triangle = ((j == 0, i), (i + j == n, j), (i == 0, n - j))
    square = ((j == 0, i), (i == n, j), (j == n, n - i), (i == 0, n - j))
    for side, (on, share) in enumerate(triangle if k == 3 else square):
        other = sheets.across[:, side]
        low = np.where(other < 0, own[:, side], np.minimum(own[:, side], other))
        along = np.where((low == own[:, side])[:, None], share[on], n - share[on])
        keys[:, on] = n_vertices + low[:, None] * (n + 1) + along
    for side, (on, share) in enumerate(triangle if k == 3 else square):
        keys[:, on & (share == 0)] = sheets.faces[:, side, None]
    return keys

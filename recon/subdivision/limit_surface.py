"""The limit surface of a control mesh: patches once refined, evaluated anywhere.

    control mesh --cut--> sheets --refine--> four patches a face --extend--> points that every patch depends on

Everything that depends on the connections alone is made once (`LimitPatches`); moving the control points costs one
sparse product.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from recon.errors import BadGeometry
from recon.geometry.control_mesh import ControlMesh
from recon.geometry.mesh import TriangleMesh
from recon.subdivision.evaluation import MAX_SUPPORT, PatchArrays, points_at
from recon.subdivision.limit_tables import corner_table, regular_table
from recon.subdivision.loop import REGULAR_FACES, extended, refine, regular_rings
from recon.subdivision.rings import MAX_RING, face_rings, fan_places
from recon.subdivision.sheets import Sheets, VertexKind, cut_along_creases

__all__ = ["LimitPatches", "limit_patches", "limit_points", "tessellate", "tessellation_places"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class LimitPatches:
    """What a limit surface owes to the connections of its control mesh.

    arrays    the patches: child i of control face f is patch 4 f + i, the middle one 4 f + 3
    points    (R, V) sparse, control points -> the points that the patches depend on
    sheets    the refined mesh, one face a patch
    refined   (W', V) sparse, control points -> points of the refined mesh
    """

    arrays: PatchArrays
    points: sparse.csr_array
    sheets: Sheets
    refined: sparse.csr_array


def limit_patches(mesh: ControlMesh) -> LimitPatches:
    """Patches of the Loop surface of a triangle control mesh.

    Raises  BadGeometry when a face is no triangle or a vertex has too many faces; NotManifold.
    """
    sheets, behind = cut_along_creases(mesh, 3)
    step = refine(sheets)
    copies = sparse.csr_array(
        (np.ones(len(behind)), behind, np.arange(len(behind) + 1)), shape=(len(behind), mesh.n_vertices)
    )
    refined = sparse.csr_array(step.matrix @ copies)
    whole = extended(step.sheets)
    arrays = _patch_arrays(step.sheets, whole.sheets)
    return LimitPatches(arrays, sparse.csr_array(whole.matrix @ refined), step.sheets, refined)


def _patch_arrays(sheets: Sheets, whole: Sheets) -> PatchArrays:
    faces, across, kinds = sheets
    n_faces = np.bincount(faces.ravel(), minlength=len(kinds))
    wanted = np.array([REGULAR_FACES.get(VertexKind(k), 0) for k in range(len(VertexKind))])
    irregular = np.flatnonzero((n_faces != wanted[kinds])[faces[:, 0]])
    regular = np.setdiff1d(np.arange(len(faces)), irregular, assume_unique=True)
    rings, lengths = face_rings(faces, across, irregular)
    if lengths.max(initial=0) > min(MAX_RING, MAX_SUPPORT):
        raise BadGeometry("control mesh", f"vertex with {int(n_faces.max())} faces; a limit patch has room for 60")
    counts = np.full(len(faces), 12)
    counts[irregular] = lengths
    starts = np.concatenate([[0], np.cumsum(counts)])
    support = np.empty(starts[-1], dtype=np.int64)
    support[starts[regular][:, None] + np.arange(12)] = regular_rings(whole, regular)
    filled = np.arange(rings.shape[1]) < lengths[:, None]
    support[(starts[irregular][:, None] + np.arange(rings.shape[1]))[filled]] = rings[filled]
    tables, table_starts, weights = _tables(sheets, irregular)
    return PatchArrays(starts, support, tables, across, regular_table(), table_starts, weights)


def _tables(sheets: Sheets, irregular: Ints) -> tuple[Ints, Ints, Floats]:
    """(C,) table of every patch, -1 where regular; where each table begins; all tables in one row."""
    around, place = fan_places(sheets.across, irregular)
    keys = np.stack([sheets.kinds[sheets.faces[irregular, 0]], around, place], axis=1)
    found, number = np.unique(keys, axis=0, return_inverse=True)
    tables = np.full(len(sheets.faces), -1)
    tables[irregular] = number.ravel()
    rows = [np.concatenate([part.ravel() for part in corner_table(VertexKind(k), n, p)]) for k, n, p in found.tolist()]
    sizes = [len(row) for row in rows]
    starts = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
    return tables, starts[:-1], np.concatenate(rows) if rows else np.empty(0)


def limit_points(
    mesh: ControlMesh,
    places: tuple[Ints, Floats, Floats],
    *,
    n_derivatives: int = 0,
    patches: LimitPatches | None = None,
) -> Floats:
    """Points, and first or second derivatives, of the limit surface at places on the control mesh.

    places         face (n,), v (n,), w (n,): barycentric coordinates (1 - v - w, v, w) in the control face
    n_derivatives  0, 1 or 2
    patches        the patches of the mesh where they are there already
    Returns        (n, 1, 3), (n, 3, 3) or (n, 6, 3): point | by v, by w | by vv, vw, ww
    Promises       exact to rounding. At a vertex that is not regular the first derivatives are the limit tangents up to
                   a common factor, and the second, which do not exist, are not numbers.
    """
    found = patches or limit_patches(mesh)
    face, v, w = (np.atleast_1d(np.asarray(x)) for x in places)
    patch, (a, c), jacobian = _in_child(face.astype(np.int64), v.astype(np.float64), w.astype(np.float64))
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


def tessellate(mesh: ControlMesh, *, halvings: int = 2, patches: LimitPatches | None = None) -> TriangleMesh:
    """The limit surface as triangles whose corners lie on it, each control face cut into 4^halvings; halvings >= 1.

    Vertices on creases come once for each side.
    """
    found = patches or limit_patches(mesh)
    face, v, w, triangles = tessellation_places(found.sheets, halvings - 1)
    points = points_at(found.arrays, found.points @ mesh.vertices, face, v, w, 1)[:, 0]
    return TriangleMesh(points, triangles, "limit surface")


def tessellation_places(sheets: Sheets, halvings: int) -> tuple[Ints, Floats, Floats, Ints]:
    """Places (patch, v, w), one a vertex, and (T, 3) triangles over them."""
    n = 1 << halvings
    i, j = (x.ravel() for x in np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij"))
    inside = i + j <= n
    i, j = i[inside], j[inside]
    number = np.full((n + 1, n + 1), -1)
    number[i, j] = np.arange(len(i))
    up = [(number[a, b], number[a + 1, b], number[a, b + 1]) for a in range(n) for b in range(n - a)]
    down = [(number[a + 1, b], number[a + 1, b + 1], number[a, b + 1]) for a in range(n) for b in range(n - 1 - a)]
    local = np.array(up + down, dtype=np.int64)
    keys = _shared_keys(sheets, np.stack([n - i - j, i, j], axis=1), n)
    _, first, vertex = np.unique(keys, return_index=True, return_inverse=True)
    patch, place = np.divmod(first, len(i))
    triangles = vertex.reshape(len(sheets.faces), len(i))[:, local].reshape(-1, 3)
    return patch, i[place] / n, j[place] / n, triangles.astype(np.int64)


def _shared_keys(sheets: Sheets, bary: Ints, n: int) -> Ints:
    """(C, m) the same number for the same place of neighbouring patches: by vertex, by edge and share, by patch."""
    n_patches, n_vertices = sheets.faces.shape[0], len(sheets.kinds)
    after_edges = n_vertices + sheets.across.size * (n + 1)
    keys = after_edges + np.arange(n_patches * len(bary)).reshape(n_patches, -1)
    own = np.arange(sheets.across.size).reshape(sheets.across.shape)
    for side in range(3):
        on = bary[:, (side + 2) % 3] == 0
        share = bary[on, (side + 1) % 3]
        other = sheets.across[:, side]
        low = np.where(other < 0, own[:, side], np.minimum(own[:, side], other))
        along = np.where((low == own[:, side])[:, None], share, n - share)
        keys[:, on] = n_vertices + low[:, None] * (n + 1) + along
    for corner in range(3):
        keys[:, bary[:, corner] == n] = sheets.faces[:, corner, None]
    return keys

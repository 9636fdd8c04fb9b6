"""The surface of a grid parted into patches: each on one sheet, or on none.

    members of a sheet -> vertices around them that it bears, ring by ring -> triangles -> patches, one a run of
    triangles of one sheet; crumbs go to their neighbours, and no patch touches itself at a vertex alone

What lies on no sheet is free: it stays triangles.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from recon.voxel_mesh.settled_surfaces import Ends
from recon.voxel_mesh.sheets import DEEP, Sheet

__all__ = ["FREE", "Patches", "sheet_patches"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

FREE = -1
RINGS = 400  # of growth, at most
CRUMB, ISLE = 12, 60  # triangles of a patch on a sheet, or of a free one among sheets, that are too few
STRIP_FIRST = 1.0  # voxels by which a rounding, which knows its ends, goes before the planes that it touches
PASSES = 12


@dataclass(frozen=True, eq=False)
class Patches:
    """sheet (F,) of every triangle, FREE without; patch (F,) its patch; owner (P,) the sheet of every patch."""

    sheet: Ints
    patch: Ints
    owner: Ints


def sheet_patches(
    faces: Ints, twin: Ints, sheets: Sequence[Sheet], ends: Ends, *, freed: Bools | None = None
) -> Patches:
    """Patches of a grid's surface, whose triangles are faces (F, 3) with opposite halfedges twin (3F,).

    freed  (V,) vertices that no sheet may have
    """
    freed = np.zeros(len(ends.solid), dtype=bool) if freed is None else freed
    label = _grown(faces, sheets, ends, freed)
    sheet = _of_triangles(label[faces])
    for number in range(PASSES):
        before = sheet.copy()
        sheet = _smoothed(sheet, twin) if number < PASSES // 2 else sheet  # crumbs may go to and fro for ever
        sheet = _without_crumbs(sheet, twin)
        sheet = _without_isles(sheet, faces, twin, sheets, (ends, freed))
        sheet = _without_pinches(sheet, faces, twin)
        if (sheet == before).all():
            break
    patch = _numbered(sheet, twin)
    owner = np.full(int(patch.max()) + 1, FREE)
    owner[patch] = sheet
    return Patches(sheet, patch, owner)


def _grown(faces: Ints, sheets: Sequence[Sheet], ends: Ends, freed: Bools) -> Ints:
    """(V,) sheet of every vertex: ring by ring from its members to the vertices that it bears."""
    n = len(ends.solid)
    rows = np.arange(n)
    bears = np.array([sheet.bears(ends, rows) for sheet in sheets], dtype=bool).reshape(-1, n) & ~freed
    middle = 0.5 * (ends.solid + ends.empty)
    away = np.array([np.abs(s.surface.distance(middle)) - STRIP_FIRST * bool(s.touches) for s in sheets]).reshape(-1, n)
    label, best = np.full(n, FREE), np.full(n, np.inf)
    for k, sheet in enumerate(sheets):
        own = sheet.members[bears[k, sheet.members] & (away[k, sheet.members] < best[sheet.members])]
        label[own], best[own] = k, away[k, own]
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()  # closed: every edge runs both ways
    for _ in range(RINGS):
        front = (label[start] == FREE) & (label[end] != FREE)
        front[front] = bears[label[end[front]], start[front]]
        if not front.any():
            break
        v, k = start[front], label[end[front]]
        order = np.lexsort((k, -away[k, v], v))  # of each vertex the nearest sheet comes last
        label[v[order]] = k[order]
    return label


def _of_triangles(label: Ints) -> Ints:
    """Sheet of every triangle from those of its corners (F, 3): the one that two have, FREE where a corner is."""
    a, b, c = label.T
    two = np.where((a == b) | (a == c), a, np.where(b == c, b, label.min(axis=1)))
    return np.where((label == FREE).any(axis=1), FREE, two)


def _smoothed(sheet: Ints, twin: Ints) -> Ints:
    """Triangles with two neighbours of one other sheet go to it; free ones stay free."""
    for _ in range(3):
        a, b, c = sheet[twin.reshape(-1, 3) // 3].T
        other = np.where((a == b) | (a == c), a, np.where(b == c, b, sheet))
        sheet = np.where(sheet == FREE, sheet, other)
    return sheet


def _numbered(sheet: Ints, twin: Ints) -> Ints:
    """(F,) number of the run of triangles of one sheet that each belongs to."""
    h = np.flatnonzero(sheet[np.arange(len(twin)) // 3] == sheet[twin // 3])
    n = len(sheet)
    graph = sparse.coo_array((np.ones(len(h), dtype=np.int8), (h // 3, twin[h] // 3)), shape=(n, n))
    return csgraph.connected_components(graph, directed=False)[1].astype(np.int64)


def _without_crumbs(sheet: Ints, twin: Ints) -> Ints:
    """Small patches on a sheet given to the neighbour with which they share most sides."""
    patch = _numbered(sheet, twin)
    here, there = np.arange(len(twin)) // 3, twin // 3
    small = (np.bincount(patch) < CRUMB) & (np.bincount(patch, sheet != FREE) > 0.0)
    h = np.flatnonzero(small[patch[here]] & (patch[here] != patch[there]))
    pairs, sides = np.unique(np.column_stack([patch[here[h]], sheet[there[h]]]), axis=0, return_counts=True)
    order = np.argsort(sides, kind="stable")  # of each patch the neighbour with most sides comes last
    goes = np.full(len(small), FREE)
    goes[pairs[order, 0]] = pairs[order, 1]
    return np.where(small[patch], goes[patch], sheet)


def _without_isles(sheet: Ints, faces: Ints, twin: Ints, sheets: Sequence[Sheet], vertices: tuple[Ends, Bools]) -> Ints:
    """Small free patches given, triangle by triangle, to the nearest of the sheets around them, where every vertex has
    one among these that stabs its grid edge.

    vertices  their grid edges, and which are freed: patches with one of these stay
    """
    ends, freed = vertices
    patch = _numbered(sheet, twin)
    small = (np.bincount(patch) < ISLE)[patch] & (sheet == FREE)
    sheet = sheet.copy()
    all_sides = np.arange(len(twin))
    h = all_sides[small[all_sides // 3] & (sheet[twin // 3] != FREE)]
    for number in np.unique(patch[small]).tolist():
        around = np.unique(sheet[twin[h[patch[h // 3] == number]] // 3]).tolist()
        rows = np.flatnonzero(patch == number)
        corners = faces[rows]
        if not around or freed[corners].any():
            continue
        missed = np.array([sheets[k].depth(ends, corners.ravel()) for k in around])
        if missed.min(axis=0).max() <= DEEP:
            x = 0.5 * (ends.solid + ends.empty)[corners.ravel()]
            away = [np.abs(sheets[k].surface.distance(x)).reshape(-1, 3).max(axis=1) for k in around]
            sheet[rows] = np.array(around)[np.argmin(away, axis=0)]
    return sheet


def _without_pinches(sheet: Ints, faces: Ints, twin: Ints) -> Ints:
    """Where a patch meets itself at a vertex alone, the triangles around are made free, or of one sheet."""
    for _ in range(PASSES):
        patch = _numbered(sheet, twin)
        border = np.flatnonzero(patch[np.arange(len(twin)) // 3] != patch[twin // 3])
        start = faces.ravel()[border]
        pairs = np.unique(np.column_stack([start, patch[border // 3]]), axis=0)
        n = int(faces.max()) + 1
        pinched = np.bincount(start, minlength=n) > np.bincount(pairs[:, 0], minlength=n)
        if not pinched.any():
            break
        sheet = sheet.copy()
        rows = np.flatnonzero(pinched[faces].any(axis=1))
        for v in np.flatnonzero(pinched).tolist():
            around = rows[(faces[rows] == v).any(axis=1)]
            values, counts = np.unique(sheet[around], return_counts=True)
            sheet[around] = FREE if values[0] == FREE else values[counts.argmax()]
    return sheet

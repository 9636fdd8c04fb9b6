"""Weights of limit patches: regular ones as polynomials, irregular ones as nested rows of regular ones.

A refined face whose corner 0 is irregular is three regular patches and a smaller copy of itself, again and again:

         2                 level 0: the three faces away from corner 0, each a regular patch over the ring;
        /2\\      3-2-2     level k: the same three of the k-th copy; corner 0 itself is the limit.
       o---o     |3|2|
      / \\3/1\\    o-o-o     A    (K, K) ring of a face -> ring of its copy, one refinement
     0---o---1   | |1|     B_s  (R, K) ring of the face -> the R points of sub-face s
                 0-o-1     M    (B, R) R points -> points of the patch's basis;   weights at level k: M B_s A^k

All powers tend to the same row l, the limit position of corner 0. It is kept apart: T_k,s = M B_s (A - 1 l)^k, weights
= l + T. So the tables lose no digits however small the copies get, and derivatives come from T alone.

All weights come from the scheme's own masks: the tables hold no constant of their own.

Paper  [stam1998], the nested patches; [lai1992], Bezier points of the regular patch.
"""

from collections.abc import Callable
from functools import cache, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from recon.numerics.halfedges import opposite_sides
from recon.subdivision import catmull_clark, loop
from recon.subdivision.rings import face_rings
from recon.subdivision.sheets import Refinement, Sheets, VertexKind

__all__ = [
    "BEZIER_INDICES",
    "CATMULL_CLARK",
    "LOOP",
    "N_LEVELS",
    "CornerTable",
    "Rules",
    "corner_table",
    "nested_levels",
    "quartic_bernstein",
    "regular_table",
    "table_arrays",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

N_LEVELS = 60  # halvings until a patch is smaller than rounding, at a valence of 20 too
DEGREE = 4
BEZIER_INDICES = np.array([(DEGREE - j - k, j, k) for k in range(DEGREE + 1) for j in range(DEGREE + 1 - k)])


class CornerTable(NamedTuple):
    """Weights of a patch over its ring of K points.

    limit     (K,) position of corner 0 in the limit
    tangents  (2, K) derivatives there toward corners 1 and 2, up to one common scale
    levels    (N_LEVELS, 3, B, K) points of the nested patches' basis, less the limit position
    """

    limit: Floats
    tangents: Floats
    levels: Floats


def quartic_bernstein(v: Floats, w: Floats) -> Floats:
    """(n, 15) quartic Bernstein polynomials at barycentric coordinates (1 - v - w, v, w), in BEZIER_INDICES order."""
    u = 1.0 - v - w
    factorial = np.array([1, 1, 2, 6, 24])
    i, j, k = BEZIER_INDICES.T
    count = factorial[DEGREE] / (factorial[i] * factorial[j] * factorial[k])
    return count * u[:, None] ** i * v[:, None] ** j * w[:, None] ** k


@cache
def regular_table() -> Floats:
    """(15, 12) Bezier points of a regular patch over its ring, as `regular_rings` orders it.

    Two refinements reach the 15 points of the patch where its barycentric coordinates are quarters; the limit mask
    (1/2 and six times 1/12) and the Bernstein basis do the rest. The weights are whole multiples of 1/24.
    """
    sheets = loop.refine(loop.refine(_fan(3, 6, VertexKind.SMOOTH)).sheets).sheets
    face = 0  # corner 0 at the middle of the fan: all three corners regular, and two rings inside
    ring = loop.regular_rings(sheets, np.array([face]))[0]
    to_patch = np.zeros((len(sheets.kinds), 12))
    to_patch[ring, np.arange(12)] = 1.0
    places = {}
    faces_at: dict[tuple[float, ...], int] = {(0.0, 0.0, 1.0, 0.0, 0.0, 1.0): face}
    for _ in range(2):
        step = loop.refine(sheets)
        to_patch, sheets = step.matrix @ to_patch, step.sheets
        faces_at = {c: 4 * f + i for parent, f in faces_at.items() for i, c in enumerate(_children(parent))}
    for corners, f in faces_at.items():
        for i in range(3):
            places[corners[2 * i], corners[2 * i + 1]] = int(sheets.faces[f, i])
    neighbours = {at: _neighbours(sheets, vertex) for at, vertex in places.items()}
    points = {at: 0.5 * to_patch[v] + to_patch[neighbours[at]].sum(axis=0) / 12.0 for at, v in places.items()}
    v, w = np.array(list(points)).T
    bezier = np.linalg.solve(quartic_bernstein(v, w), np.array(list(points.values())))
    return np.round(24.0 * bezier) / 24.0


def _children(corners: tuple[float, ...]) -> list[tuple[float, ...]]:
    """Parameter triangles (v, w of three corners) of the four children of a face, in the order of `refine`."""
    p = np.array(corners).reshape(3, 2)
    e = (p + np.roll(p, -1, axis=0)) / 2.0
    triangles = [(p[0], e[0], e[2]), (p[1], e[1], e[0]), (p[2], e[2], e[1]), tuple(e)]
    return [tuple(float(x) for x in np.concatenate(t)) for t in triangles]


def _neighbours(sheets: Sheets, vertex: int) -> Ints:
    rows, columns = np.nonzero(sheets.faces == vertex)
    return np.unique(np.concatenate([sheets.faces[rows, (columns + 1) % 3], sheets.faces[rows, (columns + 2) % 3]]))


class Rules(NamedTuple):
    """A scheme whose points sit at the vertices of its mesh.

    regular_faces  faces around a vertex of a regular mesh, by its kind; 0 where it never is regular
    regular_rings  (n, R) the points of regular patches
    sub_rings      (3, R) the points of the three patches away from corner 0 of a refined face, children 1 to 3
    basis          (B, R) points of the polynomial basis over the R points of a regular patch
    """

    n_corners: int
    regular_faces: tuple[int, int, int, int]
    refine: Callable[[Sheets], Refinement]
    extended: Callable[[Sheets], Refinement]
    regular_rings: Callable[[Sheets, Ints], Ints]
    sub_rings: Callable[[Sheets, int], Ints]
    basis: Callable[[], Floats]


def _triangle_subs(sheets: Sheets, first: int) -> Ints:
    return loop.regular_rings(sheets, first + np.arange(1, 4))


def _square_subs(sheets: Sheets, first: int) -> Ints:
    """The rings of children 1 to 3, each turned back so that its rows run as those of child 0."""
    rings = catmull_clark.regular_rings(sheets, first + np.arange(1, 4)).reshape(3, 4, 4)
    return np.stack([np.rot90(ring, -turns).ravel() for turns, ring in enumerate(rings, start=1)])


LOOP = Rules(3, loop.REGULAR_FACES, loop.refine, loop.extended, loop.regular_rings, _triangle_subs, regular_table)
CATMULL_CLARK = Rules(
    4,
    catmull_clark.REGULAR_FACES,
    catmull_clark.refine,
    catmull_clark.extended,
    catmull_clark.regular_rings,
    _square_subs,
    partial(np.eye, 16),
)


def _fan(k: int, n_faces: int, kind: VertexKind) -> Sheets:
    """One vertex with its faces of k corners, closed around it where it is smooth."""
    i = np.arange(n_faces)
    step = k - 2
    n_ring = step * n_faces + (kind != VertexKind.SMOOTH)
    faces = np.concatenate(
        [np.zeros((n_faces, 1), dtype=np.int64), 1 + (step * i[:, None] + np.arange(k - 1)) % n_ring], 1
    )
    kinds = np.full(1 + n_ring, int(VertexKind.BORDER))
    kinds[0] = kind
    return Sheets(faces, opposite_sides(faces), kinds)


@cache
def corner_table(rules: Rules, kind: VertexKind, n_faces: int, place: int) -> CornerTable:
    """Weights of a refined face by its corner 0: its kind, the faces around it, and the face's place in the fan."""
    fan = _fan(rules.n_corners, n_faces, kind)
    coarse = rules.refine(rules.refine(fan).sheets).sheets
    step = rules.refine(coarse)
    face = 16 * place
    old = _ring(coarse, face)
    new = _ring(step.sheets, 4 * face)
    shrink = step.matrix[new][:, old].toarray()
    whole = rules.extended(step.sheets)
    to_points = whole.matrix @ step.matrix
    rings = rules.sub_rings(whole.sheets, 4 * face)
    outer = np.stack([rules.basis() @ to_points[ring][:, old].toarray() for ring in rings])
    limit = np.linalg.matrix_power(shrink, 1 << 9)[0]
    limit /= limit.sum()
    tangents = _tangents(shrink, kind, (rules.n_corners, n_faces, place))
    return CornerTable(limit, tangents, nested_levels(shrink, limit, outer))


def table_arrays(tables: list[CornerTable]) -> tuple[Ints, Floats]:
    """(T,) where each table begins, and all tables in one row: limit, tangents, levels."""
    rows = [np.concatenate([part.ravel() for part in table]) for table in tables]
    starts = np.concatenate([[0], np.cumsum([len(row) for row in rows])]).astype(np.int64)
    return starts[:-1], np.concatenate(rows) if rows else np.empty(0)


def nested_levels(shrink: Floats, limit: Floats, outer: Floats) -> Floats:
    """(N_LEVELS, 3, B, K) outer (3, B, K) times the powers of the deflated matrix A - 1 l."""
    deflated = shrink - limit
    levels = np.empty((N_LEVELS, *outer.shape))
    power = np.eye(len(shrink)) - limit
    for k in range(N_LEVELS):
        levels[k] = outer @ power
        power = deflated @ power
    return levels


def _ring(sheets: Sheets, face: int) -> Ints:
    rings, lengths = face_rings(sheets.faces, sheets.across, np.array([face]))
    return rings[0, : lengths[0]]


def _tangents(shrink: Floats, kind: VertexKind, where: tuple[int, int, int]) -> Floats:
    """(2, K) how the patch's first and last corner lie in the plane that the two largest eigenvalues below one leave.

    where  corners a face, faces around corner 0, and the face's place among them
    """
    n_corners, n_faces, place = where
    size, step = len(shrink), n_corners - 2
    copy = step * n_faces + 1
    merge = np.eye(size)
    if kind == VertexKind.DART:
        # the two copies of the crease neighbour are one point: a way for them to differ is no tangent
        merge = np.delete(merge, copy, axis=1)
        merge[copy, 1] = 1.0
    keep = [i for i in range(size) if kind != VertexKind.DART or i != copy]
    small = shrink[keep] @ merge
    values, right = np.linalg.eig(small)
    left = np.linalg.inv(right)
    order = np.argsort(-np.abs(values))[1:3]
    plane = (right[:, order] @ left[order]).real
    first = 1 + step * place if kind != VertexKind.SMOOTH else 1
    expanded = np.zeros((2, size))
    rows = [merge[i].argmax() for i in (first, first + step)]
    expanded[:, keep] = plane[rows]
    return expanded

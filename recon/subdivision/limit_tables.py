"""Weights of limit patches: regular ones as quartic Bezier triangles, irregular ones as nested rows of regular ones.

A refined face whose corner 0 is irregular is three regular patches and a smaller copy of itself, again and again:

         2                 level 0: the three faces away from corner 0, each a quartic Bezier triangle over the ring;
        /2\\                level k: the same three of the k-th copy; corner 0 itself is the limit.
       o---o
      / \\3/1\\              A    (K, K) ring of a face -> ring of its copy, one refinement
     0---o---1             B_s  (12, K) ring of the face -> the twelve points of sub-face s
                           M    (15, 12) twelve points -> Bezier points;   weights at level k: M B_s A^k

All powers tend to the same row l, the limit position of corner 0. It is kept apart: T_k,s = M B_s (A - 1 l)^k, weights
= l + T. So the tables lose no digits however small the copies get, and derivatives come from T alone.

All weights come from the scheme's own masks: the tables hold no constant of their own.

Paper  [stam1998], the nested patches; [lai1992], Bezier points of the regular patch.
"""

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from recon.numerics.halfedges import opposite_sides
from recon.subdivision.loop import extended, refine, regular_rings
from recon.subdivision.rings import face_rings
from recon.subdivision.sheets import Sheets, VertexKind

__all__ = ["BEZIER_INDICES", "N_LEVELS", "CornerTable", "corner_table", "quartic_bernstein", "regular_table"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

N_LEVELS = 60  # halvings until a patch is smaller than rounding, at a valence of 20 too
DEGREE = 4
BEZIER_INDICES = np.array([(DEGREE - j - k, j, k) for k in range(DEGREE + 1) for j in range(DEGREE + 1 - k)])


class CornerTable(NamedTuple):
    """Weights of a patch over its ring of K points.

    limit     (K,) position of corner 0 in the limit
    tangents  (2, K) derivatives there toward corners 1 and 2, up to one common scale
    levels    (N_LEVELS, 3, 15, K) Bezier points of the nested patches, less the limit position
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
    sheets = refine(refine(_fan(6, VertexKind.SMOOTH)).sheets).sheets
    face = 0  # corner 0 at the middle of the fan: all three corners regular, and two rings inside
    ring = regular_rings(sheets, np.array([face]))[0]
    to_patch = np.zeros((len(sheets.kinds), 12))
    to_patch[ring, np.arange(12)] = 1.0
    places = {}
    faces_at: dict[tuple[float, ...], int] = {(0.0, 0.0, 1.0, 0.0, 0.0, 1.0): face}
    for _ in range(2):
        step = refine(sheets)
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


def _fan(n_faces: int, kind: VertexKind) -> Sheets:
    """One vertex with its faces, closed around it where it is smooth."""
    i = np.arange(n_faces)
    n_ring = n_faces + (kind != VertexKind.SMOOTH)
    faces = np.stack([np.zeros_like(i), 1 + i, 1 + (i + 1) % n_ring], axis=1)
    kinds = np.full(1 + n_ring, int(VertexKind.BORDER))
    kinds[0] = kind
    return Sheets(faces, opposite_sides(faces), kinds)


@cache
def corner_table(kind: VertexKind, n_faces: int, place: int) -> CornerTable:
    """Weights of a refined face by its corner 0: its kind, the faces around it, and the face's place in the fan."""
    fan = _fan(n_faces, kind)
    coarse = refine(refine(fan).sheets).sheets
    step = refine(coarse)
    face = 16 * place
    old = _ring(coarse, face)
    new = _ring(step.sheets, 4 * face)
    shrink = step.matrix[new][:, old].toarray()
    whole = extended(step.sheets)
    to_points = whole.matrix @ step.matrix
    outer = regular_rings(whole.sheets, 4 * face + np.arange(1, 4))
    bezier = np.stack([regular_table() @ to_points[ring][:, old].toarray() for ring in outer])
    limit = np.linalg.matrix_power(shrink, 1 << 9)[0]
    limit /= limit.sum()
    deflated = shrink - limit
    levels = np.empty((N_LEVELS, 3, 15, len(old)))
    power = np.eye(len(old)) - limit
    for k in range(N_LEVELS):
        levels[k] = bezier @ power
        power = deflated @ power
    return CornerTable(limit, _tangents(shrink, kind, n_faces, place), levels)


def _ring(sheets: Sheets, face: int) -> Ints:
    rings, lengths = face_rings(sheets.faces, sheets.across, np.array([face]))
    return rings[0, : lengths[0]]


def _tangents(shrink: Floats, kind: VertexKind, n_faces: int, place: int) -> Floats:
    """(2, K) how corners 1 and 2 lie in the plane that the two largest eigenvalues below one leave in the limit."""
    size = len(shrink)
    merge = np.eye(size)
    if kind == VertexKind.DART:
        # the two copies of the crease neighbour are one point: a way for them to differ is no tangent
        merge = np.delete(merge, n_faces + 1, axis=1)
        merge[n_faces + 1, 1] = 1.0
    keep = [i for i in range(size) if kind != VertexKind.DART or i != n_faces + 1]
    small = shrink[keep] @ merge
    values, right = np.linalg.eig(small)
    left = np.linalg.inv(right)
    order = np.argsort(-np.abs(values))[1:3]
    plane = (right[:, order] @ left[order]).real
    first, second = (1 + place, 2 + place) if kind != VertexKind.SMOOTH else (1, 2)
    expanded = np.zeros((2, size))
    rows = [merge[i].argmax() for i in (first, second)]
    expanded[:, keep] = plane[rows]
    return expanded

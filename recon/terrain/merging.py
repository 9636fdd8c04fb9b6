"""Step 3, merging: pairs of triangles become quads, and every patch knows its sides.

    sleeve, junction                    quad
    3 = 2  o  collapsed                 3 o-----o 2        side 0 (v = 0) and side 2 (v = 1) may be contour edges,
          / \\                            |     |          sides 1 and 3 are straight in plan: so the plan map is ruled
       3 /   \\ 1                         |     |
        /     \\                        0 o-----o 1            X(u, v) = (1 - v) a(u) + v b(u)
     0 o-------o 1

A patch folds where its plan map turns over. The map's Jacobian is linear in v, so it is positive everywhere when two
polynomials in u are, and those are where their Bernstein coefficients are.

Paper  [zhang2006], section 4.1; quads may here also have one contour side, or none.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.geometry.patches import COLLAPSED
from recon.numerics.bernstein import bernstein_product, reparametrization
from recon.terrain.tiling import Tiling

__all__ = ["Folds", "PatchLayout", "is_folded", "merged_layout", "plan_sides", "ruled_folds", "triangle_layout"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SHARPEST = 0.98  # largest cosine of a corner of a quad: 11 degrees
LONGEST_PATH = 8  # chosen quads that are given up for one more at most
HALVINGS = 2  # of the parameter range before a sign that the coefficients leave open is taken for a fold
MARGIN = 0.02  # of the largest coefficient: what counts as positive


@dataclass(frozen=True, eq=False)
class PatchLayout:
    """Corners and sides of all patches, as drawn above.

    corners       (P, 4) vertices at (u, v) = (0, 0), (1, 0), (1, 1), (0, 1)
    side_edges    (P, 4) edge of the tiling on every side, COLLAPSED on the side of a triangle that is one point
    side_forward  (P, 4) whether the edge runs in the side's direction: 0 to 1, 1 to 2, 3 to 2, 0 to 3
    face          (P,) triangle of the tiling that the patch covers, or one of the two
    """

    corners: Ints
    side_edges: Ints
    side_forward: NDArray[np.bool_]
    face: Ints

    @property
    def is_triangle(self) -> NDArray[np.bool_]:
        return self.side_edges[:, 2] == COLLAPSED

    def part(self, rows: NDArray[Any]) -> "PatchLayout":
        """Some of the patches, chosen by number or by a mask."""
        return PatchLayout(self.corners[rows], self.side_edges[rows], self.side_forward[rows], self.face[rows])


def triangle_layout(tiling: Tiling) -> PatchLayout:
    """Every triangle as a patch: side 0 is its contour edge, if it has one, else its shortest."""
    ends = tiling.points[tiling.edges]
    length = np.where(tiling.is_contour, -1.0, np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1))
    turn = np.argmin(length[tiling.side_edges], axis=1)[:, None]
    a, b, c = np.take_along_axis(tiling.triangles, (turn + np.arange(3)) % 3, axis=1).T
    ab, bc, ca = np.take_along_axis(tiling.side_edges, (turn + np.arange(3)) % 3, axis=1).T
    collapsed = np.full(len(a), COLLAPSED)
    sides = np.column_stack([ab, bc, collapsed, ca])
    return _layout(tiling, np.column_stack([a, b, c, c]), sides, np.arange(len(tiling.triangles)))


def _layout(tiling: Tiling, corners: Ints, side_edges: Ints, face: Ints) -> PatchLayout:
    begin = corners[:, [0, 1, 3, 0]]
    return PatchLayout(corners, side_edges, (tiling.edges[side_edges, 0] == begin) | (side_edges == COLLAPSED), face)


def merged_layout(tiling: Tiling, folds: "Folds") -> PatchLayout:
    """Triangles and quads: pairs with two opposite contour sides first, then those nearest to rectangles.

    folds     tells which patches' plan maps fold
    Promises  no quad folds; no quad has two contour sides that touch.
    """
    quads, faces, score = _candidates(tiling, folds)
    chosen, taken = _paired(faces, np.argsort(score, kind="stable"), len(tiling.triangles))
    rest = triangle_layout(tiling)
    pair = (quads.part(chosen), rest.part(~taken))
    return PatchLayout(
        np.vstack([part.corners for part in pair]),
        np.vstack([part.side_edges for part in pair]),
        np.vstack([part.side_forward for part in pair]),
        np.concatenate([part.face for part in pair]),
    )


def _paired(faces: Ints, order: Ints, n: int) -> tuple[Ints, NDArray[np.bool_]]:
    """Quads chosen, the first in order first, and (n,) whether a triangle is in one.

    Two triangles left over at the ends of a path of three candidates, its middle a chosen quad, are both taken in by
    giving that quad up for the outer two; so are those at the ends of longer paths.
    """
    pairs = faces.tolist()
    mate = [-1] * n  # candidate that holds a triangle
    for q in order.tolist():
        left, right = pairs[q]
        if mate[left] < 0 and mate[right] < 0:
            mate[left] = mate[right] = q
    around: list[list[int]] = [[] for _ in range(n)]
    for q in order.tolist():
        for face in pairs[q]:
            around[face].append(q)
    for face in range(n):
        if mate[face] < 0:
            _augmented(face, pairs, around, mate)
    held = np.array(mate)
    return np.unique(held[held >= 0]), held >= 0


def _augmented(face: int, pairs: list[list[int]], around: list[list[int]], mate: list[int]) -> None:
    """Pair the triangle by the shortest alternating path to another one that is left over, if a short one exists."""
    came: dict[int, tuple[int, int]] = {face: (-1, -1)}  # triangle at an even step -> candidate taken to it, from where
    front = [face]
    for _ in range(LONGEST_PATH):
        ahead = []
        for here in front:
            for q in around[here]:
                other = pairs[q][0] + pairs[q][1] - here
                if mate[other] < 0 and other != face:
                    _flip(here, q, came, pairs, mate)
                    return
                if mate[other] < 0 or mate[other] == q:
                    continue
                far = pairs[mate[other]][0] + pairs[mate[other]][1] - other
                if far not in came and other not in came:
                    came[far] = (q, here)
                    ahead.append(far)
        front = ahead


def _flip(here: int, q: int, came: dict[int, tuple[int, int]], pairs: list[list[int]], mate: list[int]) -> None:
    while True:
        for face in pairs[q]:
            mate[face] = q
        q, here = came[here]
        if q < 0:
            return


def _candidates(tiling: Tiling, folds: "Folds") -> tuple[PatchLayout, Ints, Floats]:
    """Quads that could be made, the (n, 2) triangles each takes, and a score, the lower the better."""
    edge = np.flatnonzero((tiling.edge_faces >= 0).all(axis=1) & ~tiling.is_contour)
    left, right = tiling.edge_faces[edge].T
    at = np.argmax(tiling.side_edges[left] == edge[:, None], axis=1)
    to = np.argmax(tiling.side_edges[right] == edge[:, None], axis=1)
    rows = np.arange(len(edge))
    i, j, k = (tiling.triangles[left, (at + s) % 3] for s in range(3))
    lone = tiling.triangles[right, (to + 2) % 3]
    corners = np.column_stack([i, lone, j, k])
    sides = np.column_stack([
        tiling.side_edges[right, (to + 1) % 3], tiling.side_edges[right, (to + 2) % 3],
        tiling.side_edges[left, (at + 1) % 3], tiling.side_edges[left, (at + 2) % 3],
    ])  # fmt: skip
    contour = tiling.is_contour[sides]
    allowed = ~((contour[:, 0] | contour[:, 2]) & (contour[:, 1] | contour[:, 3]))
    turn = np.where(contour[:, 1] | contour[:, 3], 1, 0)[:, None]
    corners = corners[rows[:, None], (np.arange(4) + turn) % 4]
    sides = sides[rows[:, None], (np.arange(4) + turn) % 4]
    bent = _corner_cosines(tiling.points[corners])
    allowed &= bent.max(axis=1) < SHARPEST
    bent = bent[allowed]
    quads = _layout(tiling, corners[allowed], sides[allowed], left[allowed])
    sound = ~folds(tiling, quads)
    quads = quads.part(sound)
    opposite = tiling.is_contour[quads.side_edges].sum(axis=1) == 2
    return quads, np.column_stack([left, right])[allowed][sound], bent[sound].sum(axis=1) - 8.0 * opposite


def _corner_cosines(points: Floats) -> Floats:
    """(n, 4) sizes of the cosines at the corners of quads (n, 4, 2); 2 where a corner is not convex."""
    before, after = np.roll(points, 1, axis=1) - points, np.roll(points, -1, axis=1) - points
    scale = np.maximum(np.linalg.norm(before, axis=2) * np.linalg.norm(after, axis=2), 1e-300)
    sine = (after[..., 0] * before[..., 1] - after[..., 1] * before[..., 0]) / scale
    return np.where(sine > 0, np.abs(np.einsum("nkd,nkd->nk", before, after)) / scale, 2.0)


def plan_sides(tiling: Tiling, layout: PatchLayout) -> tuple[Floats, Floats]:
    """(P, 4, 2) control points in plan of the sides v = 0 and v = 1: contours, straight lines, or a point."""
    return _plan_side(tiling, layout, 0, (0, 1)), _plan_side(tiling, layout, 2, (3, 2))


def _plan_side(tiling: Tiling, layout: PatchLayout, side: int, ends: tuple[int, int]) -> Floats:
    a, b = tiling.points[layout.corners[:, ends[0]]], tiling.points[layout.corners[:, ends[1]]]
    net = a[:, None] + np.linspace(0, 1, 4)[:, None] * (b - a)[:, None]
    segment = np.where(layout.side_edges[:, side] == COLLAPSED, -1, tiling.edge_segment[layout.side_edges[:, side]])
    curved = segment >= 0
    bezier = tiling.curves.bezier[segment[curved]]
    net[curved] = np.where(layout.side_forward[curved, side][:, None, None], bezier, bezier[:, ::-1])
    return net


Folds = Callable[[Tiling, PatchLayout], NDArray[np.bool_]]  # (P,) which patches' plan maps fold


def ruled_folds(tiling: Tiling, layout: PatchLayout) -> NDArray[np.bool_]:
    """(P,) of patches with the ruled plan map."""
    return is_folded(*plan_sides(tiling, layout), layout.is_triangle)


def is_folded(bottom: Floats, top: Floats, triangle: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(P,) whether a plan map cannot be shown to be one-to-one: its Jacobian is not proved positive.

    bottom, top  (P, 4, 2) plan control points of the sides v = 0 and v = 1
    triangle     (P,) whether the top is one point, where the Jacobian may vanish
    """
    across = top - bottom
    first = _cross_product(3 * np.diff(bottom, axis=1), across)
    second = np.where(triangle[:, None], 1.0, _cross_product(3 * np.diff(top, axis=1), across))
    return ~(_is_positive(first) & _is_positive(second))


def _cross_product(quadratic: Floats, cubic: Floats) -> Floats:
    """(P, 6) Bernstein coefficients of the cross product of two plane polynomials."""
    turned = np.stack([cubic[..., 1], -cubic[..., 0]], axis=1)
    return np.asarray((quadratic @ turned).reshape(-1, 12) @ bernstein_product(2, 3).reshape(6, 12).T)


def _is_positive(coefficients: Floats) -> NDArray[np.bool_]:
    least = MARGIN * np.abs(coefficients).max(axis=1)
    found = np.asarray(coefficients.min(axis=1) > least)
    open_rows = np.flatnonzero(~found)  # coefficients of the halves lie between those of the whole
    pieces = coefficients[open_rows, None]
    low, high = reparametrization(5, 0.0, 0.5), reparametrization(5, 0.5, 1.0)
    for _ in range(HALVINGS):
        pieces = np.concatenate([pieces @ low.T, pieces @ high.T], axis=1)
    found[open_rows] = (pieces > least[open_rows, None, None]).all(axis=(1, 2))
    return found

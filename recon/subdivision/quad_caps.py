"""Caps of quadrilaterals: one bi-quintic Bezier patch a quad around an irregular vertex.

            spoke 2                 patch i lies between spokes i and i + 1; u runs along spoke i, v along spoke i + 1
      .-------o-------.             P_i(u, 0) = C_i(u)      P_i(0, v) = C_{i+1}(v)
      |  P_2  |  P_1  |
      |       |       |             outer sides u = 1 and v = 1: position and cross derivative of the bicubic beyond,
      o-------x-------o spoke 1     so the poles (a, b) with a >= 4 or b >= 4 are given. Along a smooth spoke
      |  P_3  |  P_0  |
      |       |       |             d/du P_{i-1}(0, t) + d/dv P_i(t, 0) = 2 cos(theta) (1 - t)^2 C_i'(t)
      '-------o-------'
            spoke 0                 theta: 2 pi / n around a vertex, pi / n at a border

At a corner theta is the angle between its borders over n, and as these start with tangents of different lengths, each
spoke's r times as long as the one before, the condition is

    (1 + (r - 1) (1 - t)^2) d/du P_{i-1} + (1 + (1/r - 1) (1 - t)^2) d/dv P_i = 2 cos(theta) (1 - t)^2 C_i'

Poles are numbered 36 i + 6 a + b.

Paper  [loop2004], G1 patches over irregular vertices; [peters1991], the condition along a spoke.
"""

from functools import lru_cache
from math import comb

import numpy as np
from numpy.typing import NDArray

from recon.numerics.bernstein import bernstein, degree_elevation
from recon.subdivision.caps import (
    BEZIER,
    Caps,
    CapTable,
    Places,
    Turn,
    caps_of,
    corner_turn,
    fans,
    finished_table,
    probed,
)
from recon.subdivision.evaluation import PatchArrays
from recon.subdivision.quintic_splines import DEGREE
from recon.subdivision.sheets import Sheets, VertexKind

__all__ = ["cap_nets"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SAMPLES = 8
QUINTIC = {size: degree_elevation(size - 1, DEGREE) @ points for size, points in BEZIER.items()}


def cap_nets(sheets: Sheets, arrays: PatchArrays, rings: Ints, points: Floats, irregular: Ints) -> Caps:
    """Caps of all irregular faces.

    arrays, points  what the limit surface is evaluated with: a patch a face
    rings           (M, 16) or, of a bi-quadratic surface, (M, 9) points of the grid around each irregular face, row by
                    row; entry 0 is not used
    irregular       (M,) those faces; corner 0 is the irregular one
    """
    place = np.full(len(sheets.faces), -1)
    place[irregular] = np.arange(len(irregular))
    vertices, first = np.unique(sheets.faces[irregular, 0], return_index=True)
    around = fans(sheets, 4 * irregular[first])
    size = round(rings.shape[1] ** 0.5)
    grids = points[rings].reshape(-1, size, size, 3).transpose(0, 2, 1, 3)  # [i along u, j along v]
    outer = np.einsum("ai,bj,mijx->mabx", QUINTIC[size], QUINTIC[size], grids)
    groups: dict[Turn, list[Ints]] = {}
    for vertex, fan in zip(vertices.tolist(), around):
        turn, rows = Turn(VertexKind(sheets.kinds[vertex]), len(fan)), place[fan]
        _border_curves(turn.kind, grids[rows], outer, rows)
        if turn.kind == VertexKind.CORNER:
            apex, inner = outer[rows[0], 0, 0], outer[rows, 5, 5]
            borders = outer[rows[0], 1, 0] - apex, outer[rows[-1], 0, 1] - apex
            turn = corner_turn(len(fan), borders, inner.mean(axis=0) - apex)
        groups.setdefault(turn, []).append(rows)
    return caps_of(groups, (cap_table, _places()), outer, (arrays, points, irregular))


def _border_curves(kind: VertexKind, grids: Floats, outer: Floats, rows: Ints) -> None:
    """Write the first and last spoke, where they are border, into the poles: cubics that the border alone decides."""
    if kind in (VertexKind.SMOOTH, VertexKind.DART):
        return
    first, last = grids[0][:, 1].copy(), grids[-1][1, :].copy()  # rows (before, vertex, next, after next)
    centre = first[1].copy()
    if kind == VertexKind.CORNER:
        first[0], last[0] = 2 * centre - first[2], 2 * centre - last[2]
    else:
        first[0], last[0] = last[2].copy(), first[2].copy()
    outer[rows[0], :, 0], outer[rows[-1], 0, :] = QUINTIC[4] @ first, QUINTIC[4] @ last


@lru_cache(maxsize=1024)
def cap_table(turn: Turn) -> CapTable:
    """The table of a vertex."""
    n = turn.n_faces
    numbers = _numbers(n, turn.is_closed)
    size = int(numbers.max()) + 1
    given = np.zeros((n, 6, 6), dtype=bool)
    given[:, 4:, :] = given[:, :, 4:] = True
    if not turn.is_closed:
        given[0, :, 0] = given[n - 1, 0, :] = True
    rows = [_spoke_rows(turn, i, numbers, size) for i in turn.inner_spokes]
    return finished_table(np.concatenate([np.zeros((0, size)), *rows]), _places(), numbers, given)


def _numbers(n: int, closed: bool) -> Ints:
    """(36 n,) the number of every pole, the same where two patches share it."""
    poles = np.arange(36 * n).reshape(n, 6, 6)
    for i in range(n if closed else n - 1):
        poles[(i + 1) % n, :, 0] = poles[i, 0, :]
    return np.unique(poles.ravel(), return_inverse=True)[1]


def _places() -> Places:
    """Samples on a grid, none on the outer sides, which are given."""
    samples = np.indices((SAMPLES, SAMPLES)).reshape(2, -1) / SAMPLES
    return Places(_surface_basis, samples, probed(samples + 0.5 / SAMPLES))


def _surface_basis(u: Floats, v: Floats) -> Floats:
    return np.einsum("ka,kb->kab", bernstein(DEGREE, u), bernstein(DEGREE, v)).reshape(len(u), 36)


def _spoke_rows(turn: Turn, i: int, numbers: Ints, size: int) -> Floats:
    """(6, size) the condition along spoke i, of degree seven; its last two coefficients hold by what is given."""
    n, ratio = turn.n_faces, turn.ratio
    before, after = 36 * ((i - 1) % n), 36 * i
    rows = np.zeros((8, 36 * n))
    for k in range(6):
        for m, (one, two) in enumerate(((ratio, 1.0 / ratio), (1.0, 1.0), (1.0, 1.0))):
            share = 5.0 * comb(5, k) * comb(2, m) / comb(7, k + m)
            rows[k + m, before + 6 + k] += one * share
            rows[k + m, before + k] -= one * share
            rows[k + m, after + 6 * k + 1] += two * share
            rows[k + m, after + 6 * k] -= two * share
    for k in range(5):
        for m, part in enumerate((1.0, 1.0 / 3.0)):  # (1 - t)^2 as a cubic
            share = 5.0 * 2.0 * np.cos(turn.theta) * part * comb(4, k) * comb(3, m) / comb(7, k + m)
            rows[k + m, after + 6 * (k + 1)] -= share
            rows[k + m, after + 6 * k] += share
    folded = np.zeros((8, size))
    np.add.at(folded.T, numbers, rows.T)
    return folded[:6]

"""Caps: one bi-quintic Bezier patch a quad around an irregular vertex, tangent planes alike across all sides.

            spoke 2                 patch i lies between spokes i and i + 1; u runs along spoke i, v along spoke i + 1
      .-------o-------.             P_i(u, 0) = C_i(u)      P_i(0, v) = C_{i+1}(v)
      |  P_2  |  P_1  |
      |       |       |             outer sides u = 1 and v = 1: position and cross derivative of the bicubic beyond,
      o-------x-------o spoke 1     so the poles (a, b) with a >= 4 or b >= 4 are given. Along a smooth spoke
      |  P_3  |  P_0  |
      |       |       |             d/du P_{i-1}(0, t) + d/dv P_i(t, 0) = 2 cos(theta) (1 - t)^2 C_i'(t)
      '-------o-------'
            spoke 0                 theta: 2 pi / n around a vertex, pi / n at a border, and at a corner the angle

The other poles are the constrained least-squares fit to points of the limit surface; a few rounds replace each point by
its projection on the surface's normal, so that the patches lie on the surface and not on its parametrisation. The
matrices depend on the kind of vertex and the number of its faces alone: one table each, kept.

K  quads around the vertex · poles are numbered 36 i + 6 a + b, equal ones once · samples (SAMPLES^2) a patch

Paper  [loop2004], G1 patches over irregular vertices; [peters1991], the condition along a spoke.
"""

from functools import cache
from math import comb
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from recon.subdivision.evaluation import PatchArrays, points_at
from recon.subdivision.sheets import Sheets, VertexKind

__all__ = ["Caps", "cap_nets", "fans"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

DEGREE = 5
SAMPLES = 8
ROUNDS = 4
ANGLE_STEPS = 24  # a corner's angle is rounded to so many parts of a half turn
CURVES = 6.0  # weight of samples on the spokes


class CapTable(NamedTuple):
    """What the poles around one vertex owe to what is given and to the samples.

    from_known    (U, K') unknown poles over the given ones
    from_samples  (U, S) and over the samples
    spread        (36 K, U + K') all poles over the unknown and then the given ones
    known         (K',) a pole 36 i + 6 a + b for each given one
    basis         (S, 36 K) samples over all poles
    """

    from_known: Floats
    from_samples: Floats
    spread: Floats
    known: Ints
    basis: Floats


class Caps(NamedTuple):
    """faces (M,) and nets (M, 6, 6, 3) of the bi-quintic patches; off (M,) largest distance found to the limit."""

    faces: Ints
    nets: Floats
    off: Floats


def sample_places() -> tuple[Floats, Floats]:
    """(S,) u and v of the samples of one patch; none on the outer sides, which are given."""
    t = np.arange(SAMPLES) / SAMPLES
    u, v = np.meshgrid(t, t, indexing="ij")
    return u.ravel(), v.ravel()


def bernstein(degree: int, t: Floats) -> Floats:
    """(n, degree + 1) Bernstein polynomials."""
    i = np.arange(degree + 1)
    count = np.array([comb(degree, k) for k in i])
    return count * t[:, None] ** i * (1.0 - t[:, None]) ** (degree - i)


def _surface_basis(u: Floats, v: Floats) -> Floats:
    return np.einsum("ka,kb->kab", bernstein(DEGREE, u), bernstein(DEGREE, v)).reshape(len(u), 36)


def _numbers(n: int, closed: bool) -> Ints:
    """(36 n,) the number of every pole, the same where two patches share it."""
    poles = np.arange(36 * n).reshape(n, 6, 6)
    for i in range(n if closed else n - 1):
        poles[(i + 1) % n, :, 0] = poles[i, 0, :]
    return np.unique(poles.ravel(), return_inverse=True)[1]


@cache
def cap_table(kind: VertexKind, n: int, angle: int) -> CapTable:
    """The table of a vertex with n quads; angle, in parts of a half turn, matters at a corner only."""
    closed = kind in (VertexKind.SMOOTH, VertexKind.DART)
    numbers = _numbers(n, closed)
    size = int(numbers.max()) + 1
    given = np.zeros((n, 6, 6), dtype=bool)
    given[:, 4:, :] = given[:, :, 4:] = True
    if not closed:
        given[0, :, 0] = given[n - 1, 0, :] = True
    is_known = np.zeros(size, dtype=bool)
    is_known[numbers[given.ravel()]] = True
    theta = {VertexKind.SMOOTH: 2 * np.pi / n, VertexKind.DART: 2 * np.pi / n, VertexKind.BORDER: np.pi / n}.get(
        kind, np.pi * angle / ANGLE_STEPS / n
    )
    spokes = range(n) if kind == VertexKind.SMOOTH else range(1, n)
    rows = np.concatenate([_spoke_rows(n, i, theta, numbers, size) for i in spokes]) if n > 1 or closed else None
    constraints = np.zeros((0, size)) if rows is None else rows
    u, v = sample_places()
    one = _surface_basis(u, v)
    all_poles = np.zeros((36 * n, size))
    all_poles[np.arange(36 * n), numbers] = 1.0
    basis = np.zeros((n * len(u), 36 * n))
    for i in range(n):
        basis[i * len(u) : (i + 1) * len(u), 36 * i : 36 * i + 36] = one
    weights = np.tile(np.where(u * v == 0.0, np.sqrt(CURVES), 1.0), n)
    from_known, from_samples = _solved(constraints, weights[:, None] * (basis @ all_poles), is_known)
    unknown, known = np.flatnonzero(~is_known), np.flatnonzero(is_known)
    first = np.full(size, 36 * n)
    np.minimum.at(first, numbers[given.ravel()], np.flatnonzero(given.ravel()))
    spread = all_poles[:, np.concatenate([unknown, known])]
    return CapTable(from_known, from_samples * weights, spread, first[known], basis)


def _solved(constraints: Floats, samples: Floats, is_known: NDArray[np.bool_]) -> tuple[Floats, Floats]:
    """Least squares under constraints, as matrices on the given poles and on the (weighted) samples."""
    a_free, a_given = constraints[:, ~is_known], constraints[:, is_known]
    s_free, s_given = samples[:, ~is_known], samples[:, is_known]
    n_free = a_free.shape[1]
    if len(constraints):
        _, sizes, rows = np.linalg.svd(a_free)
        rank = int((sizes > 1e-10 * sizes[0]).sum())
        ways = rows[rank:].T
        particular = -np.linalg.pinv(a_free, rcond=1e-10) @ a_given
    else:
        ways, particular = np.eye(n_free), np.zeros((n_free, a_given.shape[1]))
    fit = ways @ np.linalg.pinv(s_free @ ways, rcond=1e-12)
    return particular - fit @ (s_given + s_free @ particular), fit


def _spoke_rows(n: int, i: int, theta: float, numbers: Ints, size: int) -> Floats:
    """(5, size) the condition along spoke i; its last two coefficients hold by what is given."""
    before, after = (i - 1) % n, i
    rows = np.zeros((7, 36 * n))

    def at(patch: int, a: int, b: int) -> int:
        return 36 * patch + 6 * a + b

    for k in range(6):
        for m, share in ((k, (6 - k) / 6.0), (k + 1, (k + 1) / 6.0)):  # degree five as degree six
            rows[m, at(before, 1, k)] += 5.0 * share
            rows[m, at(before, 0, k)] -= 5.0 * share
            rows[m, at(after, k, 1)] += 5.0 * share
            rows[m, at(after, k, 0)] -= 5.0 * share
    for k in range(5):
        share = 5.0 * 2.0 * np.cos(theta) * comb(4, k) / comb(6, k)
        rows[k, at(after, k + 1, 0)] -= share
        rows[k, at(after, k, 0)] += share
    folded = np.zeros((7, size))
    np.add.at(folded.T, numbers, rows.T)
    return folded[:5]


def fans(sheets: Sheets, corners: Ints) -> list[Ints]:
    """The faces around the start of each side, counter-clockwise, from the border where there is one."""
    across = sheets.across.ravel()
    found = []
    for side in corners.tolist():
        first = side
        while across[first] >= 0:  # clockwise to the border, or all around
            other = int(across[first])
            first = other - other % 4 + (other + 1) % 4
            if first == side:
                break
        row, at = [], first
        while True:
            row.append(at // 4)
            back = int(across[at - at % 4 + (at + 3) % 4])
            if back < 0 or back == first:
                break
            at = back
        found.append(np.array(row))
    return found


ELEVATED = np.array(
    [[1, 0, 0, 0], [0.4, 0.6, 0, 0], [0.1, 0.6, 0.3, 0], [0, 0.3, 0.6, 0.1], [0, 0, 0.6, 0.4], [0, 0, 0, 1]]
)  # a cubic's Bezier points as those of degree five
TO_BEZIER = np.array([[1, 4, 1, 0], [0, 4, 2, 0], [0, 2, 4, 0], [0, 1, 4, 1]]) / 6.0  # of a uniform B-spline's span
QUINTIC = ELEVATED @ TO_BEZIER


def cap_nets(sheets: Sheets, arrays: PatchArrays, rings: Ints, points: Floats, irregular: Ints) -> Caps:
    """Caps of all irregular faces.

    arrays, points  what the limit surface is evaluated with: a patch a face
    rings           (M, 16) points of the grid around each irregular face; entry 0 is not used
    irregular       (M,) those faces; corner 0 is the irregular one
    """
    place = np.full(len(sheets.faces), -1)
    place[irregular] = np.arange(len(irregular))
    vertices, first = np.unique(sheets.faces[irregular, 0], return_index=True)
    around = fans(sheets, 4 * irregular[first])
    grids = points[rings].reshape(-1, 4, 4, 3).transpose(0, 2, 1, 3)  # [i along u, j along v]
    outer = np.einsum("ai,bj,mijx->mabx", QUINTIC, QUINTIC, grids)
    groups: dict[tuple[VertexKind, int, int], list[Ints]] = {}
    for vertex, fan in zip(vertices.tolist(), around):
        kind = VertexKind(sheets.kinds[vertex])
        rows = place[fan]
        _border_curves(kind, grids[rows], outer, rows)
        angle = _corner_angle(outer[rows], kind)
        groups.setdefault((kind, len(fan), angle), []).append(rows)
    nets, off = np.empty((len(irregular), 6, 6, 3)), np.zeros(len(irregular))
    for (kind, n, angle), clusters in groups.items():
        rows = np.array(clusters)
        nets[rows.ravel()], off[rows.ravel()] = _solved_fans(
            cap_table(kind, n, angle), outer[rows], (arrays, points, irregular[rows])
        )
    return Caps(irregular, nets, off)


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
    outer[rows[0], :, 0], outer[rows[-1], 0, :] = QUINTIC @ first, QUINTIC @ last


def _corner_angle(poles: Floats, kind: VertexKind) -> int:
    """The angle at a corner between its borders, through the surface, in parts of a half turn; 0 elsewhere."""
    if kind != VertexKind.CORNER or len(poles) == 1:
        return 0
    apex = poles[0, 0, 0]
    one, two = poles[0, 1, 0] - apex, poles[-1, 0, 1] - apex
    # a direction into the fan: the far corners of its quads
    inward = poles[:, 5, 5].mean(axis=0) - apex
    cosine = one @ two / max(np.linalg.norm(one) * np.linalg.norm(two), 1e-300)
    angle = float(np.arccos(np.clip(cosine, -1.0, 1.0)))
    middle = one / np.linalg.norm(one) + two / np.linalg.norm(two)
    if middle @ inward < 0.0:
        angle = 2 * np.pi - angle
    parts = round(angle / np.pi * ANGLE_STEPS)
    straight = parts % ANGLE_STEPS == 0
    return int(np.clip(parts - 1 if straight and parts else parts, 1, 2 * ANGLE_STEPS - 1))


def _solved_fans(table: CapTable, outer: Floats, surface: tuple[PatchArrays, Floats, Ints]) -> tuple[Floats, Floats]:
    """(M n, 6, 6, 3) poles of M fans of n patches and (M n,) largest distance of a sample from the surface."""
    arrays, points, faces = surface
    m, n = faces.shape
    known = outer.reshape(m, n * 36, 3)[:, table.known]
    u, v = sample_places()
    patch = np.repeat(faces.ravel(), len(u))
    place = np.tile(u, m * n), np.tile(v, m * n)
    limit = points_at(arrays, points, patch, *place, 3).reshape(m, n * len(u), 3, 3)
    target = limit[:, :, 0]
    for _ in range(ROUNDS):
        free = np.einsum("uk,mkx->mux", table.from_known, known) + np.einsum("us,msx->mux", table.from_samples, target)
        poles = np.einsum("pa,max->mpx", table.spread, np.concatenate([free, known], axis=1))
        drawn = np.einsum("sp,mpx->msx", table.basis, poles)
        target, place, limit = _projected(arrays, points, patch, place, limit, drawn)
    distance = np.linalg.norm(target - drawn, axis=2).reshape(m * n, len(u)).max(axis=1)
    return poles.reshape(m * n, 6, 6, 3), distance


def _projected(
    arrays: PatchArrays, points: Floats, patch: Ints, place: tuple[Floats, Floats], limit: Floats, drawn: Floats
) -> tuple[Floats, tuple[Floats, Floats], Floats]:
    """The points of the limit surface's tangent planes under the drawn ones; the places nearer to their feet."""
    flat = limit.reshape(-1, 3, 3)
    away = drawn.reshape(-1, 3) - flat[:, 0]
    a, b = flat[:, 1], flat[:, 2]
    aa, ab, bb = (np.einsum("kx,kx->k", p, q) for p, q in ((a, a), (a, b), (b, b)))
    ga, gb = np.einsum("kx,kx->k", a, away), np.einsum("kx,kx->k", b, away)
    det = aa * bb - ab * ab
    safe = np.where(det > 1e-12 * aa * bb, det, np.inf)
    step = np.stack([(bb * ga - ab * gb) / safe, (aa * gb - ab * ga) / safe])
    size = np.abs(step).max(axis=0)
    step *= np.where(size > 0.2, 0.2 / np.where(size > 0, size, 1.0), 1.0)
    moving = (place[0] > 0) | (place[1] > 0)  # the vertex itself stays
    u = np.clip(place[0] + moving * step[0], 0.0, 1.0)
    v = np.clip(place[1] + moving * step[1], 0.0, 1.0)
    at = points_at(arrays, points, patch, u, v, 3)
    normal = np.cross(at[:, 1], at[:, 2])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = normal / np.where(length > 0, length, 1.0)
    off = np.einsum("kx,kx->k", at[:, 0] - drawn.reshape(-1, 3), normal)
    target = drawn + (off[:, None] * normal).reshape(drawn.shape)
    return target, (u, v), at.reshape(limit.shape)

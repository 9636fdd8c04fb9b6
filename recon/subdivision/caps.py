"""Caps around irregular vertices: patches that are near the limit surface and whose tangent planes agree.

Around a vertex lie n patches between spokes, the curves C_i along the edges that leave it. Poles along the outer sides
are given by the polynomials beyond; conditions, linear in the poles, make tangent planes agree along the spokes. The
other poles are the constrained least-squares fit to points of the limit surface. Its matrices depend on how the spokes
turn around the vertex alone: one table a turn, kept, made in a hundredth of a second. The fit follows the surface's
parametrisation, which no patch can; so rounds of Gauss-Newton steps then lower the distance along the surface's normals
alone, by moves that leave the conditions as they are (columns of `ways`), with a little damping of moves along the
surface:

    sum of (n_s . (S_s - L_s))^2 + DAMPING^2 |moves|^2,   L_s the foot of sample s, n_s the normal there

At last the patches are probed between the samples, and near the vertex: how far they are off, and whether one folds.

N  poles a patch, K patches around the vertex; equal poles have one number · S samples and T probes a patch

Paper  [loop2004], G1 patches over irregular vertices; [peters1991], the condition along a spoke.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from recon.subdivision.evaluation import PatchArrays, points_at
from recon.subdivision.sheets import Sheets, VertexKind

__all__ = [
    "BEZIER",
    "CapTable",
    "Caps",
    "Places",
    "Turn",
    "caps_of",
    "corner_turn",
    "fans",
    "finished_table",
    "probed",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

ROUNDS = 3
STEPS = 2  # toward the feet of the samples, a round
DAMPING = 0.03
AT_ONCE = 48  # vertices, which bounds the memory
STRAIGHT = 1e-4  # radians from a half turn up to which the borders of a corner are taken for one line
NEAR = 0.15  # of the patch around the vertex is probed again
STEP = 1e-4  # of the parameters, for derivatives of probes by differences
CURVES = 6.0  # weight of samples on the spokes

# Bezier points over the control points of a uniform B-spline's span, by the number of these
BEZIER = {
    3: np.array([[1, 1, 0], [0, 2, 0], [0, 1, 1]]) / 2.0,
    4: np.array([[1, 4, 1, 0], [0, 4, 2, 0], [0, 2, 4, 0], [0, 1, 4, 1]]) / 6.0,
}


class CapTable(NamedTuple):
    """What the poles around one vertex owe to what is given and to the samples.

    from_known    (U, K') unknown poles over the given ones
    from_samples  (U, S K) and over the samples
    ways          (U, q) moves of the unknown poles that no condition feels
    spread        (N K, U + K') all poles over the unknown and then the given ones
    known         (K',) a pole among all for each given one
    basis         (S K, N K) samples over all poles
    probes        (3, T K, N K) probes over all poles, and their derivatives
    """

    from_known: Floats
    from_samples: Floats
    ways: Floats
    spread: Floats
    known: Ints
    basis: Floats
    probes: Floats


class Places(NamedTuple):
    """Where one patch is looked at: its weights at places, and the samples (2, S) and probes (2, T)."""

    weights: Callable[[Floats, Floats], Floats]
    samples: Floats
    probes: Floats


class Turn(NamedTuple):
    """What the spokes around a vertex share.

    kind, n_faces  of the vertex
    angle          radians between its first and last spoke, through the surface, and
    ratio          how many times as long each tangent is as the one before; both matter at a corner only
    """

    kind: VertexKind
    n_faces: int
    angle: float = 0.0
    ratio: float = 1.0

    @property
    def is_closed(self) -> bool:
        return self.kind in (VertexKind.SMOOTH, VertexKind.DART)

    @property
    def inner_spokes(self) -> range:
        """Numbers of the spokes along which tangent planes agree."""
        return range(0 if self.kind == VertexKind.SMOOTH else 1, self.n_faces)

    @property
    def theta(self) -> float:
        """The angle between neighbouring spokes, in the plane of which the tangent plane is an affine image."""
        around = 2.0 * np.pi if self.is_closed else np.pi if self.kind == VertexKind.BORDER else self.angle
        return float(around / self.n_faces)


class Caps(NamedTuple):
    """faces (M,) and nets (M, ..., 3) of patches, (M,) the largest distance of each that was found, and if it folds."""

    faces: Ints
    nets: Floats
    off: Floats
    folded: NDArray[np.bool_]

    def are_good(self, allowed: float) -> bool:
        """Whether none is farther off than allowed, and none folds."""
        return bool((self.off <= allowed).all() and not self.folded.any())


def probed(between: Floats) -> Floats:
    """(2, 2 S) places between samples, and as many near the vertex."""
    return np.concatenate([between, NEAR * between], axis=1)


def finished_table(constraints: Floats, places: Places, numbers: Ints, given: NDArray[np.bool_]) -> CapTable:
    """The table from the conditions (C, size).

    numbers  the number of every pole; given  (n, ...) which poles are given
    """
    one, on_spoke = places.weights(*places.samples), (places.samples == 0.0).any(axis=0)
    probes = _with_slopes(places.weights, places.probes)
    n, size, n_poles = len(given), int(numbers.max()) + 1, one.shape[1]
    flags = given.ravel()
    is_known = np.zeros(size, dtype=bool)
    is_known[numbers[flags]] = True
    all_poles = np.zeros((n_poles * n, size))
    all_poles[np.arange(n_poles * n), numbers] = 1.0
    basis: Floats = np.kron(np.eye(n), one).astype(np.float64)
    weights = np.tile(np.where(on_spoke, np.sqrt(CURVES), 1.0), n)
    from_known, from_samples, ways = _solved(constraints, weights[:, None] * (basis @ all_poles), is_known)
    unknown, known = np.flatnonzero(~is_known), np.flatnonzero(is_known)
    first = np.full(size, n_poles * n)
    np.minimum.at(first, numbers[flags], np.flatnonzero(flags))
    spread = all_poles[:, np.concatenate([unknown, known])]
    return CapTable(
        from_known,
        from_samples * weights,
        ways,
        spread,
        first[known],
        basis,
        np.array([np.kron(np.eye(n), p) for p in probes]),
    )


def _with_slopes(weights: Callable[[Floats, Floats], Floats], places: Floats) -> list[Floats]:
    """Weights (T, N) at places (2, T), and their derivatives by both parameters."""
    u, v = places
    by_u = (weights(u + STEP, v) - weights(u - STEP, v)) / (2.0 * STEP)
    by_v = (weights(u, v + STEP) - weights(u, v - STEP)) / (2.0 * STEP)
    return [weights(u, v), by_u, by_v]


def _solved(constraints: Floats, samples: Floats, is_known: NDArray[np.bool_]) -> tuple[Floats, Floats, Floats]:
    """Least squares under constraints, as matrices on the given poles and on the (weighted) samples; the free moves."""
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
    return particular - fit @ (s_given + s_free @ particular), fit, ways


def fans(sheets: Sheets, corners: Ints) -> list[Ints]:
    """The faces around the start of each side, counter-clockwise, from the border where there is one."""
    k, across = sheets.across.shape[1], sheets.across.ravel()
    found = []
    for side in corners.tolist():
        first = side
        while across[first] >= 0:  # clockwise to the border, or all around
            other = int(across[first])
            first = other - other % k + (other + 1) % k
            if first == side:
                break
        row, at = [], first
        while True:
            row.append(at // k)
            back = int(across[at - at % k + (at + k - 1) % k])
            if back < 0 or back == first:
                break
            at = back
        found.append(np.array(row))
    return found


def caps_of(
    groups: dict[Turn, list[Ints]],
    scheme: tuple[Callable[[Turn], CapTable], Places],
    outer: Floats,
    surface: tuple[PatchArrays, Floats, Ints],
) -> Caps:
    """Caps of fans, those of one turn together.

    groups   rows of `outer`, fan after fan
    scheme   the table of a turn, and where patches are looked at
    outer    (M, ..., 3) poles of which the known ones are given
    surface  the limit surface: patches, their points, and (M,) the patch under each cap
    """
    make, places = scheme
    arrays, points, faces = surface
    caps = Caps(faces, np.empty_like(outer), np.zeros(len(faces)), np.zeros(len(faces), dtype=bool))
    for turn, clusters in groups.items():
        rows = np.array(clusters)
        for begin in range(0, len(rows), AT_ONCE):
            some = rows[begin : begin + AT_ONCE]
            table, below = make(turn), (arrays, points, faces[some])
            poles = _solved_fans(table, outer[some], places.samples, below)
            flat = some.ravel()
            caps.nets[flat] = poles.reshape(-1, *outer.shape[1:])
            caps.off[flat], caps.folded[flat] = _probed(table, poles, places.probes, below)
    return caps


def corner_turn(n_faces: int, borders: tuple[Floats, Floats], inward: Floats) -> Turn:
    """The turn of a corner; borders: tangents (3,) of the first and the last; inward (3,) into the surface."""
    if n_faces == 1:  # no spoke, and one table for all
        return Turn(VertexKind.CORNER, n_faces)
    one, two = (max(float(np.linalg.norm(x)), 1e-300) for x in borders)
    first, second = borders[0] / one, borders[1] / two
    # also near a half turn, where the cosine says little
    angle = 2.0 * float(np.arctan2(np.linalg.norm(first - second), np.linalg.norm(first + second)))
    if np.pi - angle < STRAIGHT:
        angle = np.pi
    elif (first + second) @ inward < 0.0:
        angle = 2 * np.pi - angle
    return Turn(VertexKind.CORNER, n_faces, angle, float((two / one) ** (1.0 / n_faces)))


def _solved_fans(table: CapTable, outer: Floats, samples: Floats, surface: tuple[PatchArrays, Floats, Ints]) -> Floats:
    """(M, K poles, 3) poles of M fans; outer (M, n, ..., 3) poles of which the known ones are given."""
    m = len(outer)
    known = outer.reshape(m, -1, 3)[:, table.known]
    patch, place, limit = _under(samples, surface)
    free = table.from_known @ known + table.from_samples @ limit[:, :, 0]
    poles = table.spread @ np.concatenate([free, known], axis=1)
    ways = table.spread[:, : len(table.ways)] @ table.ways
    reach = table.basis @ ways
    for _ in range(ROUNDS):
        drawn = table.basis @ poles
        for _ in range(STEPS):
            place, limit = _nearer(surface, patch, place, limit, drawn)
        normal = _normals(limit)
        poles = poles + ways @ _moves(reach, normal, np.einsum("msx,msx->ms", limit[:, :, 0] - drawn, normal))
    return np.asarray(poles)


def _probed(
    table: CapTable, poles: Floats, probes: Floats, surface: tuple[PatchArrays, Floats, Ints]
) -> tuple[Floats, NDArray[np.bool_]]:
    """(M n,) the largest distance of a probe of each patch from the surface, and whether one faces the other way."""
    patch, place, limit = _under(probes, surface)
    drawn, by_u, by_v = table.probes[:, None] @ poles
    for _ in range(STEPS):
        place, limit = _nearer(surface, patch, place, limit, drawn)
    normal = _normals(limit)
    off = np.abs(np.einsum("msx,msx->ms", limit[:, :, 0] - drawn, normal))
    turned = np.einsum("msx,msx->ms", np.cross(by_u, by_v), normal) < 0.0
    each = (-1, probes.shape[1])
    return off.reshape(each).max(axis=1), turned.reshape(each).any(axis=1)


def _under(places: Floats, surface: tuple[PatchArrays, Floats, Ints]) -> tuple[Ints, tuple[Floats, Floats], Floats]:
    """Patch and place of every sample (M n S,), and (M, n S, 3, 3) the limit surface there with its derivatives."""
    arrays, points, faces = surface
    patch = np.repeat(faces.ravel(), places.shape[1])
    u, v = np.tile(places, faces.size)
    return patch, (u, v), points_at(arrays, points, patch, u, v, 3).reshape(len(faces), -1, 3, 3)


def _normals(limit: Floats) -> Floats:
    """Unit normals (M, S, 3) of the surface from its derivatives (M, S, 3, 3); zero where it has none."""
    normal = np.cross(limit[:, :, 1], limit[:, :, 2])
    length = np.linalg.norm(normal, axis=2, keepdims=True)
    return np.asarray(normal / np.where(length > 0.0, length, 1.0))


def _moves(reach: Floats, normal: Floats, off: Floats) -> Floats:
    """(M, q, 3) moves that bring the samples nearer along the normals, a Gauss-Newton step for each vertex."""
    m, q = len(normal), reach.shape[1]
    rows = (reach[:, :, None] * normal[:, :, None, :]).reshape(m, len(reach), 3 * q)
    square = rows.transpose(0, 2, 1) @ rows
    square += DAMPING**2 * np.kron(reach.T @ reach, np.eye(3))
    return np.asarray(np.linalg.solve(square, rows.transpose(0, 2, 1) @ off[:, :, None]).reshape(m, q, 3))


def _nearer(
    surface: tuple[PatchArrays, Floats, Ints], patch: Ints, place: tuple[Floats, Floats], limit: Floats, drawn: Floats
) -> tuple[tuple[Floats, Floats], Floats]:
    """Places one step nearer to the feet of the drawn points, and the limit surface there; the vertex stays."""
    arrays, points, _ = surface
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
    moving = (place[0] > 0) | (place[1] > 0)
    u, v = place[0] + moving * step[0], place[1] + moving * step[1]
    if arrays.across.shape[1] == 3:
        over = np.maximum(u + v - 1.0, 0.0) / 2.0
        u, v = u - over, v - over
    u, v = np.clip(u, 0.0, 1.0), np.clip(v, 0.0, 1.0)
    if arrays.across.shape[1] == 3:
        total = np.maximum(u + v, 1.0)
        u, v = u / total, v / total
    return (u, v), points_at(arrays, points, patch, u, v, 3).reshape(limit.shape)

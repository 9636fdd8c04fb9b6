"""A profile and its axis moved until the voxel centres lie on their right sides.

Over a whole turn the centres beside the surface fall densely into the half plane of (r, z): no solid one may lie
outside the profile, no empty one inside.

    o o o|. .    depth d   of a centre on the wrong side, its distance from the profile
    o o o .|.    numbers q ends and middles of pieces, control points of splines, shift and lean of the axis
    o o o|. .    wanted    the least sum of d² over q, by Newton's steps: each a least squares over what is wrong there

Lines along the axis or across it stay so, and what lies on the axis stays there.  A line across is held where it was:
where the axis runs along the grid a whole voxel is open there.  A spline on which centres stay wrong gets twice the
spans.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial import cKDTree

from recon.geometry.bspline import BSplineCurve
from recon.geometry.turned import ProfileArc, ProfileLine, ProfilePiece, ProfileSpline, TurnedPart
from recon.numerics.bspline_basis import basis_matrix, clamped_knots
from recon.voxel_mesh.damped_newton import damped_newton
from recon.voxel_mesh.fits import across

__all__ = ["settled"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
_Sampled = tuple[Floats, Floats, Callable[[Floats], Floats]]

STEP = 0.1  # voxels between the samples of the profile that centres are held against
NEAR = 0.6  # voxels from the profile of the centres that may come to lie on the wrong side
MARGIN = 0.004  # voxels that a centre shall keep from the profile
HELD = 30.0  # centres that a line across the axis counts as, to stay where it was
STEADY = 1e-4  # of the strongest pull: what holds a number that no centre pulls
STEPS = 8  # Newton's, at most, for one set of numbers
WRONG, WRONG_CENTRES = 0.02, 10  # a spline with so many centres deeper than that, in voxels, is refined
SHORT = 4.0  # voxels of a line that may be the end of an arc
LEAST_SPAN = 4.0  # voxels of a spline's span
REFINEMENTS = 4
SMALL = 1e-4  # voxels: step of numerical derivatives
ON_AXIS = 1e-6  # voxels
BALL = 1e-3  # voxels from the axis of a ball's centre


@dataclass(frozen=True, eq=False)
class _Net:
    """Loops as points that neighbouring pieces share.

    points  (P, 2) ends, middles of arcs, control points
    rows    for every piece of every loop the rows of its points
    number  (P, 2) which free number each coordinate is, -1 where it stays
    """

    loops: tuple[tuple[ProfilePiece, ...], ...]
    points: Floats
    rows: list[Ints]
    number: Ints

    @property
    def pieces(self) -> list[ProfilePiece]:
        return [piece for loop in self.loops for piece in loop]

    def moved(self, step: Floats) -> tuple[tuple[ProfilePiece, ...], ...]:
        """The loops with their free numbers moved."""
        points = self.points + np.where(self.number >= 0, np.append(step, 0.0)[self.number], 0.0)
        found = iter([_rebuilt(piece, points[rows]) for piece, rows in zip(self.pieces, self.rows)])
        return tuple(tuple(next(found) for _ in loop) for loop in self.loops)


@dataclass(frozen=True, eq=False)
class _Samples:
    """The profile by places (n, 2), outward normals (n, 2), how far along its normal each goes when a free number grows
    (n, numbers), and the piece it lies on (n,).
    """

    places: Floats
    normals: Floats
    pull: sparse.csr_array
    piece: Ints


@dataclass(frozen=True, eq=False)
class _Wrong:
    """Centres on the wrong side: the sample next to each, its depth, negative where it is an empty one, and the
    derivatives of that by shift and lean of the axis; and how far each held number is from its place.
    """

    sample: Ints
    depth: Floats
    by_axis: Floats
    strayed: dict[int, float]

    @property
    def badness(self) -> float:
        return float((self.depth**2).sum()) + HELD * sum(away**2 for away in self.strayed.values())


def settled(part: TurnedPart, solid: Floats, empty: Floats) -> TurnedPart:
    """The part, in voxels, with as few centres (n, 3) on the wrong side as its pieces allow.

    solid, empty  centres beside the grid's surface; those far from the profile show something else and do not count
    """
    guess = _settled(part, solid, empty)
    tried = 0
    while len(shorter := _with_a_line_less(guess.part)) > tried:
        other = _settled(shorter[tried], solid, empty)
        guess, tried = (other, 0) if other.badness <= guess.badness else (guess, tried + 1)
    return guess.part


def _settled(part: TurnedPart, solid: Floats, empty: Floats) -> "_Guess":
    places = _across(_net(part.loops))
    number = 0
    while True:
        x, side = _nearby(part, solid, empty)
        guess = damped_newton(_Guess(part, x, side, places), steps=STEPS)
        part, coarse, number = guess.part, guess.coarse(), number + 1
        if not coarse or number > REFINEMENTS:
            return guess
        finer = iter([_finer(p) if n in coarse else p for n, p in enumerate(q for loop in part.loops for q in loop)])
        part = TurnedPart(part.origin, part.axis, tuple(tuple(next(finer) for _ in loop) for loop in part.loops))


def _with_a_line_less(part: TurnedPart) -> list[TurnedPart]:
    """The part with one short line given to an arc beside it, in all ways: corners seen too early make such lines."""
    found = []
    for number, loop in enumerate(part.loops):
        for k, piece in enumerate(loop):
            # of two pieces one would be left, from its start to its start
            if not isinstance(piece, ProfileLine) or piece.length > SHORT or len(loop) < 3:
                continue
            for away in (-1, 1):
                arc = loop[(k + away) % len(loop)]
                if not isinstance(arc, ProfileArc) or _is_of_ball(arc):
                    continue
                start, end = (piece.start, arc.end) if away == 1 else (arc.start, piece.end)
                kept = [ProfileArc(start, arc.middle, end) if p is arc else p for p in loop if p is not piece]
                loops = (*part.loops[:number], tuple(kept), *part.loops[number + 1 :])
                found.append(TurnedPart(part.origin, part.axis, loops))
    return found


def _nearby(part: TurnedPart, solid: Floats, empty: Floats) -> tuple[Floats, Floats]:
    """Centres near the profile and their side of it: 1 for solid ones."""
    tree = cKDTree(_samples(_net(part.loops)).places)
    near = [x[tree.query(_half_plane(part, x)[0], distance_upper_bound=NEAR)[0] < NEAR] for x in (solid, empty)]
    return np.concatenate(near), np.repeat([1.0, -1.0], [len(x) for x in near])


def _across(net: _Net) -> Floats:
    """Height of every piece that is a line across the axis, nan of the others."""
    is_across = [isinstance(p, ProfileLine) and abs(p.end[1] - p.start[1]) < ON_AXIS for p in net.pieces]
    return np.where(is_across, [p.start[1] for p in net.pieces], np.nan)


def _strayed(net: _Net, places: Floats) -> dict[int, float]:
    """How far each free number that is the height of a line across is from its place."""
    rows = np.flatnonzero(~np.isnan(places))
    return {int(net.number[net.rows[n][0], 1]): float(net.pieces[n].start[1] - places[n]) for n in rows}


class _Guess:
    """A part, and the centres x (n, 3) on its wrong side; their side (n,), and the places of its lines across."""

    def __init__(self, part: TurnedPart, x: Floats, side: Floats, places: Floats) -> None:
        self.part, self.net = part, _net(part.loops)
        self.samples = _samples(self.net)
        self.wrong = _wrong(part, self.samples, x, side, _strayed(self.net, places))
        self.badness = self.wrong.badness
        self._held = x, side, places

    def step(self) -> Floats:
        return _step(self.samples, self.wrong)

    def moved(self, step: Floats) -> "_Guess":
        return _Guess(_moved(self.part, self.net, step), *self._held)

    def coarse(self) -> set[int]:
        """Pieces that are splines and want more spans."""
        deep = self.wrong.sample[np.abs(self.wrong.depth) > WRONG]
        many = np.bincount(self.samples.piece[deep], minlength=len(self.net.rows)) > WRONG_CENTRES
        return {n for n in np.flatnonzero(many).tolist() if _may_be_finer(self.net.pieces[n])}


def _half_plane(part: TurnedPart, x: Floats) -> tuple[Floats, Floats]:
    """(r, z) of places (n, 3), and their unit vectors away from the axis."""
    arm = x - part.origin
    z = arm @ part.axis
    out = arm - z[:, None] * part.axis
    r = np.linalg.norm(out, axis=1)
    return np.column_stack([r, z]), out / np.maximum(r, 1e-9)[:, None]


def _wrong(part: TurnedPart, samples: _Samples, x: Floats, side: Floats, strayed: dict[int, float]) -> _Wrong:
    p, out = _half_plane(part, x)
    at = cKDTree(samples.places).query(p)[1]
    n = samples.normals[at]
    depth = ((p - samples.places[at]) * n).sum(axis=1) + side * MARGIN
    rows = np.flatnonzero(side * depth > 0)
    n, p, turn = n[rows], p[rows], out[rows] @ np.stack(across(part.axis), axis=1)
    lean = n[:, 1] * p[:, 0] - n[:, 0] * p[:, 1]
    return _Wrong(at[rows], depth[rows], np.concatenate([-n[:, :1] * turn, lean[:, None] * turn], axis=1), strayed)


def _step(samples: _Samples, wrong: _Wrong) -> Floats:
    """Free numbers, then shift and lean of the axis, that leave the least sum of squared depths, as far as linear."""
    jacobian = sparse.hstack([-samples.pull[wrong.sample], sparse.csr_array(wrong.by_axis)]).tocsr()
    m = (jacobian.T @ jacobian).toarray()
    m[np.diag_indices(len(m))] += STEADY * max(float(m.diagonal()[:-4].max(initial=0.0)), 1.0)
    pull = jacobian.T @ wrong.depth
    for number, away in wrong.strayed.items():
        m[number, number] += HELD
        pull[number] += HELD * away
    return np.asarray(np.linalg.solve(m, -pull))


def _moved(part: TurnedPart, net: _Net, step: Floats) -> TurnedPart:
    e = np.stack(across(part.axis))
    axis = part.axis + step[-2:] @ e
    return TurnedPart(part.origin + step[-4:-2] @ e, axis / np.linalg.norm(axis), net.moved(step[:-4]))


def _net(loops: tuple[tuple[ProfilePiece, ...], ...]) -> _Net:
    """Points and free numbers of loops."""
    points: list[Floats] = []
    rows: list[Ints] = []
    for loop in loops:
        first = len(points)
        points += [piece.start for piece in loop]
        for k, piece in enumerate(loop):
            inner = _inner_points(piece)
            ends = first + k, first + (k + 1) % len(loop)
            rows.append(np.array([ends[0], *range(len(points), len(points) + len(inner)), ends[1]]))
            points += list(inner)
    return _Net(loops, np.array(points), rows, _numbers(np.array(points), [p for loop in loops for p in loop], rows))


def _inner_points(piece: ProfilePiece) -> Sequence[Floats]:
    if isinstance(piece, ProfileSpline):
        return list(piece.curve.control_points[1:-1])
    return [piece.middle] if isinstance(piece, ProfileArc) else []


def _numbers(points: Floats, pieces: list[ProfilePiece], rows: list[Ints]) -> Ints:
    """Number of every coordinate: ends of a line along the axis, or across it, share one."""
    fixed = np.zeros(points.shape, dtype=bool)
    same = np.arange(points.size).reshape(points.shape)
    for piece, own in zip(pieces, rows):
        fixed[own, 0] |= points[own, 0] <= ON_AXIS
        if isinstance(piece, ProfileLine):
            for k in np.flatnonzero(np.abs(piece.end - piece.start) < ON_AXIS):
                same[same == same[own[1], k]] = same[own[0], k]
        elif isinstance(piece, ProfileArc) and _is_of_ball(piece):
            fixed[own[1]] = True
    held = np.isin(same, same[fixed])
    number = np.full(points.shape, -1)
    number[~held] = np.unique(same[~held], return_inverse=True)[1]
    return number


def _is_of_ball(arc: ProfileArc) -> bool:
    """Whether an arc has its centre on the axis, and an end there."""
    return bool(min(arc.start[0], arc.end[0]) <= ON_AXIS and abs(arc.circle[0][0]) < BALL)


def _ball(a: Floats, b: Floats) -> tuple[Floats, float]:
    """Circle through two points with its centre on the axis."""
    z = 0.5 * (a[1] + b[1]) + 0.5 * (b[0] ** 2 - a[0] ** 2) / (b[1] - a[1])
    centre = np.array([0.0, z])
    return centre, float(np.linalg.norm(a - centre))


def _rebuilt(piece: ProfilePiece, points: Floats) -> ProfilePiece:
    if isinstance(piece, ProfileLine):
        return ProfileLine(points[0], points[-1])
    if isinstance(piece, ProfileSpline):
        return ProfileSpline(BSplineCurve(piece.curve.degree, piece.curve.knots, points))
    arc = ProfileArc(points[0], points[1], points[2])
    if not _is_of_ball(piece):
        return arc
    centre, radius = _ball(points[0], points[2])
    angle = np.mean(arc.angles)
    return ProfileArc(points[0], centre + radius * np.array([np.cos(angle), np.sin(angle)]), points[2])


def _samples(net: _Net) -> _Samples:
    """Samples of all pieces that lie off the axis."""
    found = []
    for n, (piece, rows) in enumerate(zip(net.pieces, net.rows)):
        if isinstance(piece, ProfileLine) and max(piece.start[0], piece.end[0]) <= ON_AXIS:
            continue
        places, tangents, by_point = _arc_samples(piece) if isinstance(piece, ProfileArc) else _curve_samples(piece)
        normals = np.column_stack([tangents[:, 1], -tangents[:, 0]])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
        found.append((places, normals, _by_number(net, rows, by_point(normals)), np.full(len(places), n)))
    pull = sparse.csr_array(sparse.vstack([row[2] for row in found]))
    places, normals, piece_of = (np.concatenate([row[k] for row in found]) for k in (0, 1, 3))
    return _Samples(places, normals, pull, piece_of)


def _by_number(net: _Net, rows: Ints, by_coordinate: Floats) -> sparse.csr_array:
    """Derivatives (n, points, 2) by the coordinates of a piece as (n, numbers) by the free numbers."""
    number = net.number[rows].ravel()
    flat = by_coordinate.reshape(len(by_coordinate), -1)
    rule = sparse.coo_array(
        (np.ones((number >= 0).sum()), (np.flatnonzero(number >= 0), number[number >= 0])),
        shape=(len(number), int(net.number.max()) + 1),
    )
    return sparse.csr_array(flat @ rule.tocsr())


def _curve_samples(piece: ProfileLine | ProfileSpline) -> _Sampled:
    """Places and tangents of a line or spline, and what gives the derivatives by its points from the normals."""
    if isinstance(piece, ProfileLine):
        t = np.linspace(0.0, 1.0, _count(piece.length))
        points = np.stack([piece.start, piece.end])
        weights = np.column_stack([1.0 - t, t])
        tangents = np.broadcast_to(points[1] - points[0], (len(t), 2))
    else:
        points, curve = piece.curve.control_points, piece.curve
        t = np.linspace(*curve.domain, _count(piece.length))
        weights = basis_matrix(curve.knots, curve.degree, t).toarray()
        tangents = curve.derivative(t)
    return weights @ points, tangents, lambda normals: weights[:, :, None] * normals[:, None, :]


def _arc_samples(arc: ProfileArc) -> _Sampled:
    """The same of an arc: its distance changes with its centre and its radius, these with its three points."""
    points = np.stack([arc.start, arc.middle, arc.end])
    centre, radius = arc.circle
    first, last = arc.angles
    angle = np.linspace(first, last, _count(arc.length))
    out = np.column_stack([np.cos(angle), np.sin(angle)])
    tangents = np.sign(last - first) * np.column_stack([-out[:, 1], out[:, 0]])
    of_ball = _is_of_ball(arc)

    def by_point(normals: Floats) -> Floats:
        change = np.zeros((len(angle), 3, 2))
        for k, c in np.ndindex(3, 2):
            there = points.copy()
            there[k, c] += SMALL
            moved, larger = _ball(there[0], there[2]) if of_ball else ProfileArc(*there).circle
            change[:, k, c] = (out @ (moved - centre) + larger - radius) / SMALL
        return change * np.sign((out * normals).sum(axis=1))[:, None, None]

    return centre + radius * out, tangents, by_point


def _count(length: float) -> int:
    return max(3, int(np.ceil(length / STEP)) + 1)


def _may_be_finer(piece: ProfilePiece) -> bool:
    if not isinstance(piece, ProfileSpline):
        return False
    return piece.length > 2 * LEAST_SPAN * (len(piece.curve.control_points) - piece.curve.degree)


def _finer(piece: ProfilePiece) -> ProfilePiece:
    """The same spline with every span halved."""
    assert isinstance(piece, ProfileSpline)
    curve = piece.curve
    breaks = np.unique(curve.knots)
    middles = [0.5 * (a + b) for a, b in pairwise(breaks)]
    knots = clamped_knots(np.sort(np.concatenate([breaks, middles])), curve.degree)
    t = np.linspace(*curve.domain, 8 * len(knots))
    rows = basis_matrix(knots, curve.degree, t).toarray()
    control = np.linalg.lstsq(rows, curve.point(t), rcond=None)[0]
    control[0], control[-1] = curve.control_points[0], curve.control_points[-1]
    return ProfileSpline(BSplineCurve(curve.degree, knots, control))

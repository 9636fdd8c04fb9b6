"""Move the sherds of a broken vessel the last tenths of a millimetre, until all their cracks close at once.

Sherds are put together by hand or by a rough fit, each a little out of place. Where two of them broke from one
another the distance between them should vanish; every sherd gets one small rigid motion, and all motions are sought
together, so that closing one crack does not open the next.

      a | b        each contact says: the relative motion along n closes d
     ---+---       few contacts, or smooth ones, say little: there the prior wins, that a sherd lies where it was put
      c |          where the whole should stand no contact says: the prior makes the mean motion zero

u      (S, 6) motion of every sherd from where it came: shift t of its centre, turn ω about it
d n p  distance of two partners, their common normal, and the place of the first (`contacts`)
J      derivative of d by the motions: (n, (p - c) × n) for the first sherd, the same negative for the second
σ      robust scale of the distances of one kind of contact

Paper  [chen1992] point to plane, all sherds at once as in [pulli1999]; [geman1987] for the weights.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from recon.errors import BadOption
from recon.geometry.mesh import TriangleMesh
from recon.hole_patch.assembly import Assembly, assemble, steady_normals
from recon.hole_patch.contacts import KINDS, Pairs, PartnerTree, Samples, contact_samples, touching
from recon.hole_patch.fracture import wall_thickness

__all__ = ["Move", "Settling", "settle"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

ROUNDS = 30
STILL = 0.002  # of the bounds: a round that moves no sherd farther is the last
LIKELY = 2.0 / 9.0  # of the bounds: standard deviation of a motion before anything is measured
APART = 6.0  # standard deviations of a motion: farther apart than that two sherds are not put
FEWEST = 12  # partners that make two sherds neighbours
GAIN = 0.98  # of the gap may be left, or the motions are not worth making
THROUGH = 0.6  # of the wall's thickness; beyond it a partner may lie on the far side of the wall
NARROW = 0.02  # of the edge length: no scale is believed to be smaller; exact data would make facts of rounding


@dataclass(frozen=True, eq=False)
class Move:
    """How one sherd was moved.

    matrix                 (4, 4) from where it came to where it is
    shift_mm, turn_deg     of its centre, and about it
    gap_before, gap_after  median distance to its neighbours, in millimetres; nan where it has none
    contacts               number of places at which it touches them
    bounded                whether it went as far as it may, and would have gone farther
    """

    matrix: Floats
    shift_mm: float
    turn_deg: float
    gap_before: float
    gap_after: float
    contacts: int
    bounded: bool


@dataclass(frozen=True, eq=False)
class Settling:
    """The sherds after settling, in their old order.

    sherds                 each as it came, moved
    moves                  one a sherd
    gap_before, gap_after  mean over the sherds; nan when none has a neighbour
    settled                whether anything was moved; if not, the sherds are those that came
    """

    sherds: tuple[TriangleMesh, ...]
    moves: tuple[Move, ...]
    gap_before: float
    gap_after: float
    settled: bool

    def summary(self) -> str:
        """One sentence for a person."""
        if np.isnan(self.gap_before):
            return "The sherds stay as they came: none touches another."
        if not self.settled:
            return f"The sherds stay as they came: no small motion closes the gap of {self.gap_before:.3f} mm further."
        shift = max(move.shift_mm for move in self.moves)
        turn = max(move.turn_deg for move in self.moves)
        bounded = sum(move.bounded for move in self.moves)
        held = f"; {bounded} went as far as they may and still do not fit" if bounded else ""
        return (
            f"The sherds were moved by up to {shift:.3f} mm and {turn:.3f}°: the gap between neighbours fell from "
            f"{self.gap_before:.3f} to {self.gap_after:.3f} mm{held}."
        )


def settle(sherds: Sequence[TriangleMesh], *, max_shift: float = 0.75, max_turn: float = np.radians(0.75)) -> Settling:
    """Close the cracks between sherds by small rigid motions of all of them at once.

    Where the whole stands its sherds do not say: put together by chance errors of equal size, it is off by one of them
    over the square root of their number, and stays so.
    sherds     nearly in pose, in millimetres: closed with fracture faces, or open outer walls
    max_shift  length, of a sherd's centre; max_turn in radians, about it
    Promises   no motion beyond the bounds; sherds without neighbours stay; the mean motion is zero unless a bound was
               reached; the gap falls, or all sherds are returned as they came.
    Raises     BadOption for a bound that is not positive; NotManifold, BadGeometry.
    Paper      [chen1992], [pulli1999].
    """
    if not (max_shift > 0.0 and max_turn > 0.0):
        raise BadOption("max_shift, max_turn", f"must be positive, not {max_shift} and {max_turn}")
    table = assemble(sherds)
    reach = _reach(table, sherds, max_shift)
    samples, spacing = contact_samples(table, steady_normals(table), n_sherds=len(sherds), reach=reach)
    puzzle = _Puzzle(sherds, samples, reach)
    begin = np.zeros((len(sherds), 6))
    before = puzzle.contacts(begin)
    bounds = np.array([max_shift, max_turn])
    believed = min(1.0, (spacing / table.spacing) ** 2)  # samples denser than the measured vertices are not independent
    motion, bounded = _settled(puzzle, bounds, narrow=NARROW * table.spacing, believed=believed)
    return _judged(sherds, puzzle, motion, bounded, before)


def _reach(table: Assembly, sherds: Sequence[TriangleMesh], max_shift: float) -> float:
    """How far apart partners may be: as two sherds are likely to, but never through the wall."""
    ends = table.vertices[table.border_edges]
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    border = np.bincount(table.vertex_sherd[table.border_edges[:, 0]], lengths, len(sherds))
    area = np.bincount(table.face_sherd, table.areas, len(sherds))
    closed = (border < 0.5 * np.sqrt(area)) & (area > 0.0)
    apart = APART * LIKELY * max_shift
    if not closed.any():
        return apart
    solid = table if closed.all() else assemble([s for s, whole in zip(sherds, closed) if whole])
    return min(apart, THROUGH * wall_thickness(solid))


@dataclass(frozen=True, eq=False)
class _Contact:
    """The pairs between two sherds, in the pose that the second came in, and that pose now."""

    first: int
    second: int
    pairs: Pairs


class _Puzzle:
    """What can be asked of the sherds for any motions (S, 6): who touches whom, and where."""

    def __init__(self, sherds: Sequence[TriangleMesh], samples: Sequence[Samples], reach: float) -> None:
        self.reach = reach
        self.centres = np.array([s.vertices.mean(axis=0) if s.n_vertices else np.zeros(3) for s in sherds])
        self._samples = samples
        self._trees = [PartnerTree(part, reach) for part in samples]
        self._near = touching(samples, reach)

    def matrices(self, motion: Floats) -> Floats:
        """(S, 4, 4) of the motions."""
        found = np.tile(np.eye(4), (len(motion), 1, 1))
        found[:, :3, :3] = Rotation.from_rotvec(motion[:, 3:]).as_matrix()
        found[:, :3, 3] = self.centres + motion[:, :3] - np.einsum("sij,sj->si", found[:, :3, :3], self.centres)
        return found

    def contacts(self, motion: Floats) -> list[_Contact]:
        """All partners, of both directions, where two sherds have enough of a kind."""
        place = self.matrices(motion)
        found = []
        for a, b in self._near:
            pairs = self._trees[b].partners(_seen(self._samples[a], np.linalg.inv(place[b]) @ place[a]))
            pairs = pairs.only(np.bincount(pairs.kind, minlength=KINDS)[pairs.kind] >= FEWEST)
            if len(pairs.sample):
                found.append(_Contact(a, b, pairs.moved(place[b])))
        return found


def _seen(samples: Samples, matrix: Floats) -> Samples:
    turn = matrix[:3, :3].T
    return Samples(samples.points @ turn + matrix[:3, 3], samples.normals @ turn, samples.border)


def _settled(puzzle: _Puzzle, bounds: Floats, *, narrow: float, believed: float) -> tuple[Floats, Flags]:
    """The motions (S, 6), and whether each was held by a bound."""
    motion = np.zeros((len(puzzle.centres), 6))
    bounded = np.zeros(len(motion), dtype=bool)
    prior = np.repeat((LIKELY * bounds) ** -2, 3)
    for _ in range(ROUNDS):
        contacts = puzzle.contacts(motion)
        if not contacts:
            break
        matrix, gradient = _normal_equations(puzzle, motion, contacts, _scales(contacts, narrow))
        moved, bounded = _bounded_step(believed * matrix, believed * gradient, motion, prior=prior, bounds=bounds)
        farthest = _lengths(moved - motion) / bounds
        motion = moved
        if farthest.max() < STILL:
            break
    return motion, bounded


def _scales(contacts: Iterable[_Contact], narrow: float) -> Floats:
    """(KINDS,) normal-consistent median distance of every kind; a kind must not look better than half of all."""
    distances = np.abs(np.concatenate([contact.pairs.distances for contact in contacts]))
    kind = np.concatenate([contact.pairs.kind for contact in contacts])
    least = max(0.5 * float(np.median(distances)), narrow)
    return 1.4826 * np.array(
        [max(np.median(distances[kind == k]), least) if (kind == k).any() else 1.0 for k in range(KINDS)]
    )


def _normal_equations(
    puzzle: _Puzzle, motion: Floats, contacts: Iterable[_Contact], scales: Floats
) -> tuple[Floats, Floats]:
    """JᵀWJ (S, 6, S, 6) and JᵀWd (S, 6)."""
    n = len(motion)
    matrix, gradient = np.zeros((n, 6, n, 6)), np.zeros((n, 6))
    centres = puzzle.centres + motion[:, :3]
    for contact in contacts:
        pairs, a, b = contact.pairs, contact.first, contact.second
        d, scale = pairs.distances, scales[pairs.kind]
        weight = (1.0 + (d / (2.0 * scale)) ** 2) ** -2 / scale**2
        rows = {
            s: np.concatenate([pairs.normals, np.cross(pairs.points - centres[s], pairs.normals)], 1) for s in (a, b)
        }
        for s, sign in ((a, 1.0), (b, -1.0)):
            weighted = rows[s] * weight[:, None]
            gradient[s] += sign * (weighted.T @ d)
            for r in (a, b):
                matrix[s, :, r] += (1.0 if r == s else -1.0) * (weighted.T @ rows[r])
    return matrix, gradient


def _bounded_step(
    matrix: Floats, gradient: Floats, motion: Floats, *, prior: Floats, bounds: Floats
) -> tuple[Floats, Flags]:
    """The next motions: sherds that would leave their bounds are held there, and the others find their place again."""
    n = len(motion)
    full = matrix.reshape(6 * n, 6 * n) + np.diag(np.tile(prior, n))
    right = -(gradient + prior * motion)
    step, held = np.zeros((n, 6)), np.zeros(n, dtype=bool)
    for _ in range(n + 1):
        free = np.repeat(~held, 6)
        known = right.ravel()[free] - full[np.ix_(free, ~free)] @ step.ravel()[~free]
        step[~held] = np.linalg.solve(full[np.ix_(free, free)], known).reshape(-1, 6)
        excess = np.where(held, 0.0, (_lengths(motion + step) / bounds).max(axis=1))
        worst = int(excess.argmax())
        if excess[worst] <= 1.0:
            break
        # one at a time: what the others do depends on it, and it may be the only one that is wrong
        step[worst] = _clipped(motion + step, bounds)[worst] - motion[worst]
        held[worst] = True
    return motion + step, held


def _lengths(motion: Floats) -> Floats:
    """(S, 2) lengths of shift and turn."""
    return np.linalg.norm(motion.reshape(-1, 2, 3), axis=2)


def _clipped(motion: Floats, bounds: Floats) -> Floats:
    factor = np.minimum(1.0, bounds / np.maximum(_lengths(motion), 1e-300))
    return motion * np.repeat(factor, 3, axis=1)


def _judged(
    sherds: Sequence[TriangleMesh], puzzle: _Puzzle, motion: Floats, bounded: Flags, before: list[_Contact]
) -> Settling:
    """The motions carried out, or not when they are not worth it."""
    after = puzzle.contacts(motion)
    gaps, touches = _gaps(len(sherds), before, after, puzzle.reach)
    met = ~np.isnan(gaps[:, 0])
    mean = gaps[met].mean(axis=0) if met.any() else np.full(2, np.nan)
    settled = bool(mean[1] < GAIN * mean[0])
    if not settled:
        motion, bounded = np.zeros_like(motion), np.zeros_like(bounded)
        gaps[:, 1], mean[1] = gaps[:, 0], mean[0]
    matrices, lengths = puzzle.matrices(motion), _lengths(motion)
    moves = tuple(
        Move(matrix, float(shift), float(np.degrees(turn)), float(gap[0]), float(gap[1]), int(count), bool(held))
        for matrix, (shift, turn), gap, count, held in zip(matrices, lengths, gaps, touches, bounded)
    )
    moved = tuple(s.moved(m) if met[i] and settled else s for i, (s, m) in enumerate(zip(sherds, matrices)))
    return Settling(moved, moves, float(mean[0]), float(mean[1]), settled)


def _gaps(n: int, before: list[_Contact], after: list[_Contact], reach: float) -> tuple[Floats, Ints]:
    """(S, 2) median distance of every sherd before and after, and (S,) number of partners.

    Both over the same places, those that had a partner before or after: a motion must not look good by losing the
    contacts that it spoils. Where a partner is missing the distance counts as the reach.
    """
    keys, distances = zip(*(_keyed(n, contacts) for contacts in (before, after)))
    places = np.union1d(*keys)
    gap = np.full((2, len(places)), reach)
    for row, key, distance in zip(gap, keys, distances):
        row[np.searchsorted(places, key)] = distance
    first, second = np.divmod(places // KINDS % (n * n), n)
    mine = [(first == s) | (second == s) for s in range(n)]
    medians = [np.median(gap[:, rows], axis=1) if rows.any() else np.full(2, np.nan) for rows in mine]
    return np.array(medians), np.array([int(rows.sum()) for rows in mine])


def _keyed(n: int, contacts: list[_Contact]) -> tuple[Ints, Floats]:
    """A number for every sample, pair of sherds and kind of contact, and the distance there."""
    if not contacts:
        return np.zeros(0, dtype=np.int64), np.zeros(0)
    keys = [(c.pairs.sample * n * n + c.first * n + c.second) * KINDS + c.pairs.kind for c in contacts]
    return np.concatenate(keys), np.abs(np.concatenate([c.pairs.distances for c in contacts]))

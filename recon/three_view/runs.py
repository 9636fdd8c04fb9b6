"""Straight rows of edges of a view, and the points where lines of several directions meet.

a---b- -c---d          a-b, b-c and c-d make one run, whatever their line types;
        |              c is a corner, b is none
"""

import numpy as np
from numpy.typing import NDArray

from recon.three_view.tables import linked

__all__ = ["SLACK", "straight_runs"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

SLACK = 2.0  # snaps that a point may be off a slanted line: the ends of the line and the point have moved by one


def straight_runs(positions: Floats, edges: Ints, pieces: tuple[Ints, Ints], snap: float) -> tuple[Ints, Flags]:
    """Run of every edge, and the points that are corners.

    Pieces of one segment belong together, and edges that go straight on through a point. A piece a few snaps long has
    no direction of its own: it goes on with the line along which it lies, but may turn a corner there all the same.
    """
    slot, owner = pieces
    order = np.argsort(owner, kind="stable")
    same = np.flatnonzero(owner[order][1:] == owner[order][:-1])
    joined = np.column_stack([slot[order[same]], slot[order[same + 1]]])
    triples, pairs = _pairs_at_points(edges, len(positions))
    straight, turn = _straight_on(positions, triples, snap)
    runs = linked(np.concatenate([joined, pairs[straight]]), len(edges))
    corners = _corners(edges, runs, len(positions))
    likely = np.flatnonzero(turn <= SLACK * snap)
    likely = pairs[likely[np.argsort(turn[likely], kind="stable")]]
    return _short_pieces_joined(positions[edges], runs, likely, snap), corners


def _short_pieces_joined(ends: Floats, runs: Ints, likely: Ints, snap: float) -> Ints:
    """Runs joined over pairs of edges, the likeliest first, as long as all of a run lies along one line."""
    runs = runs.copy()
    for one, other in likely.tolist():
        both = (runs == runs[one]) | (runs == runs[other])
        if runs[one] != runs[other] and _along_one_line(ends[both].reshape(-1, 2), SLACK * snap):
            runs[both] = runs[one]
    return runs


def _along_one_line(points: Floats, reach: float) -> bool:
    """Whether points lie no further than `reach` from the line through two that are far apart."""
    first = points[int(np.argmax(((points - points[0]) ** 2).sum(axis=1)))]
    rest = points - first
    last = rest[int(np.argmax((rest**2).sum(axis=1)))]
    return bool((np.abs(rest[:, 0] * last[1] - rest[:, 1] * last[0]) <= reach * np.linalg.norm(last)).all())


def _pairs_at_points(edges: Ints, n: int) -> tuple[Ints, Ints]:
    """For every two edges at a point that point with their far ends, (k, 3), and the edges, (k, 2)."""
    ends = np.concatenate([edges, edges[:, ::-1]])
    edge = np.tile(np.arange(len(edges)), 2)
    by_point = np.argsort(ends[:, 0], kind="stable")
    ends, edge = ends[by_point], edge[by_point]
    starts = np.searchsorted(ends[:, 0], np.arange(n + 1))
    count = np.diff(starts)
    rows = [np.empty((0, 2), dtype=np.int64)]
    for valence in np.unique(count[count > 1]).tolist():
        i, j = np.triu_indices(valence, 1)
        first = starts[:-1][count == valence][:, None]
        rows.append(np.column_stack([(first + i).ravel(), (first + j).ravel()]))
    pair = np.concatenate(rows)
    return np.column_stack([ends[pair[:, 0], 0], ends[pair, 1]]), edge[pair]


def _corners(edges: Ints, runs: Ints, n: int) -> Flags:
    """(n,) whether edges of more than one run meet in a point."""
    pairs = np.unique(np.column_stack([edges.ravel(), np.repeat(runs, 2)]), axis=0)
    return np.bincount(pairs[:, 0], minlength=n) > 1


def _straight_on(positions: Floats, triples: Ints, snap: float) -> tuple[Flags, Floats]:
    """Whether two edges at a point continue each other, and how far off, where short ones may; inf where they do not.

    triples  (k, 3) point, far end of one edge, far end of the other
    """
    at, one, other = (positions[column] for column in triples.T)
    a, b, base = one - at, other - at, other - one
    away = np.abs(a[:, 0] * base[:, 1] - a[:, 1] * base[:, 0]) / np.maximum(np.linalg.norm(base, axis=1), 1e-300)
    level = ((a == 0) & (b == 0)).any(axis=1)
    long = np.minimum(np.linalg.norm(a, axis=1), np.linalg.norm(b, axis=1)) > 2 * SLACK * snap
    ahead = (a * b).sum(axis=1) < 0
    # of a slanted line a short piece may stand level, its ends' coordinates having become one
    slanted = ((a != 0) | (b != 0)).all(axis=1) & long
    straight = ahead & (level | (slanted & (away <= SLACK * snap)))
    return np.asarray(straight), np.where(ahead & ~long, away, np.inf)

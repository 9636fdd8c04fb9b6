"""Characteristic points of a row of points: the few that keep its shape, by Douglas and Peucker.

         * farthest from the chord: kept, and both halves go on
        / \\
    a--'   '--.__ b        the chord with the farthest point anywhere is split first, so that any number of points
                           can be asked for, and a smaller number keeps a part of a larger one

Paper  [douglas1973]; [maekawa2009], their use as first control points of a curve.
"""

import heapq
from itertools import count

import numpy as np
from numpy.typing import NDArray

__all__ = ["characteristic_points"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def characteristic_points(points: Floats, number: int, *, closed: bool = False, within: float = 0.0) -> Ints:
    """(k,) increasing numbers of the points that are kept, the first among them and, of an open row, the last.

    points  (n, d) in order; a closed row does not repeat its first point
    number  of points kept at most, at least 2, and 3 of a closed row
    within  no more are kept once every point is as near to its chord
    """
    row = np.concatenate([points, points[:1]]) if closed else points
    kept = {0, len(row) - 1}
    ticket = count()  # of chords equally far off the earlier goes first
    waiting: list[tuple[float, int, int, int, int]] = []

    def wait(first: int, last: int) -> None:
        if last - first > 1:
            away = _distances(row[first + 1 : last], row[first], row[last])
            worst = int(np.argmax(away))
            heapq.heappush(waiting, (-float(away[worst]), next(ticket), first, last, first + 1 + worst))

    wait(0, len(row) - 1)
    most = number + 1 if closed else number
    while waiting and len(kept) < most and -waiting[0][0] > within:
        _, _, first, last, farthest = heapq.heappop(waiting)
        kept.add(farthest)
        wait(first, farthest)
        wait(farthest, last)
    if closed:
        kept.discard(len(row) - 1)
    return np.array(sorted(kept), dtype=np.int64)


def _distances(points: Floats, a: Floats, b: Floats) -> Floats:
    """(m,) distances of points from the chord a b."""
    chord = b - a
    along = np.clip((points - a) @ chord / max(float(chord @ chord), 1e-300), 0.0, 1.0)
    return np.asarray(np.linalg.norm(points - a - along[:, None] * chord, axis=1))

"""The ribbon between two rows of points: which point of one row goes with which of the other.

      a   0---1---2---3        a path through all pairs (i, j) goes on in a or in b, never back; of all paths the one
          |\\  |  /|  /         whose rungs have the least sum of squares
      b   0-1-2---3

A row folded upon itself is a ribbon as well: its two halves are the rows, and the fold is where they end.

Paper  [fuchs1977], the triangles between two contours as a shortest path in the graph of all rungs.
"""

import numpy as np
from numpy.typing import NDArray

__all__ = ["fold_point", "ribbon"]

END = 4.0  # widths of a ribbon along its end: half a circle takes 1.6, a bead twice as thick as the ribbon 5

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def ribbon(a: Floats, b: Floats) -> Ints:
    """(n + m - 1, 2) rungs from (0, 0) to (n - 1, m - 1) between points a (n, d) and b (m, d), both evenly spaced."""
    n, m = len(a), len(b)
    _, came_from_a = _shortest(a, b, n + m - 2)
    path = np.empty((n + m - 1, 2), dtype=np.int64)
    i, j = n - 1, m - 1
    for k in range(n + m - 2, -1, -1):
        path[k] = i, j
        if k and came_from_a[k][i]:
            i -= 1
        else:
            j -= 1
    return path


def fold_point(points: Floats) -> int:
    """Number of the point in which evenly spaced points (n, d), folded to a ribbon, are folded.

    Promises  the middle of the ribbon's end, `END` times as long as the ribbon is wide: how the rungs lie within a
              round end, or a bead, says nothing.
    """
    n = len(points)
    # among folds that are as good the first is found from one end, the last from the other
    first = int(np.argmin(_shortest(points, points[::-1], n - 1)[0]))
    last = n - 1 - int(np.argmin(_shortest(points[::-1], points, n - 1)[0]))
    fold = (first + last) // 2
    path = ribbon(points[: fold + 1], points[: fold - n : -1] if fold < n - 1 else points[-1:])
    rungs = np.stack([path[:, 0], n - 1 - path[:, 1]], axis=1)
    width = float(np.median(np.linalg.norm(points[rungs[:, 0]] - points[rungs[:, 1]], axis=1)))
    step = float(np.linalg.norm(np.diff(points, axis=0), axis=1).mean())
    ends = rungs[(rungs[:, 1] - rungs[:, 0]) * step >= END * width]
    return int(ends[-1].mean()) if len(ends) else fold


def _shortest(a: Floats, b: Floats, steps: int) -> tuple[Floats, list[NDArray[np.bool_]]]:
    """(n,) least sums on the way to the rungs (i, steps - i), and for every step before, whether it went on in a."""
    n, m = len(a), len(b)
    total = np.full(n, np.inf)
    total[0] = 0.0
    went = [np.zeros(n, dtype=bool)]
    number = np.arange(n)
    for k in range(1, steps + 1):
        before = np.concatenate([[np.inf], total[:-1]])
        in_a = before < total
        j = k - number
        on = (j >= 0) & (j < m)
        rung = np.full(n, np.inf)
        rung[on] = ((a[on] - b[j[on]]) ** 2).sum(axis=1)
        total = np.minimum(before, total) + rung
        went.append(in_a)
    return total, went

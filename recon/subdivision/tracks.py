"""Tracks that part a mesh of quadrilaterals into rectangles with irregular vertices at their corners alone.

    x---o---o---o       from an irregular vertex x a track leaves along every edge and runs straight on, all of them one
    |   .   |   .       edge at a time, until it comes upon another track or the border. What lies between tracks has
    o---o===T===o       four corners and no irregular vertex inside. At most three rectangles for every four quads at
        .   |   .       irregular vertices: each has a corner there, and two more where its track ends
        o   x   o

Paper  [eppstein2008].
"""

import numpy as np
from numpy.typing import NDArray

__all__ = ["tracks"]

Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


def tracks(faces: Ints, across: Ints, regular: Bools) -> Bools:
    """(F, 4) the sides that lie on tracks.

    faces, across  (F, 4) vertices, and the sides across, -1 on a border
    regular        (F,) whether no corner is irregular; elsewhere corner 0 is
    """
    beside, start = across.ravel().tolist(), faces.ravel().tolist()
    ends = np.zeros(int(faces.max(initial=-1)) + 1, dtype=bool)
    ends[faces[~regular, 0]] = True
    free = np.flatnonzero(across.ravel() < 0)
    ends[faces.ravel()[free]] = ends[faces.ravel()[_following(free)]] = True
    met = ends.tolist()
    taken = [False] * len(beside)
    running = [side for side in (4 * np.flatnonzero(~regular)).tolist() if beside[side] >= 0]
    while running:
        going = []
        for side in running:
            if taken[side]:  # another one came the other way
                continue
            taken[side] = taken[beside[side]] = True
            after = side - side % 4 + (side + 1) % 4
            if not met[start[after]]:
                met[start[after]] = True
                other = beside[after]
                going.append(other - other % 4 + (other + 1) % 4)
        running = going
    return np.array(taken, dtype=bool).reshape(across.shape)


def _following(sides: Ints) -> Ints:
    return np.asarray(sides - sides % 4 + (sides + 1) % 4)

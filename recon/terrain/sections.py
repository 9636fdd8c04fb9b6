"""Contours of the smooth ground at any height, and what of it lies above a height.

Every patch is cut into cells whose corners neighbouring patches share by number, so that contours run on from patch to
patch; along an edge of a cell the crossing is found on the chord.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from recon.geometry.contour_map import ContourMap
from recon.geometry.patches import COLLAPSED
from recon.terrain.ground import Terrain

__all__ = ["contours_at", "islands_above", "welded_triangles"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

CELLS = 4  # of a patch in either direction
INSIDE = np.array([0.25, 0.5, 0.75])


def welded_triangles(terrain: Terrain, steps: int = CELLS) -> tuple[Floats, Ints]:
    """(n, 3) points of the ground in map coordinates and (m, 3) triangles that share their corners across patches."""
    layout = terrain.layout
    n_vertices, n_edges, inner = len(terrain.tiling.points), len(terrain.tiling.edges), steps - 1
    number = np.empty((terrain.n_patches, steps + 1, steps + 1), dtype=np.int64)
    own = n_vertices + n_edges * inner
    number[:, 1:-1, 1:-1] = own + np.arange(terrain.n_patches * inner * inner).reshape(-1, inner, inner)
    places: tuple[Any, ...] = (np.s_[:, 1:-1, 0], np.s_[:, -1, 1:-1], np.s_[:, 1:-1, -1], np.s_[:, 0, 1:-1])
    along = np.arange(inner)
    for side, place in enumerate(places):
        edge = layout.side_edges[:, side]
        forward = layout.side_forward[:, side][:, None]
        row = n_vertices + edge[:, None] * inner + np.where(forward, along, inner - 1 - along)
        number[place] = np.where(edge[:, None] == COLLAPSED, layout.corners[:, 3][:, None], row)
    for corner, (i, j) in enumerate(((0, 0), (-1, 0), (-1, -1), (0, -1))):
        number[:, i, j] = layout.corners[:, corner]
    t = np.linspace(0.0, 1.0, steps + 1)
    points = np.zeros((own + terrain.n_patches * inner * inner, 3))
    for part in terrain.nets:
        points[number[part.rows]] = part.grid(t)
    points[:n_vertices, 2] = terrain.jets.height  # to the last bit
    a, b, c, d = number[:, :-1, :-1], number[:, 1:, :-1], number[:, 1:, 1:], number[:, :-1, 1:]
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    faces = faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])]
    return points + np.r_[terrain.origin, 0.0], faces


def contours_at(terrain: Terrain, heights: Sequence[float], *, steps: int = CELLS) -> ContourMap | None:
    """Contours of the ground at the given heights, in map coordinates, uphill to the left; None where it has none.

    steps  cells of a patch in either direction: contours are found on the chords of their edges
    """
    points, faces = welded_triangles(terrain, steps)
    lines, levels = [], []
    for height in heights:
        for line in _crossings(points, faces, float(height)):
            lines.append(line)
            levels.append(float(height))
    if not lines:
        return None
    return ContourMap(lines, levels, terrain.extent + terrain.origin, terrain.crs)


def _crossings(points: Floats, faces: Ints, height: float) -> list[Floats]:
    above = points[:, 2] >= height
    count = above[faces].sum(axis=1)
    cut = faces[(count == 1) | (count == 2)]
    lone = np.where((above[cut].sum(axis=1) == 1)[:, None], above[cut], ~above[cut])
    turn = np.argmax(lone, axis=1)[:, None]
    a, b, c = np.take_along_axis(cut, (turn + np.arange(3)) % 3, axis=1).T
    up = above[a]
    first, last = np.column_stack([a, b]), np.column_stack([a, c])
    begin = np.where(up[:, None], first, last)  # with the ground above to the left
    end = np.where(up[:, None], last, first)
    n = len(points)
    keys = [pair.min(axis=1) * n + pair.max(axis=1) for pair in (begin, end)]
    ahead = dict(zip(keys[0].tolist(), keys[1].tolist()))
    chains = _chained(ahead)
    out = []
    for chain in chains:
        first, second = np.divmod(np.array(chain), n)
        low, high = points[first], points[second]
        share = (height - low[:, 2]) / (high[:, 2] - low[:, 2])
        line = low[:, :2] + share[:, None] * (high - low)[:, :2]
        line = line[np.r_[True, (np.diff(line, axis=0) != 0).any(axis=1)]]
        if len(line) > 1:
            out.append(line)
    return out


def _chained(ahead: dict[int, int]) -> list[list[int]]:
    """Chains of keys, each followed by the next; the first key again at the end of a closed one."""
    ends = set(ahead.values())
    starts = [key for key in ahead if key not in ends]
    chains = []
    while ahead:
        key = starts.pop() if starts else next(iter(ahead))
        chain = [key]
        while chain[-1] in ahead:
            chain.append(ahead.pop(chain[-1]))
        chains.append(chain)
    return chains


def islands_above(terrain: Terrain, level: float) -> list[Terrain]:
    """The connected parts of a ground above a level that is one of its contours' heights, the largest first."""
    middle = np.empty(terrain.n_patches)
    for part in terrain.nets:
        middle[part.rows] = part.heights(INSIDE).mean(axis=(1, 2))
    strip = terrain.strip[terrain.layout.face]
    total = np.bincount(strip, middle - level) / np.maximum(np.bincount(strip), 1)
    kept = np.flatnonzero(total[strip] > 0)
    sides = terrain.layout.side_edges[kept]
    used = sides != COLLAPSED
    n_edges = len(terrain.tiling.edges)
    row = np.broadcast_to(np.arange(len(kept))[:, None], sides.shape)[used]
    graph = coo_array((np.ones(used.sum()), (row, sides[used])), shape=(len(kept), n_edges)).tocsr()
    n_parts, label = connected_components(graph @ graph.T, directed=False)
    sizes = np.bincount(label, minlength=n_parts)
    return [_only(terrain, kept[label == part]) for part in np.argsort(-sizes, kind="stable").tolist()]


def _only(terrain: Terrain, rows: Ints) -> Terrain:
    place = np.full(terrain.n_patches, -1)
    place[rows] = np.arange(len(rows))
    nets = tuple(part.part(kept := place[part.rows] >= 0, place[part.rows[kept]]) for part in terrain.nets)
    return replace(terrain, layout=terrain.layout.part(rows), nets=nets)

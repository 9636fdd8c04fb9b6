"""Surfaces laid over rectangles of quads, joined along the edges of the quads.

+---+---+---+        a side of a tile is a row of quad edges; it is cut where a corner of any tile lies, and what
|   A   | B |        is left between two cuts has the same tiles on both sides: one edge of the mosaic
+   .   +---+
|       | C |        the row of an edge is named by the smallest of its quad edges, from either side
+---+---+---+
"""

from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from recon.geometry.bspline import BSplineCurve, BSplineSurface
from recon.geometry.patches import PatchMosaic
from recon.subdivision.sheets import edge_numbers

__all__ = ["Tile", "joined"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Tile(NamedTuple):
    """A surface over quads; parameters count quads: u from 0 to m, v from 0 to n.

    faces   (n, m) the quads, row by row, and `turns` (n, m) the side of each that lies at the bottom
    sides   points of the curves along the four sides, in the sides' direction
    part    curve of a part of a side: its points, first quad, last quad
    """

    faces: Ints
    turns: Ints
    surface: BSplineSurface
    sides: tuple[Floats, Floats, Floats, Floats]
    part: Callable[[Floats, int, int], BSplineCurve]


class _Row(NamedTuple):
    """The quad edges along one side of a tile, in the side's direction, and the vertices between them."""

    edges: list[int]
    vertices: list[int]


def joined(faces: Ints, across: Ints, smooth: NDArray[np.bool_], tiles: list[Tile]) -> PatchMosaic:
    """The tiles with the edges that they share; edges take their curve from the tile that comes first.

    faces, across  (F, 4) quads, and the sides across them, over vertices that creases do not part
    smooth         (F, 4) whether the surface is smooth across each side
    """
    numbers, n_edges = edge_numbers(across)
    is_smooth = np.zeros(n_edges, dtype=bool)
    is_smooth[numbers[smooth]] = True
    rows = [_side_rows(tile, faces, numbers) for tile in tiles]
    ends = np.zeros(int(faces.max()) + 1, dtype=bool)
    for four in rows:
        for row in four:
            ends[[row.vertices[0], row.vertices[-1]]] = True
    curves: list[BSplineCurve] = []
    pairs: list[tuple[int, int]] = []
    firsts: list[tuple[int, int]] = []  # first quad edge and start of every edge
    known: dict[int, int] = {}
    starts, uses, forward, ranges, creases = [0], [], [], [], []
    for tile, four in zip(tiles, rows):
        for side, row in enumerate(four):
            cuts = [k for k, v in enumerate(row.vertices) if ends[v]]
            for a, b in pairwise(cuts):
                key, first = min(row.edges[a:b]), (row.edges[a], row.vertices[a])
                e = known.setdefault(key, len(curves))
                if e == len(curves):
                    curves.append(tile.part(tile.sides[side], a, b))
                    pairs.append((row.vertices[a], row.vertices[b]))
                    firsts.append(first)
                    creases.append(bool(is_smooth[key]))
                along = firsts[e] == first
                uses.append(e)
                forward.append(along)
                ranges.append((a, b) if along else (b, a))
            starts.append(len(uses))
    used, corners = np.unique(np.array(pairs), return_inverse=True)
    vertices = np.empty((len(used), 3))
    for (a, b), curve in zip(corners.reshape(-1, 2).tolist(), curves):
        vertices[a], vertices[b] = curve.control_points[0], curve.control_points[-1]
    return PatchMosaic(
        tuple(tile.surface for tile in tiles),
        vertices,
        tuple(curves),
        corners.reshape(-1, 2),
        np.array(creases),
        np.array(starts),
        np.array(uses),
        np.array(forward),
        np.array(ranges, dtype=np.float64),
    )


def _side_rows(tile: Tile, faces: Ints, numbers: Ints) -> list[_Row]:
    strips = (
        (tile.faces[0], tile.turns[0]),
        (tile.faces[:, -1], tile.turns[:, -1]),
        (tile.faces[-1], tile.turns[-1]),
        (tile.faces[:, 0], tile.turns[:, 0]),
    )
    rows = []
    for side, (quads, turns) in enumerate(strips):
        own = (side + turns) % 4
        start, end = faces[quads, own], faces[quads, (own + 1) % 4]
        if side >= 2:  # quads run around themselves, against the direction of these sides
            start, end = end, start
        rows.append(_Row(numbers[quads, own].tolist(), [int(start[0]), *end.tolist()]))
    return rows

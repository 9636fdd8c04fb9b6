"""Surfaces laid over groups of faces of a mesh, joined along the edges of the mesh.

+---+---+---+        a side of a tile is a row of mesh edges; it is cut where a corner of any tile lies, and what
|   A   | B |        is left between two cuts has the same tiles on both sides: one edge of the mosaic
+   .   +---+
|       | C |        the row of an edge is named by the smallest of its mesh edges, from either side
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

__all__ = ["Strip", "Tile", "joined"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Strip(NamedTuple):
    """Sides of faces, one after the other along the side of a tile.

    faces, sides  (m,) the faces and the side of each that is meant, in the direction of the tile's side
    along         whether the sides of the faces run in that direction
    """

    faces: Ints
    sides: Ints
    along: bool


class Tile(NamedTuple):
    """A surface over faces of a mesh; the parameter along a side counts the mesh edges there.

    strips  what lies along its four sides; None where a side is collapsed to a point
    sides   points of the curves along the sides, in the sides' direction
    part    curve of a part of a side: its points, first mesh edge, last mesh edge
    """

    surface: BSplineSurface
    strips: tuple[Strip | None, ...]
    sides: tuple[Floats, ...]
    part: Callable[[Floats, int, int], BSplineCurve]


class _Row(NamedTuple):
    """The mesh edges along one side of a tile, in the side's direction, and the vertices between them."""

    edges: list[int]
    vertices: list[int]


def joined(faces: Ints, across: Ints, smooth: NDArray[np.bool_], tiles: list[Tile]) -> PatchMosaic:
    """The tiles with the edges that they share; edges take their curve from the tile that comes first.

    faces, across  (F, k) faces, and the sides across them, over vertices that creases do not part
    smooth         (F, k) whether the surface is smooth across each side
    """
    numbers, n_edges = edge_numbers(across)
    is_smooth = np.zeros(n_edges, dtype=bool)
    is_smooth[numbers[smooth]] = True
    rows = [[_row(strip, faces, numbers) for strip in tile.strips] for tile in tiles]
    ends = np.zeros(int(faces.max()) + 1, dtype=bool)
    for four in rows:
        for row in four:
            if row.vertices:
                ends[[row.vertices[0], row.vertices[-1]]] = True
    curves: list[BSplineCurve] = []
    pairs: list[tuple[int, int]] = []
    firsts: list[tuple[int, int]] = []  # first mesh edge and start of every edge
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


def _row(strip: Strip | None, faces: Ints, numbers: Ints) -> _Row:
    """The row along a side; empty where there is no strip."""
    if strip is None:
        return _Row([], [])
    owners, sides = strip.faces, strip.sides
    start, end = faces[owners, sides], faces[owners, (sides + 1) % faces.shape[1]]
    if not strip.along:
        start, end = end, start
    return _Row(numbers[owners, sides].tolist(), [int(start[0]), *end.tolist()])

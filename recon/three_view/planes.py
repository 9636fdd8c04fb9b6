"""Candidate planes: those of two candidate edges that meet at a vertex (paper, 4.3: a face's edges lie in a plane).

Planes across a coordinate axis are told apart by their coordinate, exactly. A slanted plane comes from the widest pair
of edges that spans it. Every vertex within two snaps of it lies on it from then on, since the vertex has moved by one
and the plane by another; pairs of edges whose three vertices do are not asked again.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.three_view.edges import Wireframe
from recon.three_view.runs import SLACK
from recon.three_view.tables import ranges

__all__ = ["Planes", "candidate_planes", "edges_in_planes", "plane_positions", "sides_of"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

FRAMES = np.array([[1, 2], [2, 0], [0, 1]])


@dataclass(frozen=True, eq=False)
class Planes:
    """Planes n·x = d and what lies on them.

    normals  (p, 3) unit normals
    offsets  (p,)
    sides    (n, p) for each vertex -1, 0 or +1: behind, on, or in front of each plane
    """

    normals: Floats
    offsets: Floats
    sides: NDArray[np.int8]

    def across(self) -> Ints:
        """(p,) coordinate axis that each plane is most nearly normal to: along it the plane is mapped flat."""
        return np.asarray(np.argmax(np.abs(self.normals), axis=1), dtype=np.int64)


def sides_of(points: Floats, normals: Floats, offsets: Floats, snap: float) -> NDArray[np.int8]:
    """(n, p) side of each plane that each point is on, 0 within two snaps; across an axis only equal coordinates."""
    height = points @ normals.T - offsets
    reach = np.where((np.abs(normals) == 1).any(axis=1), snap * 1e-6, SLACK * snap)
    return np.asarray(np.where(np.abs(height) <= reach, 0, np.sign(height)), dtype=np.int8)


def edges_in_planes(edges: Ints, sides: NDArray[np.int8]) -> tuple[Ints, Ints]:
    """All pairs (edge, plane) where both ends of the edge lie on the plane, by edge."""
    vertex, plane = np.nonzero(sides == 0)
    edge, slot = ranges(*np.searchsorted(vertex, [edges[:, 0], edges[:, 0] + 1]))
    plane = plane[slot]
    both = sides[edges[edge, 1], plane] == 0
    return edge[both], plane[both]


def plane_positions(points: Floats, across: Ints, upward: NDArray[np.bool_]) -> Floats:
    """(n, 2) points of planes mapped along a coordinate axis; loops keep the sense seen from the normal's tip."""
    frame = np.where(upward[:, None], FRAMES[across], FRAMES[across][:, ::-1])
    return np.take_along_axis(points, frame, axis=1)


def candidate_planes(wire: Wireframe, snap: float) -> Planes:
    """Every plane that two edges at a vertex span and that at least three edges lie in."""
    corner, a, b = _edge_pairs(wire.edges, len(wire.vertices))
    x = wire.vertices
    p, q = x[a] - x[corner], x[b] - x[corner]
    cross = np.cross(p, q)
    flat = np.linalg.norm(cross, axis=1) <= snap * np.maximum(np.linalg.norm(p, axis=1), np.linalg.norm(q, axis=1))
    level = (p == 0) & (q == 0)
    normal_rows, offset_rows = [], []
    for axis in range(3):
        values = np.unique(x[corner[level[:, axis] & ~flat], axis])
        normal_rows.append(np.tile(np.eye(3)[axis], (len(values), 1)))
        offset_rows.append(values)
    slanted = np.flatnonzero(~flat & ~level.any(axis=1))
    slanted = slanted[np.argsort(-np.linalg.norm(cross[slanted], axis=1), kind="stable")]
    triples = np.column_stack([corner, a, b])[slanted]
    n, d = _slanted_planes(x, triples, snap)
    normals, offsets = np.concatenate([*normal_rows, n]), np.concatenate([*offset_rows, d])
    sides = sides_of(x, normals, offsets, snap)
    _, plane = edges_in_planes(wire.edges, sides)
    held = np.bincount(plane, minlength=len(normals))
    keep = held >= 3
    return Planes(normals[keep], offsets[keep], sides[:, keep])


def _edge_pairs(edges: Ints, n: int) -> tuple[Ints, Ints, Ints]:
    """Every vertex with two of its neighbours."""
    ends = np.concatenate([edges, edges[:, ::-1]])
    ends = ends[np.argsort(ends[:, 0], kind="stable")]
    starts = np.searchsorted(ends[:, 0], np.arange(n + 1))
    count = np.diff(starts)
    rows = [np.empty((0, 3), dtype=np.int64)]
    for valence in np.unique(count[count > 1]):
        at = np.flatnonzero(count == valence)
        i, j = np.triu_indices(valence, 1)
        near = ends[starts[at][:, None] + np.arange(valence), 1]
        rows.append(np.column_stack([np.repeat(at, len(i)), near[:, i].ravel(), near[:, j].ravel()]))
    corner, a, b = np.concatenate(rows).T
    return corner, a, b


def _slanted_planes(x: Floats, triples: Ints, snap: float) -> tuple[Floats, Floats]:
    """Planes through triples of vertices, widest first, leaving out the triples that lie in one found before."""
    normals, offsets = [np.empty((0, 3))], [np.empty(0)]
    while len(triples):
        a, b, c = x[triples[0]]
        normal = np.cross(b - a, c - a)
        normal /= np.linalg.norm(normal)
        on = np.abs(x @ normal - normal @ a) <= SLACK * snap
        refined = _fitted(x[on], normal)
        normals.append(refined[0][None])
        offsets.append(np.array([refined[1]]))
        on |= np.abs(x @ refined[0] - refined[1]) <= SLACK * snap
        on[triples[0]] = True
        triples = triples[~on[triples].all(axis=1)]
    return np.concatenate(normals), np.concatenate(offsets)


def _fitted(points: Floats, normal: Floats) -> tuple[Floats, float]:
    """Least-squares plane of points that lie close to a plane of known normal; normals keep exact zeros."""
    centre = points.mean(axis=0)
    rest = points - centre
    ways = normal != 0
    _, _, axes = np.linalg.svd(rest[:, ways], full_matrices=False)
    fit = np.zeros(3)
    fit[ways] = axes[-1] * (1 if axes[-1] @ normal[ways] > 0 else -1)
    return fit, float(fit @ centre)

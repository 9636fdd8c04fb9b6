"""Terraces off: within the half voxel that a binary grid leaves open, the smoothest surface.

    o----x------.     a vertex may lie anywhere on its own grid edge between solid o and empty . without any voxel
       <-|->          changing sides; rounds of smoothing move it there, along the edge and no farther

A vertex moves along its edge direction a so that it meets the plane, with its own normal n, through the place that the
smoothing asks for: by ((wanted - x)·n) / (a·n).  Membrane rounds ask for the mean m of the neighbours, and shrink holes
if they last; bilaplacian rounds ask for what makes m - x vary evenly, and keep curvature.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import sparse

from recon.numerics.halfedges import vertex_adjacency, vertex_normals
from recon.voxel_mesh.marching_cubes import GridSurface

__all__ = ["without_terraces"]

Floats = NDArray[np.float64]

MEMBRANE_ROUNDS, BILAPLACIAN_ROUNDS = 12, 80
REACH = 0.499  # of a grid edge, to either side of its middle
NORMALS_EVERY = 8


def without_terraces(surface: GridSurface, proportions: Floats) -> Floats:
    """(V, 3) places of the vertices on their grid edges that make the surface smooth, in voxels.

    Promises  every voxel centre stays on its side.  Sharp edges of the part are rounded within the half voxel.
    """
    middle = surface.vertices
    length = proportions[surface.edge_axis]
    adjacency = sparse.csr_array(vertex_adjacency(surface.face_vertices, len(middle)))
    links = adjacency.indptr.astype(np.int64), adjacency.indices.astype(np.int64)
    slide = np.zeros(len(middle))
    places = middle.copy()
    for number in range(MEMBRANE_ROUNDS + BILAPLACIAN_ROUNDS):
        if number % NORMALS_EVERY == 0:
            normal = vertex_normals(places, surface.face_vertices)
        bending = number >= MEMBRANE_ROUNDS
        _round(places, slide, middle, surface.edge_axis, length, normal, *links, bending)
    return places


@njit(cache=True)
def _round(
    places: Floats,
    slide: Floats,
    middle: Floats,
    axis: NDArray[np.int64],
    length: Floats,
    normal: Floats,
    start: NDArray[np.int64],
    neighbour: NDArray[np.int64],
    bending: bool,
) -> None:  # pragma: no cover - compiled
    """One round over all vertices, all moved at once."""
    n = len(places)
    lap = np.zeros((n, 3))
    for i in range(n):
        m = start[i + 1] - start[i]
        for e in range(start[i], start[i + 1]):
            for k in range(3):
                lap[i, k] += places[neighbour[e], k] / m
        for k in range(3):
            lap[i, k] -= places[i, k]
    for i in range(n):
        pull = 0.0
        for k in range(3):
            wanted = lap[i, k]
            if bending:
                m = start[i + 1] - start[i]
                for e in range(start[i], start[i + 1]):
                    wanted -= lap[neighbour[e], k] / m
                wanted *= 0.6
            pull += wanted * normal[i, k]
        along = normal[i, axis[i]]
        along = along if abs(along) > 0.2 else (0.2 if along >= 0 else -0.2)
        reach = REACH * length[i]
        slide[i] = min(max(slide[i] + pull / along, -reach), reach)
    for i in range(n):
        places[i, axis[i]] = middle[i, axis[i]] + slide[i]

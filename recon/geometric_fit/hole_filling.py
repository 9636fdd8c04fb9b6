"""Holes of a scan closed by a smooth skin, where that is asked for.

    border loop of n points      rings of n points each, shrinking to the middle      thin plate

         .--.--.                      .--.--.
        /       \\                    / .--.  \\                  the squared Laplacian is least with the
       .         .        -->        . | o  |  .       -->       border and the points around it fixed, so
        \\       /                    \\ '--'  /                 the skin leaves the scan tangentially
         '--.--'                      '--.--'

Rings make a disc of triangles whatever the shape of the loop.
"""

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu

from recon.geometry.mesh import TriangleMesh
from recon.numerics.halfedges import boundary_loops

__all__ = ["close_holes", "cotangents", "fill_loops"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

MOST_RINGS = 40
LEAST_COTANGENT = 1e-2  # a sliver keeps a little of its weight: the skin must not tear there


def close_holes(scan: TriangleMesh) -> tuple[TriangleMesh, int]:
    """The scan with every hole filled, and how many there were; new vertices follow the old ones."""
    loops = boundary_loops(scan.face_vertices)
    return fill_loops(scan, loops), len(loops)


def fill_loops(scan: TriangleMesh, loops: list[Ints]) -> TriangleMesh:
    """The scan with these of its borders filled; new vertices and faces follow the old ones."""
    if not loops:
        return scan
    vertices, faces = scan.vertices, scan.face_vertices
    for loop in loops:
        vertices, faces = _with_rings(vertices, faces, loop)
    return TriangleMesh(_thin_plate(vertices, faces, scan.n_vertices), faces, scan.name)


def _with_rings(vertices: Floats, faces: Ints, loop: Ints) -> tuple[Floats, Ints]:
    """A disc of rings in a loop that has the surface to its left, so the disc runs the other way round."""
    rim = loop[::-1]
    n = len(rim)
    n_rings = int(np.clip(round(n / (2.0 * np.pi)), 1, MOST_RINGS))
    middle = vertices[rim].mean(axis=0)
    share = np.arange(1, n_rings)[:, None, None] / n_rings
    rings = (1.0 - share) * vertices[rim] + share * middle
    first = len(vertices)
    number = np.concatenate([rim[None], first + np.arange((n_rings - 1) * n).reshape(-1, n)])
    top = first + (n_rings - 1) * n
    inner, outer = number[1:], number[:-1]
    following = np.roll(outer, -1, axis=1)
    bands = [
        np.stack([outer, following, inner], axis=-1).reshape(-1, 3),
        np.stack([following, np.roll(inner, -1, axis=1), inner], axis=-1).reshape(-1, 3),
    ]
    cap = np.stack([number[-1], np.roll(number[-1], -1), np.full(n, top)], axis=1)
    return np.concatenate([vertices, rings.reshape(-1, 3), middle[None]]), np.concatenate([faces, *bands, cap])


def _thin_plate(vertices: Floats, faces: Ints, n_fixed: int) -> Floats:
    """Vertices from n_fixed on moved to where the squared Laplacian is least, the others as they are."""
    weights = cotangents(vertices, faces)
    laplacian = sparse.diags_array(np.asarray(weights.sum(axis=1)).ravel()) - weights
    near = np.unique(faces[(faces >= n_fixed).any(axis=1)])
    # the integral of the squared Laplacian: each row is an integral over the area around its vertex
    a, b, c = vertices[faces].transpose(1, 0, 2)
    area = np.bincount(faces.ravel(), np.repeat(np.linalg.norm(np.cross(b - a, c - a), axis=1), 3))[near]
    scale = sparse.diags_array(1.0 / np.sqrt(np.maximum(area, 1e-12 * area.max())))
    rows = sparse.csc_array(scale @ sparse.csr_array(laplacian)[near])
    free, held = rows[:, n_fixed:], rows[:, :n_fixed]
    moved = vertices.copy()
    moved[n_fixed:] = splu(sparse.csc_array(free.T @ free)).solve(-(free.T @ (held @ vertices[:n_fixed])))
    return moved


def cotangents(vertices: Floats, faces: Ints) -> sparse.csr_array:
    """(V, V) half the sum of the cotangents across each edge."""
    rows, columns, values = [], [], []
    for i in range(3):
        a, b, c = (faces[:, (i + k) % 3] for k in range(3))
        one, two = vertices[a] - vertices[c], vertices[b] - vertices[c]
        double_area = np.linalg.norm(np.cross(one, two), axis=1)
        cotangent = np.einsum("ij,ij->i", one, two) / np.maximum(double_area, 1e-300)
        rows += [a, b]
        columns += [b, a]
        values += [0.5 * np.clip(cotangent, LEAST_COTANGENT, 1.0 / LEAST_COTANGENT)] * 2
    shape = (len(vertices), len(vertices))
    entries = (np.concatenate(rows), np.concatenate(columns))
    return sparse.csr_array(sparse.coo_array((np.concatenate(values), entries), shape=shape))

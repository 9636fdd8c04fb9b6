"""One step of Catmull-Clark's scheme on faces with any number of corners: after it all faces are quadrilaterals.

Same masks as `catmull_clark`, a vertex of n edges going to (F + 2 E + (n - 3) V) / n with F the mean of the middles of
its faces and E that of the middles of its edges.

Paper  [catmull1978]; [derose1998], sharp edges.
"""

import numpy as np
from numpy.typing import NDArray

from recon.errors import NotManifold
from recon.geometry.control_mesh import ControlMesh

__all__ = ["split_polygons"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def split_polygons(mesh: ControlMesh) -> ControlMesh:
    """The control mesh once refined, with the same limit surface: a quadrilateral for each corner of each face.

    Raises  NotManifold when an edge has more than two faces.
    """
    n, corner = mesh.n_vertices, mesh.face_corners
    following = mesh.next_corners()
    face = np.repeat(np.arange(mesh.n_faces), np.diff(mesh.face_starts))
    low, high = np.minimum(corner, corner[following]), np.maximum(corner, corner[following])
    keys, edge, uses = np.unique(low * n + high, return_inverse=True, return_counts=True)
    ends = np.stack([keys // n, keys % n], axis=1)
    if (uses > 2).any():
        place = mesh.vertices[ends[np.argmax(uses > 2)]].mean(axis=0)
        raise NotManifold("control mesh", "an edge has more than two faces", place.tolist())
    creases = np.sort(mesh.crease_edges, axis=1)
    sharp = (uses == 1) | np.isin(keys, creases[:, 0] * n + creases[:, 1])
    middles = _means(mesh.vertices[corner], face, mesh.n_faces)
    halves = mesh.vertices[ends].mean(axis=1)
    edge_points = np.where(sharp[:, None], halves, 0.5 * (halves + _means(middles[face], edge, len(keys))))
    moved = _moved(mesh, ends, sharp, (_means(middles[face], corner, n), halves))
    previous = np.empty_like(following)
    previous[following] = np.arange(len(following))
    first_edge, first_middle = n, n + len(keys)
    quads = np.stack([corner, first_edge + edge, first_middle + face, first_edge + edge[previous]], axis=1)
    number = np.searchsorted(keys, creases[:, 0] * n + creases[:, 1])
    halved = np.concatenate([np.stack([creases[:, i], first_edge + number], axis=1) for i in range(2)])
    points = np.concatenate([moved, edge_points, middles])
    return ControlMesh.from_faces(points, quads, crease_edges=halved, corner_vertices=_corners(mesh))


def _corners(mesh: ControlMesh) -> Ints:
    """Corners as marked, and the vertices of one face."""
    single = np.bincount(mesh.face_corners, minlength=mesh.n_vertices) == 1
    single[mesh.corner_vertices] = True
    return np.flatnonzero(single)


def _moved(mesh: ControlMesh, ends: Ints, sharp: NDArray[np.bool_], means: tuple[Floats, Floats]) -> Floats:
    """(V, 3) the vertices after the step; means: of the faces around each, and the middles of the edges."""
    of_faces, halves = means
    n, v = mesh.n_vertices, mesh.vertices
    valence = np.maximum(np.bincount(ends.ravel(), minlength=n), 1)[:, None]
    of_edges = _means(np.repeat(halves, 2, axis=0), ends.ravel(), n)
    smooth = (of_faces + 2.0 * of_edges + (valence - 3.0) * v) / valence
    sharp_ends = ends[sharp]
    n_sharp = np.bincount(sharp_ends.ravel(), minlength=n)
    along = 0.5 * v + 0.5 * _means(np.repeat(halves[sharp], 2, axis=0), sharp_ends.ravel(), n)
    still = n_sharp > 2
    marked = _corners(mesh)
    still[marked[n_sharp[marked] > 0]] = True
    return np.where(still[:, None], v, np.where((n_sharp == 2)[:, None], along, smooth))


def _means(values: Floats, owner: Ints, n: int) -> Floats:
    """(n, 3) means of the values (m, 3) of each owner; zero where it has none."""
    count = np.maximum(np.bincount(owner, minlength=n), 1)
    return np.stack([np.bincount(owner, column, n) for column in values.T], axis=1) / count[:, None]

"""One step of refinement of a control mesh whose faces have any number of corners, or of one of triangles.

`split_polygons`, Catmull-Clark's scheme: after it all faces are quadrilaterals. A vertex of n edges goes to
(F + 2 E + (n - 3) V) / n with F the mean of the middles of its faces and E that of the middles of its edges.

`split_triangles`, Loop's scheme: same masks and same order of the children as `loop`.

Both with the creases and corners of `semi_sharp`, which come out one step less sharp.

Paper  [catmull1978]; [loop1987].
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from recon.errors import BadGeometry
from recon.geometry.control_mesh import ControlMesh
from recon.subdivision.loop import vertex_weight
from recon.subdivision.semi_sharp import MeshEdges, firm_points, halved_creases, mesh_edges, sharpness_of

__all__ = ["MAX_FACES", "n_steps", "refined", "settled", "split_polygons", "split_triangles"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

MAX_FACES = 250_000


def split_polygons(mesh: ControlMesh) -> ControlMesh:
    """The control mesh once refined, with the same limit surface: a quadrilateral for each corner of each face.

    Raises  NotManifold when an edge has more than two faces.
    """
    n, corner, edges = mesh.n_vertices, mesh.face_corners, mesh_edges(mesh)
    following = mesh.next_corners()
    face = np.repeat(np.arange(mesh.n_faces), np.diff(mesh.face_starts))
    sharpness, single = sharpness_of(mesh, edges), np.bincount(corner, minlength=n) == 1
    sharpness.vertices[single] = np.inf
    middles = _means(mesh.vertices[corner], face, mesh.n_faces)
    halves = mesh.vertices[edges.ends].mean(axis=1)
    smooth_edges = 0.5 * (halves + _means(middles[face], edges.number, len(edges.ends)))
    smooth = _smooth_vertices(mesh, edges, _means(middles[face], corner, n), halves)
    moved, edge_points = firm_points(mesh, edges, sharpness, (smooth, smooth_edges))
    previous = np.empty_like(following)
    previous[following] = np.arange(len(following))
    e, first_middle = n + edges.number, n + len(edges.ends)
    quads = np.stack([corner, e, first_middle + face, e[previous]], axis=1)
    marks = halved_creases(mesh, edges, n)
    marks["corner_vertices"] = np.concatenate([marks["corner_vertices"], np.flatnonzero(single)])
    marks["corner_sharpness"] = np.concatenate([marks["corner_sharpness"], np.full(single.sum(), np.inf)])
    return ControlMesh.from_faces(np.concatenate([moved, edge_points, middles]), quads, **marks)


def _smooth_vertices(mesh: ControlMesh, edges: MeshEdges, of_faces: Floats, halves: Floats) -> Floats:
    """(V, 3); of_faces (V, 3) means of the middles of their faces, halves (E, 3) middles of the edges."""
    n, ends = mesh.n_vertices, edges.ends.ravel()
    valence = np.maximum(np.bincount(ends, minlength=n), 1)[:, None]
    of_edges = _means(np.repeat(halves, 2, axis=0), ends, n)
    return (of_faces + 2.0 * of_edges + (valence - 3.0) * mesh.vertices) / valence


def split_triangles(mesh: ControlMesh) -> ControlMesh:
    """The control mesh of triangles once refined, with the same limit surface: four triangles for each.

    Raises  BadGeometry when a face is no triangle; NotManifold when an edge has more than two faces.
    """
    faces, n, edges = mesh.faces_of(3), mesh.n_vertices, mesh_edges(mesh)
    number, ends = edges.number.reshape(-1, 3), edges.ends
    beyond = _sums(mesh.vertices[np.roll(faces, -2, axis=1).ravel()], number.ravel(), len(ends))
    smooth_edges = 0.375 * mesh.vertices[ends].sum(axis=1) + 0.125 * beyond
    valence = np.maximum(np.bincount(ends.ravel(), minlength=n), 1)
    b = vertex_weight(valence)[:, None]
    around = _sums(mesh.vertices[ends[:, ::-1].ravel()], ends.ravel(), n)
    smooth = (1.0 - valence[:, None] * b) * mesh.vertices + b * around
    moved, edge_points = firm_points(mesh, edges, sharpness_of(mesh, edges), (smooth, smooth_edges))
    e = n + number
    corners = [np.stack([faces[:, i], e[:, i], e[:, i - 1]], axis=1) for i in range(3)]
    children = np.stack([*corners, e], axis=1).reshape(-1, 3)
    return ControlMesh.from_faces(np.concatenate([moved, edge_points]), children, **halved_creases(mesh, edges, n))


def n_steps(mesh: ControlMesh) -> int:
    """Steps of refinement after which no crease or corner is semi-sharp."""
    both = np.concatenate([mesh.crease_sharpness, mesh.corner_sharpness])
    return int(np.ceil(both[np.isfinite(both)].max(initial=0.0)))


def refined(mesh: ControlMesh, split: Callable[[ControlMesh], ControlMesh]) -> ControlMesh:
    """One step; raises BadGeometry when semi-sharp creases ask for it beyond 250,000 faces."""
    if mesh.is_semi_sharp and 4 * mesh.n_faces > MAX_FACES:
        problem = f"{n_steps(mesh)} more steps until its creases are smooth take over {MAX_FACES:,} faces"
        raise BadGeometry("control mesh", f"{problem}; lower their sharpness, or make it 10, which is sharp")
    return split(mesh)


def settled(mesh: ControlMesh, split: Callable[[ControlMesh], ControlMesh]) -> ControlMesh:
    """The mesh refined until no crease or corner is semi-sharp; raises as `refined` does."""
    while mesh.is_semi_sharp:
        mesh = refined(mesh, split)
    return mesh


def _sums(values: Floats, owner: Ints, n: int) -> Floats:
    """(n, 3) sums of the values (m, 3) of each owner."""
    return np.stack([np.bincount(owner, column, n) for column in values.T], axis=1)


def _means(values: Floats, owner: Ints, n: int) -> Floats:
    """(n, 3) means of the values of each owner; zero where it has none."""
    return _sums(values, owner, n) / np.maximum(np.bincount(owner, minlength=n), 1)[:, None]

"""All sherds as one table of faces: the question a face asks its neighbours must not depend on which file it came from.

Two faces are neighbours when they share an edge within one sherd. Across sherds nothing is joined.

        /\\          faces 0 and 1 are a row of `pairs`;
       /0 \\         the edge they share runs from `pair_edges[:, 0]`
      /----\\        to `pair_edges[:, 1]` as face 0 goes round it
      \\ 1  /
       \\  /         every other edge here is a row of `border_edges`
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.errors import BadGeometry, NotManifold
from recon.geometry.mesh import TriangleMesh

__all__ = ["Assembly", "assemble", "label_groups", "steady_normals"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

FEW = 0.01  # share of faces on broken edges that may be left out without a word


@dataclass(frozen=True, eq=False)
class Assembly:
    """The faces of all sherds.

    vertices      (V, 3)
    faces         (F, 3) vertex numbers
    vertex_sherd  (V,) and face_sherd (F,): number of the sherd
    centres       (F, 3) and normals (F, 3), unit, and areas (F,)
    pairs         (P, 2) neighbouring faces; pair_edges (P, 2) the edge between them, directed as the first face runs
    border_faces  (B,) and border_edges (B, 2): edges with one face only, directed as that face runs
    spacing       median edge length
    """

    vertices: Floats
    faces: Ints
    vertex_sherd: Ints
    face_sherd: Ints
    centres: Floats
    normals: Floats
    areas: Floats
    pairs: Ints
    pair_edges: Ints
    border_faces: Ints
    border_edges: Ints
    spacing: float

    @property
    def n_faces(self) -> int:
        return len(self.faces)

    @property
    def n_sherds(self) -> int:
        return int(self.vertex_sherd.max()) + 1


def assemble(sherds: Sequence[TriangleMesh]) -> Assembly:
    """Put the faces of all sherds into one table; faces without area and the few on broken edges are left out.

    Raises  BadGeometry when there is no face; NotManifold when edges are shared by more than two faces, or by two that
            face opposite ways, or when the triangles are not joined to each other.
    """
    if not any(sherd.n_faces for sherd in sherds):
        raise BadGeometry("sherds", "there is not a single triangle in them")
    first = np.cumsum([0, *(sherd.n_vertices for sherd in sherds)])
    vertices = np.concatenate([sherd.vertices for sherd in sherds])
    faces = np.concatenate([sherd.face_vertices + start for sherd, start in zip(sherds, first)])
    owner = np.repeat(np.arange(len(sherds)), [sherd.n_vertices for sherd in sherds])
    across = _area_vectors(vertices, faces)
    faces = faces[np.linalg.norm(across, axis=1) > 0.0]
    if not len(faces):
        raise BadGeometry("sherds", "not one of their triangles has an area")
    faces = _without_broken_edges(vertices, faces)
    return _table(vertices, faces, owner)


def _table(vertices: Floats, faces: Ints, owner: Ints) -> Assembly:
    begin, end, left, right = _edge_sides(faces)
    border = right < 0
    if border.sum() > 1.5 * len(faces) + 3:
        raise NotManifold("sherds", "most triangles are joined to nothing; merge equal vertices first", vertices[0])
    across = _area_vectors(vertices, faces)
    size = np.linalg.norm(across, axis=1)
    lengths = np.linalg.norm(vertices[begin] - vertices[end], axis=1)
    edges = np.stack([begin, end], axis=1)
    return Assembly(
        vertices=vertices,
        faces=faces,
        vertex_sherd=owner,
        face_sherd=owner[faces[:, 0]],
        centres=vertices[faces].mean(axis=1),
        normals=across / size[:, None],
        areas=size,
        pairs=np.stack([left, right], axis=1)[~border],
        pair_edges=edges[~border],
        border_faces=left[border],
        border_edges=edges[border],
        spacing=float(np.median(lengths)),
    )


def _area_vectors(vertices: Floats, faces: Ints) -> Floats:
    a, b, c = vertices[faces].transpose(1, 0, 2)
    return np.asarray(0.5 * np.cross(b - a, c - a))


def _directed_edges(faces: Ints) -> tuple[Ints, Ints, Ints]:
    """Begin, end and undirected number of the edges 0-1, 1-2, 2-0 of every face, edge by edge."""
    begin, end = faces.T.ravel(), faces[:, [1, 2, 0]].T.ravel()
    key = np.minimum(begin, end) * (faces.max() + 1) + np.maximum(begin, end)
    return begin, end, key


def _without_broken_edges(vertices: Floats, faces: Ints) -> Ints:
    """Leave out faces on an edge that has more than two faces, or two that run through it the same way."""
    begin, end, key = _directed_edges(faces)
    _, number, count = np.unique(key, return_inverse=True, return_counts=True)
    turns = np.bincount(number, weights=np.where(begin < end, 1.0, -1.0))
    broken = (count > 2) | ((count == 2) & (turns != 0))
    bad = broken[number].reshape(3, -1).any(axis=0)
    if bad.sum() > FEW * len(faces):
        where = vertices[faces[int(np.argmax(bad))]].mean(axis=0)
        raise NotManifold("sherds", f"{int(broken.sum())} edges have more than two faces or faces turned over", where)
    return faces[~bad]


def _edge_sides(faces: Ints) -> tuple[Ints, Ints, Ints, Ints]:
    """Each edge once: begin, end, the face that runs so, and the face on its other side or -1."""
    begin, end, key = _directed_edges(faces)
    face = np.tile(np.arange(len(faces)), 3)
    order = np.argsort(key, kind="stable")
    twice = np.flatnonzero(key[order][1:] == key[order][:-1])
    other = np.full(len(key), -1)
    other[order[twice]] = face[order[twice + 1]]
    again = np.zeros(len(key), dtype=bool)
    again[order[twice + 1]] = True
    return begin[~again], end[~again], face[~again], other[~again]


def steady_normals(table: Assembly, *, rounds: int = 3, angle: float = 0.35) -> Floats:
    """(F, 3) unit normals, averaged over neighbours that agree: noise goes, creases stay.

    angle   radians, the difference at which a neighbour's say has dropped to 0.6
    """
    i, j = table.pairs.T
    n = table.normals
    for _ in range(rounds):
        agree = np.exp(-((n[i] - n[j]) ** 2).sum(axis=1) / (2.0 * angle**2))
        total = n * table.areas[:, None]
        for axis in range(3):
            total[:, axis] += np.bincount(i, agree * table.areas[j] * n[j, axis], table.n_faces)
            total[:, axis] += np.bincount(j, agree * table.areas[i] * n[i, axis], table.n_faces)
        n = total / np.linalg.norm(total, axis=1, keepdims=True)
    return n


def label_groups(table: Assembly, labels: Ints) -> tuple[Ints, Floats]:
    """Number of the connected group of equal label every face belongs to, and the area of each group."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    i, j = table.pairs[labels[table.pairs[:, 0]] == labels[table.pairs[:, 1]]].T
    graph = coo_array((np.ones(len(i), dtype=np.int8), (i, j)), shape=(table.n_faces, table.n_faces))
    _, group = connected_components(graph, directed=False)
    return group.astype(np.int64), np.bincount(group, weights=table.areas).astype(np.float64)

"""Control meshes of quadrilaterals made for the tests: any valence from 3 up, any genus, open and closed, creased."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from recon.geometry.control_mesh import ControlMesh
from recon.numerics.halfedges import edge_table

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def drum(n: int, *, layers: int = 2) -> ControlMesh:
    """A closed drum whose two ends are n quadrilaterals around a vertex of valence n; 2 n vertices with three faces."""
    turn = np.pi * np.arange(2 * n) / n
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1) * np.where(np.arange(2 * n) % 2, 1.1, 0.9)[:, None]
    heights = np.linspace(-0.6, 0.6, layers + 1)
    rings = np.concatenate([np.column_stack([ring, np.full(2 * n, z)]) for z in heights])
    points = np.concatenate([rings, [[0.1, 0.0, -0.9], [0.0, 0.1, 0.8]]])
    i, following = np.arange(2 * n), (np.arange(2 * n) + 1) % (2 * n)
    faces = [np.stack([i, following, following + 2 * n, i + 2 * n], axis=1) + 2 * n * k for k in range(layers)]
    a = 2 * np.arange(n)
    top = 2 * n * layers
    ends = np.stack([a, a + 1, (a + 2) % (2 * n)], axis=1)
    upper = np.column_stack([np.full(n, len(rings) + 1), ends + top])
    lower = np.column_stack([np.full(n, len(rings)), ends[:, ::-1]])
    return ControlMesh.from_faces(points, np.concatenate([*faces, upper, lower]))


def boxes(cells: Iterable[tuple[int, int, int]]) -> ControlMesh:
    """The surface of a set of unit cubes, joined where they share a face."""
    filled = set(cells)
    corners: dict[tuple[int, int, int], int] = {}
    faces = []
    for cell in sorted(filled):
        for axis in range(3):
            for side in (0, 1):
                beyond = tuple(c + (2 * side - 1) * (k == axis) for k, c in enumerate(cell))
                if beyond not in filled:
                    b, c = (axis + 1) % 3, (axis + 2) % 3
                    square = [(0, 0), (1, 0), (1, 1), (0, 1)][:: 1 if side else -1]
                    place = [dict(zip((axis, b, c), (side, *s))) for s in square]
                    names = [(cell[0] + p[0], cell[1] + p[1], cell[2] + p[2]) for p in place]
                    faces.append([corners.setdefault(name, len(corners)) for name in names])
    return ControlMesh.from_faces(np.array(list(corners), dtype=np.float64), np.array(faces))


def with_handles(genus: int) -> ControlMesh:
    """A plate of cubes with `genus` square holes."""
    holes = {(2 * g + 1, 1, 0) for g in range(genus)}
    plate = {(x, y, 0) for x in range(2 * genus + 1) for y in range(3)} or {(0, 0, 0)}
    return boxes(plate - holes)


def without_faces(mesh: ControlMesh, dropped: Iterable[int]) -> ControlMesh:
    """The mesh with a hole: some faces and the vertices that only they use are left out."""
    faces = np.delete(mesh.faces_of(4), list(dropped), axis=0)
    used, numbers = np.unique(faces, return_inverse=True)
    return ControlMesh.from_faces(mesh.vertices[used], numbers.reshape(faces.shape))


def creased(mesh: ControlMesh, chosen: Ints) -> ControlMesh:
    """The mesh with a crease all around the chosen faces."""
    rim = edge_table(mesh.faces_of(4)[chosen])
    return ControlMesh.from_faces(mesh.vertices, mesh.faces_of(4), crease_edges=rim.edges[rim.uses == 1])


def shaken(mesh: ControlMesh, amount: float = 0.12, seed: int = 0) -> ControlMesh:
    """The mesh with its points moved at random, so that nothing about it is symmetric."""
    move = np.random.default_rng(seed).normal(size=mesh.vertices.shape)
    return mesh.with_vertices(mesh.vertices + amount * move)


def grid(columns: int, rows: int) -> ControlMesh:
    """An open sheet of columns x rows quadrilaterals with a wave for height."""
    x, y = (a.ravel() for a in np.meshgrid(np.arange(columns + 1.0), np.arange(rows + 1.0), indexing="ij"))
    points = np.column_stack([x, y, 0.5 * np.sin(x) * np.cos(0.7 * y)])
    first = (np.arange(columns)[:, None] * (rows + 1) + np.arange(rows)).ravel()
    faces = np.stack([first, first + rows + 1, first + rows + 2, first + 1], axis=1)
    return ControlMesh.from_faces(points, faces)

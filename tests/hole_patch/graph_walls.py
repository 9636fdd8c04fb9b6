"""Walls with a hole, generated as graphs z = f(x, y) over a square grid: their surface is known exactly."""

from collections.abc import Callable

import numpy as np

from recon.geometry.mesh import TriangleMesh
from recon.hole_patch.surroundings import HoleEdge, Wall

Height = Callable[[np.ndarray, np.ndarray], np.ndarray]


def plane(x, y):
    return 0.1 * x - 0.2 * y + 3.0


def cylinder(x, y, radius=40.0):
    return np.sqrt(radius**2 - x**2) - radius + 0.0 * y


def sphere(x, y, radius=40.0):
    return np.sqrt(radius**2 - x**2 - y**2) - radius


def paraboloid(x, y):
    return -(x**2) / 60.0 - y**2 / 90.0 + x * y / 200.0


def graph_wall(height: Height, *, half=24.0, steps=61, hole=8.0, matrix=None) -> Wall:
    """A square wall of side 2 half whose outside is up, a wavy round hole of about that radius cut in its middle."""
    at = np.linspace(-half, half, steps)
    x, y = (a.ravel() for a in np.meshgrid(at, at, indexing="ij"))
    i, j = np.meshgrid(np.arange(steps - 1), np.arange(steps - 1), indexing="ij")
    a, b, c, d = (((i + di) * steps + j + dj).ravel() for di, dj in ((0, 0), (1, 0), (1, 1), (0, 1)))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    u, v = x[faces].mean(axis=1), y[faces].mean(axis=1)
    inside = np.hypot(u, v) < hole * (1 + 0.15 * np.sin(3 * np.arctan2(v, u)))
    vertices = np.stack([x, y, height(x, y)], axis=1)
    edge = vertices[_border(faces[inside])]
    mesh = TriangleMesh(vertices, faces[~inside], "graph")
    used = np.unique(mesh.face_vertices)
    mesh = mesh.part(np.arange(mesh.n_faces))
    if matrix is not None:
        mesh, edge = mesh.moved(matrix), edge @ matrix[:3, :3].T + matrix[:3, 3]
    n = len(used)
    hole_edge = HoleEdge(edge, np.zeros(len(edge), dtype=np.int64))
    return Wall(mesh, mesh, np.zeros(n, dtype=np.int64), np.ones(n), hole_edge)


def rigid(seed=0):
    """A rotation and a shift as a (4, 4) matrix."""
    rng = np.random.default_rng(seed)
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    matrix = np.eye(4)
    matrix[:3, :3] = q * np.sign(np.linalg.det(q))
    matrix[:3, 3] = rng.normal(size=3) * 50
    return matrix


def _border(faces):
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    both = {(int(p), int(q)) for p, q in edges}
    after = {p: q for p, q in both if (q, p) not in both}
    start = min(after)
    row = [start]
    while after[row[-1]] != start:
        row.append(after[row[-1]])
        assert len(row) <= len(after), "the hole's border touches itself"
    return np.array(row)

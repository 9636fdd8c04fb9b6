"""Scans that can be unrolled: a wavy sheet, a bent tube, a wavy torus, with noise and with holes on request."""

import numpy as np

from recon.geometry.mesh import TriangleMesh


def sheet(n=60, noise=0.0):
    """n x 2n points of a wavy sheet 4 by 2."""
    a, b = np.meshgrid(np.linspace(0, 1, 2 * n), np.linspace(0, 1, n), indexing="ij")
    z = 0.2 * np.sin(9.0 * a) * np.cos(7.0 * b)
    return _grid(np.stack([4.0 * a, 2.0 * b, z], axis=-1), (False, False), noise)


def tube(n=50, noise=0.0):
    """2n points around, n along a bent tube of radius about 1 and length 5."""
    a, b = np.meshgrid(np.linspace(0, 2 * np.pi, 2 * n, endpoint=False), np.linspace(0, 1, n), indexing="ij")
    r = 1.0 + 0.1 * np.sin(3.0 * a) * np.cos(5.0 * b)
    return _grid(np.stack([r * np.cos(a) + b * b, r * np.sin(a), 5.0 * b], axis=-1), (True, False), noise)


def torus(n=50, noise=0.0, waves=0.1):
    """2n points around, n across a torus of radii 3 and about 1."""
    a, b = np.meshgrid(
        np.linspace(0, 2 * np.pi, 2 * n, endpoint=False), np.linspace(0, 2 * np.pi, n, endpoint=False), indexing="ij"
    )
    r = 1.0 + waves * np.sin(5.0 * a) * np.cos(3.0 * b)
    out = 3.0 + r * np.cos(b)
    return _grid(np.stack([out * np.cos(a), out * np.sin(a), r * np.sin(b)], axis=-1), (True, True), noise)


def cliff(n=60):
    """n x n points from above of a plain 2 by 2 and half a cone on it; the cliff where it ends has not been seen."""
    x, y = np.meshgrid(np.linspace(-1, 1, n), np.linspace(-1, 1, n), indexing="ij")
    cone = 1.5 * np.maximum(1.0 - np.hypot(x, y) / 0.6, 0.0)
    z = np.where(x < 0.0, cone, 0.0) + 0.05 * np.sin(7.0 * x) * np.cos(5.0 * y)
    mesh = _grid(np.stack([x, y, z], axis=-1), (False, False), 0.0)
    return mesh.part(np.ptp(mesh.vertices[mesh.face_vertices, 2], axis=1) < 16.0 / (n - 1))


def pierced(mesh, *holes):
    """The mesh without the faces that have a corner within a radius of a point, for each (point, radius)."""
    kept = np.ones(mesh.n_faces, dtype=bool)
    for place, radius in holes:
        kept &= (np.linalg.norm(mesh.vertices - place, axis=1) > radius)[mesh.face_vertices].all(axis=1)
    return mesh.part(kept)


def double_torus():
    """A closed surface with two handles: two tori joined at a hole in each."""
    one, two = torus(20, waves=0.0), torus(20, waves=0.0)
    low = len(one.vertices) - 1
    other = TriangleMesh(two.vertices * [-1.0, 1.0, 1.0] + [8.2, 0.0, 0.0], two.face_vertices[:, ::-1])
    vertices = np.concatenate([one.vertices, other.vertices])
    faces = np.concatenate([one.face_vertices, other.face_vertices + low + 1])
    # vertex 0 of both is the outermost: its ring is opened in each, and the two rings are joined by a band
    rings = [_ring(one.face_vertices, 0), low + 1 + _ring(other.face_vertices, 0)]
    faces = faces[~np.isin(faces, [0, low + 1]).any(axis=1)]
    first, second = rings[0], rings[1][::-1]
    start = int(np.argmin(np.linalg.norm(vertices[second] - vertices[first[0]], axis=1)))
    second = np.roll(second, -start)
    after, beyond = np.roll(first, -1), np.roll(second, -1)
    band = [np.stack([first, after, beyond], axis=1), np.stack([first, beyond, second], axis=1)]
    mesh = TriangleMesh(vertices, np.concatenate([faces, *band]), "double torus")
    return mesh.part(np.ones(mesh.n_faces, dtype=bool))


def _ring(faces, vertex):
    """The vertices around one, in the direction in which faces run around it."""
    rows = [np.roll(f, -int(np.argmax(f == vertex))) for f in faces[(faces == vertex).any(axis=1)]]
    after = {int(row[1]): int(row[2]) for row in rows}
    ring = [next(iter(after))]
    while after[ring[-1]] != ring[0]:
        ring.append(after[ring[-1]])
    return np.array(ring)


def _grid(points, around, noise):
    n, m = points.shape[:2]
    number = np.pad(np.arange(n * m).reshape(n, m), [(0, int(around[0])), (0, int(around[1]))], mode="wrap")
    p, q, r, s = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    faces = np.concatenate([np.stack([p, q, r], axis=-1).reshape(-1, 3), np.stack([p, r, s], axis=-1).reshape(-1, 3)])
    vertices = points.reshape(-1, 3)
    return TriangleMesh(vertices + noise * np.random.default_rng(1).normal(size=vertices.shape), faces)

"""A cube as a scanner would like it: with vertices on its edges."""

import numpy as np

from recon.geometry.mesh import TriangleMesh


def block(n: int, *, scale: float = 1.0) -> TriangleMesh:
    """The surface of a cube as n by n squares a side, each in two triangles, sharp edges and all."""
    ticks = np.linspace(-0.5, 0.5, n + 1)
    u, v = (x.ravel() for x in np.meshgrid(ticks, ticks, indexing="ij"))
    corner = ((n + 1) * np.arange(n)[:, None] + np.arange(n)).ravel()
    two = [corner, corner + n + 1, corner + n + 2], [corner, corner + n + 2, corner + 1]
    faces = np.concatenate([np.stack(t, axis=1) for t in two])
    points, triangles = [], []
    for axis in range(3):
        for sign in (-0.5, 0.5):
            side = np.empty((len(u), 3))
            side[:, axis], side[:, (axis + 1) % 3], side[:, (axis + 2) % 3] = sign, u, v
            triangles.append((faces if sign > 0 else faces[:, ::-1]) + len(u) * len(points))
            points.append(side)
    _, first, place = np.unique(np.round(np.concatenate(points), 9), axis=0, return_index=True, return_inverse=True)
    return TriangleMesh(scale * np.concatenate(points)[first], place.ravel()[np.concatenate(triangles)], "block")

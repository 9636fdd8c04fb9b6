"""A control mesh of quadrilaterals in rows that follow the shape, with few irregular vertices: what a solid wants.

A solid of the limit surface has a face for each rectangle of regular quads and one for each quad at an irregular
vertex, so the fewer of those the better. An orientation field smoothed over the scan and a position field on top of it
put most vertices where four rows meet; the library returns each quad as two triangles, (a, b, c) and (d, a, c).

Paper  [jakob2015].
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from recon.geometric_fit.initial_mesh import NoControlMesh
from recon.geometric_fit.quad_mesh import without_doublets
from recon.geometry.control_mesh import ControlMesh
from recon.geometry.mesh import TriangleMesh
from recon.numerics.halfedges import edge_table

__all__ = ["remeshed_quads"]

TRIES = (1.0, 0.93, 1.08, 0.85, 1.2)  # other counts, where a mesh comes out torn


def remeshed_quads(scan: TriangleMesh, n_quads: int) -> ControlMesh:
    """About `n_quads` quadrilaterals over the scan, closed where it is.

    Raises  NoControlMesh when every try is torn, pinched, or of more than twice or less than half as many.
    """
    closed = not (edge_table(scan.face_vertices).uses == 1).any()
    size = float(np.linalg.norm(np.ptp(scan.vertices, axis=0)))
    middle = scan.vertices.mean(axis=0)
    for share in TRIES:
        vertices, quads = _remeshed((scan.vertices - middle) / size, scan.face_vertices, int(share * n_quads))
        if 0.5 * n_quads <= len(quads) <= 2.0 * n_quads and _is_sound(quads, closed=closed):
            return without_doublets(ControlMesh.from_faces(vertices * size + middle, quads), quads)
    raise NoControlMesh(
        f"no mesh of about {n_quads} quadrilaterals came out whole; ask for another number, or for loop."
    )


def _remeshed(
    points: NDArray[np.float64], faces: NDArray[np.int64], n_quads: int
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    import pyinstantmeshes  # heavy, and only this function needs it

    with _silence():
        # all-quad meshes come from one subdivision at the end: a quarter is asked for
        vertices, triangles = pyinstantmeshes.remesh(
            points.astype(np.float32),
            faces.astype(np.int32),
            target_face_count=max(n_quads // 4, 6),
            pure_quad=True,
            deterministic=True,
        )
    first, second = np.asarray(triangles[0::2], dtype=np.int64), np.asarray(triangles[1::2], dtype=np.int64)
    if len(first) != len(second) or not (second[:, [1, 2]] == first[:, [0, 2]]).all():
        return np.empty((0, 3)), np.empty((0, 4), dtype=np.int64)
    return np.asarray(vertices, dtype=np.float64), np.column_stack([first, second[:, 0]])


def _is_sound(quads: NDArray[np.int64], *, closed: bool) -> bool:
    table = edge_table(quads)
    torn = closed and bool((table.uses == 1).any())
    return not (torn or len(table.overused()) or len(table.misoriented()))


@contextmanager
def _silence() -> Iterator[None]:
    """The library writes its progress to the process's own standard output, which belongs to the result."""
    kept, nothing = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nothing, 1)
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nothing)

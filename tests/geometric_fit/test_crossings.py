"""Surface that cuts itself is drawn apart, and looking only where it moved finds the same as looking everywhere."""

import numpy as np
import pytest

from recon.geometric_fit.crossings import without_crossings
from recon.geometry.control_mesh import ControlMesh
from recon.numerics.self_intersection import crossing_triangles
from recon.subdivision.limit_surface import Scheme, limit_patches, tessellate
from recon.subdivision.polygons import split_polygons


def ball(n_splits):
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    mesh = ControlMesh.from_faces(corners, np.array(quads))
    for _ in range(n_splits):
        mesh = split_polygons(mesh)
    return mesh


def n_crossing(mesh):
    drawn = tessellate(mesh, scheme=Scheme.CATMULL_CLARK, halvings=3)
    return len(crossing_triangles(drawn.vertices, drawn.face_vertices)[0])


@pytest.mark.parametrize("dent", [1.2, 1.6])
def test_a_dent_that_comes_out_on_the_other_side_is_drawn_apart(dent):
    mesh = ball(3)
    points = mesh.vertices.copy()
    top = (points[:, 2] > 0.6 * points[:, 2].max()) & (np.hypot(points[:, 0], points[:, 1]) < 0.35)
    points[top, 2] -= dent * np.ptp(points[:, 2])
    crossed = mesh.with_vertices(points)
    assert n_crossing(crossed) > 0
    apart = without_crossings(crossed, limit_patches(crossed, Scheme.CATMULL_CLARK))
    assert n_crossing(apart) == 0
    still = np.all(apart.vertices == points, axis=1)
    assert still.sum() > 0.5 * len(points)


def test_sound_surface_stays():
    mesh = ball(2)
    assert (without_crossings(mesh, limit_patches(mesh, Scheme.CATMULL_CLARK)).vertices == mesh.vertices).all()

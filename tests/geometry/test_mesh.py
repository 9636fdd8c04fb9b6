"""Triangle meshes: measures of a tetrahedron, rigid motion, parts, and what is refused at birth."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from recon.errors import BadGeometry
from recon.geometry.mesh import PointSet, TriangleMesh

CORNER = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


@pytest.mark.parametrize("shift", [0.0, 1e3])
def test_volume_of_a_corner_is_a_sixth_wherever_it_stands(shift):
    assert_allclose(TriangleMesh(CORNER + shift, FACES).volume(), 1 / 6, rtol=1e-9)


def test_area_vectors_of_a_closed_mesh_sum_to_zero():
    assert_allclose(TriangleMesh(CORNER, FACES).area_vectors().sum(axis=0), 0, atol=1e-15)


def test_a_mirror_turns_the_volume_over():
    mirror = np.diag([-1.0, 1.0, 1.0, 1.0])
    assert_allclose(TriangleMesh(CORNER, FACES).moved(mirror).volume(), -1 / 6)


def test_a_part_keeps_its_points_and_drops_the_rest():
    part = TriangleMesh(CORNER, FACES).part(np.array([False, True, False, False]))
    assert_allclose(part.corners()[0], CORNER[[0, 1, 3]])
    assert part.n_vertices == 3


@pytest.mark.parametrize(
    ("vertices", "faces", "fault"),
    [
        (CORNER, [[0, 1, 4]], "face 0 names a vertex outside 0 to 3"),
        (CORNER, [[0, 1, 2], [0, 1, -1]], "face 1 names a vertex outside"),
        (CORNER, [[0, 1, 1]], "names the same vertex twice"),
        (np.full((4, 3), np.inf), FACES, "row 0 holds a value that is not a finite number"),
        (CORNER[:, :2], FACES, "has shape"),
    ],
)
def test_arrays_that_describe_no_mesh_are_refused(vertices, faces, fault):
    with pytest.raises(BadGeometry, match=fault):
        TriangleMesh(vertices, faces)


def test_points_are_locked():
    points = PointSet(CORNER).points
    with pytest.raises(ValueError, match="read-only"):
        points[0] = 0

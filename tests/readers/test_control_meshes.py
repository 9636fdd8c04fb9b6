"""Control meshes in files: faces of any size, creases and corners with their sharpness, there and back."""

import numpy as np
import pytest
from limit_meshes import faces_of, prism
from numpy.testing import assert_array_equal

from brep_export.control_mesh_files import write_control_mesh
from recon.errors import BadGeometry, UnreadableFile
from recon.geometry.control_mesh import ControlMesh
from recon.readers.control_meshes import read_control_mesh

CUBE = """v 0 -1.414214 1
v 1.414214 0 1
v -1.414214 0 1
v 0 1.414214 1
v -1.414214 0 -1
v 0 1.414214 -1
v 0 -1.414214 -1
v 1.414214 0 -1
f 1/1/1 2/2/2 4/4/3 3/3/4
f 3/3/5 4/4/6 6/6/7 5/5/8
f 5/5/9 6/6/10 8/8/11 7/7/12
f 7/7/13 8/8/14 2/10/15 1/9/16
f 2/2/17 8/11/18 6/12/19 4/4/20
f 7/13/21 1/1/22 3/3/23 5/14/24
"""


def read(tmp_path, tags):
    path = tmp_path / "cube.obj"
    path.write_text(CUBE + tags)
    return read_control_mesh(path)


def test_tags_name_creases_and_corners_from_point_nought(tmp_path):
    tags = "t crease 2/1/0 0 1 2.5\nt crease 3/2/0 1 3 2 1 12\nt corner 2/1/0 4 5 0.5\n"
    mesh = read(tmp_path, tags + "t facevaryinginterpolateboundary 1/0/0 1\nl 5 6\n")
    found = dict(zip(map(tuple, mesh.crease_edges.tolist()), mesh.crease_sharpness.tolist()))
    assert found == {(4, 5): np.inf, (0, 1): 2.5, (1, 3): 1.0, (3, 2): np.inf}
    assert_array_equal([mesh.corner_vertices, mesh.corner_sharpness], [[4, 5], [0.5, 0.5]])


def test_a_sharpness_of_nought_is_no_crease(tmp_path):
    assert len(read(tmp_path, "t crease 3/2/0 0 1 3 0 1\n").crease_edges) == 1


@pytest.mark.parametrize(
    "tags, error, words",
    [
        ("t hole 1/0/0 2\n", BadGeometry, "tag 'hole' has no meaning"),
        ("t crease 2/1/0 0 8 1\n", BadGeometry, "names a point that does not exist"),
        ("t crease 2/1/0 0 5 1\n", BadGeometry, "no edge of a face"),
        ("t crease 2/1/0 0 1 -1\n", BadGeometry, "of 0 or above"),
        ("t crease 4/2/0 0 1 3 2 1 1\n", BadGeometry, "3 creases or corners"),
        ("t crease 2/1/0 0 1\n", UnreadableFile, "fewer numbers"),
        ("t crease 2/1 0 1 1\n", UnreadableFile, "fewer numbers"),
        ("t crease 2/1/0 0 one 1\n", UnreadableFile, "where a number belongs"),
    ],
)
def test_tags_that_cannot_be_are_refused(tmp_path, tags, error, words):
    with pytest.raises(error, match=words):
        read(tmp_path, tags)


def test_a_control_mesh_comes_back_from_its_file(tmp_path):
    mesh = ControlMesh.from_faces(
        prism(5).vertices,
        faces_of(prism(5)),
        crease_edges=[[0, 1], [1, 2], [5, 6]],
        crease_sharpness=[np.inf, 1.25, 0.1],
        corner_vertices=[1, 7],
        corner_sharpness=[np.inf, 2.0],
    )
    write_control_mesh(mesh, tmp_path / "prism.obj", scheme="catmull-clark")
    back = read_control_mesh(tmp_path / "prism.obj")
    for name in ("vertices", "face_corners", "face_starts", "crease_edges", "corner_vertices"):
        assert_array_equal(getattr(back, name), getattr(mesh, name))
    assert_array_equal(back.crease_sharpness, mesh.crease_sharpness)
    assert_array_equal(back.corner_sharpness, mesh.corner_sharpness)

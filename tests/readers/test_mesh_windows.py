"""Scans left in their files: the same points and triangles as read whole, and no file taken for what it is not."""

import numpy as np
import pytest
from sheets import torus

from recon.errors import BadGeometry, UnreadableFile
from recon.readers.mesh_windows import open_mesh
from recon.readers.meshes import read_mesh

POINTS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=np.float64)
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])


def ply(path, points=POINTS, faces=FACES, order="<", extra="", corners=3):
    name = {"<": "little", ">": "big"}[order]
    head = (
        f"ply\nformat binary_{name}_endian 1.0\nelement vertex {len(points)}\nproperty float x\nproperty float y\n"
        f"property float z\n{extra}element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    fields = [("p", order + "f4", (3,))] + ([("c", "u1")] if extra else [])
    rows = np.zeros(len(points), dtype=fields)
    rows["p"] = points
    table = np.zeros(len(faces), dtype=[("n", "u1"), ("c", order + "i4", (corners,))])
    table["n"], table["c"] = corners, faces
    path.write_bytes(head.encode() + rows.tobytes() + table.tobytes())
    return path


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("extra", ["", "property uchar red\n"])
def test_points_and_triangles_are_those_of_the_whole(tmp_path, order, extra):
    path = ply(tmp_path / "scan.ply", order=order, extra=extra)
    source, whole = open_mesh(path, unit="cm", least=4), read_mesh(path, unit="cm").mesh
    assert (source.n_vertices, source.n_faces) == (4, 4)
    assert (source.points(slice(None)) == whole.vertices).all()
    assert (source.triangles(np.array([3, 1])) == whole.face_vertices[[3, 1]]).all()


def stl(path, corners):
    rows = np.zeros(len(corners), np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")]))
    rows["corners"] = corners
    path.write_bytes(bytes(80) + np.uint32(len(corners)).tobytes() + rows.tobytes())
    return path


@pytest.mark.parametrize("at_once", [1 << 22, 200])
def test_corners_of_an_stl_file_at_the_same_place_are_one_point_numbered_as_in_the_whole(
    tmp_path, monkeypatch, at_once
):
    monkeypatch.setattr("recon.readers.mesh_windows.AT_ONCE", at_once)
    monkeypatch.setattr("recon.readers.mesh_windows.PIECE", 64)
    mesh = torus(12)
    corners = mesh.corners().astype(np.float32)
    corners[7, 1] = corners[7, 0]  # a face with two corners in one point
    corners[corners == 0.0] = -0.0
    corners[::2][corners[::2] == 0.0] = 0.0
    path = stl(tmp_path / "scan.stl", corners)
    source, whole = open_mesh(path, unit="cm", least=100), read_mesh(path, unit="cm")
    assert source.points(slice(None)).tobytes() == whole.mesh.vertices.tobytes()
    assert (source.triangles(slice(None)) == whole.mesh.face_vertices).all()
    assert source.notes == ("1 faces with two corners in the same point were dropped",) == whole.notes[2:3]
    assert open_mesh(path, least=mesh.n_vertices + 1) is None


def test_faults_of_an_stl_file_are_named(tmp_path):
    corners = POINTS[FACES]
    path = stl(tmp_path / "cut.stl", corners)
    path.write_bytes(path.read_bytes()[:-5])
    assert open_mesh(path, least=1) is None  # the reader of whole files says where it ends
    corners[2, 1, 0] = np.inf
    with pytest.raises(BadGeometry, match="not a finite number"):
        open_mesh(stl(tmp_path / "endless.stl", corners), least=1)
    with pytest.raises(BadGeometry, match="three different points"):
        open_mesh(stl(tmp_path / "points.stl", np.ones((2, 3, 3))), least=1)


def test_other_files_are_left_to_the_reader_of_whole_files(tmp_path):
    assert open_mesh(ply(tmp_path / "few.ply"), least=5) is None
    quads = ply(tmp_path / "quads.ply", faces=np.array([[0, 1, 2, 3]]), corners=4)
    assert open_mesh(quads, least=1) is None
    (tmp_path / "scan.stl").write_bytes(b"solid")
    assert open_mesh(tmp_path / "scan.stl", least=1) is None


def test_faults_are_named(tmp_path):
    path = ply(tmp_path / "cut.ply")
    path.write_bytes(path.read_bytes()[:-5])
    assert open_mesh(path, least=1) is None  # the reader of whole files says where it ends
    with pytest.raises(UnreadableFile, match="ends before"):
        read_mesh(path)
    beyond, nowhere = FACES.copy(), POINTS.copy()
    beyond[2, 1], nowhere[1, 2] = 9, np.nan
    for name, points, faces, says in (("a", POINTS, beyond, "outside 0 to 3"), ("b", nowhere, FACES, "not a finite")):
        with pytest.raises(BadGeometry, match=says):
            open_mesh(ply(tmp_path / f"{name}.ply", points, faces), least=1)

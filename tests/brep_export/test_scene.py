"""The scene of a page holds what it was given, about an origin of its own, and thins out what is too much."""

import json
from base64 import b64decode

import numpy as np
import pytest

from brep_export.app import scene
from brep_export.app.scene import Measured, line_part, mesh_part, point_part, shape_parts, write_scene
from brep_export.check import check
from recon.geometry.mesh import TriangleMesh
from recon.tolerance import Tolerance

cq = pytest.importorskip("cadquery")
FAR = np.array([450_000.0, 5_200_000.0, 0.0])


def grid(n):
    """Two n² triangles of a wavy sheet, far from the origin."""
    x, y = np.meshgrid(np.arange(n + 1.0), np.arange(n + 1.0), indexing="ij")
    points = np.stack([x.ravel(), y.ravel(), np.sin(x.ravel())], axis=1) + FAR
    a = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    triangles = np.concatenate([np.stack([a, a + n + 1, a + n + 2], 1), np.stack([a, a + n + 2, a + 1], 1)])
    return TriangleMesh(points, triangles)


def written(path, parts):
    write_scene(path, parts, unit="m")
    content = json.loads(path.read_text(encoding="utf-8"))
    return content, {part["name"]: part for part in content["parts"]}


def array(text, kind):
    return np.frombuffer(b64decode(text), dtype=kind)


def test_places_keep_their_digits_far_from_the_origin(tmp_path):
    mesh = grid(4)
    content, parts = written(tmp_path / "scene.json", [mesh_part("sheet", mesh, "#000000")])
    middle = np.mean(content["box"], axis=0)
    back = array(parts["sheet"]["points"], "<f4").reshape(-1, 3) + middle
    assert np.abs(back - mesh.vertices).max() < 1e-5
    assert (array(parts["sheet"]["cells"], "<u4").reshape(-1, 3) == mesh.face_vertices).all()


def test_too_much_is_thinned_out_and_keeps_its_numbers(tmp_path, monkeypatch):
    monkeypatch.setattr(scene, "MOST_TRIANGLES", 1000)
    mesh = grid(40)
    values = mesh.vertices[:, 0] - FAR[0]
    given = [
        mesh_part("measured", mesh, "#000000", values=values, scale="x, m"),
        mesh_part("made", grid(15), "#000000", result=True),
    ]
    content, parts = written(tmp_path / "scene.json", given)
    counts = {name: len(array(part["cells"], "<u4")) // 3 for name, part in parts.items()}
    assert counts["made"] == 450 and 300 < counts["measured"] <= 560
    middle = np.mean(content["box"], axis=0)
    x = array(parts["measured"]["points"], "<f4").reshape(-1, 3)[:, 0] + middle[0] - FAR[0]
    assert np.abs(array(parts["measured"]["values"], "<f4") - x).max() < 1.0


def test_lines_and_points_of_the_plane_lie_in_it_and_a_name_is_shown_once(tmp_path):
    row = [[0.0, 0.0], [2.0, 0.0], [2.0, 2.0]]
    given = [line_part("row", [row, row], "#000000"), point_part("ends", row, "#000000"), line_part("row", [row], "#0")]
    _, parts = written(tmp_path / "scene.json", given)
    assert len(parts) == 2
    assert array(parts["row"]["cells"], "<u4").tolist() == [0, 1, 1, 2]
    assert np.abs(array(parts["ends"]["points"], "<f4").reshape(-1, 3)[:, 2]).max() == 0.0


def test_a_shape_comes_with_its_edges_and_its_deviation():
    box = cq.Workplane().box(2, 4, 6).val().wrapped
    measured = Measured(deviation=lambda points: points[:, 2], scale="height, mm")
    faces, edges = shape_parts("box", box, check(box, Tolerance()), measured, colour="#000000")
    assert (faces.values == faces.points[:, 2]).all() and faces.scale == "height, mm"
    assert edges.name == "edges of box" and (edges.angles == 90.0).all() and len(edges.angles) == 12


def test_nothing_to_show_writes_nothing(tmp_path):
    write_scene(tmp_path / "scene.json", [], unit="mm")
    assert list(tmp_path.iterdir()) == []

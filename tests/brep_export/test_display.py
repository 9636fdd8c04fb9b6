"""What is shown of a shape: normals of the faces, not of triangles, and edges by the angle that faces make there."""

import numpy as np
import pytest

from brep_export.display import FREE, shown_edges, shown_faces

cq = pytest.importorskip("cadquery")


def test_normals_are_those_of_the_faces_and_point_outward():
    ball = shown_faces(cq.Workplane().sphere(5).translate((1, 2, 3)).val().wrapped, 0.2)
    outward = (ball.vertices - [1, 2, 3]) / 5
    assert np.abs(ball.normals - outward).max() < 1e-6


def test_an_edge_has_the_normal_of_each_of_its_faces():
    box = shown_faces(cq.Workplane().box(2, 3, 4).val().wrapped, 0.1)
    assert len(box.vertices) == 24 and len(box.triangles) == 12
    axis = np.abs(box.normals).argmax(axis=1)
    assert np.allclose(box.vertices[np.arange(24), axis], box.normals.sum(axis=1) * np.array([1, 1.5, 2])[axis])


def test_normals_turn_with_a_moved_shape():
    turned = cq.Workplane().box(2, 2, 2).val().rotate(cq.Vector(), cq.Vector(0, 0, 1), 45).wrapped
    normals = shown_faces(turned, 0.1).normals
    assert np.isclose(np.abs(normals[np.abs(normals[:, 2]) < 0.5][:, :2]), np.sqrt(0.5)).all()


def test_edges_know_the_angle_between_their_faces():
    rounded = cq.Workplane().box(2, 2, 2).edges("|Z").fillet(0.5)
    edges = shown_edges(rounded.val().wrapped)
    assert set(edges.angles.round(3)) == {0.0, 90.0}
    length = np.linalg.norm(edges.legs[:, 1] - edges.legs[:, 0], axis=1)
    assert length[edges.angles < 1].sum() == pytest.approx(8 * 2)
    assert length[edges.angles > 1].sum() == pytest.approx(2 * (4 + np.pi), rel=1e-2)


def test_free_edges_are_marked_and_a_curve_is_all_its_own():
    face = shown_edges(cq.Face.makePlane(2, 3).wrapped)
    assert (face.angles == FREE).all() and len(face.legs) == 4
    curve = shown_edges(cq.Edge.makeCircle(2).wrapped)
    assert np.linalg.norm(curve.legs[:, 1] - curve.legs[:, 0], axis=1).sum() == pytest.approx(4 * np.pi, rel=1e-4)


def test_of_too_many_edges_the_sharpest_and_the_free_are_kept(monkeypatch):
    monkeypatch.setattr("brep_export.display.MOST_LEGS", 28)
    rounded = cq.Workplane().box(2, 2, 2).edges("|Z").fillet(0.5)
    edges = shown_edges(rounded.val().wrapped)
    assert (len(edges.legs), edges.left_out) == (28, 4)
    assert (edges.angles > 1).sum() == 2 * (4 + 4 * 2)  # four sides and four arcs of two legs, above and below

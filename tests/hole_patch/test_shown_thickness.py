import numpy as np
import pytest
from thrown_walls import cylinder

from recon.geometry.mesh import TriangleMesh
from recon.hole_patch.assembly import assemble, steady_normals
from recon.hole_patch.shown_thickness import shown_thickness
from recon.hole_patch.walls import INNER, OUTER


def tube(radius: float, heights: tuple[float, float], *, inward: bool) -> TriangleMesh:
    angle, t = np.meshgrid(np.arange(90) * 2 * np.pi / 90, np.linspace(*heights, 30), indexing="ij")
    at = np.arange(90 * 30).reshape(90, 30)
    a, b = at[:, :-1].ravel(), np.roll(at, -1, axis=0)[:, :-1].ravel()
    faces = np.concatenate([np.stack([a, b, b + 1], axis=1), np.stack([a, b + 1, a + 1], axis=1)])
    return TriangleMesh(cylinder(radius)(angle.ravel(), t.ravel()), faces[:, ::-1] if inward else faces)


def read(*meshes: TriangleMesh, limit: float = 12.0):
    table = assemble(meshes)
    labels = np.where(table.face_sherd == 0, OUTER, INNER)
    return shown_thickness(table, steady_normals(table), labels, limit=limit)


def test_a_strip_of_inner_wall_shows_the_thickness():
    shown = read(tube(30.0, (-30.0, 30.0), inward=False), tube(27.0, (20.0, 30.0), inward=True))
    assert shown is not None
    assert shown.median == pytest.approx(3.0, abs=0.05)
    assert shown.low <= shown.median <= shown.high and shown.high - shown.low < 0.3


def test_an_outer_wall_alone_shows_nothing():
    assert read(tube(30.0, (-30.0, 30.0), inward=False)) is None


def test_an_inner_face_that_lies_behind_nothing_shows_nothing():
    assert read(tube(30.0, (-30.0, -10.0), inward=False), tube(27.0, (40.0, 60.0), inward=True)) is None


def test_a_face_that_is_turned_the_same_way_is_no_inner_wall():
    assert read(tube(30.0, (-30.0, 30.0), inward=False), tube(27.0, (-30.0, 30.0), inward=False)) is None


def test_the_other_side_of_the_vessel_is_no_inner_wall():
    walls = tube(30.0, (-30.0, 30.0), inward=False), tube(27.0, (20.0, 30.0), inward=True)
    assert read(*walls, limit=2.0) is None

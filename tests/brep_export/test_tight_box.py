"""The box around a shape is that of what is there, not of what was cut away."""

import cadquery as cq
import numpy as np
import pytest

from brep_export.step import write_step
from brep_export.tight_box import tight_box

TURNED = [(0.0, 0.0, 0.0), (31.0, 0.0, 0.0), (20.0, -40.0, 75.0)]


def turned(shape, angles):
    for axis, angle in zip(np.eye(3), angles):
        shape = shape.rotate((0, 0, 0), tuple(axis), angle)
    return shape


def box_of_points(shape):
    """From many points on the kernel's own fine triangles, which lie inside of what is curved outwards."""
    points = np.array([p.toTuple() for p in shape.tessellate(5e-3, 0.1)[0]])
    return points.min(axis=0), points.max(axis=0)


def dome():
    """A block whose upper face is a spline surface with a single top, as `dome(x, y)`."""
    places = [[cq.Vector(x, y, 4.0 - 0.04 * x * x - 0.03 * y * y) for y in range(-8, 9, 2)] for x in range(-8, 9, 2)]
    face = cq.Face.makeSplineApprox(places, tol=1e-6)
    return cq.Workplane().box(10, 10, 20).translate((0, 0, -5)).split(cq.Workplane(face)).solids("<Z")


@pytest.mark.parametrize("angles", TURNED)
@pytest.mark.parametrize("cut", [None, "top", "side"])
def test_the_box_of_a_dome_with_and_without_its_top(cut, angles):
    part = dome()
    if cut == "top":
        part = part.cut(cq.Workplane().polygon(6, 3.0).extrude(30.0, both=True))
    elif cut == "side":
        part = part.cut(cq.Workplane().box(4, 4, 30).translate((5, 5, 0)))
    shape = turned(part.val(), angles)
    low, high = box_of_points(shape)
    found = np.array(tight_box(shape.wrapped))
    assert np.allclose(found, [low, high], atol=8e-3)
    assert (found[0] < low + 1e-6).all() and (found[1] > high - 1e-6).all()


def test_a_pocket_takes_the_top_off():
    high = tight_box(dome().val().wrapped)[1][2]
    assert high == pytest.approx(4.0, abs=1e-5)
    pocket = dome().cut(cq.Workplane().circle(2.0).extrude(30.0, both=True)).val()
    assert tight_box(pocket.wrapped)[1][2] == pytest.approx(4.0 - 0.03 * 4.0, abs=1e-4)


def test_what_was_cut_reads_back_with_its_box(tmp_path):
    pocket = dome().cut(cq.Workplane().polygon(6, 3.0).extrude(30.0, both=True)).val()
    assert write_step(turned(pocket, TURNED[2]).wrapped, tmp_path / "pocket.step").same


@pytest.mark.parametrize("angles", TURNED)
def test_a_sphere_with_a_bite(angles):
    ball = turned(cq.Workplane().sphere(5.0).cut(cq.Workplane().box(20, 3, 3).translate((0, 0, 5))).val(), angles)
    low, high = box_of_points(ball)
    found = np.array(tight_box(ball.wrapped))
    assert np.allclose(found, [low, high], atol=8e-3)


def test_shapes_without_faces():
    edge = cq.Edge.makeCircle(2.0)
    assert np.allclose(tight_box(edge.wrapped), [[-2, -2, 0], [2, 2, 0]], atol=1e-6)
    assert tight_box(cq.Compound.makeCompound([]).wrapped) == ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))

"""Drawings by hidden line removal: of solids whose drawing is known."""

import numpy as np
import pytest
from lattice_solids import lattice_drawing

from recon.three_view.hidden_lines import draw, draw_front
from recon.three_view.pipeline import interpret
from recon.three_view.verification import differences


def test_a_solid_of_cubes_draws_as_its_cubes_say():
    rng = np.random.default_rng(2)
    for _ in range(5):
        cubes = rng.random((3, 3, 3)) < 0.6
        drawing = lattice_drawing(cubes)
        found = interpret(drawing)
        assert not differences(drawing, found.polyhedron(0), 1e-3)


def test_a_changed_line_type_and_a_missing_line_are_told():
    cubes = np.ones((2, 2, 2), dtype=bool)
    cubes[0, 0, 1] = False
    solid = interpret(lattice_drawing(cubes)).polyhedron(0)
    other = np.ones((2, 2, 2), dtype=bool)
    other[1, 1, 1] = False
    told = {(d.view, str(d.given), str(d.again)) for d in differences(lattice_drawing(other), solid, 1e-3)}
    assert ("front", "a dashed line", "a line drawn through") in told
    assert not differences(lattice_drawing(cubes), solid, 1e-3)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_drawing_does_not_depend_on_the_unit(scale):
    cubes = np.ones((2, 3, 2), dtype=bool)
    cubes[0, 1, 1] = False
    solid = interpret(lattice_drawing(cubes)).polyhedron(0)
    scaled = type(solid)(solid.vertices * scale, solid.faces, solid.bodies)
    for (_, one), (_, other) in zip(draw(solid), draw(scaled)):
        assert np.allclose(one.segments * scale, other.segments)
        assert (one.hidden == other.hidden).all()


def test_the_front_view_alone_is_that_of_the_three():
    solid = interpret(lattice_drawing(np.random.default_rng(8).random((3, 3, 3)) < 0.6)).polyhedron(0)
    front, alone = draw(solid).front, draw_front(solid)
    assert np.allclose(front.segments, alone.segments)
    assert (front.hidden == alone.hidden).all()

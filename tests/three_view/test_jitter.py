"""Drawings off by a draughtsman's error: slanted parts, lines that lie over each other, lines that nearly meet."""

import numpy as np
import pytest
from lattice_solids import PITCH, lattice_drawing
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from recon.geometry.polyhedron import Polyhedron
from recon.geometry.views import DrawnView, ThreeViews
from recon.three_view.hidden_lines import draw
from recon.three_view.pipeline import interpret
from recon.three_view.stretches import cut_beside, lone_stretches
from recon.three_view.verification import differences
from recon.three_view.view_graph import view_graphs

ERROR = PITCH / 1000


def turned_block(seed):
    """A block of cubes with some taken off its top, turned out of all three axes."""
    rng = np.random.default_rng(seed)
    cubes = np.zeros((3, 3, 3), dtype=bool)
    for i, j in np.ndindex(3, 3):
        cubes[i, j, : rng.integers(1, 4)] = True
    solid = interpret(lattice_drawing(cubes)).polyhedron(0)
    turn = Rotation.from_euler("xyz", rng.uniform(15, 75, 3), degrees=True)
    return Polyhedron(solid.vertices @ turn.as_matrix().T, solid.faces, solid.bodies)


def shaken(drawing, error, seed):
    rng = np.random.default_rng(seed)
    views = [(v.segments + rng.uniform(-error, error, v.segments.shape), v.hidden) for _, v in drawing]
    return ThreeViews(*(DrawnView(*view) for view in views))


@pytest.mark.parametrize("seed", range(5))
def test_a_turned_part_is_found_from_a_drawing_whose_every_coordinate_is_off(seed):
    solid = turned_block(seed)
    drawing = shaken(draw(solid), ERROR, seed)
    found = interpret(drawing)
    made = found.polyhedron(0)
    assert not found.differences(made)
    assert len(made.faces) == len(solid.faces)
    assert cKDTree(made.vertices).query(solid.vertices)[0].max() < 5 * ERROR


def test_a_turned_part_is_a_solution_of_its_own_drawing_when_that_is_off_and_no_other_one_is():
    solid, other = turned_block(1), turned_block(2)
    drawing = shaken(draw(solid), ERROR, 0)
    assert not differences(drawing, solid, 3 * ERROR)
    assert differences(drawing, other, 3 * ERROR)


def square(*lines):
    sides = [[[0, 0], [9, 0]], [[9, 0], [9, 9]], [[9, 9], [0, 9]], [[0, 9], [0, 0]]]
    return DrawnView(np.array([*sides, *lines], dtype=float), np.zeros(4 + len(lines), dtype=bool))


def test_lines_at_an_angle_have_one_point_in_common():
    # two ends on the upright line lie within two snaps of the slanted one: that one passes through the nearer of them
    upright, slanted, ends = [[4, 0], [4, 9]], [[2, 0], [6, 9]], [[[1, 4.49], [4, 4.49]], [[4, 4.53], [8, 4.53]]]
    _, (graph, *_) = view_graphs(ThreeViews(square(upright, slanted, *ends), square(), square()), 0.02)
    way = np.abs(graph.directions())
    runs = [set(graph.runs[rows]) for rows in (way[:, 0] == 0, (way[:, 1] > way[:, 0]) & (way[:, 0] > 0))]
    assert all(runs)
    assert not set.intersection(*runs)


def test_a_stretch_is_lone_but_for_what_runs_beside_it():
    line = np.array([[[0.0, 0.0], [10.0, 0.0]]])
    others = np.array([[[-1.0, 0.05], [4.0, 0.05]], [[6.0, -0.05], [8.0, 0.05]], [[7.0, 1.0], [10.0, 1.0]]])
    number, ends = lone_stretches(line, others, 0.1)
    assert number.tolist() == [0, 0]
    np.testing.assert_allclose(np.sort(ends[:, :, 0], axis=None), [4.1, 5.9, 8.1, 10.0], atol=0.01)
    assert not len(lone_stretches(line, line[:, ::-1] + 0.05, 0.1)[0])


def test_pieces_of_a_line_make_it_up_and_end_beside_the_points():
    line = np.array([[[0.0, 0.0], [10.0, 10.0]]])
    points = np.array([[3.0, 3.05], [7.0, 6.95], [5.0, 6.0]])
    pieces = cut_beside(line, points, 0.1)
    np.testing.assert_allclose(pieces[1:, 0], pieces[:-1, 1])
    np.testing.assert_allclose(pieces[:, 1, 0], [3.025, 6.975, 10.0])

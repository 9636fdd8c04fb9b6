"""Counts of solids that are not listed, and their order."""

import numpy as np
from lattice_solids import lattice_drawing

from recon.three_view.counting import exact_count
from recon.three_view.pipeline import ViewsOptions, interpret
from recon.three_view.plausibility import plausibility


def many_solids():
    """The drawing of a loose heap of cubes, which many heaps share."""
    return lattice_drawing(np.random.default_rng(3).random((4, 4, 4)) < 0.4)


def test_projected_models_are_counted_once_whatever_completes_them():
    assert exact_count([[1, 2]], 2, seconds=60) == 3
    assert exact_count([[1, 3], [-3, 1, 2]], 2, seconds=60) == 3  # 3 only has to exist: both empty is left out
    assert exact_count([[1, 2], [3, 4]], 4, seconds=60) == 9


def test_counting_agrees_with_listing():
    drawing = many_solids()
    listed = interpret(drawing)
    counted = interpret(drawing, ViewsOptions(limit=2, seconds=60))
    assert listed.complete and listed.count > 50
    assert (counted.count, counted.exact, counted.complete) == (listed.count, True, False)
    assert counted.labelings.listed < listed.count


def test_without_time_for_counting_the_count_is_called_a_lower_bound():
    found = interpret(many_solids(), ViewsOptions(limit=2, seconds=0))
    assert not found.exact
    assert found.count == found.labelings.listed


def test_solids_come_the_most_plausible_first():
    found = interpret(many_solids())
    made, cells = found.arrangement.fragments, found.arrangement.cells
    costs = [tuple(row) for row in plausibility(made, cells, np.array(list(found.labelings))).tolist()]
    assert costs == sorted(costs)
    bodies = len(found.polyhedron(0).bodies)
    assert bodies == costs[0][0] == min(len(solid.bodies) for solid in found.polyhedra())
    assert len(found.polyhedron(0).faces) == costs[0][2]

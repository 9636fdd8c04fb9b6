"""The first of very many solids, which are not all listed."""

import numpy as np
import pytest
from lattice_solids import lattice_drawing

from recon.three_view.pipeline import ViewsOptions, interpret
from recon.three_view.plausibility import plausibility
from recon.three_view.simplest import Surroundings, simplest


def cubes_of_many(seed):
    """A loose heap of cubes whose drawing many heaps share."""
    rng = np.random.default_rng(seed)
    return rng.random(tuple(rng.integers(3, 6, 3))) < rng.choice([0.5, 0.6, 0.7])


def first_cost(found):
    made = found.arrangement
    return plausibility(made.fragments, made.cells, found.labelings.labeling(0)[None])[0].tolist()


@pytest.mark.parametrize("seed", [1, 6, 10, 26])
def test_the_first_of_few_that_are_listed_has_as_few_bodies_and_voids_as_the_first_of_all(seed):
    drawing = lattice_drawing(cubes_of_many(seed))
    all_listed = interpret(drawing, ViewsOptions(seconds=0))
    few_listed = interpret(drawing, ViewsOptions(limit=1, seconds=0))
    assert all_listed.complete and not few_listed.complete
    best, got = first_cost(all_listed), first_cost(few_listed)
    assert got[:2] == best[:2]
    assert got[2] <= 1.1 * best[2]
    assert not few_listed.differences(few_listed.polyhedron(0))


def test_pieces_are_joined_or_left_out_and_voids_filled():
    # a row of cells from the solid 1 to the solid 5, cell 6 between the empty 0 and the void 7
    walls = np.array([[1, 2], [2, 3], [3, 4], [4, 5], [0, 1], [0, 2], [0, 3], [0, 4], [0, 5], [0, 6], [6, 7], [5, 6]])
    known = np.array([-1, 1, 0, 0, 0, 1, 1, 0])
    within = Surroundings(walls, known, np.array([2, 3, 4, 7]))
    joined = [1, 2, 3, 4]

    def cost(model):
        return (len(within.spare_pieces(model)), sum(x > 0 for x in model[:4]))

    assert simplest([[1, -1], [2, 3], [4, -4]], within, cost, [[-1, 2, -3, -4]]) == joined


def test_bodies_that_nothing_can_join_stay():
    walls = np.array([[0, 1], [0, 2], [0, 3], [1, 3], [2, 3]])
    within = Surroundings(walls, np.array([-1, 1, 1, 0]), np.array([3]))

    def cost(model):
        return (len(within.spare_pieces(model)),)

    assert simplest([[-1]], within, cost, [[-1]]) == [-1]
    assert simplest([[1, -1]], within, cost, [[-1]]) == [1]


def test_towers_of_very_many_meanings_are_one_body_without_a_void_first():
    heights = np.random.default_rng(2).integers(1, 5, (9, 9))
    heights[1::2] = 1  # rows of towers, apart from each other, on one floor
    heights[:, 1::2] = 1
    found = interpret(lattice_drawing(np.arange(4) < heights[..., None]), ViewsOptions(limit=1, seconds=0))
    assert not found.exact
    assert [len(body) for body in found.polyhedron(0).bodies] == [1]

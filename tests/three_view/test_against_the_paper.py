"""The choice of cells finds what the paper's choice of faces finds."""

import numpy as np
import pytest
from lattice_solids import lattice_drawing, lattice_solids, signature
from paper_labeling import count_of_the_paper

from recon.geometry.views import DrawnView, ThreeViews
from recon.three_view.pipeline import arrange, interpret

SQUARE = [[0, 0, 40, 0], [40, 0, 40, 40], [40, 40, 0, 40], [0, 40, 0, 0]]


@pytest.mark.parametrize("shape", [(2, 1, 1), pytest.param((2, 2, 1), marks=pytest.mark.slow)])
def test_lattice_drawings_have_as_many_labelings_of_faces_as_of_cells(shape):
    drawings = {signature(cubes): lattice_drawing(cubes) for cubes in lattice_solids(shape)}
    for drawing in drawings.values():
        found = interpret(drawing)
        assert count_of_the_paper(arrange(drawing, found.snap), drawing) == found.count


@pytest.mark.slow
def test_the_puzzle_of_six_has_six_labelings_of_faces():
    lines = [[0, 40, 40, 0]], [[0, 0, 40, 40]], [[0, 0, 40, 40]]
    views = [np.array(SQUARE + own, dtype=float).reshape(-1, 2, 2) for own in lines]
    drawing = ThreeViews(*(DrawnView(rows, np.zeros(len(rows), dtype=bool)) for rows in views))
    found = interpret(drawing)
    assert count_of_the_paper(arrange(drawing, found.snap), drawing) == found.count == 6

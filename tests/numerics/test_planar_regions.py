"""Minimal regions: Euler's formula, areas, holes, loose ends."""

import numpy as np

from recon.numerics.planar_regions import minimal_regions


def regions(points, edges, layer=None):
    points, edges = np.array(points, dtype=float), np.array(edges)
    layer = np.zeros(len(edges), dtype=np.int64) if layer is None else np.array(layer)
    return minimal_regions(edges, points[edges.ravel()], layer)


SQUARE = [(0, 1), (1, 2), (2, 3), (3, 0)]
CORNERS = [(0, 0), (4, 0), (4, 4), (0, 4)]


def test_a_grid_has_as_many_regions_as_euler_says_and_they_fill_it():
    n = 6
    number = np.arange(n * n).reshape(n, n)
    upright = np.column_stack([number[:-1].ravel(), number[1:].ravel()])
    level = np.column_stack([number[:, :-1].ravel(), number[:, 1:].ravel()])
    edges = np.concatenate([upright, level])
    points = np.column_stack([g.ravel() for g in np.mgrid[:n, :n]])
    found = regions(points, edges)
    assert len(found.area) == len(edges) - n * n + 1
    assert np.allclose(found.area, 1.0)


def test_a_hole_belongs_to_the_region_around_it_and_holds_one_of_its_own():
    points = [*CORNERS, (1, 1), (3, 1), (3, 3), (1, 3)]
    found = regions(points, SQUARE + [(a + 4, b + 4) for a, b in SQUARE])
    assert sorted(found.area.tolist()) == [4.0, 16.0]
    outer = int(np.argmax(found.area))
    assert (found.region[1::2][4:] == outer).all()
    assert (found.region[0::2][:4] == outer).all()
    assert (found.region[1::2][:4] == -1).all()


def test_a_loose_end_lies_in_its_region_on_both_sides():
    found = regions([*CORNERS, (2, 2)], [*SQUARE, (0, 4)])
    assert len(found.area) == 1
    assert found.region[8] == found.region[9] == 0


def test_layers_do_not_see_each_other():
    points = [*CORNERS, (1, 1), (3, 1), (3, 3), (1, 3)]
    found = regions(points, SQUARE + [(a + 4, b + 4) for a, b in SQUARE], [0] * 4 + [1] * 4)
    assert (found.region[1::2] == -1).all()

import numpy as np
import pytest
from numpy.testing import assert_allclose

from recon.numerics.polygons import within
from recon.numerics.ribbons import fold_point, ribbon


def arc(radius, n, turn=np.pi):
    t = np.linspace(0.0, turn, n)
    return radius * np.stack([np.cos(t), np.sin(t)], axis=1)


def test_rungs_between_concentric_arcs_are_radii():
    outer, inner = arc(10.0, 301), arc(8.0, 241)
    path = ribbon(outer, inner)
    rungs = outer[path[:, 0]] - inner[path[:, 1]]
    assert np.linalg.norm(rungs, axis=1).max() < 2.0 + 0.02


def test_a_ribbon_begins_and_ends_with_both_rows_and_never_goes_back():
    chance = np.random.default_rng(2)
    path = ribbon(chance.random((40, 3)), chance.random((23, 3)))
    assert path[0].tolist() == [0, 0]
    assert path[-1].tolist() == [39, 22]
    assert (np.diff(path, axis=0).sum(axis=1) == 1).all() and (np.diff(path, axis=0) >= 0).all()


@pytest.mark.parametrize("lean", [-3.0, 0.0, 3.0])
def test_a_hairpin_is_folded_at_its_tip(lean):
    t = np.linspace(-30, 30, 1201)  # straight, half a circle of radius 2, straight
    turn = np.clip(t, -np.pi, np.pi) / 2
    away = np.maximum(np.abs(t) - np.pi, 0.0)
    hairpin = np.stack([away + 2 * (1 - np.cos(turn)), 2 * np.sin(turn)], axis=1)
    bent = hairpin + np.stack([0 * t, lean * (hairpin[:, 0] / 30) ** 2], axis=1)
    assert abs(fold_point(bent) - 600) <= 10


def test_within_a_polygon():
    square = np.array([[0, 0], [2, 0], [2, 2], [0, 2.0]])
    points = np.random.default_rng(0).uniform(-1, 3, (500, 2))
    assert_allclose(within(square, points), ((points > 0) & (points < 2)).all(axis=1))


def test_a_bead_is_folded_at_its_top():
    turn = np.linspace(-2.3, 2.3, 461)  # a circle of radius 3 on a wall 4.5 thick
    bead = 3 * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    wall = np.stack([np.linspace(-20, bead[0, 0], 600, endpoint=False), np.full(600, bead[0, 1])], axis=1)
    assert abs(fold_point(np.concatenate([wall, bead, wall[::-1] * [1, -1]])) - 830) <= 10

"""Boxes near some of them: none that touches a seed is missed, and few that are far are named."""

import numpy as np
import pytest

from recon.numerics.near_boxes import near_boxes


def touching(corners, seeds):
    low, high = corners.min(axis=1), corners.max(axis=1)
    apart = (low[:, None] > high[None, seeds]) | (low[None, seeds] > high[:, None])
    return (~apart.any(axis=2)).any(axis=1)


@pytest.mark.parametrize("seed", range(5))
def test_no_box_that_touches_a_seed_is_missed(seed):
    rng = np.random.default_rng(seed)
    middles = rng.uniform(-5.0, 5.0, (2000, 1, 3)) * [1.0, 0.3, 1e-3 * seed]
    corners = middles + rng.normal(scale=0.05, size=(2000, 3, 3))
    seeds = np.zeros(2000, dtype=bool)
    seeds[rng.integers(0, 2000, 20)] = True
    found = near_boxes(corners, seeds)
    assert found[touching(corners, seeds)].all() and found[seeds].all()


def test_what_is_far_is_left_out():
    rng = np.random.default_rng(0)
    corners = rng.uniform(0.0, 1.0, (5000, 1, 3)) + rng.uniform(0.0, 0.02, (5000, 3, 3))
    seeds = corners.mean(axis=1)[:, 0] < 0.1
    found = near_boxes(corners, seeds)
    assert found.sum() < 0.25 * len(corners)


def test_without_seeds_nothing_is_near():
    assert not near_boxes(np.zeros((4, 3, 3)), np.zeros(4, dtype=bool)).any()


def test_one_place_for_all():
    assert near_boxes(np.ones((4, 3, 3)), np.arange(4) == 2).all()

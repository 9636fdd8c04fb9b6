"""The vessel that the package makes: closed, whole after breaking, scanned within the noise that was asked for."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial import cKDTree

from recon.errors import BadOption
from recon.hole_patch.sample_vessel import VesselOptions, broken_vessel, whole_vessel
from recon.numerics.halfedges import free_edges

COARSE = VesselOptions(edge=2.0)


@pytest.fixture(scope="module")
def vessel():
    return broken_vessel(COARSE)


def test_the_whole_is_closed_and_its_relief_moves_no_clay_to_speak_of():
    plain, pressed = whole_vessel(COARSE, relief=False), whole_vessel(COARSE)
    assert len(free_edges(plain.face_vertices)) == 0
    assert_allclose(pressed.volume(), plain.volume(), rtol=0.01)
    assert plain.volume() > 0


def test_the_sherds_make_up_the_whole(vessel):
    parts = sum(sherd.volume() for sherd in vessel.sherds) + vessel.lost.volume()
    assert_allclose(parts, whole_vessel(COARSE).volume(), rtol=0.005)  # noise alone changes the volumes
    assert len(vessel.sherds) == len(vessel.outer_walls) == 10


def test_every_sherd_is_closed_and_every_outer_wall_open(vessel):
    for sherd, wall in zip(vessel.sherds, vessel.outer_walls):
        assert len(free_edges(sherd.face_vertices)) == 0
        assert len(free_edges(wall.face_vertices)) > 0


def test_outer_walls_stay_within_relief_and_misplacement_of_the_plain_outside(vessel):
    plain = cKDTree(vessel.plain.vertices)
    for wall in vessel.outer_walls:
        middle = wall.corners().mean(axis=1)
        reach = COARSE.relief + 5 * COARSE.misplacement + COARSE.edge
        assert plain.query(middle)[0].max() < reach


def test_the_lost_sherd_touches_neither_lip_nor_base(vessel):
    low, high = np.array([0.1, 0.85]) * COARSE.height
    assert low < vessel.lost.vertices[:, 2].min() and vessel.lost.vertices[:, 2].max() < high


def test_the_same_seed_breaks_the_same_way():
    again = [broken_vessel(COARSE).lost.vertices for _ in range(2)]
    assert np.array_equal(*again)


def test_a_wall_that_does_not_fit_is_refused():
    with pytest.raises(BadOption, match="thickness"):
        VesselOptions(height=20, thickness=5)

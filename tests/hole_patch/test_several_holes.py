"""More than one hole, holes over the base, and what runs round the whole vessel."""

from functools import cache

import numpy as np
import pytest

from recon.errors import BadOption, NoHole, NoSurface
from recon.hole_patch.pipeline import PatchOptions, list_holes, patch_hole, patch_holes
from recon.hole_patch.sample_vessel import BrokenVessel, VesselOptions, broken_vessel
from recon.hole_patch.sherd_reading import find_holes, read_sherds
from recon.hole_patch.surroundings import HoleKind

AS_THEY_ARE = PatchOptions(settle=False)


@cache
def vessel() -> BrokenVessel:
    """Two sherds of the base, four of the belly, opposite the lost one at 2, four of the neck from 6; a coarse mesh."""
    return broken_vessel(VesselOptions(edge=1.6))


def without(kind: str, *numbers: int) -> list:
    return [mesh for i, mesh in enumerate(getattr(vessel(), kind)) if i not in numbers]


@pytest.mark.parametrize("kind", ["sherds", "outer_walls"])
def test_two_holes_of_a_belly_with_slanted_cracks_are_told_apart(kind):
    holes = find_holes(without(kind, 2))
    lost = [vessel().lost.vertices.mean(axis=0), vessel().sherds[2].vertices.mean(axis=0)]
    away = np.linalg.norm([[hole.place - place for place in lost] for hole in holes], axis=2)
    assert [(hole.kind, hole.problem) for hole in holes] == [(HoleKind.WALL, "")] * 2
    assert sorted(away.argmin(axis=1)) == [0, 1] and away.min(axis=1).max() < 5.0
    assert holes[0].length >= holes[1].length and (holes[0].size[0] >= holes[0].size[1] > 10.0)


def test_every_hole_is_tried_and_numbered_as_listed():
    walls = without("outer_walls", 2)
    attempts = patch_holes(walls, AS_THEY_ARE)
    listed = list_holes(walls, AS_THEY_ARE).holes
    assert [attempt.number for attempt in attempts] == [0, 1]
    for attempt, hole in zip(attempts, listed):
        assert attempt.piece is not None and attempt.reason == ""
        np.testing.assert_array_equal(attempt.piece.around.outer.edge.points, hole.outer.points)


def test_all_holes_are_not_one_of_them():
    with pytest.raises(BadOption, match="--hole"):
        patch_holes(vessel().outer_walls, PatchOptions(hole=0))


@pytest.mark.parametrize("kind", ["sherds", "outer_walls"])
def test_a_hole_over_the_base_is_found_and_the_axis_still_points_to_the_mouth(kind):
    reading = read_sherds(without(kind, 1))
    assert reading.axis is not None and reading.axis.direction[2] > 0.99
    lowest = min(reading.holes, key=lambda hole: hole.place[2])
    assert lowest.problem == "" and lowest.outer.points[:, 2].min() < 1.0
    assert np.linalg.norm(lowest.place - vessel().sherds[1].vertices.mean(axis=0)) < 12.0


def test_a_vessel_without_its_neck_is_refused_with_the_reason():
    with pytest.raises((NoHole, NoSurface), match=r"missing|too little (of the wall )?is left"):
        patch_hole([*without("sherds", 6, 7, 8, 9), vessel().lost], AS_THEY_ARE)


def test_neither_mouth_nor_foot_of_a_vessel_without_its_base_is_a_hole():
    with pytest.raises(NoHole, match="no hole"):
        patch_hole([vessel().plain.part(vessel().plain.corners().mean(axis=1)[:, 2] > 10.0)], AS_THEY_ARE)

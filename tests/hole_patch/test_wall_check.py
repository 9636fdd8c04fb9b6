"""What keeps a piece between two walls from being the lost one: handles, swellings, misread edges."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from warped_vessels import Side, swollen

from recon.errors import NoSurface
from recon.geometry.trimmed import ThickPiece
from recon.hole_patch.pipeline import MissingPiece, PatchOptions, patch_hole
from recon.hole_patch.sample_vessel import VesselOptions, broken_vessel
from recon.hole_patch.wall_check import (
    WallFigures,
    check_fracture_met,
    check_fracture_unfolded,
    check_walls_go_on,
    wall_figures,
)

OPTIONS = VesselOptions(edge=2.0, seed=3)
GOOD = WallFigures(outer=0.02, inner=0.0, place=np.zeros(3))


@cache
def piece(clearance: float = 0.0) -> MissingPiece:
    return patch_hole(broken_vessel(OPTIONS).sherds, PatchOptions(clearance=clearance))


@pytest.mark.parametrize("name", ["outer", "inner"])
@pytest.mark.parametrize(("at_foot", "reason"), [(True, "at the vessel's foot"), (False, "A handle")])
def test_a_wall_that_does_not_go_on_is_named_with_the_reason(name: str, at_foot: bool, reason: str) -> None:
    assert GOOD.problem() == ""
    problem = replace(GOOD, **{name: 0.2}, at_foot=at_foot).problem()
    assert f"the {name} wall" in problem
    assert reason in problem


def test_in_a_right_piece_both_walls_go_on() -> None:
    made = piece()
    assert made.inner is not None
    figures = wall_figures(made.outer.trimmed, made.inner.trimmed, made.around)
    assert max(figures.outer, figures.inner) < 0.02
    assert not figures.at_foot


def test_a_wall_whose_edge_strays_is_refused() -> None:
    made = piece()
    assert made.inner is not None and made.around.inner is not None
    edge = made.around.inner.edge
    part = np.arange(len(edge.points)) < 0.2 * len(edge.points)
    strayed = replace(edge, points=edge.points + 3.0 * part[:, None])
    around = replace(made.around, inner=replace(made.around.inner, edge=strayed))
    with pytest.raises(NoSurface, match=r"over 2.% of its edge.*the inner wall"):
        check_walls_go_on(made.outer.trimmed, made.inner.trimmed, around)


def test_fracture_must_be_met_but_for_the_room_left_for_glue() -> None:
    """A gap of 1.5 mm is wider than what counts as met without it."""
    made = piece(1.5)
    assert isinstance(made.shape, ThickPiece)
    check_fracture_met(made.shape, made.around, clearance=1.5)
    with pytest.raises(NoSurface, match="neighbours' fracture"):
        check_fracture_met(made.shape, made.around)


def test_a_fracture_that_turns_back_is_named_with_its_place() -> None:
    made = piece()
    assert isinstance(made.shape, ThickPiece)
    check_fracture_unfolded(made.shape)
    wall = made.shape.wall[1]
    net = wall.control_net.copy()
    middle = len(net) // 2
    net[middle : middle + 3] = net[middle + 2 : middle - 1 : -1]  # three control points in the wrong order
    back = replace(wall, control_net=net)
    with pytest.raises(NoSurface, match="folds back on itself near") as refusal:
        check_fracture_unfolded(replace(made.shape, wall=(made.shape.wall[0], back, *made.shape.wall[2:])))
    named = re.search(r"near \(([^)]*)\)", str(refusal.value))
    assert named is not None
    assert np.linalg.norm(np.array(named[1].split(", "), dtype=float) - net[middle + 1].mean(axis=0)) < 4.0


@pytest.mark.parametrize("outside_alone", [True, False])
def test_a_hole_at_the_root_of_a_handle_is_refused_with_the_place(outside_alone: bool) -> None:
    edge = piece().around.outer.edge.points
    place = edge[np.argmax(edge[:, 2])]
    whole = broken_vessel(OPTIONS).sherds
    on = Side.OUTER if outside_alone else Side.BOTH
    sherds = [swollen(sherd, OPTIONS, place, outward=8.0, wide=9.0, on=on) for sherd in whole]
    with pytest.raises(NoSurface, match="A handle, a spout or a swelling sat there") as refusal:
        patch_hole(sherds)
    named = re.search(r"near \(([^)]*)\)", str(refusal.value))
    assert named is not None
    assert np.linalg.norm(np.array(named[1].split(", "), dtype=float) - place) < 9.0

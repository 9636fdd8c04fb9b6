"""Holes beside a lump on the inner wall, of which no wheel knows."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from warped_vessels import Side, swollen

from recon.errors import NoSurface
from recon.hole_patch.bridged_wall import bridged_sheet
from recon.hole_patch.confidence import confidence
from recon.hole_patch.pipeline import MissingPiece, patch_hole
from recon.hole_patch.sample_vessel import VesselOptions, broken_vessel
from recon.hole_patch.wall_check import wall_figures
from recon.numerics.foot_points import foot_points

OPTIONS = VesselOptions(edge=2.0, seed=3)
INWARD, WIDE = 5.0, 9.0  # millimetres: depth and width of the lump


@cache
def plain() -> MissingPiece:
    return patch_hole(broken_vessel(OPTIONS).sherds)


def place() -> np.ndarray:
    edge = plain().around.outer.edge.points
    return np.asarray(edge[np.argmax(edge[:, 2])])


@cache
def lumpy(outward: float) -> MissingPiece:
    sherds = broken_vessel(OPTIONS).sherds
    return patch_hole([swollen(s, OPTIONS, place(), outward=outward, wide=WIDE, on=Side.INNER) for s in sherds])


def test_beside_a_lump_on_the_inner_wall_the_piece_goes_from_edge_to_edge() -> None:
    made = lumpy(-INWARD)
    assert made.inner is not None
    figures = wall_figures(made.outer.trimmed, made.inner.trimmed, made.around)
    assert max(figures.outer, figures.inner) < 0.02
    assert any("bridged from edge to edge" in note for note in made.notes)


def test_the_outer_wall_is_as_it_is_without_the_lump() -> None:
    surface = lumpy(-INWARD).outer.trimmed.surface
    loop = plain().outer.trimmed.surface.point(plain().outer.trimmed.loops[0].polygon(64))
    middle = loop.mean(axis=0) + 0.5 * (loop - loop.mean(axis=0))
    expected = plain().outer.trimmed.surface
    on_wall = expected.point(foot_points(expected, middle))
    off = np.linalg.norm(surface.point(foot_points(surface, on_wall)) - on_wall, axis=1)
    assert off.max() < 0.03


def test_what_was_bridged_is_trusted_less_where_the_lump_was() -> None:
    made, before = confidence(lumpy(-INWARD)), confidence(plain())
    assert made.inner is not None and before.inner is not None
    near = made.inner.surface.point(made.inner.places)
    near = made.inner.places[np.linalg.norm(near - place(), axis=1) < WIDE]
    sigma = made.inner.at_parameters(near)
    assert np.median(sigma) > 5.0 * np.median(before.inner.at_parameters(before.inner.places))
    assert np.median(sigma) > 0.2 * INWARD


def test_an_edge_that_sinks_into_the_wall_is_no_lump() -> None:
    made = plain()
    inner, axis = made.around.inner, made.around.axis
    assert inner is not None and axis is not None
    sunk = inner.edge.points.copy()
    part = np.arange(len(sunk)) < 0.2 * len(sunk)
    radius = np.linalg.norm(sunk[part, :2], axis=1, keepdims=True)
    sunk[part, :2] *= 1.0 + 0.6 * OPTIONS.thickness / radius
    misread = replace(inner, edge=replace(inner.edge, points=sunk))
    with pytest.raises(NoSurface, match="runs down into the fracture near"):
        bridged_sheet(misread, axis, made.outer)

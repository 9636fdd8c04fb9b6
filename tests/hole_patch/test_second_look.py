"""Fracture that was taken for wall is found by the sheet over the hole, and true wall is left alone."""

from functools import cache

import numpy as np
import pytest
from scipy.spatial import cKDTree

from recon.hole_patch.sample_vessel import BrokenVessel, VesselOptions, broken_vessel
from recon.hole_patch.second_look import look_again
from recon.hole_patch.sherd_reading import Reading, read_sherds, with_labels
from recon.hole_patch.sherds import surroundings_in
from recon.hole_patch.surroundings import HoleEdge, Surroundings
from recon.hole_patch.walls import FRACTURE, INNER, OUTER
from recon.numerics.distance import TriangleTree

OPTIONS = VesselOptions(edge=1.6, thickness=4.0, noise=0.01, misplacement=0.0, relief=0.4, seed=11)


@cache
def vessel() -> BrokenVessel:
    return broken_vessel(OPTIONS)


@cache
def reading() -> Reading:
    return read_sherds(vessel().sherds)


def edge_of(reading: Reading, side: int) -> HoleEdge:
    around = surroundings_in(reading)
    edge = around.outer.edge if side == OUTER else around.inner and around.inner.edge
    assert edge is not None
    return edge


def misread(place: int, side: int) -> tuple[Reading, np.ndarray]:
    """The reading, its fracture beside one place of the edge taken for wall; and those faces."""
    good = reading()
    point = edge_of(good, side).points[place]
    near = np.linalg.norm(good.table.centres - point, axis=1) < 0.8 * OPTIONS.thickness
    faces = good.fracture & near
    labels = np.where(faces, side, good.labels)
    return with_labels(good, labels), faces


@pytest.mark.parametrize("side", [OUTER, INNER])
@pytest.mark.parametrize("share", [0.1, 0.6])
def test_an_edge_that_ran_down_the_fracture_comes_back_to_the_wall(side: int, share: float) -> None:
    good = edge_of(reading(), side).points
    wrong, faces = misread(int(share * len(good)), side)
    assert faces.sum() >= 5
    before = surroundings_in(wrong)
    after, labels = look_again(wrong, before, pass_band=0.01)
    strayed, mended = (
        cKDTree(good).query(edge.points)[0].max()
        for around in (before, after)
        for edge in [around.outer.edge if side == OUTER else around.inner.edge]
    )
    assert strayed > 0.3 * OPTIONS.thickness
    assert (labels[faces] == FRACTURE).any()
    assert mended < 0.5 * strayed


def against_the_lost(around: Surroundings) -> float:
    """Share of the faces read as fracture beside the hole that lie against the lost sherd."""
    lost, fracture = vessel().lost, around.fracture
    assert fracture is not None
    ours, theirs = (
        mesh.area_vectors() / np.linalg.norm(mesh.area_vectors(), axis=1, keepdims=True) for mesh in (fracture, lost)
    )
    nearest = TriangleTree(lost.vertices, lost.face_vertices).closest(fracture.corners().mean(axis=1))
    return float((np.einsum("ij,ij->i", ours, theirs[nearest.faces]) < -0.5).mean())


@pytest.mark.parametrize("side", [OUTER, INNER])
def test_wall_that_was_taken_for_fracture_comes_back(side: int) -> None:
    good = reading()
    point = edge_of(good, side).points[40]
    near = np.linalg.norm(good.table.centres - point, axis=1) < 0.8 * OPTIONS.thickness
    taken = near & (good.labels == side)
    wrong = with_labels(good, np.where(taken, FRACTURE, good.labels))
    _, labels = look_again(wrong, surroundings_in(wrong), pass_band=0.01)
    areas = good.table.areas
    assert areas[taken & (labels == side)].sum() > 0.8 * areas[taken].sum()
    assert not (labels[good.fracture & near] == side).any()


def test_wall_with_relief_is_not_taken_for_fracture() -> None:
    around = surroundings_in(reading())
    after, _ = look_again(reading(), around, pass_band=0.01)
    assert against_the_lost(after) > against_the_lost(around) - 0.002


def test_open_walls_are_left_as_they_were() -> None:
    read = read_sherds(vessel().outer_walls)
    around = surroundings_in(read)
    after, labels = look_again(read, around, pass_band=0.01)
    assert after is around
    assert not (labels == FRACTURE).any()

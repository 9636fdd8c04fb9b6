"""Holes in the rim of a made vessel, from sherds to the piece; and the virtual curve across open rims."""

from functools import cache

import numpy as np
import pytest
from scipy.spatial import cKDTree

from recon.geometry.trimmed import LipPiece, TrimmedSurface
from recon.hole_patch.hole_edges import Cycle
from recon.hole_patch.open_rims import excursions
from recon.hole_patch.pipeline import MissingPiece, PatchOptions, Relief, patch_hole
from recon.hole_patch.sample_vessel import BrokenVessel, VesselOptions, broken_vessel
from recon.hole_patch.sherds import find_holes
from recon.hole_patch.surroundings import Axis, HoleKind

OPTIONS = VesselOptions(edge=1.4, seed=1, lost_at_rim=True)
Z_AXIS = Axis(np.zeros(3), np.array([0.0, 0.0, 1.0]), 0.0)


@cache
def vessel() -> BrokenVessel:
    return broken_vessel(OPTIONS)


@cache
def piece(kind: str) -> MissingPiece:
    return patch_hole(getattr(vessel(), kind))


@pytest.mark.parametrize(("kind", "n_walls"), [("sherds", 2), ("outer_walls", 1)])
def test_the_hole_is_listed_as_one_at_the_rim(kind: str, n_walls: int) -> None:
    hole = find_holes(getattr(vessel(), kind))[0]
    assert (hole.kind, hole.n_walls, hole.problem) == (HoleKind.RIM, n_walls, "")


def test_closed_sherds_give_a_piece_over_the_lip() -> None:
    shape = piece("sherds").shape
    assert isinstance(shape, LipPiece)
    top = shape.face.surface.point(shape.face.loops[0].polygon())[:, 2].max()
    assert top > 0.97 * OPTIONS.height


def test_outer_walls_give_a_face_that_ends_at_the_rim() -> None:
    shape = piece("outer_walls").shape
    assert isinstance(shape, TrimmedSurface)
    top = shape.surface.point(shape.loops[0].polygon())[:, 2].max()
    assert abs(top - vessel().lost.vertices[:, 2].max()) < 2.0


@pytest.mark.parametrize("kind", ["sherds", "outer_walls"])
def test_the_edge_of_the_piece_lies_on_the_lost_sherd(kind: str) -> None:
    shape = piece(kind).shape
    face = shape.face if isinstance(shape, LipPiece) else shape
    assert isinstance(face, TrimmedSurface)
    lost = vessel().lost
    truth = np.concatenate([lost.vertices, lost.corners().mean(axis=1)])
    away = cKDTree(truth).query(face.surface.point(face.loops[0].polygon()))[0]
    assert np.median(away) < 0.5 * OPTIONS.edge
    assert np.quantile(away, 0.9) < 1.2 * OPTIONS.edge


def test_relief_over_the_lip_is_left_out_and_said_so() -> None:
    smooth = patch_hole(vessel().sherds, PatchOptions(relief=Relief.CONTINUE))
    assert smooth.relief is None
    assert any("over the lip" in note for note in smooth.notes)


def slanted_rim(gap: float) -> Cycle:
    """A mouth whose height waves with the angle, with a V cut into it, `gap` radians wide, about the angle 0."""
    angle = np.linspace(np.pi, -np.pi, 900, endpoint=False)
    height = 50.0 + 0.4 * np.cos(angle) - 25.0 * np.clip(1.0 - np.abs(angle) / (0.5 * gap), 0.0, None)
    points = np.stack([30 * np.cos(angle), 30 * np.sin(angle), height], axis=1)
    outward = points * [1, 1, 0] / 30.0
    return Cycle(points, outward, np.zeros(900, np.int64), np.ones(900, np.int64), 0.0)


@pytest.mark.parametrize("gap", [0.4, 1.0, 2.0])
def test_the_virtual_curve_runs_on_from_the_rim_on_both_sides(gap: float) -> None:
    (hole,) = excursions(slanted_rim(gap), Z_AXIS, 0.25)
    x, y, height = hole.points[hole.sherds < 0].T
    np.testing.assert_allclose(np.hypot(x, y), 30.0, atol=1e-3)
    np.testing.assert_allclose(height, 50.0 + 0.4 * x / 30.0, atol=0.1)

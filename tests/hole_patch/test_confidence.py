from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from brep_export.app.patch_job import kernel_piece
from brep_export.triangulation import triangulate
from recon.geometry.mesh import TriangleMesh
from recon.hole_patch.confidence import BOUND, SHARE, Confidence, confidence
from recon.hole_patch.pipeline import MissingPiece, PatchMethod, PatchOptions, patch_hole
from recon.hole_patch.sample_vessel import BrokenVessel, VesselOptions, broken_vessel
from recon.numerics.distance import closest_points

Floats = NDArray[np.float64]
Marked = tuple[BrokenVessel, MissingPiece, Confidence]

VESSELS = (VesselOptions(seed=1), VesselOptions(edge=1.4, seed=3, relief=0.0))


@pytest.fixture(scope="module")
def marked() -> list[Marked]:
    vessels = [broken_vessel(options) for options in VESSELS]
    pieces = [patch_hole(vessel.sherds) for vessel in vessels]
    return [(vessel, piece, confidence(piece)) for vessel, piece in zip(vessels, pieces)]


def errors_in_sigmas(vessel: BrokenVessel, trust: Confidence) -> Floats:
    """Distance of points of both walls from the lost sherd, relief and all, in units of what was expected."""
    shares = []
    for wall in (trust.outer, trust.inner):
        assert wall is not None
        points = wall.surface.point(wall.places)
        off = closest_points(points, vessel.lost.vertices, vessel.lost.face_vertices).distances
        shares.append(off / wall.at_parameters(wall.places))
    return np.concatenate(shares)


def test_the_stated_share_of_points_lies_within_the_stated_bound(marked: list[Marked]) -> None:
    off = np.concatenate([errors_in_sigmas(vessel, trust) for vessel, _, trust in marked])
    assert (off < BOUND).mean() >= SHARE
    assert np.median(off) > 0.2  # 0.67 of a normal law; a bound that is kept because it is wide would say nothing


def test_sherds_that_had_to_be_moved_may_be_out_of_place_together(marked: list[Marked]) -> None:
    _, piece, trust = marked[0]
    assert piece.settling is not None and piece.settling.settled
    moves = np.array([move.shift_mm for move in piece.settling.moves])
    astray = np.sqrt(np.mean(moves**2) / len(moves))
    left = confidence(replace(piece, settling=None))
    assert trust.outer.missed == pytest.approx(np.hypot(left.outer.missed, astray))


def test_the_edge_is_known_and_the_middle_is_not(marked: list[Marked]) -> None:
    _, piece, trust = marked[0]
    loop = piece.outer.trimmed.loops[0].polygon()
    at_edge, in_middle = trust.outer.at_parameters(loop), trust.outer.at_parameters(loop.mean(axis=0)[None])
    assert np.median(at_edge) < 0.5 * in_middle
    assert in_middle == pytest.approx(trust.outer.scatter, rel=0.5)


def test_relief_that_is_not_continued_is_marked_as_invented(marked: list[Marked]) -> None:
    with_cords, without = marked[0][2], marked[1][2]
    assert np.median(with_cords.outer.at_parameters(with_cords.outer.places)) > 2.0 * np.median(
        without.outer.at_parameters(without.outer.places)
    )


def test_points_of_the_piece_are_asked_wherever_they_lie(marked: list[Marked]) -> None:
    _, piece, trust = marked[0]
    assert trust.inner is not None and piece.around.fracture is not None
    for wall in (trust.outer, trust.inner):
        on_wall = wall.surface.point(wall.places)
        np.testing.assert_allclose(trust.at(on_wall), wall.at_parameters(wall.places), rtol=1e-3)
    fracture = piece.around.fracture.corners().mean(axis=1)
    between = fracture[trust.at(fracture) < 1.001 * trust.outer.missed]
    assert len(between) > 0.5 * len(fracture)  # measured; the rest lies so near a wall that it counts as wall


def test_each_sherd_at_the_hole_was_left_out_once(marked: list[Marked]) -> None:
    _, piece, trust = marked[0]
    beside = piece.around.outer.edge.sherds
    assert trust.outer.n_left_out == len(np.unique(beside[beside >= 0]))


def test_one_scan_with_a_hole_has_no_sherd_to_spare() -> None:
    vessel = broken_vessel(VesselOptions(edge=2.5, relief=0.0, misplacement=0.0, noise=0.0))
    joined = vessel.plain.part(
        closest_points(vessel.plain.corners().mean(axis=1), vessel.lost.vertices, vessel.lost.face_vertices).distances
        > 1.0
    )
    outside = joined.part(np.einsum("ij,ij->i", joined.area_vectors()[:, :2], joined.corners().mean(axis=1)[:, :2]) > 0)
    trust = confidence(patch_hole([outside]))
    assert trust.outer.n_left_out == 0
    assert np.isfinite(trust.over_walls()).all() and trust.inner is None


def test_the_box_says_that_it_knows_less(marked: list[Marked]) -> None:
    vessel, _, wheel = marked[1]
    box = confidence(patch_hole(vessel.outer_walls, PatchOptions(method=PatchMethod.BOX, settle=False)))
    assert np.median(box.over_walls()) > 2.0 * np.median(wheel.outer.at_parameters(wheel.outer.places))


def as_triangles(piece: MissingPiece) -> TriangleMesh:
    shape, _ = kernel_piece(piece)
    return triangulate(shape, 0.02).mesh


def test_the_volume_is_marked_by_what_was_scanned_of_the_cracks(marked: list[Marked]) -> None:
    vessel, piece, trust = marked[1]
    mesh = as_triangles(piece)
    scanned = trust.of(mesh)
    np.testing.assert_allclose(scanned.at_vertices, trust.at(mesh.vertices))
    assert trust.fracture_scanned
    assert abs(mesh.volume() - vessel.lost.volume()) < BOUND * scanned.volume < 0.3 * mesh.volume()
    options = PatchOptions(thickness=VESSELS[1].thickness)
    guessed = patch_hole(vessel.outer_walls, options)
    unknown, open_mesh = confidence(guessed), as_triangles(guessed)
    assert not unknown.fracture_scanned
    assert abs(open_mesh.volume() - vessel.lost.volume()) < BOUND * unknown.of(open_mesh).volume


def test_a_crack_that_was_not_scanned_may_lean_by_half_its_depth(marked: list[Marked]) -> None:
    vessel = marked[1][0]
    thin, thick = (patch_hole(vessel.outer_walls, PatchOptions(thickness=t)) for t in (1.0, 4.0))
    shares = []
    for piece in (thin, thick):
        mesh = as_triangles(piece)
        shares.append(confidence(piece).of(mesh).volume / mesh.volume())
    assert shares[1] > 1.5 * shares[0]  # of the share of the fracture, four times; the walls have theirs

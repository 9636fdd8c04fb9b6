import numpy as np
import pytest
from thrown_walls import AXIS, cylinder
from warped_vessels import Map, spouted, squared, squashed, three_sided, warped

from recon.errors import NoHole, NoSurface
from recon.geometry.mesh import TriangleMesh
from recon.hole_patch.axis import departure, wheel_axis
from recon.hole_patch.pipeline import PatchOptions, patch_hole
from recon.hole_patch.sample_vessel import BrokenVessel, VesselOptions, broken_vessel
from recon.hole_patch.surroundings import Axis
from recon.numerics.distance import closest_points
from recon.numerics.polygons import within

RADIUS = 30.0


@pytest.fixture(scope="module")
def vessel() -> BrokenVessel:
    return broken_vessel(VesselOptions(relief=0.0, edge=1.6))


def faces_of(meshes: list[TriangleMesh]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Middles, unit normals and areas."""
    vectors = np.concatenate([mesh.area_vectors() for mesh in meshes])
    areas = np.linalg.norm(vectors, axis=1)
    middles = np.concatenate([mesh.corners().mean(axis=1) for mesh in meshes])
    return middles, vectors / areas[:, None], areas


def wall(relief: float, oval: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points, normals and weights of a cylinder with a wave of 5 mm on it, and out of round by cos 2θ."""
    angle, t = np.meshgrid(np.linspace(0, 2 * np.pi, 500, endpoint=False), np.arange(-30.0, 30.0, 0.5), indexing="ij")
    angle, t = angle.ravel(), t.ravel()
    radius = RADIUS + relief * np.sin(38 * angle + 2 * np.pi * t / 7.0) + oval * np.cos(2 * angle)
    points = AXIS.cartesian(np.stack([angle, radius, t], axis=1))
    outside = cylinder(RADIUS + 1)(angle, t) - cylinder(RADIUS)(angle, t)
    return points, outside, np.ones(len(points))


@pytest.mark.parametrize("oval", [0.2, 0.4])
def test_quality_is_what_the_wall_is_out_of_round_by_whatever_its_relief(oval: float) -> None:
    found = departure(AXIS, *wall(0.5, oval))
    assert found.quality == pytest.approx(oval / np.sqrt(2), rel=0.15)
    assert found.support == 1.0


def test_of_relief_alone_a_fifth_is_left_in_the_quality() -> None:
    assert departure(AXIS, *wall(0.5, 0.0)).quality < 0.2 * 0.5 / np.sqrt(2)


def test_support_is_the_share_of_the_turn_that_is_there() -> None:
    points, normals, weights = wall(0.2, 0.0)
    half = AXIS.cylindrical(points)[:, 0] > 0
    assert departure(AXIS, points[half], normals[half], weights[half]).support == pytest.approx(0.5, abs=0.05)


def found_axis(vessel: BrokenVessel, bend: Map) -> Axis | None:
    return wheel_axis(*faces_of(warped(vessel.outer_walls, bend)))


def test_a_slightly_squashed_vessel_keeps_its_wheel_and_says_by_how_much(vessel: BrokenVessel) -> None:
    round_one, oval = found_axis(vessel, squashed(0.0)), found_axis(vessel, squashed(0.03))
    assert round_one is not None and oval is not None
    assert round_one.quality < 0.12 and round_one.support > 0.9
    assert oval.support > 0.7
    assert 0.2 < oval.quality < 0.5  # 1.5 % of 32 mm either way, over √2: 0.34


def test_a_spout_lessens_the_support_but_not_the_quality(vessel: BrokenVessel) -> None:
    axis = found_axis(vessel, spouted)
    assert axis is not None
    assert axis.quality < 0.2 and 0.7 < axis.support < 0.95


OVAL = {"squashed by a tenth": squashed(0.1), "three-sided": three_sided(0.03)}
BENT = {"squashed by a quarter": squashed(0.25), "square": squared(8.0)}


@pytest.mark.parametrize("kind", ["sherds", "outer_walls"])
@pytest.mark.parametrize("bend", BENT.values(), ids=BENT.keys())
def test_what_is_far_from_round_is_refused_with_a_reason(vessel: BrokenVessel, bend: Map, kind: str) -> None:
    with pytest.raises((NoHole, NoSurface), match="wheel"):
        patch_hole(warped(getattr(vessel, kind), bend), PatchOptions(settle=False))


@pytest.mark.parametrize("bend", OVAL.values(), ids=OVAL.keys())
def test_closed_sherds_of_an_oval_vessel_are_refused_with_advice(vessel: BrokenVessel, bend: Map) -> None:
    with pytest.raises(NoHole, match=r"wheel.*give the outer walls alone"):
        patch_hole(warped(vessel.sherds, bend), PatchOptions(settle=False))


@pytest.mark.parametrize("bend", OVAL.values(), ids=OVAL.keys())
def test_an_oval_vessel_whose_wall_foretells_itself_is_patched_within_what_is_said(
    vessel: BrokenVessel, bend: Map
) -> None:
    piece = patch_hole(warped(vessel.outer_walls, bend), PatchOptions(settle=False))
    (note,) = [note for note in piece.notes if "not round" in note]
    said = float(note.split("off by up to ")[1].split()[0])
    surface, loop = piece.outer.trimmed.surface, piece.outer.trimmed.loops[0].polygon()
    u, v = (np.linspace(*ends, 40) for ends in surface.domain)
    grid = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
    (plain,) = warped([vessel.plain], bend)
    inside = surface.point(grid[within(loop, grid)])
    away = closest_points(inside, plain.vertices, plain.face_vertices).distances
    assert 0.1 < away.mean() < said < 1.5


def test_half_a_vessel_is_refused_with_a_reason(vessel: BrokenVessel) -> None:
    away = vessel.lost.vertices.mean(axis=0)[:2]
    near = [wall for wall in vessel.outer_walls if wall.vertices.mean(axis=0)[:2] @ away > 0]
    with pytest.raises((NoHole, NoSurface), match=r"missing|no hole"):
        patch_hole(near, PatchOptions(settle=False))


def test_a_squashed_vessel_is_patched_and_says_how_badly_the_wheel_holds(vessel: BrokenVessel) -> None:
    piece = patch_hole(warped(vessel.sherds, squashed(0.03)), PatchOptions(settle=False))
    assert any("stands off from the wheel by 0." in note for note in piece.notes)

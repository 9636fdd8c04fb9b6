import manifold3d
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from recon.geometry.mesh import TriangleMesh
from recon.hole_patch.placing import place, scans_tolerance
from recon.hole_patch.sample_vessel import BrokenVessel, VesselOptions, broken_vessel
from recon.hole_patch.settling import Settling
from recon.numerics.overlap import face_points, solid

HEIGHT = 6.0
UP = np.array([0.0, 0.0, 1.0])


def stacked_squares(heights: list[float], half_widths: list[float]) -> manifold3d.Manifold:
    """A solid through squares about the z axis."""
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)], dtype=float)
    rings = [np.column_stack([half * corners, np.full(4, z)]) for z, half in zip(heights, half_widths)]
    at = np.arange(4)
    a, b = at, (at + 1) % 4
    sides = [
        np.concatenate([np.stack([a, b, b + 4], 1), np.stack([a, b + 4, a + 4], 1)]) + 4 * k
        for k in range(len(heights) - 1)
    ]
    top = 4 * (len(heights) - 1)
    ends = [[0, 2, 1], [0, 3, 2], [top, top + 1, top + 2], [top, top + 2, top + 3]]
    faces = np.concatenate([*sides, ends]).astype(np.uint64)
    return manifold3d.Manifold(manifold3d.Mesh64(np.concatenate(rings), faces))


def as_mesh(body: manifold3d.Manifold, turn: Rotation | None = None) -> TriangleMesh:
    raw = body.to_mesh64()
    vertices = np.array(raw.vert_properties)[:, :3]
    return TriangleMesh(vertices if turn is None else turn.apply(vertices), np.array(raw.tri_verts).astype(np.int64))


def box(low: tuple[float, ...], high: tuple[float, ...]) -> manifold3d.Manifold:
    size = np.subtract(high, low)
    return manifold3d.Manifold.cube([float(x) for x in size]).translate([float(x) for x in low])


# a sherd far below tells where the inside of the vessel is
BELOW = box((-1, -1, -81), (1, 1, -80))
BLOCK = box((-20, -20, 0), (20, 20, HEIGHT))


def plug_in_block(
    profile: manifold3d.Manifold, turn: Rotation | None = None
) -> tuple[TriangleMesh, list[TriangleMesh]]:
    """A plug cut out of the block, and the rest of the block, above the sherd that tells where inside is."""
    plug = profile ^ BLOCK
    return as_mesh(plug, turn), [as_mesh(BLOCK - plug, turn), as_mesh(BELOW, turn)]


def prism(bottom: float, top: float) -> manifold3d.Manifold:
    return stacked_squares([0.0, HEIGHT], [bottom, top])


def angle(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    return float(np.degrees(np.arccos(np.clip(a @ b, -1.0, 1.0))))


@pytest.mark.parametrize("turn", [None, Rotation.from_rotvec([0.7, -0.4, 1.1])], ids=["upright", "turned"])
def test_a_plug_wider_above_is_set_in_from_outside(turn: Rotation | None) -> None:
    placing = place(*plug_in_block(prism(7.0, 8.0), turn))
    assert placing.collision_free and not placing.from_inside
    assert placing.insert_direction is not None
    down = -UP if turn is None else turn.apply(-UP)
    assert angle(placing.insert_direction, down) < np.degrees(np.arctan(1.0 / HEIGHT))  # within the draft it is free
    assert placing.undercut_mm == pytest.approx(0.0, abs=1e-9)
    assert placing.notes == ()


def test_a_straight_plug_goes_along_its_walls() -> None:
    placing = place(*plug_in_block(prism(8.0, 8.0)))
    assert placing.collision_free
    assert placing.insert_direction is not None
    assert angle(placing.insert_direction, -UP) < np.degrees(0.05 / HEIGHT)  # the tolerance over the height


def test_a_plug_wider_below_is_set_in_from_inside() -> None:
    placing = place(*plug_in_block(prism(9.0, 8.0)))
    assert placing.collision_free and placing.from_inside
    assert placing.insert_direction is not None
    assert angle(placing.insert_direction, UP) < 9.0
    assert "mouth" in placing.notes[0]


@pytest.mark.parametrize("bulge", [0.2, 0.5, 1.0])
def test_a_plug_widest_in_the_middle_is_held_by_its_bulge(bulge: float) -> None:
    placing = place(*plug_in_block(stacked_squares([0.0, HEIGHT / 2, HEIGHT], [8.0, 8.0 + bulge, 8.0])))
    assert placing.collision_free is False
    assert placing.undercut_mm == pytest.approx(bulge, rel=0.03)
    # half way up, the wide lower half of the plug is under the narrow upper half of the hole: a slice of the bulge
    assert placing.worst_overlap_mm3 is not None and placing.worst_overlap_mm3 > 20.0 * bulge
    assert "held" in placing.notes[0]


def test_a_gap_as_wide_as_the_bulge_sets_the_plug_free() -> None:
    plug, sherds = plug_in_block(stacked_squares([0.0, HEIGHT / 2, HEIGHT], [8.0, 8.3, 8.0]))
    smaller = TriangleMesh(plug.vertices * [7.68 / 8.0, 7.68 / 8.0, 1.0], plug.face_vertices)
    placing = place(smaller, sherds)
    assert placing.collision_free
    assert placing.neighbours[0].gap_mm == pytest.approx(0.32, rel=0.03)


@pytest.mark.parametrize("turn", [None, Rotation.from_rotvec([0.7, -0.4, 1.1])], ids=["upright", "turned"])
def test_a_crumb_on_a_wedge_is_told_from_its_gap(turn: Rotation | None) -> None:
    slant = 1.0 / np.hypot(1.0, 1.0 / HEIGHT)  # the wedge widens by a millimetre over its height
    crumb = box((7.0, -0.3, 2.7), (8.1, 0.3, 3.3))
    plug, hole = (prism(7.0, 8.0) ^ BLOCK) + crumb, prism(7.1, 8.1) ^ BLOCK
    placing = place(as_mesh(plug, turn), [as_mesh(BLOCK - hole, turn), as_mesh(BELOW, turn)])
    (neighbour,) = placing.neighbours
    assert neighbour.gap_mm == pytest.approx(-(8.1 - 7.1 - 2.7 / HEIGHT) * slant)
    assert neighbour.usual_gap_mm == pytest.approx(0.1 * slant, rel=1e-6)
    assert neighbour.overlap_mm3 == pytest.approx(0.6 * 0.6 * (8.1 - 7.6))
    assert placing.collision_free and placing.held_by == ()
    down = -UP if turn is None else turn.apply(-UP)
    assert placing.insert_direction is not None
    assert angle(placing.insert_direction, down) < np.degrees(np.arctan(1.0 / HEIGHT))


def test_without_the_sherds_that_hold_it_the_way_is_free() -> None:
    half = [(8.0, 7.0), (9.0, 7.5), (8.0, 8.0)]  # to the right, where it bulges, and to the front and back
    rings = [(x, y, 3.0 * k) for k, (right, deep) in enumerate(half) for x in (-8.0, right) for y in (-deep, deep)]
    plug = manifold3d.Manifold.hull_points(np.array(rings))
    parts = [
        box((6, -20, 0), (20, 20, HEIGHT)),
        box((-20, -20, 0), (-6, 20, HEIGHT)),
        box((-6, -20, 0), (6, 0, HEIGHT)),
        box((-6, 0, 0), (6, 20, HEIGHT)),
    ]
    right, left, front, back = (as_mesh(part - plug) for part in parts)
    placing = place(as_mesh(plug), [front, right, left, back, as_mesh(BELOW)])
    assert placing.collision_free is False
    assert 1 in placing.held_by and not {0, 3} & set(placing.held_by)
    others = [sherd for k, sherd in enumerate([front, right, left, back, as_mesh(BELOW)]) if k not in placing.held_by]
    assert place(as_mesh(plug), others).collision_free
    assert "sherds 1, 2" in placing.notes[0] or "sherd 1" in placing.notes[0]


def test_what_counts_as_a_collision_follows_the_scans() -> None:
    assert scans_tolerance(None) == scans_tolerance(Settling((), (), np.nan, np.nan, False)) == 0.05
    assert scans_tolerance(Settling((), (), 0.1, 0.01, True)) == 0.05
    assert scans_tolerance(Settling((), (), 0.3, 0.1, True)) == pytest.approx(0.3)
    bulging = plug_in_block(stacked_squares([0.0, HEIGHT / 2, HEIGHT], [8.0, 8.2, 8.0]))
    assert place(*bulging).collision_free is False
    assert place(*bulging, tolerance=0.3).collision_free


def test_overlap_and_depth_of_two_boxes() -> None:
    piece, sherd = as_mesh(box((0, 0, 0), (10, 10, 4))), as_mesh(box((9.5, 2, 1), (20, 7, 3)))
    (neighbour,) = place(piece, [sherd]).neighbours
    assert neighbour.overlap_mm3 == pytest.approx(0.5 * 5 * 2)
    assert neighbour.overlap_share == pytest.approx(5.0 / 400.0)
    assert neighbour.gap_mm == neighbour.usual_gap_mm == pytest.approx(-0.5)


def test_gap_between_two_boxes() -> None:
    piece, sherd = as_mesh(box((0, 0, 0), (10, 10, 4))), as_mesh(box((10.7, -5, -5), (20, 15, 9)))
    far = as_mesh(box((40, 0, 0), (50, 10, 4)))
    placing = place(piece, [far, sherd])
    (neighbour,) = placing.neighbours
    assert neighbour.sherd == 1
    assert neighbour.gap_mm == neighbour.usual_gap_mm == pytest.approx(0.7)
    assert neighbour.overlap_mm3 == 0.0


def test_no_usual_gap_is_deeper_than_the_deepest_cut(vessel: BrokenVessel) -> None:
    neighbours = place(vessel.lost, vessel.sherds).neighbours
    assert all(one.usual_gap_mm is None or one.usual_gap_mm >= one.gap_mm - 1e-6 for one in neighbours)
    facing = [one.usual_gap_mm for one in neighbours if one.usual_gap_mm is not None]
    assert len(facing) >= 3 and np.abs(facing).max() < 0.01  # the sherd that was lost lies where it lay


def test_a_sherd_that_is_not_closed_has_no_overlap_but_a_direction() -> None:
    plug, sherds = plug_in_block(prism(7.0, 8.0))
    block = sherds[0]
    sideways = np.abs(block.corners().mean(axis=1)[:, 0]) < 19.9
    placing = place(plug, [block.part(sideways), sherds[1]])
    assert placing.neighbours[0].overlap_mm3 is None
    assert placing.worst_overlap_mm3 is None
    assert placing.insert_direction is not None and placing.undercut_mm == pytest.approx(0.0, abs=1e-9)
    assert "Sherd 0 is not closed" in placing.notes[0]


def test_nobody_near() -> None:
    placing = place(as_mesh(BLOCK), [as_mesh(BELOW)])
    assert placing.neighbours == ()
    assert placing.insert_direction is None and placing.collision_free is None


def test_points_on_faces_lie_on_them_and_fill_them() -> None:
    block = as_mesh(BLOCK)
    points = face_points(block.vertices, block.face_vertices, 0.8)
    corners = block.corners()[points.faces]
    height = np.einsum("ij,ij->i", points.places - corners[:, 0], points.normals)
    assert np.abs(height).max() < 1e-9
    count = np.bincount(points.faces, minlength=block.n_faces)
    areas = np.linalg.norm(block.area_vectors(), axis=1)
    assert (count >= areas / 0.8**2 - 1e-9).all()
    middle = np.array([np.average(points.places[points.faces == k], axis=0) for k in range(block.n_faces)])
    np.testing.assert_allclose(middle, block.corners().mean(axis=1), atol=0.5)


def test_an_open_mesh_and_one_inside_out_bound_no_solid() -> None:
    block = as_mesh(BLOCK)
    assert solid(block.vertices, block.face_vertices[1:]) is None
    assert solid(block.vertices, block.face_vertices[:, ::-1]) is None
    made = solid(block.vertices, block.face_vertices)
    assert made is not None and made.volume == pytest.approx(40 * 40 * HEIGHT)


@pytest.fixture(scope="module")
def vessel() -> BrokenVessel:
    return broken_vessel(VesselOptions(edge=2.0, noise=0.0, misplacement=0.0))


def test_the_lost_sherd_lies_in_its_place_without_overlap(vessel: BrokenVessel) -> None:
    placing = place(vessel.lost, vessel.sherds)
    touching = [one for one in placing.neighbours if abs(one.gap_mm) < 1e-6]
    assert len(touching) >= 3
    assert sum(one.overlap_mm3 or 0.0 for one in placing.neighbours) < 1e-3
    assert placing.insert_direction is not None
    assert np.linalg.norm(placing.insert_direction) == pytest.approx(1.0)


def test_open_outer_walls_tell_gaps_alone(vessel: BrokenVessel) -> None:
    placing = place(vessel.lost, vessel.outer_walls)
    assert placing.neighbours
    assert all(one.overlap_mm3 is None and one.gap_mm >= 0.0 for one in placing.neighbours)
    assert placing.insert_direction is None
    assert placing.undercut_mm is None

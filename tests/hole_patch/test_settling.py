"""Settling: known small motions are found again, bounds hold, and what fits already is left alone."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from recon.errors import BadOption
from recon.geometry.mesh import TriangleMesh
from recon.hole_patch.contacts import BORDER, CONTINUATION, MATING, PartnerTree, Samples
from recon.hole_patch.sample_vessel import BrokenVessel, VesselOptions, broken_vessel
from recon.hole_patch.settling import settle

VESSEL = VesselOptions(edge=2.5, misplacement=0.1)


@cache
def vessel(misplacement: float, seed: int = 1) -> BrokenVessel:
    return broken_vessel(replace(VESSEL, misplacement=misplacement, seed=seed))


@cache
def settled_vessel():
    return settle(vessel(0.1).sherds)


def bent(x, y):
    return 0.8 * np.sin(0.7 * x + 0.2) * np.cos(0.5 * y) + 0.05 * x + 0.3 * np.sin(1.9 * y + 0.4 * x)


def flat(x, y):
    return np.zeros_like(x)


def block(low, high, *, size=20.0, n=41, name="block"):
    """A closed block between the sheets z = low(x, y) and z = high(x, y)."""
    line = np.linspace(-size / 2, size / 2, n)
    x, y = np.meshgrid(line, line, indexing="ij")
    points = np.concatenate([np.stack([x, y, f(x, y)], axis=-1).reshape(-1, 3) for f in (low, high)])
    at = np.arange(n * n).reshape(n, n)
    a, b, c, d = at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]
    floor = np.stack([a, c, b, a, d, c], axis=-1).reshape(-1, 3)
    border = np.concatenate([at[:-1, 0], at[-1, :-1], at[:0:-1, -1], at[0, :0:-1]])
    ahead = np.roll(border, -1)
    sides = np.stack([border, ahead, ahead + n * n, border, ahead + n * n, border + n * n], axis=-1).reshape(-1, 3)
    return TriangleMesh(points, np.concatenate([floor, floor[:, ::-1] + n * n, sides]), name)


def level(height):
    return lambda x, y: np.full_like(x, height)


def puzzle(crack=bent):
    """Two blocks that fit, measured at different places."""
    return block(level(-6.0), crack, n=41), block(crack, level(6.0), n=47)


def motion(shift, turn_degrees=(0.0, 0.0, 0.0)):
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_rotvec(turn_degrees, degrees=True).as_matrix()
    matrix[:3, 3] = shift
    return matrix


def noisy(mesh, sigma, seed):
    step = np.random.default_rng(seed).normal(0.0, sigma, mesh.vertices.shape)
    return TriangleMesh(mesh.vertices + step, mesh.face_vertices, mesh.name)


def common_motion_removed(points, truth):
    """The parts (n, 3) moved by the one rigid motion that brings all of them nearest to the truth."""
    p, q = np.concatenate(points), np.concatenate(truth)
    turn, _ = Rotation.align_vectors(q - q.mean(axis=0), p - p.mean(axis=0))
    return [turn.apply(x - p.mean(axis=0)) + q.mean(axis=0) for x in points]


def rms_errors(points, truth):
    moved = common_motion_removed(points, truth)
    return np.array([np.sqrt(((x - t) ** 2).sum(axis=1).mean()) for x, t in zip(moved, truth)])


@pytest.mark.parametrize(
    ("shift", "turn"),
    [((0.0, 0.0, 0.2), (0, 0, 0)), ((0.15, -0.1, 0.1), (0, 0, 0)), ((0.1, 0.1, -0.1), (0.2, -0.15, 0.3))],
    ids=["apart", "aside", "turned"],
)
@pytest.mark.parametrize("sigma", [0.0, 0.02])
def test_a_known_motion_is_undone_to_a_tenth(shift, turn, sigma):
    lower, upper = puzzle()
    moved = noisy(upper, sigma, 1).moved(motion(shift, turn))
    settling = settle([noisy(lower, sigma, 2), moved])
    truth = [lower.vertices, upper.vertices]
    before = rms_errors([lower.vertices, upper.moved(motion(shift, turn)).vertices], truth)
    placed = [lower.moved(settling.moves[0].matrix), upper.moved(settling.moves[1].matrix @ motion(shift, turn))]
    assert settling.settled
    assert rms_errors([mesh.vertices for mesh in placed], truth).max() < 0.1 * before.max()


@pytest.mark.parametrize("kind", ["sherds", "outer_walls"])
@pytest.mark.parametrize("seed", [1, 3])
def test_sherds_of_a_vessel_end_four_times_nearer_to_where_they_broke(kind, seed):
    sherds = getattr(vessel(0.1, seed), kind)
    truth = [mesh.vertices for mesh in getattr(vessel(0.0, seed), kind)]
    settling = settle(sherds)
    before = rms_errors([mesh.vertices for mesh in sherds], truth)
    after = rms_errors([mesh.vertices for mesh in settling.sherds], truth)
    assert after.mean() < 0.25 * before.mean() and after.max() < 0.4 * before.max()
    assert settling.gap_after < settling.gap_before
    assert not any(move.bounded for move in settling.moves)


def test_a_sherd_that_came_far_out_of_place_does_not_hold_the_others_up():
    lost, shift, turn = 4, (0.3, -0.25, 0.2), (0.4, 0.3, -0.35)
    truth = [mesh.vertices for mesh in vessel(0.0).sherds]
    sherds = [s.moved(_about(s, shift, turn)) if i == lost else s for i, s in enumerate(vessel(0.1).sherds)]
    settling = settle(sherds)
    assert not any(move.bounded for move in settling.moves)
    assert rms_errors([mesh.vertices for mesh in settling.sherds], truth).max() < 0.05


def _about(sherd, shift, turn_degrees):
    centre = sherd.vertices.mean(axis=0)
    matrix = motion(shift, turn_degrees)
    matrix[:3, 3] += centre - matrix[:3, :3] @ centre
    return matrix


def test_the_mean_motion_is_zero():
    shifts = []
    for sherd, move in zip(vessel(0.1).sherds, settled_vessel().moves):
        centre = sherd.vertices.mean(axis=0)
        shifts.append(move.matrix[:3, :3] @ centre + move.matrix[:3, 3] - centre)
    assert np.linalg.norm(np.mean(shifts, axis=0)) < 0.02 * np.linalg.norm(shifts, axis=1).mean()


def test_every_move_is_rigid_and_what_it_says():
    settling = settled_vessel()
    for came, sherd, move in zip(vessel(0.1).sherds, settling.sherds, settling.moves):
        turn = Rotation.from_matrix(move.matrix[:3, :3])
        assert_allclose(sherd.vertices, came.moved(move.matrix).vertices, atol=1e-12)
        assert_allclose(np.degrees(turn.magnitude()), move.turn_deg, atol=1e-9)
        shift = sherd.vertices.mean(axis=0) - came.vertices.mean(axis=0)
        assert_allclose(np.linalg.norm(shift), move.shift_mm, atol=1e-9)
        assert np.array_equal(sherd.face_vertices, came.face_vertices)


def test_no_sherd_goes_beyond_the_bounds():
    settling = settle(vessel(0.4).sherds, max_shift=0.3, max_turn=np.radians(0.2))
    assert any(move.bounded for move in settling.moves)
    assert max(move.shift_mm for move in settling.moves) <= 0.3 + 1e-9
    assert max(move.turn_deg for move in settling.moves) <= 0.2 + 1e-9
    assert settling.gap_after < settling.gap_before


def test_one_sherd_out_of_reach_does_not_drag_the_others_along():
    whole, strays = vessel(0.1).outer_walls, 4
    sherds = [s.moved(motion((2.5, 1.3, 0.7))) if i == strays else s for i, s in enumerate(whole)]
    truth = [mesh.vertices for mesh in vessel(0.0).outer_walls]
    settled = settle(sherds).sherds
    others = [i for i in range(len(sherds)) if i != strays]
    before = rms_errors([sherds[i].vertices for i in others], [truth[i] for i in others])
    after = rms_errors([settled[i].vertices for i in others], [truth[i] for i in others])
    assert after.mean() < 0.4 * before.mean()


def test_what_fits_is_returned_as_it_came():
    lower, upper = puzzle()
    settling = settle([lower, upper])
    assert not settling.settled and settling.sherds == (lower, upper)
    assert [move.shift_mm for move in settling.moves] == [0.0, 0.0]
    assert "stay" in settling.summary()


@pytest.mark.parametrize("kind", ["sherds", "outer_walls"])
def test_a_vessel_in_place_moves_no_more_than_its_noise(kind):
    settling = settle(getattr(vessel(0.0), kind))
    assert max(move.shift_mm for move in settling.moves) < VESSEL.noise


def test_a_sherd_without_neighbours_stays():
    lower, upper = puzzle()
    far = block(level(40.0), level(46.0), name="far")
    settling = settle([lower, upper.moved(motion((0.0, 0.0, 0.2))), far])
    assert settling.settled and settling.sherds[2] is far
    assert np.isnan(settling.moves[2].gap_before) and settling.moves[2].contacts == 0
    assert np.array_equal(settling.moves[2].matrix, np.eye(4))


@pytest.mark.parametrize("alone", [1, 2])
def test_sherds_that_touch_nothing_all_stay(alone):
    sherds = [block(level(20.0 * i), level(20.0 * i + 6.0)) for i in range(alone)]
    settling = settle(sherds)
    assert not settling.settled and settling.sherds == tuple(sherds)
    assert "none touches" in settling.summary()


def test_what_a_contact_cannot_tell_stays_as_it_was():
    # A small block on a large plane: its height and two of its turns are known, its place on the plane is not.
    lower = block(level(-6.0), flat)
    upper = block(flat, level(6.0), size=8.0, n=23).moved(motion((0.3, -0.2, 0.2)))
    settling = settle([lower, upper])
    closed = settling.sherds[1].vertices[:, 2].min() - settling.sherds[0].vertices[:, 2].max()
    slid = [move.matrix[:2, 3] for move in settling.moves]
    assert abs(closed) < 0.02
    assert np.abs(slid).max() < 0.01


def test_settling_the_settled_moves_little():
    # It moves a little: the prior, that sherds lie where they were put, now holds for where they were settled.
    once = settled_vessel()
    again = settle(once.sherds)
    assert max(move.shift_mm for move in again.moves) < 0.3 * max(move.shift_mm for move in once.moves)


def test_the_answer_is_the_same_every_time():
    sherds = vessel(0.1).outer_walls
    one, two = settle(sherds), settle(sherds)
    assert all(np.array_equal(a.vertices, b.vertices) for a, b in zip(one.sherds, two.sherds))
    assert [m.gap_after for m in one.moves] == [m.gap_after for m in two.moves]


@pytest.mark.parametrize("scale", [0.01, 100.0])
def test_lengths_scale_with_the_model(scale):
    lower, upper = puzzle()
    sherds = [lower, upper.moved(motion((0.1, -0.1, 0.15)))]
    larger = [mesh.moved(np.diag([scale, scale, scale, 1.0])) for mesh in sherds]
    one, two = settle(sherds), settle(larger, max_shift=0.75 * scale)
    for a, b in zip(one.moves, two.moves):
        assert_allclose(b.shift_mm, scale * a.shift_mm, rtol=1e-3)
        assert_allclose(b.turn_deg, a.turn_deg, rtol=1e-3, atol=1e-6)


@pytest.mark.parametrize("bounds", [{"max_shift": 0.0}, {"max_turn": -0.1}, {"max_shift": float("nan")}])
def test_bounds_must_be_positive(bounds):
    with pytest.raises(BadOption, match="must be positive"):
        settle(puzzle(), **bounds)


def on_circle(angles, radius=30.0):
    out = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=1)
    return Samples(radius * out, out, np.zeros(len(angles), dtype=bool))


def test_a_round_wall_goes_on_across_a_crack_without_a_step():
    # For two points of one circle (p - q)·(n_p + n_q) = r (n_p - n_q)·(n_p + n_q) = 0, however wide the crack.
    left, right = on_circle(np.linspace(-0.2, -0.01, 60)), on_circle(np.linspace(0.01, 0.2, 60))
    pairs = PartnerTree(right, 2.0).partners(left)
    assert len(pairs.sample) > 0 and (pairs.kind == CONTINUATION).all()
    assert_allclose(pairs.distances, 0.0, atol=1e-12)


@pytest.mark.parametrize("border", [False, True])
def test_the_distance_of_parallel_fractures_is_the_gap(border):
    points = np.random.default_rng(5).uniform(-3, 3, (500, 3)) * [1, 1, 0]
    up = np.tile([0.0, 0.0, 1.0], (500, 1))
    flags = np.full(500, border)
    pairs = PartnerTree(Samples(points + np.array([0, 0, 0.3]), -up, flags), 1.0).partners(
        Samples(points[::-1], up, flags)
    )
    assert len(pairs.sample) == 500 and (pairs.kind == (BORDER if border else MATING)).all()
    assert_allclose(pairs.distances, 0.3, atol=1e-12)


def test_walls_back_to_back_are_no_partners():
    # The far side of a thin wall looks the right way, but lies farther off than the reach.
    points = np.random.default_rng(5).uniform(-3, 3, (500, 3)) * [1, 1, 0]
    up, flags = np.tile([0.0, 0.0, 1.0], (500, 1)), np.zeros(500, dtype=bool)
    pairs = PartnerTree(Samples(points - np.array([0, 0, 1.1]), -up, flags), 1.0).partners(Samples(points, up, flags))
    assert len(pairs.sample) == 0

"""Lines between wall and void: found, joined, cleaned, cut off at the rim."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from recon.geometry.mesh import TriangleMesh
from recon.hole_patch.assembly import Assembly, assemble
from recon.hole_patch.edge_cleaning import chart_points, clean_rows, crossings, signed_area
from recon.hole_patch.hole_edges import Cycle, free_border, hole_cycles, void_edges
from recon.hole_patch.open_rims import excursions, winding
from recon.hole_patch.surroundings import Axis
from recon.hole_patch.walls import OUTER

Z_AXIS = Axis(np.zeros(3), np.array([0.0, 0.0, 1.0]), 0.0)


def square_frame(gap: float) -> list[TriangleMesh]:
    """A 40 x 40 sheet with a 16 x 16 hole in its middle, in two halves a gap apart."""
    x, y = (a.ravel() for a in np.meshgrid(np.arange(40), np.arange(40), indexing="ij"))
    kept = ~((x >= 12) & (x < 28) & (y >= 12) & (y < 28))
    halves = []
    for half in (x < 20, x >= 20):
        corner = (x * 41 + y)[kept & half]
        faces = np.concatenate(
            [np.stack([corner, corner + 41, corner + 1], 1), np.stack([corner + 1, corner + 41, corner + 42], 1)]
        )
        gx, gy = np.meshgrid(np.arange(41.0), np.arange(41.0), indexing="ij")
        points = np.stack([gx.ravel() + (gap if half[-1] else 0.0), gy.ravel(), 0 * gx.ravel()], axis=1)
        halves.append(TriangleMesh(points, faces).part(np.ones(len(faces), dtype=bool)))
    return halves


def cycles_of(table: Assembly) -> list[Cycle]:
    nothing = np.zeros(table.n_faces, dtype=bool)
    labels = np.full(table.n_faces, OUTER)
    free = free_border(table, np.zeros(table.n_sherds, dtype=bool))
    void = void_edges(table, labels, hole=nothing, free=free, lip=nothing, thickness=1.0)
    return hole_cycles(table, table.normals, labels, void=void)


def circle(n: int, radius: float = 10.0) -> np.ndarray:
    angle = np.linspace(0, 2 * np.pi, n, endpoint=False)
    return radius * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)


def test_chains_of_two_sherds_join_to_one_line_round_the_hole_and_one_round_the_sheet():
    outside, hole = cycles_of(assemble(square_frame(0.05)))
    assert_allclose([outside.length, hole.length], [160.1, 64.1], atol=0.05)
    assert set(hole.sherds) >= {0, 1}
    assert signed_area(hole.points[:, :2]) < 0 < signed_area(outside.points[:, :2])  # the wall lies on the left


def test_a_border_near_another_sherd_is_not_free():
    table = assemble(square_frame(0.05))
    middle = table.vertices[table.border_edges].mean(axis=1)
    crack = (np.abs(middle[:, 0] - 20) < 0.2) & (np.abs(middle[:, 1] - 20) < 18)
    assert not free_border(table, np.zeros(2, dtype=bool))[crack].any()


def test_a_border_of_one_mesh_alone_is_all_free():
    table = assemble(square_frame(0.05)[:1])
    assert free_border(table, np.zeros(1, dtype=bool)).all()


def test_chart_keeps_the_sense_of_rotation_seen_from_outside():
    ring = circle(40)
    up = np.tile([0.0, 0.0, 1.0], (40, 1))
    assert signed_area(chart_points(ring, up)) > 0 > signed_area(chart_points(ring, -up))
    assert signed_area(chart_points(ring[::-1], up)) < 0


def test_area_of_a_regular_polygon():
    assert_allclose(signed_area(circle(12, 2.0)[:, :2]), 0.5 * 12 * 4 * np.sin(np.pi / 6))


def test_a_convex_polygon_has_no_crossing_and_an_eight_has_one():
    t = np.linspace(0, 2 * np.pi, 41)[:-1] + 0.03
    assert len(crossings(circle(30)[:, :2])) == 0
    assert len(crossings(np.stack([np.sin(t), np.sin(2 * t)], axis=1))) == 1


def test_a_clean_line_keeps_every_point():
    ring = circle(60)
    assert_allclose(clean_rows(ring, ring[:, :2], 1.0), np.arange(60))


@pytest.mark.parametrize("reach", [14.0, 6.0])
def test_a_hair_is_cut_off_and_the_rest_stays(reach):
    ring = circle(60)
    along = np.linspace(10, reach, 8)[1:]
    out = np.stack([along, np.full(7, 0.1), 0 * along], axis=1)
    back = np.stack([along[::-1], np.full(7, 0.4), 0 * along], axis=1)
    line = np.concatenate([ring[:1], out, back, ring[1:]])
    kept = line[clean_rows(line, line[:, :2], 1.0)]
    assert np.abs(np.linalg.norm(kept, axis=1) - 10.0).max() < 0.7
    assert len(kept) > 55


def test_what_is_left_after_cleaning_never_crosses_itself():
    chance = np.random.default_rng(6)
    for _ in range(5):
        ring = circle(80) + 0.6 * chance.standard_normal((80, 3)) * [1, 1, 0]
        kept = ring[clean_rows(ring, ring[:, :2], 0.8), :2]
        assert len(crossings(kept)) == 0
        assert len(kept) > 30


def rim_with_notch() -> Cycle:
    """The mouth of a cylinder, run through with the wall below it on the left, with a V 8 deep cut into it."""
    angle = -np.linspace(0, 2 * np.pi, 240, endpoint=False)
    depth = np.clip(8.0 - 40.0 * np.abs(np.abs(angle) - np.pi), 0.0, None)
    points = Z_AXIS.cartesian(np.stack([angle, np.full(240, 20.0), 50.0 - depth], axis=1))
    out = Z_AXIS.cartesian(np.stack([angle, np.ones(240), np.zeros(240)], axis=1))
    return Cycle(points, out, np.zeros(240, dtype=np.int64), np.full(240, OUTER), 0.0)


def test_a_line_round_the_axis_winds_once_and_a_hole_does_not():
    rim = rim_with_notch()
    small = Cycle(rim.points * [0.1, 0.1, 1] + [20, 0, 0], rim.normals, rim.sherds, rim.walls, 0.0)
    assert winding(rim, Z_AXIS) == -1
    assert winding(small, Z_AXIS) == 0


def test_a_notch_is_cut_off_at_the_level_of_the_rim():
    (notch,) = excursions(rim_with_notch(), Z_AXIS, 0.5)
    height = notch.points[:, 2]
    assert_allclose([height.min(), height.max()], [42.0, 50.0], atol=0.6)
    assert np.abs(height[notch.sherds < 0] - 50.0).max() < 0.6  # the bridge runs along the rim
    assert_allclose(notch.length, 2 * np.hypot(8, 4) + 8, rtol=0.1)


def test_an_even_rim_has_no_excursion():
    rim = rim_with_notch()
    even = Cycle(rim.points * [1, 1, 0] + [0, 0, 50], rim.normals, rim.sherds, rim.walls, 0.0)
    assert excursions(even, Z_AXIS, 0.5) == []

from collections.abc import Callable

import numpy as np
import pytest
from thrown_walls import (
    AXIS,
    Surface,
    cone,
    cylinder,
    dish,
    dish_with_hole,
    hole_points,
    plan_circle,
    sphere,
    wall_with_hole,
)

from recon.errors import NoSurface
from recon.geometry.mesh import TriangleMesh
from recon.hole_patch.sheet import Sheet
from recon.hole_patch.surroundings import Axis, HoleEdge, Wall
from recon.hole_patch.unit_length import axis_in, wall_in
from recon.hole_patch.wheel_sheet import wheel_sheet
from recon.numerics.foot_points import foot_points

Shift = Callable[[np.ndarray, np.ndarray], np.ndarray]


def distances(sheet: Sheet, points: np.ndarray) -> np.ndarray:
    surface = sheet.trimmed.surface
    return np.linalg.norm(surface.point(foot_points(surface, points)) - points, axis=1)


def bent(wall: Wall, shift: Shift) -> Wall:
    """The wall with its radii changed by shift(θ, z)."""

    def moved(points: np.ndarray) -> np.ndarray:
        p = AXIS.cylindrical(points)
        p[:, 1] += shift(p[:, 0], p[:, 2])
        return AXIS.cartesian(p)

    mesh = TriangleMesh(moved(wall.measured.vertices), wall.measured.face_vertices)
    edge = HoleEdge(moved(wall.edge.points), wall.edge.sherds)
    return Wall(mesh, mesh, wall.sherds, wall.trust, edge)


@pytest.mark.parametrize(
    ("surface", "allowed"),
    [(cylinder(30.0), 1e-6), (cone(40.0, 0.4), 1e-6), (sphere(45.0), 1e-4)],
    ids=("cylinder", "cone", "sphere"),
)
def test_a_turned_wall_is_reproduced(surface: Surface, allowed: float) -> None:
    sheet = wheel_sheet(wall_with_hole(surface), AXIS)
    assert distances(sheet, hole_points(surface)).max() < allowed
    assert sheet.edge_distance.max() < allowed


def test_normal_points_away_from_the_axis_and_the_loop_bounds_the_hole() -> None:
    radius, size = 30.0, (0.5, 14.0)
    sheet = wheel_sheet(wall_with_hole(cylinder(radius), size=size), AXIS)
    surface, loop = sheet.trimmed.surface, sheet.trimmed.loops[0]
    uv = loop.polygon()
    outward = surface.point(uv) - AXIS.cartesian(AXIS.cylindrical(surface.point(uv)) * [1, 0, 1])
    np.testing.assert_allclose(np.einsum("ij,ij->i", surface.normal(uv), outward), radius, rtol=1e-5)
    assert loop.signed_area() == pytest.approx(np.pi * size[0] * radius * size[1], rel=5e-3)  # an oval, unrolled


@pytest.mark.parametrize("aside", [0.0, 9.0])
def test_a_hole_over_the_axis_is_covered_smoothly(aside: float) -> None:
    surface = dish(80.0)
    sheet = wheel_sheet(dish_with_hole(surface, aside=aside, radius=14.0), AXIS)
    points = np.concatenate(
        [surface(np.arctan2(y, x), np.hypot(x, y)) for x, y in (plan_circle(aside, r) for r in (0.5, 5.0, 10.0, 13.0))]
    )
    assert distances(sheet, points).max() < 0.05
    normals = sheet.trimmed.surface.normal(foot_points(sheet.trimmed.surface, points))
    centre = AXIS.cartesian(np.array([[0.0, 0.0, 80.0]]))
    np.testing.assert_allclose(normals, (points - centre) / 80.0, atol=0.01)


def test_ovality_is_followed_across_the_hole() -> None:
    oval = lambda angle, z: 0.3 * np.cos(2 * angle)  # noqa: E731
    sheet = wheel_sheet(bent(wall_with_hole(cylinder(30.0)), oval), AXIS)
    points = AXIS.cylindrical(hole_points(cylinder(30.0)))
    points[:, 1] += oval(points[:, 0], 0)
    off = distances(sheet, AXIS.cartesian(points))
    assert off.mean() < 0.03
    assert off.max() < 0.08


def test_relief_is_met_at_the_edge_and_not_carried_inside() -> None:
    cords = lambda angle, z: 0.4 * np.sin(30 * angle + z)  # noqa: E731
    surface = cylinder(30.0)
    sheet = wheel_sheet(bent(wall_with_hole(surface), cords), AXIS)
    inner_half = hole_points(surface, (0.35, 9.0))
    assert sheet.edge_distance.mean() < 0.03
    assert distances(sheet, inner_half).max() < 0.1


def test_chips_in_the_edge_are_left_out_and_told() -> None:
    wall = wall_with_hole(cylinder(30.0))
    points = wall.edge.points.copy()
    points[50] = AXIS.cartesian(AXIS.cylindrical(points[50:51]) - [0, 1.5, 0])[0]
    chipped = Wall(wall.measured, wall.plain, wall.sherds, wall.trust, HoleEdge(points, wall.edge.sherds))
    sheet = wheel_sheet(chipped, AXIS)
    assert sheet.edge_distance.max() < 1e-3
    assert len(sheet.edge_distance) == len(points) - 1
    assert "1 of 240" in sheet.notes[0]


def test_a_stretch_of_edge_that_strayed_into_the_fracture_does_not_draw_the_face() -> None:
    wall = wall_with_hole(cylinder(30.0))
    points = AXIS.cylindrical(wall.edge.points)
    points[60:80, 1] -= 2.0
    strayed = HoleEdge(AXIS.cartesian(points), wall.edge.sherds)
    sheet = wheel_sheet(Wall(wall.measured, wall.plain, wall.sherds, wall.trust, strayed), AXIS)
    assert distances(sheet, hole_points(cylinder(30.0))).max() < 1e-3
    assert "20 of 240" in sheet.notes[0]


def test_bridges_between_sherds_do_not_draw_the_face() -> None:
    wall = wall_with_hole(cylinder(30.0))
    points, sherds = wall.edge.points.copy(), wall.edge.sherds.copy()
    chord = np.linspace(0, 1, 21)[1:-1, None]
    points[101:120] = points[100] + chord * (points[120] - points[100])  # straight, below the round wall
    sherds[101:120] = -1
    bridged = Wall(wall.measured, wall.plain, wall.sherds, wall.trust, HoleEdge(points, sherds))
    sheet = wheel_sheet(bridged, AXIS)
    assert distances(sheet, hole_points(cylinder(30.0))).max() < 1e-3


def test_no_ring_is_refused() -> None:
    wall = wall_with_hole(cylinder(30.0))
    p = AXIS.cylindrical(wall.measured.vertices)
    far = (np.cos(p[:, 0] - 2.5) < 0)[wall.measured.face_vertices].all(axis=1)
    part = wall.measured.part(far)
    n = part.n_vertices
    with pytest.raises(NoSurface, match="No wall"):
        wheel_sheet(Wall(part, part, np.zeros(n, np.int64), np.ones(n), wall.edge), AXIS)


def test_an_axis_a_little_aside_is_made_up_for_by_the_plate() -> None:
    aside = Axis(AXIS.point + 2.0 * AXIS.frame()[0], AXIS.direction, 0.0)
    sheet = wheel_sheet(wall_with_hole(cylinder(30.0)), aside)
    assert distances(sheet, hole_points(cylinder(30.0))).max() < 0.2


def test_a_wall_that_was_not_thrown_on_this_axis_is_refused() -> None:
    folds = lambda angle, z: 6.0 * np.sin(7 * angle + z / 5)  # noqa: E731
    with pytest.raises(NoSurface, match="not round"):
        wheel_sheet(bent(wall_with_hole(cylinder(30.0)), folds), AXIS)


@pytest.mark.parametrize("factor", [0.4, 3.0])
def test_a_vessel_of_another_size_gets_the_same_piece_at_that_size(factor: float) -> None:
    wall = wall_with_hole(cone(40.0, 0.4))
    unit = 1.0 / factor
    one, other = wheel_sheet(wall, AXIS), wheel_sheet(wall_in(wall, unit), axis_in(AXIS, unit))
    uv = one.trimmed.loops[0].polygon()
    middle = np.concatenate([uv, 0.5 * (uv + uv.mean(axis=0))])
    points, others = one.trimmed.surface.point(middle), other.trimmed.surface.point(factor * middle)
    np.testing.assert_allclose(others, factor * points, atol=1e-6 * factor)

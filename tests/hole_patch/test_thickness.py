import numpy as np
import pytest
from thrown_walls import AXIS, cylinder, sphere, wall_with_hole

from recon.errors import BadOption, NoWall
from recon.hole_patch.sheet import Sheet
from recon.hole_patch.thickness import Thickness, offset_sheet, piece_thickness
from recon.hole_patch.wheel_sheet import wheel_sheet


@pytest.fixture(scope="module")
def outer() -> Sheet:
    return wheel_sheet(wall_with_hole(cylinder(30.0)), AXIS)


@pytest.fixture(scope="module")
def inner() -> Sheet:
    """Smaller and turned a little: a fracture that is not square to the wall."""
    return wheel_sheet(wall_with_hole(cylinder(27.0), size=(0.45, 12.5)), AXIS)


def test_thickness_between_two_cylinders(outer: Sheet, inner: Sheet) -> None:
    found = piece_thickness(outer, inner)
    np.testing.assert_allclose([found.least, found.mean, found.greatest], 3.0, atol=1e-4)


@pytest.mark.parametrize("thickness", [0.5, 2.0, 8.0])
def test_offset_of_a_cylinder_is_a_cylinder(outer: Sheet, thickness: float) -> None:
    sheet = offset_sheet(outer, thickness)
    uv = sheet.trimmed.loops[0].polygon()
    radius = AXIS.cylindrical(sheet.trimmed.surface.point(uv))[:, 1]
    np.testing.assert_allclose(radius, 30.0 - thickness, atol=1e-4)
    assert len(sheet.edge_distance) == 0
    assert "not measured" in sheet.notes[0]


def test_offset_keeps_parameters_and_sides(outer: Sheet) -> None:
    sheet = offset_sheet(outer, 2.0)
    uv = outer.trimmed.loops[0].polygon()
    apart = outer.trimmed.surface.point(uv) - sheet.trimmed.surface.point(uv)
    np.testing.assert_allclose(apart, 2.0 * outer.trimmed.surface.normal(uv), atol=1e-3)
    np.testing.assert_allclose(sheet.trimmed.surface.normal(uv), outer.trimmed.surface.normal(uv), atol=1e-3)


def test_a_wall_thicker_than_the_radius_is_refused() -> None:
    ball = wheel_sheet(wall_with_hole(sphere(24.0), t_range=(-24.0, 24.0), size=(0.4, 8.0)), AXIS)
    assert offset_sheet(ball, 20.0).samples == 0
    with pytest.raises(NoWall, match="radius"):
        offset_sheet(ball, 25.0)


@pytest.mark.parametrize("thickness", [0.0, -1.0, float("nan")])
def test_a_thickness_must_be_positive(outer: Sheet, thickness: float) -> None:
    with pytest.raises(BadOption):
        offset_sheet(outer, thickness)


def test_thin_places_are_found_with_their_share() -> None:
    thickness = Thickness(np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]]), np.array([3.0, 0.8, 2.0, 0.9]))
    share, place = thickness.thinner_than(1.0)
    assert share == 0.5 and place.tolist() == [1.0, 0.0, 0.0]
    assert thickness.thinner_than(0.5)[0] == 0.0

import numpy as np
import pytest
from numpy.testing import assert_allclose

from recon.errors import BadOption, NoSurface
from recon.geometry.bspline import BSplineSurface
from recon.geometry.trimmed import TrimmedSurface
from recon.hole_patch.trim_loop import clean_polygon, crossings, even_points, parameter_loop, trim_loop

KNOTS = np.array([0.0, 0.0, 1.0, 1.0])


def flat_surface(width=60.0, height=40.0):
    """A rectangle around the origin in millimetres whose parameters run from 0 to 1."""
    x, y = np.meshgrid([-width / 2, width / 2], [-height / 2, height / 2], indexing="ij")
    return BSplineSurface(1, 1, KNOTS, KNOTS, np.stack([x, y, 0 * x], axis=-1))


def circle(radius=10.0, n=200):
    angle = np.arange(n) * 2 * np.pi / n
    return radius * np.stack([np.cos(angle), np.sin(angle), np.zeros(n)], axis=1)


def spiky(n=400):
    """A circle with a needle outward, a slit inward, a small knot, and a jump off the surface."""
    points = circle(n=n)
    points[10, :2] *= 1.5
    points[100, :2] *= 0.4
    points[[200, 203]] = points[[203, 200]]
    points[300, 2] += 3.0
    return points


@pytest.mark.parametrize("turn", [1, -1])
@pytest.mark.parametrize("n_curves", [1, 2, 4, 7])
def test_the_loop_of_a_circle_is_the_circle(turn, n_curves):
    surface = flat_surface()
    loop = trim_loop(surface, circle()[::turn], n_curves=n_curves)
    assert len(loop.pcurves) == n_curves
    assert TrimmedSurface(surface, (loop,)).loops[0].signed_area() > 0
    radius = np.linalg.norm(surface.point(loop.polygon(100)), axis=1)
    assert_allclose(radius, 10.0, atol=0.01)


def test_curves_meet_with_equal_first_and_second_derivatives():
    pcurves = trim_loop(flat_surface(), spiky()).pcurves
    for one, after in zip(pcurves, pcurves[1:] + pcurves[:1]):
        assert one.domain[1] == after.domain[0] or after is pcurves[0]
        for order in (0, 1, 2):
            at_end = one.derivative([one.domain[1]], order)
            assert_allclose(at_end, after.derivative([after.domain[0]], order), atol=1e-9)


def test_spikes_slits_and_knots_are_removed():
    surface = flat_surface()
    polygon = surface.point(trim_loop(surface, spiky()).polygon(200))[:, :2]
    assert len(crossings(polygon)) == 0
    # A disk of 0.6 mm rolled along both sides keeps within that of the clean circle, but for the slit's mouth.
    assert np.abs(np.linalg.norm(polygon, axis=1) - 10.0).max() < 0.6


def test_the_loop_begins_near_the_first_point():
    surface, points = flat_surface(), np.roll(circle(), -57, axis=0)
    start = surface.point(trim_loop(surface, points).pcurves[0].control_points[:1])
    assert np.linalg.norm(start - points[0]) < 0.4


def test_gaps_are_closed_by_straight_steps():
    surface, points = flat_surface(), circle()
    kept = np.abs(np.arctan2(points[:, 1], points[:, 0])) > 0.3
    polygon = surface.point(trim_loop(surface, points[kept]).polygon(200))[:, :2]
    chord = 10 * np.cos(0.3)
    across = polygon[(polygon[:, 0] > 0) & (np.abs(polygon[:, 1]) < 2.0)]
    assert_allclose(across[:, 0], chord, atol=0.1)


def test_points_known_in_parameters_give_the_same_loop():
    surface, points = flat_surface(), circle()
    uv = points[:, :2] / [60.0, 40.0] + 0.5
    one, other = trim_loop(surface, points), parameter_loop(surface, uv)
    assert_allclose(other.polygon(), one.polygon(), atol=1e-9)


def test_an_edge_beyond_the_surface_is_refused():
    with pytest.raises(NoSurface, match="runs off the surface"):
        trim_loop(flat_surface(), circle(radius=25.0))


def test_a_hole_narrower_than_the_cleaning_is_refused():
    with pytest.raises(NoSurface, match="nowhere wider"):
        trim_loop(flat_surface(), circle() * [1.0, 0.03, 1.0])


def test_a_loop_needs_a_curve():
    with pytest.raises(BadOption, match="at least one curve"):
        trim_loop(flat_surface(), circle(), n_curves=0)


def test_even_points_are_evenly_spaced_on_the_polygon():
    square = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]])
    points = even_points(square, 0.5)
    assert len(points) == 32
    assert_allclose(np.linalg.norm(points - np.roll(points, 1, axis=0), axis=1), 0.5)


def test_crossings_names_the_sides_of_a_figure_of_eight():
    eight = np.array([[0.0, 0.0], [2.0, 2.0], [2.0, 0.0], [0.0, 2.0]])
    assert crossings(eight).tolist() == [[0, 2]]
    assert len(crossings(eight[[0, 2, 1, 3]])) == 0


def test_cleaning_keeps_a_smooth_convex_outline():
    outline = clean_polygon(circle(n=400)[:, :2], radius=0.6)
    assert_allclose(np.linalg.norm(outline, axis=1), 10.0, atol=0.01)
    x, y = outline.T
    assert np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)) > 0

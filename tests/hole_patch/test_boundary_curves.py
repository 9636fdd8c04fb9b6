import graph_walls as gw
import numpy as np
import pytest
from numpy.testing import assert_allclose

from recon.hole_patch.boundary_curves import boundary_ordinates, fit_cubic
from recon.hole_patch.box import edge_box
from recon.hole_patch.cutting_planes import Section, cut_sides, near_wall
from recon.numerics.bernstein import bernstein

T = np.linspace(0.0, 1.0, 31)


def section(t, height):
    return Section(t, height, np.ones_like(t))


def cubic(t):
    return 2.0 - 3.0 * t + 5.0 * t**2 - 4.0 * t**3


def test_the_least_squares_curve_reproduces_a_cubic():
    t = np.random.default_rng(0).uniform(size=40)
    assert_allclose(bernstein(3, T) @ fit_cubic(section(t, cubic(t))), cubic(T), atol=1e-12)


def test_the_least_squares_curve_solves_the_papers_normal_equations():
    rng = np.random.default_rng(1)
    t, noise = rng.uniform(size=60), rng.normal(size=60)
    residual = bernstein(3, t) @ fit_cubic(section(t, noise)) - noise
    for power in range(4):  # [kinoshita], equations (7) to (10): the residual is orthogonal to 1, x, x², x³
        assert residual @ t**power == pytest.approx(0.0, abs=1e-10)


def test_fixed_ends_are_met_exactly():
    t = np.random.default_rng(2).uniform(size=40)
    ordinates = fit_cubic(section(t, cubic(t)), start=2.5, end=-1.0)
    assert ordinates[0] == 2.5
    assert ordinates[-1] == -1.0


def test_points_without_trust_have_no_say():
    t = np.linspace(0, 1, 40)
    height = cubic(t) + np.where(np.arange(40) % 2, 10.0, 0.0)
    trusted = Section(t, height, np.where(np.arange(40) % 2, 1e-14, 1.0))
    assert_allclose(bernstein(3, T) @ fit_cubic(trusted), cubic(T), atol=1e-9)


@pytest.mark.parametrize(("covered", "degree"), [(0.5, 2), (0.3, 1)])
def test_a_curve_covered_in_part_is_of_lower_degree(covered, degree):
    t = np.linspace(0, covered, 30)
    ordinates = fit_cubic(section(t, np.sin(9 * t)))
    assert_allclose(np.diff(ordinates, degree + 1), 0.0, atol=1e-9)


@pytest.mark.parametrize("shape", [gw.cylinder, gw.sphere, gw.paraboloid])
@pytest.mark.parametrize("angle", [0.0, 0.4, 1.3])
def test_neighbouring_curves_meet(shape, angle):
    wall = gw.graph_wall(shape, matrix=gw.rigid(1))
    box = edge_box(wall).turned(angle)
    sides = boundary_ordinates(cut_sides(near_wall(wall, box), box))
    for (side, end), (other, other_end) in (
        ((0, 0), (3, 0)),
        ((0, -1), (1, 0)),
        ((1, -1), (2, -1)),
        ((2, 0), (3, -1)),
    ):
        assert sides[side, end] == pytest.approx(sides[other, other_end], abs=1e-12)


@pytest.mark.parametrize("angle", [0.0, 0.7])
def test_sections_lie_on_the_wall_and_in_the_sides_of_the_box(angle):
    wall = gw.graph_wall(gw.plane, matrix=gw.rigid(2))
    box = edge_box(wall).turned(angle)
    for side in cut_sides(near_wall(wall, box), box):
        # The box stands in the plane of the edge, which is the wall itself here.
        assert_allclose(side.height, 0.0, atol=1e-9)
        assert side.t.min() >= 0
        assert side.t.max() <= 1
        assert side.coverage() == 1.0


def test_the_opposite_wall_is_left_out():
    wall = gw.graph_wall(gw.sphere)
    box = edge_box(wall)
    assert (near_wall(wall, box).vertices[:, 2] <= 0).all()
    turned_over = gw.graph_wall(gw.sphere, matrix=np.diag([1.0, -1.0, -1.0, 1.0]))
    assert len(near_wall(turned_over, box).vertices) == 0

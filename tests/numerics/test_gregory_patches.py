"""Gregory patches side by side, and their B-splines."""

import numpy as np
import pytest

from recon.geometry.bspline import BSplineSurface
from recon.numerics.bspline_basis import clamped_knots
from recon.numerics.gregory import GregoryNets, gregory_nets, spline_nets
from recon.numerics.rows import unit_vectors

BREAKS = np.array([0.0, 0.03, 0.09, 0.27, 0.5, 0.73, 0.91, 0.97, 1.0])
T = np.linspace(0.0, 1.0, 41)
SIDES = [(T, 0 * T), (0 * T + 1, T), (T, 0 * T + 1), (0 * T, T)]


def pair(seed: int, apex: bool = False) -> GregoryNets:
    """Two patches within cubics over a bumpy strip, the right side of the first the left one of the second; with an
    apex their sides v = 1 are a point each.
    """
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid([0.0, 1.0, 2.0], [0.0, 1.0])
    points = np.column_stack([x.ravel(), y.ravel(), 0.4 * np.sin(3 * x.ravel() + y.ravel())])
    points += 0.1 * rng.normal(size=points.shape)
    normals = unit_vectors(np.column_stack([0.5 * rng.normal(size=(6, 2)), np.ones(6)]))
    if apex:
        points[[3, 5]], normals[[3, 5]] = points[4], normals[4]

    def cubic(i, j):
        legs = [(points[k] - points[i]) / 3 for k in (j, j)]
        legs = [leg - (leg @ normals[k]) * normals[k] for leg, k in zip(legs, (i, j))]
        return np.array([points[i], points[i] + legs[0], points[j] - legs[1], points[j]])

    middle = cubic(1, 4)
    rows = [(cubic(0, 1), middle, cubic(3, 4), cubic(0, 3)), (cubic(1, 2), cubic(2, 5), cubic(4, 5), middle)]
    sides = [np.stack([row[k] for row in rows]) for k in range(4)]
    return gregory_nets(
        (sides[0], sides[1], sides[2], sides[3]), np.stack([normals[[0, 1, 4, 3]], normals[[1, 2, 5, 4]]])
    )


def angles(one, other):
    return np.linalg.norm(np.cross(unit_vectors(one), unit_vectors(other)), axis=-1)


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("apex", [False, True])
def test_two_patches_share_points_and_tangent_planes(seed, apex):
    nets = pair(seed, apex)
    t = T[1:-1]
    right, left = (nets.part(np.array([k])).points(np.column_stack([u + 0 * t, t])) for k, u in ((0, 1), (1, 0)))
    assert np.abs(right[0] - left[0]).max() < 1e-14
    assert angles(np.cross(right[1], right[2]), np.cross(left[1], left[2])).max() < 1e-9


def test_derivatives_are_those_of_the_points():
    nets, step = pair(3), 1e-6
    uv = np.random.default_rng(0).uniform(0.02, 0.98, (50, 2))
    _, along_u, along_v = nets.points(uv)
    for given, way in ((along_u, [step, 0.0]), (along_v, [0.0, step])):
        change = (nets.points(uv + way)[0] - nets.points(uv - way)[0]) / (2 * step)
        assert np.abs(change - given).max() < 1e-7


def splines(nets: GregoryNets, breaks=BREAKS) -> list[BSplineSurface]:
    knots = clamped_knots(breaks, 3)
    return [BSplineSurface(3, 3, knots, knots, net) for net in spline_nets(nets, breaks)]


@pytest.mark.parametrize("apex", [False, True])
def test_the_spline_keeps_sides_and_their_cross_derivatives_but_beside_corners(apex):
    nets = pair(5, apex)
    for k, surface in enumerate(splines(nets)):
        for side, (u, v) in enumerate(SIDES):
            uv = np.column_stack([u, v])
            point, along_u, along_v = (x[k] for x in nets.points(uv))
            across, order = (along_v, (0, 1)) if side in (0, 2) else (along_u, (1, 0))
            assert np.abs(surface.point(uv) - point).max() < 1e-13
            # a cross derivative's second control point, the first that is averaged, fades out at the fourth break
            inner = (BREAKS[3] < T) & (1 - BREAKS[3] > T)
            assert np.abs(surface.derivative(uv, *order) - across)[inner].max() < 1e-12


def test_closer_knots_at_the_corners_bring_the_tangent_planes_together():
    nets = pair(7)
    t = np.linspace(0.0, 1.0, 2001)
    found = []
    for first in (0.1, 0.01, 0.001):
        breaks = np.concatenate([[0.0, first, 3 * first, 0.5], 1 - np.array([3 * first, first, 0.0])])
        right, left = splines(nets, breaks)
        normals = right.normal(np.column_stack([0 * t + 1, t])), left.normal(np.column_stack([0 * t, t]))
        found.append(np.degrees(np.arcsin(angles(*normals).max())))
    assert found[0] > 4 * found[1] > 16 * found[2]


def test_small_patches_far_away_lose_nothing_when_counted_from_their_corner():
    near = pair(5, apex=True)
    near = GregoryNets(0.1 * near.net_s, 0.1 * near.net_t)
    far = near.moved(np.full((2, 1, 1, 3), 2e3))
    breaks = np.array([0.0, 1e-5, 1e-3, 0.1, 0.5, 0.9, 0.999, 1.0 - 1e-5, 1.0])
    wanted = spline_nets(near.moved(-near.corner), breaks)
    made = spline_nets(far.moved(-far.corner), breaks)
    assert np.abs(made - wanted).max() < 1e-10
    assert (made[:, 0, 0] == 0.0).all()
    shift = far.points(np.array([[0.3, 0.6]]))[0] - near.points(np.array([[0.3, 0.6]]))[0]
    assert shift == pytest.approx(2e3)

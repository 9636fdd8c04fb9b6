import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from recon.errors import BadGeometry
from recon.geometry.bspline import BSplineSurface
from recon.geometry.patches import COLLAPSED, PatchNetwork, connect, side_curve

BEZIER = np.repeat([0.0, 1.0], 4)


def quilt(rows, columns, seed):
    """Bicubic patches over one net, so that neighbours share their border control points, each turned at random."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.arange(3 * rows + 1), np.arange(3 * columns + 1), indexing="ij")
    net = np.stack([x, y, np.zeros_like(x)], axis=-1) + rng.uniform(-0.3, 0.3, (*x.shape, 3))
    patches = []
    for i in range(rows):
        for j in range(columns):
            part = net[3 * i : 3 * i + 4, 3 * j : 3 * j + 4]
            way_u, way_v, exchange = rng.choice([-1, 1]), rng.choice([-1, 1]), rng.random() < 0.5
            part = part[::way_u, ::way_v]
            patches.append(BSplineSurface(3, 3, BEZIER, BEZIER * 2.5, part.swapaxes(0, 1) if exchange else part))
    return patches


def tube(n, radius, length, pole=False):
    """A prism of n flat strips around z as one surface of degree 1, closed in u; with a pole its top is a point."""
    turn = np.linspace(0, 2 * np.pi, n + 1)
    ring = radius * np.stack([np.cos(turn), np.sin(turn), np.zeros(n + 1)], axis=1)
    ring[-1] = ring[0]
    top = (np.zeros_like(ring) if pole else ring) + [0, 0, length]
    knots = np.concatenate([[0], np.arange(n + 1), [n]]) / n
    return BSplineSurface(1, 1, knots, [0, 0, 1, 1], np.stack([ring, top], axis=1))


@pytest.mark.parametrize("seed", range(5))
def test_a_quilt_has_the_corners_and_edges_of_its_grid_however_its_patches_are_turned(seed):
    network = connect(quilt(3, 2, seed), 1e-9)
    assert len(network.vertices) == 4 * 3
    assert len(network.edge_vertices) == 4 * 2 + 3 * 3
    uses = np.bincount(network.side_edges.ravel())
    assert (uses == 2).sum() == 2 * 2 + 3 * 1 and (uses == 1).sum() == 2 * (3 + 2)


@pytest.mark.parametrize("seed", range(3))
def test_both_sides_of_an_edge_run_through_the_same_points_in_the_direction_it_says(seed):
    network = connect(quilt(2, 3, seed), 1e-9)
    paths = {}
    for p, side in np.ndindex(network.side_edges.shape):
        curve = side_curve(network.patches[p], side)
        points = curve.point(np.linspace(*curve.domain, 7))[:: 1 if network.side_forward[p, side] else -1]
        e = int(network.side_edges[p, side])
        assert_allclose(points, paths.setdefault(e, points), atol=1e-12)
        assert_allclose(points[[0, -1]], network.vertices[network.edge_vertices[e]], atol=1e-9)


def test_a_closed_surface_has_a_seam_and_two_closed_edges():
    network = connect([tube(6, 2.0, 5.0)], 1e-9)
    bottom, end, top, begin = network.side_edges[0].tolist()
    assert end == begin and bottom != top
    assert len(network.vertices) == 2
    assert all(network.edge_vertices[e, 0] == network.edge_vertices[e, 1] for e in (bottom, top))


def test_a_side_in_one_point_is_collapsed():
    network = connect([tube(6, 2.0, 5.0, pole=True)], 1e-9)
    assert network.side_edges[0, 2] == COLLAPSED
    assert len(network.vertices) == 2 and len(network.edge_vertices) == 2


def test_two_arcs_between_the_same_corners_are_two_edges():
    def arc_patch(height):
        rim = np.array([[0, 0, 0], [1, 0, height], [2, 0, 0]], dtype=float)
        return BSplineSurface(
            2, 1, np.repeat([0.0, 1.0], 3), [0, 0, 1, 1], np.stack([rim, rim + np.array([0, 1, 0])], axis=1)
        )

    network = connect([arc_patch(1.0), arc_patch(-1.0)], 1e-9)
    assert len(network.vertices) == 4
    assert len(network.edge_vertices) == 2 + 4  # the straight sides are shared, the arcs are not


def test_sides_at_different_speeds_are_one_edge():
    flat = np.array([[[0, 0, 0], [0, 1, 0]], [[1, 0, 0], [1, 1, 0]], [[2, 0, 0], [2, 1, 0]]], dtype=float)
    even = BSplineSurface(2, 1, np.repeat([0.0, 1.0], 3), [0, 0, 1, 1], flat)
    hasty = np.array(flat[::-1]) - [0, 1, 0]
    hasty[1] += [0.7, 0, 0]
    uneven = BSplineSurface(2, 1, np.repeat([0.0, 1.0], 3), [0, 0, 1, 1], hasty)
    network = connect([even, uneven], 1e-9)
    assert network.side_edges[0, 0] == network.side_edges[1, 2]
    assert network.side_forward[0, 0] != network.side_forward[1, 2]


def test_corners_within_merge_are_one_and_beyond_it_are_not():
    left, right = quilt(1, 2, 0)
    moved = BSplineSurface(3, 3, right.knots_u, right.knots_v, right.control_net + np.array([0, 0, 1e-4]))
    assert len(connect([left, moved], 1e-3).vertices) == 6
    assert len(connect([left, moved], 1e-5).vertices) == 8


def test_a_network_whose_edges_do_not_join_its_corners_is_refused():
    good = connect(quilt(1, 2, 0), 1e-9)
    assert_array_equal(good.corner_vertices.max(), len(good.vertices) - 1)
    with pytest.raises(BadGeometry, match="does not join"):
        PatchNetwork(
            good.patches, good.vertices, good.edge_vertices, good.side_edges, ~good.side_forward, good.corner_vertices
        )
    with pytest.raises(BadGeometry, match="no patches"):
        connect([], 1e-9)

import numpy as np
import pytest
from exact_shapes import (
    area,
    barrel,
    disk,
    each_edge_is_used_once_each_way,
    edges_of,
    is_valid,
    quarters,
    shapes_in,
    sphere,
    swapped,
    torus,
)
from numpy.testing import assert_allclose
from OCP.BRep import BRep_Tool
from OCP.TopoDS import TopoDS

from brep_export.shells import PlanarLoops, network_shell, planar_shell
from recon.errors import NotManifold
from recon.geometry.bspline import BSplineSurface
from recon.geometry.patches import connect
from recon.tolerance import Tolerance

TETRAHEDRON = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
ITS_FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])


def loops_of(faces):
    faces = np.asarray(faces)
    return PlanarLoops(faces.ravel(), np.full(len(faces), faces.shape[1]), np.arange(len(faces)))


def shell_of(*patches, fit=0.05):
    return network_shell(connect(patches, 1e-7), Tolerance(fit=fit))


def test_a_planar_shell_shares_its_corners_and_edges():
    shell, volume = planar_shell(TETRAHEDRON, loops_of(ITS_FACES))
    assert is_valid(shell) and each_edge_is_used_once_each_way(shell) and BRep_Tool.IsClosed_s(shell)
    assert [len(shapes_in(shell, kind)) for kind in ("VERTEX", "EDGE", "FACE")] == [4, 6, 4]
    assert_allclose(volume, 1 / 6, rtol=1e-14)


def test_the_volume_of_a_shell_inside_out_is_negative():
    assert planar_shell(TETRAHEDRON, loops_of(ITS_FACES[:, ::-1]))[1] == pytest.approx(-1 / 6)


def test_edges_of_faces_that_are_not_quite_flat_have_a_tolerance_that_reaches_their_planes():
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    points = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    points[7] += 1e-3
    shell, _ = planar_shell(points, loops_of(quads))
    assert is_valid(shell)
    assert 2.5e-4 <= max(BRep_Tool.Tolerance_s(edge) for edge in edges_of(shell)) <= 1e-3


@pytest.mark.parametrize(
    ("faces", "problem"),
    [
        (ITS_FACES[1:], "belongs to 1 faces"),
        (np.concatenate([ITS_FACES, [[0, 1, 2]]]), "belongs to 3 faces"),
        (np.concatenate([ITS_FACES[:3], [[0, 2, 3]]]), "same direction"),
        (np.concatenate([ITS_FACES, [[0, 1, 1]]]), "no area"),
    ],
)
def test_planar_faces_that_bound_nothing_are_refused(faces, problem):
    with pytest.raises(NotManifold, match=problem) as refusal:
        planar_shell(TETRAHEDRON, loops_of(faces))
    assert refusal.value.where is not None


@pytest.mark.parametrize(
    ("patches", "n_edges", "surface_area"),
    [
        ([torus(3, 1)], 2, 4 * np.pi**2 * 3),
        ([sphere(2)], 1, 16 * np.pi),
        (quarters(sphere(2)), 4, 16 * np.pi),
        ([barrel(2, 2, 5), disk(2, 0), disk(2, 5)], 5, 28 * np.pi),
        ([barrel(3, 0, 4), disk(3, 0)], 3, 24 * np.pi),
    ],
    ids=["torus", "sphere", "quartered sphere", "cylinder", "cone"],
)
def test_closed_networks_with_seams_and_collapsed_sides_are_closed_shells(patches, n_edges, surface_area):
    shell = shell_of(*patches)
    assert is_valid(shell) and shell.Closed() and BRep_Tool.IsClosed_s(shell)
    assert each_edge_is_used_once_each_way(shell)
    assert len(edges_of(shell)) == n_edges
    assert_allclose(area(shell), surface_area, rtol=1e-6)


def test_exact_borders_leave_every_edge_the_smallest_tolerance():
    shell = shell_of(barrel(2, 2, 5), disk(2, 0), disk(2, 5))
    assert max(BRep_Tool.Tolerance_s(edge) for edge in edges_of(shell)) < 1.1e-7


def test_an_open_network_is_an_open_shell():
    shell = shell_of(*quarters(barrel(2, 1, 3))[:3])
    assert is_valid(shell) and not shell.Closed()
    assert len(edges_of(shell)) == 2 * 3 + 4


def test_patches_that_point_both_ways_are_turned_to_agree():
    first, second, third, fourth = quarters(sphere(2))
    assert each_edge_is_used_once_each_way(shell_of(first, swapped(second), third, swapped(fourth)))


def test_patches_that_run_along_an_edge_at_different_speeds_get_a_small_tolerance_all_the_same():
    faster = [
        BSplineSurface(
            2, q.degree_v, q.knots_u, q.knots_v, q.control_net, q.weights * np.array([1, 1.6, 1.6**2])[:, None]
        )
        for q in quarters(barrel(2, 2, 5))
    ]
    shell = shell_of(*faster, *quarters(disk(2, 0)), *quarters(disk(2, 5)))
    assert is_valid(shell) and each_edge_is_used_once_each_way(shell)
    assert max(BRep_Tool.Tolerance_s(edge) for edge in edges_of(shell)) < 1e-4


def moebius_strip():
    turn = np.linspace(0, 2 * np.pi, 9)
    side = np.array([-1.0, 1.0])
    reach = 3 + side * np.cos(turn / 2)[:, None]
    net = np.stack(
        [reach * np.cos(turn)[:, None], reach * np.sin(turn)[:, None], side * np.sin(turn / 2)[:, None]], axis=-1
    )
    net[-1] = net[0, ::-1]
    knots = np.concatenate([[0], np.arange(9), [8]])
    return BSplineSurface(1, 1, knots, [0, 0, 1, 1], net)


def test_a_moebius_strip_is_refused_whole_and_in_pieces():
    strip = moebius_strip()
    pieces = [
        BSplineSurface(1, 1, [0, 0, 1, 1], strip.knots_v, strip.control_net[i : i + 2]) for i in range(8)
    ]  # fmt: skip
    for network in ([strip], pieces):
        with pytest.raises(NotManifold, match="one side only"):
            shell_of(*network)


def test_three_patches_on_an_edge_are_refused_with_their_place():
    def leaf(x, y):
        net = np.array([[[0, 0, 0], [0, 0, 2]], [[x, y, 0], [x, y, 2]]], dtype=float)
        return BSplineSurface(1, 1, [0, 0, 1, 1], [0, 0, 1, 1], net)

    with pytest.raises(NotManifold, match="3 sides") as refusal:
        shell_of(leaf(1, 0), leaf(0, 1), leaf(-1, -1))
    assert_allclose(refusal.value.where, (0, 0, 1))


def test_patches_that_gape_more_than_fit_are_refused():
    bulged = barrel(2, 2, 5)
    network = connect([bulged, disk(2, 0), disk(2, 5)], 0.2)
    net = np.array(bulged.control_net)
    net[1, 0, 2] -= 0.3
    apart = BSplineSurface(2, 1, bulged.knots_u, bulged.knots_v, net, bulged.weights)
    torn = connect([apart, disk(2, 0), disk(2, 5)], 0.2)
    assert torn.side_edges.tolist() == network.side_edges.tolist()
    with pytest.raises(NotManifold, match=r"apart along an edge, allowed 0\.05"):
        network_shell(torn, Tolerance())


def test_the_vertex_of_a_collapsed_side_is_one_and_its_edge_has_no_curve_in_space():
    shell = shell_of(sphere(2))
    flat = [e for e in map(TopoDS.Edge_s, shapes_in(shell, "EDGE")) if BRep_Tool.Degenerated_s(e)]
    assert len(flat) == 2 and len(shapes_in(shell, "VERTEX")) == 2
    assert all(BRep_Tool.Curve_s(edge, 0.0, 0.0) is None for edge in flat)

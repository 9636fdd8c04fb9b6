import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from recon.numerics.halfedges import (
    boundary_loops,
    connected_components,
    edge_table,
    euler_number,
    free_edges,
    misoriented_edges,
    overused_edges,
    vertex_adjacency,
    vertex_normals,
)

TETRAHEDRON = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
OCTAHEDRON = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 1], [5, 2, 1], [5, 3, 2], [5, 4, 3], [5, 1, 4]])


def grid(n, m, *, wrap=(False, False)):
    """Triangles of an n x m grid of vertices, row by row, counter-clockwise in (column, row); wrapped: closed up."""
    number = np.arange(n * m).reshape(n, m)
    number = np.concatenate([number, number[:1]]) if wrap[0] else number
    number = np.concatenate([number, number[:, :1]], axis=1) if wrap[1] else number
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
    return np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)


@pytest.mark.parametrize(
    ("faces", "euler"),
    [
        (TETRAHEDRON, 2),
        (OCTAHEDRON, 2),
        (grid(4, 5), 1),
        (grid(5, 7, wrap=(True, True)), 0),
        (grid(5, 7, wrap=(False, True)), 0),
        (np.concatenate([TETRAHEDRON, TETRAHEDRON + 4]), 4),
    ],
    ids=["tetrahedron", "octahedron", "disk", "torus", "annulus", "two spheres"],
)
def test_euler_number_is_that_of_the_surface(faces, euler):
    assert euler_number(faces) == euler


def test_every_side_lies_on_the_edge_between_its_corners():
    faces = np.random.default_rng(1).permuted(grid(6, 7, wrap=(True, False)), axis=0)
    table = edge_table(faces)
    start, end = faces, np.roll(faces, -1, axis=1)
    pairs = table.edges[table.face_edges]
    assert_array_equal(np.where(table.forward, pairs[..., 0], pairs[..., 1]), start)
    assert_array_equal(np.where(table.forward, pairs[..., 1], pairs[..., 0]), end)
    assert table.uses.sum() == faces.size
    assert len({tuple(edge) for edge in table.edges.tolist()}) == len(table.edges)


def test_closed_surfaces_have_no_border():
    for faces in (TETRAHEDRON, grid(5, 7, wrap=(True, True))):
        assert len(free_edges(faces)) == 0
        assert boundary_loops(faces) == []


def test_the_border_of_a_grid_is_one_loop_with_the_surface_to_its_left():
    (loop,) = boundary_loops(grid(4, 5))
    columns, rows = loop % 5, loop // 5
    area = 0.5 * np.sum(columns * np.roll(rows, -1) - np.roll(columns, -1) * rows)
    assert area == 4 * 3
    assert len(set(loop.tolist())) == len(loop) == 2 * (4 + 5) - 4


def test_an_annulus_has_two_loops_with_all_free_edges_between_them():
    faces = grid(3, 8, wrap=(False, True))
    loops = boundary_loops(faces)
    walked = {(int(a), int(b)) for loop in loops for a, b in zip(loop, np.roll(loop, -1))}
    assert sorted(len(loop) for loop in loops) == [8, 8]
    assert walked == {tuple(edge) for edge in free_edges(faces).tolist()}


def without(faces, vertices):
    return faces[~np.isin(faces, vertices).any(axis=1)]


def test_two_holes_that_touch_in_a_vertex_are_two_loops():
    # Vertices 16 and 32 of the 7 x 7 grid lie two diagonal steps apart; vertex 24 between them is on both holes.
    faces = without(grid(7, 7), [16, 32])
    loops = boundary_loops(faces)
    assert sorted(len(loop) for loop in loops) == [6, 6, 24]
    assert all(len(set(loop.tolist())) == len(loop) for loop in loops)
    touching = [set(loop.tolist()) for loop in loops if len(loop) == 6]
    assert touching[0] & touching[1] == {24}


def test_two_triangles_that_touch_in_a_vertex_are_two_loops_and_two_pieces():
    faces = np.array([[0, 1, 2], [2, 3, 4]])
    assert sorted(sorted(loop.tolist()) for loop in boundary_loops(faces)) == [[0, 1, 2], [2, 3, 4]]
    assert len(set(connected_components(faces).tolist())) == 2


def test_a_moebius_band_has_one_loop_and_one_edge_row_that_disagrees():
    number = np.arange(2 * 9).reshape(2, 9)
    number = np.concatenate([number, number[::-1, :1]], axis=1)
    a, b, c, d = number[0, :-1], number[0, 1:], number[1, 1:], number[1, :-1]
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    (loop,) = boundary_loops(faces)
    assert len(loop) == 18
    assert_array_equal(misoriented_edges(faces), [[0, 9]])


def test_three_faces_on_an_edge_are_seen():
    faces = np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4]])
    assert_array_equal(overused_edges(faces), [[0, 1]])


def test_free_edges_that_close_no_loop_do_not_stop_the_others():
    fin = np.concatenate([TETRAHEDRON, [[0, 1, 4]], TETRAHEDRON[1:] + 5])
    assert [sorted(loop.tolist()) for loop in boundary_loops(fin)] == [[5, 6, 7]]


def test_one_ring_of_an_octahedron_is_everything_but_the_opposite_vertex():
    ring = vertex_adjacency(OCTAHEDRON, 7).toarray()
    assert_array_equal(ring, ring.T)
    assert_array_equal(ring.sum(axis=1), [4, 4, 4, 4, 4, 4, 0])
    assert ring[0, 5] == ring[1, 3] == ring[2, 4] == 0


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_normals_of_an_octahedron_point_from_its_centre(scale):
    points = scale * np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [0, 0, -1], [9, 9, 9]])
    normals = vertex_normals(points, OCTAHEDRON)
    assert_allclose(normals[:6], points[:6] / scale, atol=1e-15)
    assert_array_equal(normals[6], 0)


def test_nothing_is_wrong_with_no_faces():
    none = np.empty((0, 3), dtype=np.int64)
    assert len(edge_table(none).edges) == 0
    assert boundary_loops(none) == []
    assert len(connected_components(none)) == 0
    assert euler_number(none) == 0

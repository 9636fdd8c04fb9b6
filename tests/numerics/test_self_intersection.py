"""Triangles that cut: against the geometry of rings, folds and neighbours, at every size and place."""

import numpy as np
import pytest

from recon.geometry.mesh import TriangleMesh
from recon.geometry.promises import triangle_mesh_defects
from recon.numerics.self_intersection import box_pairs, crossing_triangles

_DIGITS = "021 123 456 576 014 154 263 367 042 246 135 375"
BOX_FACES = np.array([[int(digit) for digit in face] for face in _DIGITS.split()])


def box(*, size=(1.0, 1.0, 1.0), at=(0.0, 0.0, 0.0)):
    corners = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], dtype=float)
    return (corners - 0.5) * size + at, BOX_FACES


def together(*meshes):
    starts = np.cumsum([0] + [len(v) for v, _ in meshes])
    return np.concatenate([v for v, _ in meshes]), np.concatenate([f + s for (_, f), s in zip(meshes, starts)])


def torus(n, m, *, ring, tube):
    u, v = np.meshgrid(2 * np.pi * np.arange(n) / n, 2 * np.pi * np.arange(m) / m, indexing="ij")
    out = ring + tube * np.cos(v)
    points = np.stack([out * np.cos(u), out * np.sin(u), tube * np.sin(v)], axis=-1).reshape(-1, 3)
    i, j = (k.ravel() for k in np.meshgrid(np.arange(n), np.arange(m), indexing="ij"))
    a, b, c, d = i * m + j, (i + 1) % n * m + j, (i + 1) % n * m + (j + 1) % m, i * m + (j + 1) % m
    return points, np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def count(vertices, faces):
    return len(crossing_triangles(vertices, faces)[0])


def test_box_pairs_are_all_pairs_that_meet():
    rng = np.random.default_rng(5)
    low = rng.random((200, 3))
    high = low + rng.random((200, 3)) ** 4
    meet = (low[:, None] <= high[None]).all(axis=2) & (low[None] <= high[:, None]).all(axis=2)
    found = box_pairs(low, high)
    assert sorted(map(tuple, found.tolist())) == [tuple(p) for p in np.argwhere(np.triu(meet, 1)).tolist()]


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("move", [0.0, 1e4])
def test_smooth_closed_surfaces_do_not_cut_and_a_spindle_torus_does(scale, move):
    ring = torus(40, 16, ring=3.0, tube=1.0)
    spindle = torus(40, 16, ring=1.0, tube=1.5)
    assert count(scale * (ring[0] + move), ring[1]) == 0
    pairs, places = crossing_triangles(scale * (spindle[0] + move), spindle[1])
    # a torus whose tube is wider than its ring meets itself on the axis, at z = sqrt(tube^2 - ring^2)
    height = np.sqrt(1.5**2 - 1.0)
    assert len(pairs) and np.allclose(np.abs(places[:, 2] / scale - move), height, atol=0.4)


def test_boxes_that_overlap_cut_and_boxes_that_touch_or_nest_do_not():
    assert count(*together(box(), box(at=(0.5, 0.5, 0.5)))) > 0
    assert count(*together(box(), box(at=(0.3, 0.2, 0.1), size=(0.2, 0.2, 2.0)))) > 0
    assert count(*together(box(), box(size=(0.5, 0.5, 0.5)))) == 0
    assert count(*together(box(), box(at=(1.0, 1.0, 0.3)))) == 0  # along an edge
    assert count(*together(box(), box(at=(2.0, 0.0, 0.0)))) == 0


def test_faces_that_lie_on_each_other_cut():
    assert count(*together(box(), box(at=(1.0, 0.3, 0.2)))) > 0


@pytest.mark.parametrize("angle", [np.pi, 1.0, 1e-3, -1.0])
def test_neighbours_over_an_edge_cut_only_when_folded_flat(angle):
    points = np.array([[0, 0, 0], [1, 0, 0], [0.4, 1, 0], [0.5, np.cos(angle), np.sin(angle)]])
    faces = np.array([[0, 1, 2], [1, 0, 3]])
    assert count(points, faces) == 0
    folded = points.copy()
    folded[3] = [0.5, 1.0, 0.0]
    assert count(folded, faces) == 1


def test_neighbours_at_a_vertex_cut_when_one_runs_through_the_other():
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 1], [1, 1, -1], [-1, -1, 1], [-1, -1, -1]], dtype=float)
    assert count(points, np.array([[0, 1, 2], [0, 3, 4]])) == 1
    assert count(points, np.array([[0, 1, 2], [0, 5, 6]])) == 0
    flat = points * (1, 1, 0) + [(0.2 * (i in (4, 6)), 0, 0) for i in range(7)]
    assert count(flat, np.array([[0, 1, 2], [0, 3, 4]])) == 1
    assert count(flat, np.array([[0, 1, 2], [0, 5, 6]])) == 0


def test_the_order_of_triangles_does_not_matter_and_nothing_has_no_pairs():
    vertices, faces = together(box(), box(at=(0.5, 0.4, 0.3)))
    order = np.random.default_rng(1).permutation(len(faces))
    first, second = crossing_triangles(vertices, faces)[0], crossing_triangles(vertices, faces[order])[0]
    assert np.array_equal(first, np.array(sorted(map(tuple, np.sort(order[second], axis=1)))))
    assert count(vertices, faces[:0]) == 0
    assert count(vertices, faces[:1]) == 0


def test_the_promise_of_a_mesh_names_each_broken_line_once():
    vertices, faces = box()

    def codes(v, f, **options):
        return [d.code for d in triangle_mesh_defects(TriangleMesh(v, f), **options)]

    assert codes(vertices, faces) == []
    assert codes(vertices, faces[1:]) == ["mesh-free-edge"]
    assert codes(vertices, faces[1:], closed=False) == []
    assert codes(vertices, np.concatenate([faces[:1, ::-1], faces[1:]])) == ["mesh-face-flipped"]
    assert codes(*together(box(), box(at=(0.5, 0.4, 0.3)))) == ["mesh-cuts-itself"]
    fin = np.concatenate([vertices, [[0.0, -2.0, 0.0]]]), np.concatenate([faces, [[0, 1, 8]]])
    assert codes(*fin, closed=False) == ["mesh-edge-overused"]
    assert codes(vertices, faces[:0]) == ["mesh-empty"]

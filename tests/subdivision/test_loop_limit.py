"""The limit surface is what repeated refinement tends to, at every place, with every kind of vertex."""

import numpy as np
import pytest
from hull_meshes import ball, disc
from numpy.testing import assert_allclose

from recon.errors import BadGeometry, NotManifold
from recon.geometry.control_mesh import ControlMesh
from recon.numerics.halfedges import edge_table, opposite_sides
from recon.subdivision.limit_surface import _in_child, limit_points, tessellate
from recon.subdivision.limit_tables import regular_table
from recon.subdivision.loop import refine
from recon.subdivision.sheets import VertexKind, cut_along_creases


def control_mesh(mesh, **marks):
    return ControlMesh.from_faces(mesh.vertices, mesh.face_vertices, **marks)


def places(mesh, n, spread, seed=0):
    """n random places; a small spread keeps them near the vertices."""
    rng = np.random.default_rng(seed)
    bary = rng.dirichlet([spread] * 3, size=n)
    return rng.integers(mesh.n_faces, size=n), bary[:, 1], bary[:, 2]


def refined(mesh):
    """The control mesh after one step; only for meshes without inner creases, whose sheets are the mesh itself."""
    sheets, behind = cut_along_creases(mesh, 3)
    step = refine(sheets)
    corners = np.flatnonzero(step.sheets.kinds == VertexKind.CORNER)
    return ControlMesh.from_faces(step.matrix @ mesh.vertices[behind], step.sheets.faces, corner_vertices=corners)


MESHES = {
    "closed": control_mesh(ball(14, 1)),
    "high valence": control_mesh(ball(40, 5)),
    "border": control_mesh(disc(30, 2)),
    "border with corners": control_mesh(disc(30, 3), corner_vertices=np.arange(30)),
}


@pytest.mark.parametrize("spread", [1.0, 0.05])
@pytest.mark.parametrize("name", MESHES)
def test_refinement_leaves_the_limit_surface_as_it_is(name, spread):
    mesh = MESHES[name]
    here = places(mesh, 400, spread)
    expected = limit_points(mesh, here)[:, 0]
    for _ in range(4):
        patch, (v, w), _ = _in_child(*here)
        here, mesh = (patch, v, w), refined(mesh)
        assert_allclose(limit_points(mesh, here)[:, 0], expected, atol=1e-12)


def test_dense_refinement_tends_to_the_limit_surface():
    mesh = MESHES["border"]
    dense, face = mesh, np.arange(mesh.n_faces)
    for _ in range(6):
        dense, face = refined(dense), 4 * face + 3
    middle = dense.vertices[dense.faces_of(3)[face]].mean(axis=1)
    third = np.full(mesh.n_faces, 1 / 3)
    # a face of edge h lies within h squared of the surface
    assert_allclose(limit_points(mesh, (np.arange(mesh.n_faces), third, third))[:, 0], middle, atol=4.0**-6)


def test_an_inner_crease_is_the_border_of_either_side():
    mesh = ball(40, 7)
    above = mesh.vertices[mesh.face_vertices].mean(axis=1)[:, 2] > 0.0
    half = ControlMesh.from_faces(mesh.vertices, mesh.face_vertices[above])
    rim = edge_table(mesh.face_vertices[above])
    whole = control_mesh(mesh, crease_edges=rim.edges[rim.uses == 1])
    face, v, w = places(half, 300, 0.5)
    assert_allclose(
        limit_points(whole, (np.flatnonzero(above)[face], v, w)), limit_points(half, (face, v, w)), atol=1e-13
    )


@pytest.mark.parametrize("name", [*MESHES, "dart"])
def test_derivatives_are_those_of_the_points(name):
    faces = ball(14, 1).face_vertices
    mesh = MESHES[name] if name in MESHES else control_mesh(ball(14, 1), crease_edges=[faces[0, :2]])
    face, v, w = places(mesh, 500, 1.0)
    inside = (np.minimum(v, w) > 0.02) & (1 - v - w > 0.02)
    face, v, w, h = face[inside], v[inside], w[inside], 1e-5
    exact = limit_points(mesh, (face, v, w), n_derivatives=2)
    ahead, behind = (limit_points(mesh, (face, v + s, w), n_derivatives=1) for s in (h, -h))
    left, right = (limit_points(mesh, (face, v, w + s), n_derivatives=1) for s in (h, -h))
    for numeric, row in (
        ((ahead - behind)[:, 0], 1),
        ((left - right)[:, 0], 2),
        ((ahead - behind)[:, 1], 3),
        ((ahead - behind)[:, 2], 4),
        ((left - right)[:, 2], 5),
    ):
        difference = np.abs(numeric / (2 * h) - exact[:, row]).max(axis=1)
        # pieces of polynomials: a difference that straddles two of them is no derivative of either
        assert np.quantile(difference, 0.97) < 1e-5


def test_a_vertex_has_the_limit_mask_and_tangents_across_the_normal():
    mesh = MESHES["closed"]
    faces = mesh.faces_of(3)
    vertex = limit_points(
        mesh, (np.arange(mesh.n_faces), np.zeros(mesh.n_faces), np.zeros(mesh.n_faces)), n_derivatives=1
    )
    near = limit_points(
        mesh, (np.arange(mesh.n_faces), np.full(mesh.n_faces, 1e-6), np.full(mesh.n_faces, 1e-6)), n_derivatives=1
    )
    normal, around = (np.cross(x[:, 1], x[:, 2]) for x in (vertex, near))
    cosine = np.einsum("ij,ij->i", normal, around) / np.linalg.norm(normal, axis=1) / np.linalg.norm(around, axis=1)
    assert cosine.min() > 1 - 1e-6
    for v in range(mesh.n_vertices):
        own = faces[:, 0] == v
        ring = np.setdiff1d(faces[(faces == v).any(axis=1)], [v])
        n = len(ring)
        beta = (0.625 - (0.375 + 0.25 * np.cos(2 * np.pi / n)) ** 2) / n
        share = 1 / (n + 3 / (8 * beta))  # limit mask of [loop1987]
        expected = (1 - n * share) * mesh.vertices[v] + share * mesh.vertices[ring].sum(axis=0)
        assert_allclose(vertex[own, 0], np.broadcast_to(expected, (own.sum(), 3)), atol=1e-13)


def test_a_corner_vertex_stays():
    mesh = MESHES["border with corners"]
    faces = mesh.faces_of(3)
    table = edge_table(faces)
    border = np.unique(table.edges[table.uses == 1])
    on = np.flatnonzero(np.isin(faces[:, 0], border))
    assert_allclose(limit_points(mesh, (on, 0 * on, 0 * on))[:, 0], mesh.vertices[faces[on, 0]], atol=1e-14)


def test_the_regular_table_is_the_box_spline():
    table = 24 * regular_table()
    assert_allclose(table, np.round(table), atol=0)
    assert_allclose(table.sum(axis=1), 24.0)
    # the limit mask of a regular vertex: half of itself, a twelfth of each neighbour
    assert sorted(table[0].tolist()) == [0] * 5 + [2] * 6 + [12]


@pytest.mark.parametrize("name", MESHES)
def test_the_tessellation_is_as_closed_as_the_control_mesh(name):
    mesh = MESHES[name]
    drawn = tessellate(mesh, halvings=2)
    assert drawn.n_faces == 16 * mesh.n_faces
    assert (opposite_sides(drawn.face_vertices) < 0).sum() == 4 * (opposite_sides(mesh.faces_of(3)) < 0).sum()


def test_refined_sides_match():
    for mesh in MESHES.values():
        sheets = refine(cut_along_creases(mesh, 3)[0]).sheets
        assert (sheets.across == opposite_sides(sheets.faces)).all()


def test_an_edge_with_three_faces_is_refused():
    points = np.eye(5, 3)
    points[4] = 1.0
    with pytest.raises(NotManifold, match="more than two faces"):
        limit_points(ControlMesh.from_faces(points, [[0, 1, 2], [1, 0, 3], [0, 1, 4]]), (0, 0.2, 0.2))


def test_a_quadrilateral_is_refused():
    with pytest.raises(BadGeometry, match="another number of corners"):
        limit_points(ControlMesh.from_faces(np.eye(4, 3), [[0, 1, 2, 3]]), (0, 0.2, 0.2))

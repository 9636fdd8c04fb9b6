"""Limit surfaces of quadrilaterals are what repeated subdivision tends to, at every place, at every kind of vertex."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from plain_subdivision import catmull_clark_step, doo_sabin_step, plain
from quad_meshes import boxes, creased, drum, grid, shaken, with_handles, without_faces

from recon.errors import BadGeometry
from recon.geometry.control_mesh import ControlMesh
from recon.numerics.halfedges import opposite_sides
from recon.subdivision.doo_sabin import corner_weights
from recon.subdivision.limit_surface import Scheme, limit_patches, limit_points, tessellate

CLOSED = {
    **{f"drum {n}": shaken(drum(n)) for n in (3, 5, 8)},
    "a handle": shaken(with_handles(1)),
    "cube": shaken(boxes([(0, 0, 0)])),
}
OPEN = {
    "sheet": shaken(grid(4, 3)),
    "drum without faces": shaken(without_faces(drum(5), [0, 1, 3, 20, 24])),
    "one face": shaken(grid(1, 1)),
}
CREASED = {
    "crease": shaken(creased(drum(5), np.arange(20, 25))),
    "crease with corners": shaken(creased(boxes([(0, 0, 0), (1, 0, 0), (0, 1, 0)]), np.array([0, 1, 5, 6]))),
    "dart": shaken(ControlMesh.from_faces(drum(6).vertices, drum(6).faces_of(4), crease_edges=[[0, 1], [1, 2]])),
}


def places(mesh, n, spread, seed=0):
    """n random places; a spread below 1 keeps them near the vertices."""
    rng = np.random.default_rng(seed)
    v, w = rng.beta(spread, spread, size=(2, n))
    return rng.integers(mesh.n_faces, size=n), v, w


def corners_on_mesh(refined):
    """Face, v, w and point of every corner of a plain mesh."""
    rows = [
        (owner, *at[i], *refined.points[face[i]])
        for face, (owner, at) in zip(refined.faces, refined.places)
        for i in range(4)
    ]
    table = np.array(rows)
    return (table[:, 0].astype(np.int64), table[:, 1], table[:, 2]), table[:, 3:]


@pytest.mark.parametrize("name", [*CLOSED, *OPEN, *CREASED])
def test_dense_catmull_clark_tends_to_the_limit_points(name):
    mesh = (CLOSED | OPEN | CREASED)[name]
    coarse = catmull_clark_step(plain(mesh))
    where, _ = corners_on_mesh(coarse)
    expected = limit_points(mesh, where, scheme=Scheme.CATMULL_CLARK)[:, 0]
    ids = [v for face in coarse.faces for v in face]
    rows, dense = [], coarse
    for _ in range(2):
        rows.append(dense.points[ids])
        dense = catmull_clark_step(dense)
    rows.append(dense.points[ids])
    # a vertex keeps its number while it moves to its limit; what is left of the way shrinks about fourfold a step
    left = [np.abs(row - expected).max() for row in rows]
    assert left[2] < 0.5 * left[1] + 1e-14 < 0.25 * left[0] + 1e-13


@pytest.mark.parametrize("name", CLOSED)
def test_vertices_of_dense_catmull_clark_have_the_limit_mask(name):
    mesh = CLOSED[name]
    dense = catmull_clark_step(catmull_clark_step(plain(mesh)))
    n = np.bincount(np.ravel(dense.faces), minlength=len(dense.points))[:, None]
    faces = np.array(dense.faces)
    spokes, diagonals = np.zeros_like(dense.points), np.zeros_like(dense.points)
    for i in range(4):
        np.add.at(spokes, faces[:, i], dense.points[faces[:, (i + 1) % 4]])
        np.add.at(diagonals, faces[:, i], dense.points[faces[:, (i + 2) % 4]])
    limit = (n * n * dense.points + 4 * spokes + diagonals) / (n * (n + 5))  # [halstead1993]
    where, _ = corners_on_mesh(dense)
    found = limit_points(mesh, where, scheme=Scheme.CATMULL_CLARK)[:, 0]
    assert_allclose(found, limit[faces.ravel()], atol=1e-12)


@pytest.mark.parametrize("name", CLOSED)
def test_the_middles_of_dense_doo_sabin_faces_are_limit_points(name):
    mesh = CLOSED[name]
    dense = plain(mesh)
    for _ in range(3):
        dense = doo_sabin_step(dense)
    middles = np.array([dense.points[face].mean(axis=0) for face in dense.faces])
    n = 8
    grid_v, grid_w = (x.ravel() / n for x in np.meshgrid(np.arange(n + 1), np.arange(n + 1)))
    face = np.repeat(np.arange(mesh.n_faces), len(grid_v))
    where = face, np.tile(grid_v, mesh.n_faces), np.tile(grid_w, mesh.n_faces)
    found = limit_points(mesh, where, scheme=Scheme.DOO_SABIN)[:, 0]
    distance = np.array([np.abs(found - middle).max(axis=1).min() for middle in middles])
    assert distance.max() < 1e-12


@pytest.mark.parametrize("scheme", [Scheme.CATMULL_CLARK, Scheme.DOO_SABIN])
@pytest.mark.parametrize("name", [*CLOSED, *OPEN, *CREASED])
def test_derivatives_are_those_of_the_points(name, scheme):
    mesh = (CLOSED | OPEN | CREASED)[name]
    face, v, w = places(mesh, 300, 0.7)
    inside = (np.minimum(v, w) > 0.02) & (np.maximum(v, w) < 0.98)
    face, v, w, h = face[inside], v[inside], w[inside], 1e-5
    found = limit_patches(mesh, scheme)

    def at(dv, dw):
        return limit_points(mesh, (face, v + dv, w + dw), n_derivatives=2, patches=found)

    exact = at(0, 0)
    ahead, behind, left, right = at(h, 0), at(-h, 0), at(0, h), at(0, -h)
    for numeric, row in (
        ((ahead - behind)[:, 0], 1),
        ((left - right)[:, 0], 2),
        ((ahead - behind)[:, 1], 3),
        ((ahead - behind)[:, 2], 4),
        ((left - right)[:, 2], 5),
    ):
        difference = np.abs(numeric / (2 * h) - exact[:, row]).max(axis=1)
        # pieces of polynomials: a difference that straddles two of them is no derivative of either
        assert np.quantile(difference, 0.96) < 1e-5


@pytest.mark.parametrize("scheme", [Scheme.CATMULL_CLARK, Scheme.DOO_SABIN])
@pytest.mark.parametrize("name", CLOSED)
def test_tangents_at_a_vertex_are_those_nearby(name, scheme):
    mesh = CLOSED[name]
    face = np.arange(mesh.n_faces)
    here, near = (
        limit_points(mesh, (face, 0 * face + t, 0 * face + t), scheme=scheme, n_derivatives=1) for t in (0.0, 1e-9)
    )
    normal, around = (np.cross(x[:, 1], x[:, 2]) for x in (here, near))
    cosine = np.einsum("ij,ij->i", normal, around) / np.linalg.norm(normal, axis=1) / np.linalg.norm(around, axis=1)
    assert cosine.min() > 1 - 1e-6
    assert_allclose(here[:, 0], near[:, 0], atol=1e-3)


@pytest.mark.parametrize("scheme", [Scheme.CATMULL_CLARK, Scheme.DOO_SABIN])
def test_an_inner_crease_is_the_border_of_either_side(scheme):
    whole = CREASED["crease"]
    chosen = np.arange(20, 25)
    faces = whole.faces_of(4)
    single = np.flatnonzero(np.bincount(faces[chosen].ravel(), minlength=whole.n_vertices) == 1)
    whole = ControlMesh.from_faces(whole.vertices, faces, crease_edges=whole.crease_edges, corner_vertices=single)
    half = ControlMesh.from_faces(whole.vertices, faces[chosen])
    face, v, w = places(half, 200, 0.5)
    assert_allclose(
        limit_points(whole, (chosen[face], v, w), scheme=scheme),
        limit_points(half, (face, v, w), scheme=scheme),
        atol=1e-13,
    )


def test_the_sides_of_a_sheet_are_the_curves_of_its_border():
    mesh = OPEN["sheet"]
    t = np.linspace(0, 1, 5)
    row = mesh.vertices[mesh.faces_of(4)[::3, 0]]  # the border points of four faces along side 0
    cubic = limit_points(mesh, (np.full(5, 3), t, 0 * t), scheme=Scheme.CATMULL_CLARK)[:, 0]
    basis = np.stack([(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1, t**3]) / 6
    points = [row[0], row[1], row[2], row[3]]
    assert_allclose(cubic, basis.T @ np.array(points), atol=1e-14)


def test_doo_sabin_keeps_the_corners_of_a_sheet():
    mesh = OPEN["one face"]
    patches = limit_patches(mesh, Scheme.DOO_SABIN)
    drawn = tessellate(mesh, patches=patches, halvings=1)
    for corner in mesh.vertices:
        assert np.abs(drawn.vertices - corner).max(axis=1).min() < 1e-14


@pytest.mark.parametrize("scheme", [Scheme.CATMULL_CLARK, Scheme.DOO_SABIN])
@pytest.mark.parametrize("name", [*CLOSED, *OPEN])
def test_the_tessellation_is_as_closed_as_the_control_mesh(name, scheme):
    mesh = (CLOSED | OPEN)[name]
    drawn = tessellate(mesh, scheme=scheme, halvings=3)
    free = (opposite_sides(drawn.face_vertices) < 0).sum()
    assert (free == 0) == (name in CLOSED)
    if scheme == Scheme.CATMULL_CLARK:
        assert drawn.n_faces == 2 * 4**3 * mesh.n_faces
        assert free == 8 * (opposite_sides(mesh.faces_of(4)) < 0).sum()


def test_doo_sabin_corners_are_the_masks_of_the_paper():
    assert_allclose(corner_weights(4)[0], np.array([9, 3, 1, 3]) / 16)
    assert_allclose(corner_weights(7).sum(axis=1), 1.0)


def double_areas(mesh):
    """(T,) of the triangles of a fine tessellation of a mesh in the plane, negative where it folds."""
    corners = tessellate(mesh, scheme=Scheme.DOO_SABIN, halvings=3).corners()
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2]


def edge(mesh, one, two):
    return [int(np.flatnonzero((mesh.vertices[:, :2] == end).all(axis=1))[0]) for end in (one, two)]


def test_a_crease_may_end_inside_a_surface_of_doo_sabin_and_cuts_nothing_off():
    whole = grid(6, 6)
    crease = [edge(whole, (x, 3), (x + 1, 3)) for x in range(3)]
    marked = ControlMesh.from_faces(whole.vertices, whole.faces_of(4), crease_edges=crease)
    assert double_areas(marked).min() > -1e-12
    assert double_areas(marked).sum() == pytest.approx(2 * 36)
    x, y = whole.vertices[:, :2].T
    bent = np.stack([x, y, np.abs(y - 3.0)], axis=1)
    roof = ControlMesh.from_faces(bent, whole.faces_of(4), crease_edges=crease)
    drawn = tessellate(roof, scheme=Scheme.DOO_SABIN, halvings=4)
    ridge = drawn.vertices[(np.abs(drawn.vertices[:, 1] - 3.0) < 1e-9) & (drawn.vertices[:, 0] < 2.5)]
    assert len(ridge) > 20
    assert np.abs(ridge[:, 2]).max() < 1e-12


def test_a_concave_corner_of_doo_sabin_folds_unless_creases_divide_it():
    whole = grid(6, 6)
    middles = whole.vertices[whole.faces_of(4)].mean(axis=1)
    used, faces = np.unique(whole.faces_of(4)[(middles[:, :2] > 3.0).any(axis=1)], return_inverse=True)
    plain = ControlMesh.from_faces(whole.vertices[used], faces.reshape(-1, 4))
    corner = edge(plain, (3, 3), (3, 3))[:1]
    creases = [edge(plain, (3, 3), (4, 3)), edge(plain, (3, 3), (3, 4))]
    folding, divided = (
        ControlMesh.from_faces(plain.vertices, plain.faces_of(4), crease_edges=marks, corner_vertices=corner)
        for marks in ((), creases)
    )
    assert double_areas(folding).min() < -1e-4
    assert double_areas(divided).min() > -1e-12
    assert double_areas(divided).sum() == pytest.approx(2 * 27)


def test_triangles_are_refused_by_catmull_clark():
    with pytest.raises(BadGeometry, match="another number of corners"):
        limit_patches(ControlMesh.from_faces(np.eye(3), [[0, 1, 2]]), Scheme.CATMULL_CLARK)

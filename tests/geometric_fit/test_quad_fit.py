"""Quadrilateral control meshes and fits of Catmull-Clark and Doo-Sabin surfaces."""

import numpy as np
import pytest
from block_mesh import block
from hull_meshes import ball, bumpy_ball, disc
from numpy.testing import assert_allclose
from quad_meshes import with_handles

from recon.geometric_fit.foot_points import EXACT, nearest_feet
from recon.geometric_fit.initial_mesh import initial_mesh
from recon.geometric_fit.pipeline import FitOptions, fit_surface
from recon.geometric_fit.quad_mesh import initial_quads, paired, without_doublets
from recon.geometric_fit.quad_splits import inset, refine_quads, split_rows, with_quads_only
from recon.geometric_fit.quad_turns import turned_to_even_valences
from recon.geometric_fit.slits import with_slits
from recon.geometric_fit.tips import covered_tips
from recon.geometric_fit.updates import Update
from recon.geometric_fit.wrapping import wrapped
from recon.geometry.control_mesh import ControlMesh
from recon.geometry.mesh import TriangleMesh
from recon.numerics.distance import closest_points
from recon.numerics.halfedges import edge_table, opposite_sides
from recon.subdivision.limit_surface import Scheme, limit_patches, tessellate
from recon.subdivision.polygons import split_polygons
from recon.subdivision.sheets import VertexKind, cut_along_creases

QUADS = [Scheme.CATMULL_CLARK, Scheme.DOO_SABIN]


def control_mesh(mesh, **marks):
    return ControlMesh.from_faces(mesh.vertices, mesh.face_vertices, **marks)


def euler_number_of(mesh, k):
    faces = mesh.faces_of(k)
    edges = np.unique(np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1), axis=0)
    return len(np.unique(faces)) - len(edges) + len(faces)


@pytest.mark.parametrize("seed", range(6))
def test_every_closed_mesh_of_triangles_pairs_up(seed):
    mesh = control_mesh(ball(40 + 30 * seed, seed))
    quads, left = paired(mesh)
    assert len(left) == 0
    assert len(quads) == mesh.n_faces // 2
    assert (opposite_sides(quads) >= 0).all()
    assert euler_number_of(ControlMesh.from_faces(mesh.vertices, quads), 4) == 2


@pytest.mark.parametrize("shape", [ball(600, 3), disc(601, 4)], ids=["closed", "border"])
def test_quadrilaterals_have_the_shape_and_keep_the_creases(shape):
    creases = shape.face_vertices[:5, :2]

    def triangles(count):
        return control_mesh(shape, crease_edges=creases) if count >= 600 else control_mesh(disc(40, 1))

    mesh = initial_quads(triangles, 601)
    assert mesh.n_vertices <= 601
    faces = mesh.faces_of(4)
    assert len(np.unique(np.sort(faces, axis=1), axis=0)) == len(faces)
    assert np.bincount(faces.ravel(), minlength=mesh.n_vertices).min() >= 1


def test_pairs_do_not_reach_over_creases():
    shape = ball(300, 5)
    broken = np.sort(shape.face_vertices[::7, :2], axis=1)
    quads, _ = paired(control_mesh(shape, crease_edges=broken))
    diagonals = np.sort(np.concatenate([quads[:, [0, 2]], quads[:, [1, 3]]]), axis=1)
    assert not {tuple(e) for e in broken.tolist()} & {tuple(e) for e in diagonals.tolist()}


def quads_of(shape):
    return ControlMesh.from_faces(shape.vertices, paired(control_mesh(shape))[0])


def is_whole(mesh, euler):
    faces = mesh.faces_of(4)
    table = edge_table(faces)
    distinct = (np.sort(faces, axis=1)[:, 1:] != np.sort(faces, axis=1)[:, :-1]).all()
    return distinct and euler_number_of(mesh, 4) == euler and len(table.overused()) == len(table.misoriented()) == 0


def test_an_inset_adds_four_points_a_face_and_keeps_the_surface_whole():
    quads = quads_of(ball(300, 3))
    grown = inset(quads, np.arange(10))
    assert grown.n_vertices == 340
    assert is_whole(grown, 2)


@pytest.mark.parametrize("n_new", [40, 200])
def test_faces_cut_in_four_leave_no_corner_in_the_middle_of_a_side(n_new):
    quads = quads_of(ball(300, 3))
    grown = refine_quads(quads, np.arange(quads.n_faces), n_new)
    assert quads.n_vertices < grown.n_vertices <= quads.n_vertices + n_new
    assert_allclose(grown.vertices[: quads.n_vertices], quads.vertices)
    assert is_whole(grown, 2)


def test_triangles_among_quadrilaterals_go_and_creases_stay():
    shape = ball(300, 5)
    creases = np.sort(shape.face_vertices[::7, :2], axis=1)
    quads, _ = paired(control_mesh(shape, crease_edges=creases))
    cut = [corners for a, b, c, d in quads[:40:8].tolist() for corners in ([a, b, c], [a, c, d])]
    mixed = [*np.delete(quads, np.arange(0, 40, 8), axis=0).tolist(), *cut]
    mesh = with_quads_only(ControlMesh.from_faces(shape.vertices, mixed, crease_edges=creases))
    assert is_whole(mesh, 2)

    def length(vertices, edges):
        return np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1).sum()

    assert length(mesh.vertices, mesh.crease_edges) == pytest.approx(length(shape.vertices, np.unique(creases, axis=0)))


def test_rows_halved_where_the_error_is_make_no_irregular_vertex():
    i, j = (x.ravel() for x in np.meshgrid(np.arange(12), np.arange(8), indexing="ij"))
    right, up = (i + 1) % 12, (j + 1) % 8
    quads = np.stack([8 * i + j, 8 * right + j, 8 * right + up, 8 * i + up], axis=1)
    a, b = np.pi * i / 6.0, np.pi * j / 4.0
    points = np.stack([(3.0 + np.cos(b)) * np.cos(a), (3.0 + np.cos(b)) * np.sin(a), np.sin(b)], axis=1)
    grown = split_rows(ControlMesh.from_faces(points, quads), (i == 4).astype(float), 8)
    assert grown.n_vertices == 96 + 8
    assert (np.bincount(grown.face_corners) == 4).all()
    assert is_whole(grown, 0)
    bands = np.linalg.norm(np.diff(grown.vertices[grown.faces_of(4)][:, :2], axis=1)[:, 0], axis=1)
    assert (bands < 0.7 * np.median(bands)).sum() >= 12


def test_two_quadrilaterals_on_a_border_are_no_doublet():
    # both faces have the corners 0, 2 and 5: only vertex 2, between them, goes
    points = np.array([[0, 0, 0], [2, 0, 0], [1, 1, 0], [9, 9, 9], [0, 2, 0], [2, 2, 0.0]])
    mesh = ControlMesh.from_faces(points, [[0, 1, 5, 2], [0, 2, 5, 4]])
    merged = without_doublets(mesh, mesh.faces_of(4))
    assert merged.n_faces == 1
    assert_allclose(merged.vertices, points[[0, 1, 4, 5]])


def test_concave_corners_are_divided_for_doo_sabin():
    i, j = (x.ravel() for x in np.meshgrid(np.arange(5), np.arange(5), indexing="ij"))
    squares = [(a, b) for a in range(4) for b in range(4) if not (a < 2 and b < 2)]
    faces = [[5 * a + b, 5 * a + 5 + b, 5 * a + 6 + b, 5 * a + b + 1] for a, b in squares]
    used, faces = np.unique(faces, return_inverse=True)
    points = np.stack([i, j, 0 * i], axis=1)[used].astype(float)
    corner = np.flatnonzero((points == [2, 2, 0]).all(axis=1))
    mesh = ControlMesh.from_faces(points, faces.reshape(-1, 4), corner_vertices=corner)
    divided = with_slits(mesh)
    assert is_whole(divided, 1)
    assert divided.crease_edges.shape == (2, 2)
    assert (divided.crease_edges == corner).any(axis=1).all()
    drawn = tessellate(divided, scheme=Scheme.DOO_SABIN, halvings=3).area_vectors()
    assert drawn[:, 2].min() > -1e-12
    # corners of one face and straight borders need nothing
    assert with_slits(ControlMesh.from_faces(points, faces.reshape(-1, 4))).n_vertices == mesh.n_vertices


@pytest.mark.parametrize("seed", range(4))
def test_turned_edges_make_valences_even(seed):
    quads = without_doublets(quads_of(ball(400, seed)), quads_of(ball(400, seed)).faces_of(4))
    turned = turned_to_even_valences(quads)
    unevenness = [((np.bincount(mesh.face_corners) - 4) ** 2).sum() for mesh in (quads, turned)]
    assert unevenness[1] < unevenness[0]
    assert is_whole(turned, 2)


def test_three_triangles_make_room_at_a_smooth_crease():
    shape = block(6)
    at_edge = np.sort(np.abs(shape.vertices), axis=1)[:, 1] > 0.999 * np.abs(shape.vertices).max()
    ends = np.sort(np.stack([shape.face_vertices, np.roll(shape.face_vertices, -1, axis=1)], axis=2).reshape(-1, 2))
    edges = np.unique(ends, axis=0)
    mesh = control_mesh(shape, crease_edges=edges[at_edge[edges].all(axis=1)])
    quads = initial_quads(lambda count: mesh, 10 * mesh.n_vertices)
    sheets, _ = cut_along_creases(quads, 4)
    counts = np.bincount(sheets.faces.ravel())
    assert counts[sheets.kinds == VertexKind.BORDER].min() >= 2
    assert is_whole(quads, 2)


def test_a_wrapped_mesh_reaches_a_tip_that_was_cut_off():
    scan = bumpy_ball(3000)
    x = scan.vertices.copy()
    near = np.linalg.norm(x - x[np.argmax(x[:, 2])], axis=1)
    x *= (1.0 + 1.0 * np.exp(-((near / 0.25) ** 2)))[:, None]
    tipped = TriangleMesh(x, scan.face_vertices, "ball with a tip")
    round_net = initial_quads(lambda count: initial_mesh(scan, min(count, 300)), 300)
    off = []
    for mesh in (round_net, wrapped(round_net, tipped, 20)):
        drawn = mesh.triangle_mesh()
        off.append(closest_points(x, drawn.vertices, drawn.face_vertices).distances.max())
    assert off[1] < 0.3 * off[0]


@pytest.mark.parametrize("scheme", QUADS)
@pytest.mark.parametrize("shape", [ball(60, 3), disc(61, 4)], ids=["closed", "border"])
def test_feet_on_quadrilaterals_are_as_near_as_a_dense_search_finds(shape, scheme):
    mesh = initial_quads(lambda count: control_mesh(shape), 500)
    data = shape.vertices[np.random.default_rng(1).integers(60, size=300)] * 0.9 + 0.1
    patches = limit_patches(mesh, scheme)
    feet = nearest_feet(patches, patches.points @ mesh.vertices, data, step=EXACT)
    found = np.linalg.norm(feet.positions - data, axis=1)
    drawn = tessellate(mesh, scheme=scheme, halvings=5, patches=patches)
    dense = closest_points(data, drawn.vertices, drawn.face_vertices).distances
    assert np.quantile(found - dense, 0.95) < 1e-3
    assert (found - dense).min() > -2e-3


@pytest.mark.parametrize(("scheme", "times"), [(Scheme.CATMULL_CLARK, 1.3), (Scheme.DOO_SABIN, 2.0)])
def test_quadrilaterals_come_nearly_as_near_as_triangles(scheme, times):
    scan = bumpy_ball(4000)
    loop, quads = (fit_surface(scan, FitOptions(scheme=s, control_points=150)) for s in (Scheme.LOOP, scheme))
    assert quads.mesh.n_vertices <= 150
    assert quads.errors.rms < times * loop.errors.rms
    assert quads.folds == 0
    drawn = tessellate(quads.mesh, scheme=scheme, halvings=4)
    assert_allclose(
        closest_points(scan.vertices, drawn.vertices, drawn.face_vertices).distances.max() / quads.diagonal,
        quads.errors.maximum / 100.0,
        atol=2e-4,
    )


def test_all_updates_move_quadrilaterals_too():
    scan = bumpy_ball(2000)
    for update in Update:
        fitted = fit_surface(
            scan, FitOptions(scheme=Scheme.CATMULL_CLARK, control_points=150, plain=True, update=update)
        )
        assert fitted.rounds[-1].errors.rms < fitted.rounds[0].errors.rms


def ball_with_a_finger(n):
    """Triangles of a unit ball, a finger as long as its radius at the north."""
    scan = ball(n, 3)
    points = scan.vertices / np.linalg.norm(scan.vertices, axis=1, keepdims=True)
    away = np.arccos(np.clip(points[:, 2], -1.0, 1.0))
    return TriangleMesh(points * (1.0 + 1.2 / (1.0 + (away / 0.22) ** 6))[:, None], scan.face_vertices)


def round_quads(times):
    mesh = with_handles(0)
    for _ in range(times):
        mesh = split_polygons(mesh)
    middle = mesh.vertices - mesh.vertices.mean(axis=0)
    return mesh.with_vertices(middle / np.linalg.norm(middle, axis=1, keepdims=True))


def test_a_finger_that_a_coarse_mesh_has_cut_off_gets_quads_of_its_own():
    scan = ball_with_a_finger(6000)
    round_mesh = wrapped(round_quads(3), scan, 20)
    covered = covered_tips(round_mesh, scan)
    assert covered.n_faces > round_mesh.n_faces
    assert euler_number_of(covered, 4) == 2
    off = [
        closest_points(scan.vertices, mesh.vertices, mesh.triangle_mesh().face_vertices).distances
        for mesh in (round_mesh, covered)
    ]
    assert off[1].max() < 0.5 * off[0].max()


def rows_of_triangles(n):
    """Two triangles a square of n x n points, all facing up."""
    i, j = (a.ravel() for a in np.meshgrid(np.arange(n - 1), np.arange(n - 1), indexing="ij"))
    a = n * i + j
    return np.concatenate([np.stack([a, a + 1, a + n + 1], axis=1), np.stack([a, a + n + 1, a + n], axis=1)])


def test_sheets_that_face_each_other_do_not_draw_each_other_over():
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(0, 1, 30), np.linspace(0, 1, 30)))
    low = TriangleMesh(np.column_stack([x, y, 0 * x]), rows_of_triangles(30))
    scan = TriangleMesh(
        np.concatenate([low.vertices, low.vertices + np.array([0.0, 0.0, 0.05])]),
        np.concatenate([low.face_vertices, low.face_vertices[:, ::-1] + len(x)]),
    )
    i, j = (a.ravel() for a in np.meshgrid(np.arange(4), np.arange(4), indexing="ij"))
    quads = np.stack([5 * i + j, 5 * i + j + 1, 5 * i + j + 6, 5 * i + j + 5], axis=1)
    corners = np.column_stack([np.tile(np.linspace(0, 1, 5), 5), np.repeat(np.linspace(0, 1, 5), 5), np.full(25, 0.01)])
    lower = ControlMesh.from_faces(corners, quads)
    assert np.abs(wrapped(lower, scan, 10).vertices[:, 2]).max() < 0.02

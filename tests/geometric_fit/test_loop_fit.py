"""Foot points, moves, refinement and whole fits: near, without folds, and no farther from the scan than asked."""

import numpy as np
import pytest
from hull_meshes import ball, bumpy_ball, disc
from numpy.testing import assert_allclose
from scipy.spatial import Delaunay

from recon.errors import BadOption
from recon.geometric_fit.convergence import StoppedBy
from recon.geometric_fit.foot_points import EXACT, nearest_feet
from recon.geometric_fit.guards import Guards, fairness
from recon.geometric_fit.initial_mesh import initial_mesh
from recon.geometric_fit.pipeline import FitOptions, fit_surface
from recon.geometric_fit.refinement import flip_to_delaunay, flip_to_even_valences, split_faces
from recon.geometric_fit.scan_data import fold_places, scan_data
from recon.geometric_fit.tangent_distance import Metric, basis_rows, tangent_distance_move
from recon.geometric_fit.updates import Update
from recon.geometry.control_mesh import ControlMesh
from recon.geometry.mesh import TriangleMesh
from recon.numerics.distance import closest_points
from recon.numerics.halfedges import euler_number, opposite_sides
from recon.subdivision.evaluation import points_at
from recon.subdivision.limit_surface import limit_patches, tessellate
from recon.subdivision.patch_network import limit_network


def control_mesh(mesh, **marks):
    return ControlMesh.from_faces(mesh.vertices, mesh.face_vertices, **marks)


@pytest.fixture(scope="module")
def scan():
    return bumpy_ball(4000)


@pytest.fixture(scope="module")
def fitted(scan):
    return fit_surface(scan, FitOptions(control_points=150))


@pytest.mark.parametrize("scale", [1e-4, 1.0, 1e5])
@pytest.mark.parametrize("shape", [ball(60, 3), disc(60, 4)], ids=["closed", "border"])
def test_feet_are_as_near_as_a_dense_search_finds(shape, scale):
    mesh = ControlMesh.from_faces(shape.vertices * scale, shape.face_vertices)
    data = scale * (shape.vertices[np.random.default_rng(1).integers(60, size=500)] * 0.9 + 0.1)
    patches = limit_patches(mesh)
    feet = nearest_feet(patches, patches.points @ mesh.vertices, data)
    found = np.linalg.norm(feet.positions - data, axis=1)
    drawn = tessellate(mesh, halvings=5)
    dense = closest_points(data, drawn.vertices, drawn.face_vertices).distances
    assert np.quantile(found - dense, 0.99) < 2e-4 * scale
    assert (found - dense).min() > -1e-3 * scale


def test_feet_stand_square_on_a_closed_surface(scan):
    mesh = initial_mesh(scan, 200)
    patches = limit_patches(mesh)
    feet = nearest_feet(patches, patches.points @ mesh.vertices, scan.vertices, step=EXACT)
    away = scan.vertices - feet.positions
    height = np.einsum("ij,ij->i", away, feet.normals)
    assert_allclose(away, height[:, None] * feet.normals, atol=2e-7)


def test_rows_of_basis_functions_give_the_feet(scan):
    mesh = initial_mesh(scan, 200)
    patches = limit_patches(mesh)
    feet = nearest_feet(patches, patches.points @ mesh.vertices, scan.vertices)
    matrix = basis_rows(patches, feet).matrix(mesh.n_vertices)
    assert_allclose(matrix @ mesh.vertices, feet.positions, atol=1e-12)
    assert_allclose(matrix.sum(axis=1), 1.0, atol=1e-12)


def test_the_move_solves_the_normal_equations(scan):
    mesh = initial_mesh(scan, 60)
    patches = limit_patches(mesh)
    feet = nearest_feet(patches, patches.points @ mesh.vertices, scan.vertices)
    residuals, weights = scan.vertices - feet.positions, np.random.default_rng(2).random(scan.n_vertices) + 0.5
    energy = fairness(mesh, np.full(mesh.n_vertices, 0.05))
    rows = basis_rows(patches, feet)
    metric = Metric(feet.normals, weights, 0.02)
    move = tangent_distance_move(rows, residuals, metric, energy, mesh.vertices, accuracy=1e-12, max_iterations=2000)
    full = np.einsum("i,ij,ik->ijk", weights, feet.normals, feet.normals)
    full += 0.02 * weights[:, None, None] * np.eye(3)
    a = rows.matrix(mesh.n_vertices).toarray()
    system = np.einsum("ip,iab,iq->paqb", a, full, a, optimize=True)
    system += np.einsum("pq,ab->paqb", energy.toarray(), np.eye(3))
    right = np.einsum("ip,iab,ib->pa", a, full, residuals) - energy @ mesh.vertices
    n = 3 * mesh.n_vertices
    expected = np.linalg.solve(system.reshape(n, n), right.ravel()).reshape(-1, 3)
    assert_allclose(move, expected, atol=1e-6)


@pytest.mark.parametrize("shape", [ball(300, 3), disc(300, 4)], ids=["closed", "border"])
def test_flips_even_the_valences_and_splits_keep_the_surface_whole(shape):
    creases = shape.face_vertices[:20, :2]
    mesh = control_mesh(shape, crease_edges=creases)
    flipped = flip_to_even_valences(mesh)
    grown = split_faces(flipped, np.arange(flipped.n_faces), 40)
    assert grown.n_vertices == 340

    def unevenness(m):
        return ((np.bincount(m.face_corners, minlength=m.n_vertices) - 6) ** 2).sum()

    assert unevenness(flipped) < 0.6 * unevenness(mesh)
    for after in (flipped, grown):
        faces = after.faces_of(3)
        assert euler_number(faces) == euler_number(shape.face_vertices)
        assert TriangleMesh(after.vertices, faces).n_faces == len(np.unique(np.sort(faces, axis=1), axis=0))
    free = [(opposite_sides(m.faces_of(3)) < 0).sum() for m in (mesh, flipped)]
    assert free[0] == free[1]
    assert len(flipped.crease_edges) == len(np.unique(np.sort(creases, axis=1), axis=0))


def test_flips_on_a_plane_end_at_the_delaunay_triangulation_and_keep_creases():
    flat = np.random.default_rng(4).random((80, 2))
    stretched = np.array([6.0, 1.0])
    other, wanted = (Delaunay(points).simplices for points in (flat * stretched, flat))
    turned = np.linalg.det(flat[other[:, 1:]] - flat[other[:, :1]]) < 0
    other[turned] = other[turned][:, ::-1]
    vertices = np.column_stack([flat, np.zeros(80)])
    flipped = flip_to_delaunay(ControlMesh.from_faces(vertices, other), passes=100)
    assert as_set(flipped.faces_of(3)) == as_set(wanted)
    creases = np.unique(np.sort(other[::7, :2], axis=1), axis=0)
    kept = flip_to_delaunay(ControlMesh.from_faces(vertices, other, crease_edges=creases), passes=100)
    sides = np.concatenate([np.roll(kept.faces_of(3), k, axis=1)[:, :2] for k in range(3)])
    assert as_set(creases) <= as_set(sides)


def as_set(rows):
    return {tuple(row) for row in np.sort(rows, axis=1).tolist()}


def test_a_fit_comes_near_and_stays_near_on_both_sides(scan, fitted):
    assert fitted.mesh.n_vertices <= 150
    assert fitted.stopped_by is StoppedBy.CONTROL_POINTS
    assert fitted.folds == 0
    drawn = tessellate(fitted.mesh, halvings=3)
    dense = closest_points(scan.vertices, drawn.vertices, drawn.face_vertices).distances
    assert abs(100 * dense.max() / fitted.diagonal - fitted.errors.maximum) < 0.02
    back = closest_points(drawn.vertices, scan.vertices, scan.face_vertices).distances
    assert back.max() < 2.0 * fitted.distances.max()
    assert len(fold_places(drawn.vertices, drawn.face_vertices)) == 0


def test_the_tangent_distance_beats_least_squares_and_those_the_plain_rule(scan):
    rms = {u: fit_surface(scan, FitOptions(control_points=150, plain=True, update=u)).errors.rms for u in Update}
    assert rms[Update.TANGENT] < rms[Update.LEAST_SQUARES] < rms[Update.BASIS]
    assert rms[Update.ANDERSON] < rms[Update.BASIS]
    assert rms[Update.NESTEROV] < rms[Update.BASIS]


def test_a_tolerance_ends_the_fit(scan):
    fit = fit_surface(scan, FitOptions(tolerance=0.02))
    assert fit.stopped_by is StoppedBy.TOLERANCE
    assert fit.distances.max() <= 0.02
    assert fit.mesh.n_vertices < scan.n_vertices // 3


def test_a_fold_is_seen_unless_the_scan_has_it_too():
    flat = np.stack(np.meshgrid(np.arange(9.0), np.arange(9.0), [0.0], indexing="ij"), axis=-1).reshape(-1, 3)
    corner = (9 * np.arange(8)[:, None] + np.arange(8)).ravel()
    faces = np.concatenate(
        [np.stack([corner, corner + 9, corner + 10], 1), np.stack([corner, corner + 10, corner + 1], 1)]
    )
    folded = flat.copy()
    folded[40, 0] += 3.5
    mesh = ControlMesh.from_faces(folded, faces)
    patches = limit_patches(mesh)
    drawn = tessellate(mesh, halvings=2, patches=patches)
    flat_scan = Guards(mesh, patches, scan_data(TriangleMesh(flat, faces), 81))
    alike = Guards(mesh, patches, scan_data(drawn, 81))
    assert flat_scan.folded(folded).any()
    assert not flat_scan.folded(flat).any()
    assert not alike.folded(folded).any()


def test_the_patch_network_is_the_limit_surface(fitted):
    patches = limit_patches(fitted.mesh)
    network, misfit = limit_network(fitted.mesh, patches)
    assert misfit < 2e-3
    assert (np.bincount(network.side_edges[network.side_edges >= 0]) == 2).all()
    points = patches.points @ fitted.mesh.vertices
    regular = np.flatnonzero(patches.arrays.tables < 0)[:20]
    u, v = 0.3, 0.6
    exact = points_at(patches.arrays, points, regular, np.full(20, u * (1 - v)), np.full(20, v), 1)[:, 0]
    drawn = [network.patches[p].point(np.array([[u, v]]))[0] for p in regular]
    assert_allclose(drawn, exact, atol=1e-12)


def test_senseless_options_are_refused():
    with pytest.raises(BadOption, match="--tolerance"):
        FitOptions(tolerance=-1.0)
    with pytest.raises(BadOption, match="--control-points"):
        FitOptions(control_points=3)

"""Quadrilateral control meshes and fits of Catmull-Clark and Doo-Sabin surfaces."""

import numpy as np
import pytest
from hull_meshes import ball, bumpy_ball, disc
from numpy.testing import assert_allclose

from recon.geometric_fit.foot_points import EXACT, nearest_feet
from recon.geometric_fit.pipeline import FitOptions, fit_surface
from recon.geometric_fit.quad_mesh import initial_quads, paired
from recon.geometric_fit.refinement import inset_faces
from recon.geometric_fit.updates import Update
from recon.geometry.control_mesh import ControlMesh
from recon.numerics.distance import closest_points
from recon.numerics.halfedges import opposite_sides
from recon.subdivision.limit_surface import Scheme, limit_patches, tessellate

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


def test_an_inset_adds_four_points_and_keeps_the_surface_whole():
    quads = ControlMesh.from_faces(ball(300, 3).vertices, paired(control_mesh(ball(300, 3)))[0])
    grown = inset_faces(quads, np.arange(quads.n_faces), 43)
    assert grown.n_vertices == 340
    assert euler_number_of(grown, 4) == 2


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


@pytest.mark.parametrize("scheme", QUADS)
def test_quadrilaterals_come_nearly_as_near_as_triangles(scheme):
    scan = bumpy_ball(4000)
    loop, quads = (fit_surface(scan, FitOptions(scheme=s, control_points=150)) for s in (Scheme.LOOP, scheme))
    assert quads.mesh.n_vertices <= 150
    assert quads.errors.rms < 2.0 * loop.errors.rms
    assert quads.folds == 0
    drawn = tessellate(quads.mesh, scheme=scheme, halvings=3)
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

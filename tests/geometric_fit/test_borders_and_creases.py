"""Open scans keep their borders, holes close on request, sharp edges stay sharp, and tangles are refused."""

import numpy as np
import pytest
from block_mesh import block
from hull_meshes import bumpy_ball, disc
from numpy.testing import assert_allclose
from scipy.spatial import Delaunay

from recon.errors import NotManifold
from recon.geometric_fit.creases import with_creases
from recon.geometric_fit.hole_filling import close_holes
from recon.geometric_fit.initial_mesh import initial_mesh
from recon.geometric_fit.pipeline import FitOptions, fit_surface
from recon.geometric_fit.sharpening import SharpScan
from recon.geometry.mesh import TriangleMesh
from recon.numerics.distance import closest_points
from recon.numerics.halfedges import boundary_loops, euler_number, free_edges
from recon.subdivision.limit_surface import tessellate

RIGHT = np.radians(40.0)
NO_EDGES = np.empty((0, 2), dtype=np.int64)


def holed_ball():
    ball = bumpy_ball(3000)
    middle = ball.corners().mean(axis=1)
    return TriangleMesh(ball.vertices, ball.face_vertices[np.abs(middle[:, 2]) < 0.8], "holed ball")


def both_ways(scan, fitted):
    drawn = tessellate(fitted.mesh, halvings=2)
    back = closest_points(drawn.vertices, scan.vertices, scan.face_vertices).distances
    return 100.0 * back.max() / fitted.diagonal


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e6])
def test_a_simplified_sheet_keeps_its_corners_and_its_border(scale):
    sheet = disc(1500, 6)
    scan = TriangleMesh(sheet.vertices * scale, sheet.face_vertices, "sheet")
    mesh = initial_mesh(scan, 60)
    assert euler_number(mesh.faces_of(3)) == 1
    assert_allclose(np.ptp(mesh.vertices, axis=0)[:2], np.ptp(scan.vertices, axis=0)[:2], rtol=0.02)


def test_an_open_scan_is_fitted_up_to_its_border():
    scan = disc(1500, 6)
    fitted = fit_surface(scan, FitOptions(control_points=120))
    assert fitted.errors.rms < 0.05
    assert fitted.errors.maximum < 0.5
    # the border of this scan is a zigzag of random points, which no smooth border follows
    assert both_ways(scan, fitted) < 2.0
    assert len(boundary_loops(fitted.mesh.faces_of(3))) == 1


def test_holes_stay_or_are_closed_as_asked():
    scan = holed_ball()
    kept, closed = (fit_surface(scan, FitOptions(control_points=200, close=c)) for c in (False, True))
    assert len(boundary_loops(kept.mesh.faces_of(3))) == 2
    assert (kept.n_closed, closed.n_closed) == (0, 2)
    assert len(free_edges(closed.mesh.faces_of(3))) == 0
    assert len(closed.distances) == len(np.unique(scan.face_vertices))
    assert max(kept.errors.rms, closed.errors.rms) < 0.06


def test_a_filled_hole_continues_the_sphere_around_it():
    ball = bumpy_ball(3000, height=0.0)
    open_ball = TriangleMesh(ball.vertices, ball.face_vertices[ball.corners().mean(axis=1)[:, 2] < 0.9], "ball")
    whole, n = close_holes(open_ball)
    assert n == 1
    assert euler_number(whole.face_vertices) == 2
    assert_allclose(np.linalg.norm(whole.vertices, axis=1), 1.0, atol=0.04)


def test_creases_are_found_where_the_scan_is_sharp_and_nowhere_else():
    cube, ball = block(20), bumpy_ball(3000)
    sharp = with_creases(initial_mesh(cube, 300), SharpScan(cube, NO_EDGES), RIGHT)
    middle = np.sort(np.abs(sharp.vertices[sharp.crease_edges].mean(axis=1)), axis=1)
    assert np.quantile(np.abs(middle[:, 1:] - 0.5), 0.8) < 0.03
    assert (middle[:, 2] - middle[:, 1]).max() < 0.15
    along = np.linspace(-0.45, 0.45, 10)
    places = np.array(
        [np.roll([t, a, b], k) for t in along for a in (-0.5, 0.5) for b in (-0.5, 0.5) for k in range(3)]
    )
    drawn = closest_points(places, sharp.vertices, sharp.crease_edges[:, [0, 1, 1]]).distances
    assert np.quantile(drawn, 0.9) < 0.06
    assert len(with_creases(initial_mesh(ball, 40), SharpScan(ball, NO_EDGES), RIGHT).crease_edges) == 0


def test_corners_of_a_border_are_those_of_the_scan():
    side = np.linspace(-1.0, 1.0, 41)
    x, y = (a.ravel() for a in np.meshgrid(side, side, indexing="ij"))
    radius = np.hypot(x, y)
    # points next to the hole go onto its rim
    rim = (radius > 0.4) & (radius < 0.45)
    x[rim], y[rim] = 0.425 * x[rim] / radius[rim], 0.425 * y[rim] / radius[rim]
    faces = Delaunay(np.stack([x, y], axis=1)).simplices.astype(np.int64)
    faces = faces[(radius[faces] > 0.4).all(axis=1)]
    used, faces = np.unique(faces, return_inverse=True)
    scan = TriangleMesh(np.stack([x, y, 0 * x], axis=1)[used], faces.reshape(-1, 3), "sheet with a round hole")
    marked = with_creases(initial_mesh(scan, 30), SharpScan(scan, NO_EDGES), RIGHT)
    found = marked.vertices[marked.corner_vertices]
    assert len(found) == 4
    assert np.abs(np.abs(found[:, :2]) - 1.0).max() < 1e-6


@pytest.mark.parametrize("scale", [1e-3, 1e4])
def test_a_block_keeps_its_edges(scale):
    scan = block(20, scale=scale)
    fitted, smooth = (fit_surface(scan, FitOptions(control_points=300, crease_angle=a)) for a in (RIGHT, np.pi))
    assert fitted.errors.maximum < 0.2
    assert fitted.errors.rms < 0.2 * smooth.errors.rms


def test_outliers_pull_less_where_robust_weights_are_asked_for():
    ball = bumpy_ball(3000)
    rng = np.random.default_rng(3)
    off = rng.choice(ball.n_vertices, 60, replace=False)
    spoilt = ball.vertices.copy()
    spoilt[off] *= 1.0 + 0.1 * rng.random((60, 1))
    scan = TriangleMesh(spoilt, ball.face_vertices, "spoilt ball")

    def error(robust):
        mesh = fit_surface(scan, FitOptions(control_points=200, robust=robust)).mesh
        drawn = tessellate(mesh, halvings=2)
        away = closest_points(ball.vertices, drawn.vertices, drawn.face_vertices).distances
        return np.sqrt(np.mean(away**2))

    assert error(True) < 0.6 * error(False)


def test_a_scan_with_three_faces_on_an_edge_is_refused_with_the_place():
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1.0], [2, 2, 2]])
    scan = TriangleMesh(corners, np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4], [1, 2, 5]]), "fin")
    with pytest.raises(NotManifold, match="more than two faces"):
        fit_surface(scan, FitOptions(control_points=4))

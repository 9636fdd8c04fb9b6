"""Edges that a scan has cut off are put back, those it has stay, and none are invented."""

from pathlib import Path

import numpy as np
import pytest
import pyvista as pv
from block_mesh import block
from hull_meshes import bumpy_ball, disc
from numpy.testing import assert_allclose
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from recon.geometric_fit.pipeline import FitOptions, fit_surface
from recon.geometric_fit.scan_data import fold_places
from recon.geometric_fit.sharpening import sharpened
from recon.geometry.mesh import TriangleMesh
from recon.numerics.distance import closest_points
from recon.numerics.halfedges import edge_table, euler_number
from recon.readers.meshes import read_mesh
from recon.subdivision.limit_surface import tessellate

ANGLE = np.radians(40.0)
FANDISK = Path(__file__).parents[3] / "shared" / "data" / "scans" / "fandisk_large.off"


def isosurface(height, *, cells, reach):
    """Where a function of points is zero, sampled on a grid without regard to edges: these are cut off."""
    h = 2.0 * reach / cells
    grid = pv.ImageData(dimensions=(cells + 1,) * 3, spacing=(h, h, h), origin=(-reach,) * 3)
    surface = grid.contour([0.0], height(grid.points.astype(np.float64)), method="flying_edges").clean(tolerance=1e-6)
    faces = surface.faces.reshape(-1, 4)[:, 1:].astype(np.int64)
    return TriangleMesh(surface.points.astype(np.float64), faces, "isosurface")


CELL = 2.0 * 1.9 / 30  # of the grid in which the cube is sampled
TURN = Rotation.from_euler("xyz", [0.3, 0.5, 0.7]).as_matrix()


def cut_off_cube(cells):
    """The cube from -1 to 1, turned by TURN."""
    return isosurface(lambda x: np.abs(x @ TURN).max(axis=1) - 1.0, cells=cells, reach=1.9)


def half_cylinder(cells):
    """The half at z > 0 of a cylinder of radius 1 around x, from -1.2 to 1.2; turned by TURN."""

    def height(x):
        x, y, z = (x @ TURN).T
        return np.max([np.hypot(y, z) - 1.0, -z, np.abs(x) - 1.2], axis=0)

    return isosurface(height, cells=cells, reach=1.9)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e5])
def test_the_edges_of_a_cube_are_put_back(scale):
    scan = cut_off_cube(30)
    mesh, edges = sharpened(TriangleMesh(scale * scan.vertices, scan.face_vertices, "cube"), ANGLE)
    vertices = mesh.vertices @ TURN / scale
    assert euler_number(mesh.face_vertices) == 2
    assert len(edge_table(mesh.face_vertices).misoriented()) == 0
    volumes = [abs(np.linalg.det(v[m.face_vertices]).sum()) / 6.0 for v, m in ((scan.vertices, scan), (vertices, mesh))]
    assert 8.0 - volumes[1] < 0.35 * (8.0 - volumes[0])
    ends = np.sort(np.abs(vertices[edges]), axis=2)
    length = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
    off_edge = np.abs(ends[..., 1:] - 1.0).max(axis=(1, 2))
    assert length[off_edge < 0.2 * CELL].sum() > 0.8 * 24.0
    assert length[off_edge > 0.5 * CELL].sum() < 0.3 * length.sum()


def test_curved_edges_are_put_back_the_nearer_the_finer_the_scan():
    off = []
    for cells in (24, 48):
        scan = half_cylinder(cells)
        mesh, edges = sharpened(scan, ANGLE)
        assert len(edges)
        x, y, z = (mesh.vertices[scan.n_vertices :] @ TURN).T
        heights = np.abs([np.hypot(y, z) - 1.0, z, np.abs(x) - 1.2])
        # a point on an edge is on two of the three surfaces
        off.append(np.median(np.sort(heights, axis=0)[1]))
    assert off[0] < 0.01
    assert off[1] < 0.6 * off[0]


def test_a_scan_that_has_its_edges_or_has_none_stays_as_it_is():
    ball = bumpy_ball(3000)
    mesh, edges = sharpened(ball, ANGLE)
    assert mesh is ball
    assert len(edges) == 0
    whole = block(20)
    again, edges = sharpened(whole, ANGLE)
    assert_allclose(again.vertices, whole.vertices, atol=1e-9)
    assert len(edges) == 12 * 20


@pytest.mark.parametrize("seed", range(1, 9))
def test_slivers_along_a_border_are_no_edges(seed):
    sheet = disc(1500, seed)
    assert sharpened(sheet, ANGLE).mesh is sheet


def test_noise_alone_makes_no_edges():
    ball = bumpy_ball(3000)
    noise = np.random.default_rng(1).normal(0.0, 0.02, ball.vertices.shape)
    rough = TriangleMesh(ball.vertices + noise, ball.face_vertices, "rough ball")
    assert len(sharpened(rough, ANGLE).edges) == 0


def plate_with_boss_and_hole(cells):
    def height(x):
        x, y, z = (x @ TURN).T
        plate = np.max([np.abs(x) - 1.3, np.abs(y) - 0.9, np.abs(z + 0.4) - 0.25], axis=0)
        boss = np.max([np.hypot(x - 0.5, y) - 0.45, np.abs(z - 0.1) - 0.55], axis=0)
        return np.maximum(np.minimum(plate, boss), 0.28 - np.hypot(x + 0.7, y))

    return isosurface(height, cells=cells, reach=1.8)


@pytest.mark.slow
@pytest.mark.parametrize("count", [400, 600, 900])
def test_a_machined_part_keeps_its_edges_without_a_fold(count):
    fitted = fit_surface(plate_with_boss_and_hole(70), FitOptions(control_points=count))
    assert len(fitted.mesh.crease_edges) > 100
    assert fitted.folds == 0
    assert fitted.mesh.n_vertices <= count


@pytest.mark.skipif(not FANDISK.is_file(), reason="the folder of scans is not beside this checkout")
def test_fandisk_keeps_its_edges():
    scan = read_mesh(FANDISK).mesh
    on_edges = np.unique(sharpened(scan, ANGLE).edges)
    fitted = fit_surface(scan, FitOptions(control_points=1500))
    assert fitted.folds == 0
    # nor beside sharp edges, whose own right angles excuse nothing on either side
    drawn = tessellate(fitted.mesh, halvings=2)
    known, folds = (fold_places(m.vertices, m.face_vertices) for m in (scan, drawn))
    assert len(folds) == 0 or cKDTree(known).query(folds)[0].max() <= 0.005 * fitted.diagonal
    assert fitted.errors.rms < 0.008
    off = 100.0 * fitted.distances[on_edges[on_edges < scan.n_vertices]] / fitted.diagonal
    assert np.quantile(off, 0.98) < 0.05


def test_the_fits_of_a_cut_off_cube_have_its_edges():
    scan, edge = cut_off_cube(30), np.linspace(-0.95, 0.95, 50)
    places = np.concatenate([np.roll(np.stack([edge, 0 * edge + 1, 0 * edge + 1], 1), k, axis=1) for k in range(3)])
    on_edges, farthest = [], []
    for count in (100, 145, 150, 155, 180):
        fitted = fit_surface(scan, FitOptions(control_points=count))
        vertices, creases = fitted.mesh.vertices @ TURN, fitted.mesh.crease_edges
        ends = np.sort(np.abs(vertices[creases]), axis=2)
        on_edges.append((np.abs(ends[..., 1:] - 1.0) < 0.4 * CELL).all(axis=(1, 2)).mean())
        farthest.append(closest_points(places, vertices, creases[:, [0, 1, 1]]).distances.max())
    assert min(on_edges) > 0.8
    # an edge is put back with a kink of 0.3998 cells, and rounding decides what a single fit makes of it
    assert np.median(farthest) < 0.4 * CELL and max(farthest) < 0.5 * CELL

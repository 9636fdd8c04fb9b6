import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial import Delaunay

from recon.errors import BadOption
from recon.geometry.mesh import TriangleMesh
from recon.hole_patch.smoothing import Boundary, ring_mean_operator, taubin_factors, taubin_smooth, transfer
from recon.numerics.halfedges import free_edges, vertex_normals

PASS_BANDS = np.arange(0.01, 0.1001, 0.005)


def loop(mesh, *, pass_band=0.01, pairs=1000, boundary=Boundary.HELD):
    """The filter as the paper writes it, step by step."""
    lam, mu = taubin_factors(pass_band)
    mean = ring_mean_operator(mesh, boundary)
    x = mesh.vertices
    for _ in range(pairs):
        x = x + lam * (mean @ x - x)
        x = x + mu * (mean @ x - x)
    return x


def torus_faces(n):
    """Six faces around each of n x n vertices: neighbours one step along either axis and along the diagonal."""
    number = np.pad(np.arange(n * n).reshape(n, n), (0, 1), mode="wrap")
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
    return np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)


def sheet(n, rng, *, height=lambda x, y: 0 * x):
    """A sheet over the unit square with vertices of all valences, triangulated at random places."""
    x, y = rng.random((2, n))
    faces = Delaunay(np.stack([x, y], axis=1)).simplices
    return TriangleMesh(np.stack([x, y, height(x, y)], axis=1), faces)


def sphere(levels):
    """Unit sphere: an octahedron whose faces were halved along all sides, over and over."""
    points = np.array([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], dtype=float)
    faces = np.array([[i, (i + 1) % 4, 4] for i in range(4)] + [[(i + 1) % 4, i, 5] for i in range(4)])
    for _ in range(levels):
        sides = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
        edges, inverse = np.unique(sides, axis=0, return_inverse=True)
        m = inverse.reshape(-1, 3) + len(points)
        points = np.concatenate([points, points[edges].sum(axis=1)])
        points /= np.linalg.norm(points, axis=1, keepdims=True)
        a, b, c = faces.T
        faces = np.stack([a, m[:, 0], m[:, 2], m[:, 0], b, m[:, 1], m[:, 2], m[:, 1], c, *m.T], axis=1).reshape(-1, 3)
    return TriangleMesh(points, faces)


def test_published_factors():
    assert_allclose(taubin_factors(0.01), (0.6324, -0.6364), atol=5e-5)  # [kinoshita], section on relief


@pytest.mark.parametrize("pass_band", PASS_BANDS)
def test_factors_satisfy_both_conditions(pass_band):
    lam, mu = taubin_factors(pass_band)
    assert 0 < lam < -mu
    assert_allclose(1 / lam + 1 / mu, pass_band, rtol=1e-12)
    assert_allclose((1 - lam) * (1 - mu), -(1 - 2 * lam) * (1 - 2 * mu), rtol=1e-12)


@pytest.mark.parametrize("pass_band", PASS_BANDS)
def test_transfer_function_keeps_the_pass_band_and_damps_the_rest(pass_band):
    k = np.linspace(1.001 * pass_band, 2, 500)
    assert_allclose(transfer(np.array([0.0, pass_band]), pass_band=pass_band, pairs=1000), 1.0, rtol=1e-9)
    assert np.abs(transfer(k, pass_band=pass_band, pairs=1)).max() < 1.0
    assert (transfer(np.linspace(0, pass_band, 50), pass_band=pass_band, pairs=1) >= 1.0 - 1e-15).all()


@pytest.mark.parametrize("pairs", [0, 1, 7, 1000])
@pytest.mark.parametrize("pass_band", [0.01, 0.1])
def test_every_wave_on_a_regular_torus_is_scaled_by_the_transfer_function(pass_band, pairs):
    # On this graph plane waves are eigenvectors: k = 1 - (cos a + cos b + cos(a + b)) / 3 for steps a and b.
    n = 24
    row, column = np.divmod(np.arange(n * n), n)
    for i, j in ((1, 0), (0, 1), (1, 2), (3, 5), (12, 0), (8, 8)):
        a, b = 2 * np.pi * i / n, 2 * np.pi * j / n
        phase = a * row + b * column
        waves = np.stack([np.cos(phase), np.sin(phase), 3 * np.cos(phase + 1)], axis=1)
        k = 1 - (np.cos(a) + np.cos(b) + np.cos(a + b)) / 3
        found = taubin_smooth(TriangleMesh(waves, torus_faces(n)), pass_band=pass_band, pairs=pairs).vertices
        assert_allclose(found, waves * transfer(k, pass_band=pass_band, pairs=pairs), atol=1e-11)


@pytest.mark.parametrize("boundary", [Boundary.HELD, Boundary.ALONG, Boundary.FREE])
@pytest.mark.parametrize(("pass_band", "pairs"), [(0.01, 1), (0.01, 30), (0.01, 1000), (0.1, 1000)])
def test_the_series_equals_the_loop_on_an_irregular_open_mesh(pass_band, pairs, boundary):
    rng = np.random.default_rng(1)
    mesh = sheet(1500, rng, height=lambda x, y: 0.3 * np.sin(5 * x) + 0.02 * rng.standard_normal(len(x)))
    found = taubin_smooth(mesh, pass_band=pass_band, pairs=pairs, boundary=boundary).vertices
    expected = loop(mesh, pass_band=pass_band, pairs=pairs, boundary=boundary)
    assert np.abs(found - expected).max() < 1e-10 * np.linalg.norm(np.ptp(mesh.vertices, axis=0))


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_the_series_is_as_exact_at_any_size_and_far_from_the_origin(scale):
    mesh = sheet(400, np.random.default_rng(2))
    moved = TriangleMesh(scale * mesh.vertices + 1e3 * scale, mesh.face_vertices)
    expected = scale * taubin_smooth(mesh).vertices + 1e3 * scale
    assert_allclose(taubin_smooth(moved).vertices, expected, rtol=0, atol=1e-11 * scale)


@pytest.mark.parametrize("boundary", list(Boundary))
def test_the_operator_has_a_real_spectrum_in_the_range_of_the_series(boundary):
    # This is what makes the recurrence stable; with a held border the operator is not symmetric in any scaling.
    mesh = sheet(150, np.random.default_rng(3))
    mean = ring_mean_operator(mesh, boundary).toarray()
    values = np.linalg.eigvals(mean)
    assert np.abs(values.imag).max() < 1e-7
    assert values.real.min() > -1 - 1e-9 and values.real.max() < 1 + 1e-9
    assert_allclose(mean.sum(axis=1), 1.0)


def test_powers_of_the_recurrence_stay_bounded_with_a_held_border():
    mesh = sheet(800, np.random.default_rng(4))
    mean = ring_mean_operator(mesh)
    before, now = mesh.vertices, mean @ mesh.vertices
    for _ in range(2000):
        before, now = now, 2 * (mean @ now) - before
    assert np.abs(now).max() < 10 * np.abs(mesh.vertices).max()


def test_border_and_lonely_vertices_are_held_to_the_last_bit():
    mesh = sheet(300, np.random.default_rng(5), height=lambda x, y: x * y)
    mesh = TriangleMesh(np.concatenate([mesh.vertices, [[5.0, 5.0, 5.0]]]), mesh.face_vertices)
    border = np.unique(free_edges(mesh.face_vertices))
    found = taubin_smooth(mesh).vertices
    assert_array_equal(found[border], mesh.vertices[border])
    assert_array_equal(found[-1], [5, 5, 5])


def test_smoothing_commutes_with_affine_maps_so_planes_stay_planes():
    rng = np.random.default_rng(6)
    mesh = sheet(300, rng, height=lambda x, y: np.sin(9 * x * y))
    matrix = np.eye(4)
    matrix[:3] = rng.standard_normal((3, 4))
    assert_allclose(taubin_smooth(mesh.moved(matrix)).vertices, taubin_smooth(mesh).moved(matrix).vertices, atol=1e-10)
    plane = taubin_smooth(sheet(300, rng, height=lambda x, y: 2 * x - y + 3)).vertices
    assert_allclose(plane @ [2, -1, -1], -3, atol=1e-11)


@pytest.mark.parametrize("pass_band", [0.01, 0.1])
def test_a_regular_grid_with_a_held_border_does_not_move(pass_band):
    n = 15
    y, x = np.mgrid[:n, :n]
    number = np.arange(n * n).reshape(n, n)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
    faces = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
    mesh = TriangleMesh(np.stack([x, y, 0.25 * x + y], axis=-1).reshape(-1, 3).astype(float), faces)
    assert_allclose(taubin_smooth(mesh, pass_band=pass_band).vertices, mesh.vertices, atol=1e-11)


def test_a_sphere_keeps_its_radius_and_loses_its_relief():
    ball = sphere(5)
    relief = 0.01 * np.random.default_rng(7).standard_normal((ball.n_vertices, 1))
    rough = TriangleMesh(ball.vertices * (1 + relief), ball.face_vertices)
    plain, smoothed = (np.linalg.norm(taubin_smooth(mesh).vertices, axis=1) for mesh in (ball, rough))
    peak = transfer(np.array([0.005]), pass_band=0.01, pairs=1000)[0]  # no wave grows by more: 1.010
    assert 1.0 <= smoothed.mean() < peak
    assert np.abs(plain - 1.0).max() < 2 * (peak - 1.0)
    assert np.std(smoothed - plain) < 0.12 * 0.01


def cap(rng, relief):
    """Part of a sphere of radius √3 over the unit square, with noise along the normal and the rim as a mask."""
    n = 60
    y, x = np.mgrid[:n, :n] / (n - 1)
    x, y = x.ravel(), y.ravel()
    rim = (x % 1 == 0) | (y % 1 == 0)
    x, y = np.where(rim, [x, y], [x, y] + rng.uniform(-0.2, 0.2, (2, n * n)) / n)
    radial = np.stack([x - 0.5, y - 0.5, np.sqrt(3 - (x - 0.5) ** 2 - (y - 0.5) ** 2)], axis=1) / np.sqrt(3)
    number = np.arange(n * n).reshape(n, n)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
    faces = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
    return TriangleMesh(radial * (np.sqrt(3) + relief * rng.standard_normal((n * n, 1))), faces), rim


def test_levelling_takes_the_relief_off_the_rim_and_moves_along_normals_only():
    mesh, rim = cap(np.random.default_rng(8), 0.01)
    roughness = {
        rule: np.std(np.linalg.norm(taubin_smooth(mesh, boundary=rule).vertices[rim], axis=1)) for rule in Boundary
    }
    assert roughness[Boundary.LEVELLED] < roughness[Boundary.ALONG] < roughness[Boundary.HELD]
    assert roughness[Boundary.LEVELLED] < 0.25 * roughness[Boundary.HELD]
    moved = taubin_smooth(mesh, boundary=Boundary.LEVELLED).vertices - mesh.vertices
    normals = vertex_normals(taubin_smooth(mesh, boundary=Boundary.FREE).vertices, mesh.face_vertices)
    assert_allclose(np.cross(moved, normals), 0.0, atol=1e-12)


@pytest.mark.parametrize("pass_band", [0.0, -0.1, 1.0, np.nan])
def test_pass_bands_without_meaning_are_refused(pass_band):
    with pytest.raises(BadOption, match="between 0 and 1"):
        taubin_factors(pass_band)


def test_counts_that_make_no_sense_or_swell_the_shape_are_refused():
    mesh = sheet(20, np.random.default_rng(9))
    with pytest.raises(BadOption, match="negative"):
        taubin_smooth(mesh, pairs=-1)
    with pytest.raises(BadOption, match="swells"):
        taubin_smooth(mesh, pass_band=0.1, pairs=100_000)

"""B-spline and NURBS surfaces of scans: exact in their space, feet nearest, near the scan, without folds."""

from dataclasses import replace

import numpy as np
import pytest
from hull_meshes import bumpy_ball
from numpy.testing import assert_allclose
from sheets import cliff, double_torus, pierced, sheet, torus, tube

from recon.errors import BadOption, NoSurface, NotManifold
from recon.geometric_fit.convergence import StoppedBy
from recon.geometric_fit.hole_filling import fill_loops
from recon.geometric_fit.knot_gains import knot_gains
from recon.geometric_fit.net_guards import NetEnergy, NetGuards
from recon.geometric_fit.scan_data import fold_places, scan_data
from recon.geometric_fit.scan_kind import ScanKind
from recon.geometric_fit.spline_fit import SplineKind, SplineOptions, fit_sheet
from recon.geometric_fit.spline_space import SplineSpace
from recon.geometric_fit.tensor_space import TensorSpace, nearest_net_feet, net_rows, walk_net_feet
from recon.geometric_fit.trimming import end_caps, trimmed_sheet
from recon.geometric_fit.updates import Update
from recon.geometry.mesh import TriangleMesh
from recon.geometry.trimmed import TrimmedSurface
from recon.numerics.distance import closest_points
from recon.numerics.halfedges import boundary_loops

BREAKS = np.array([0.0, 0.13, 0.2, 0.45, 0.5, 0.77, 0.8, 1.0])
SPACES = [
    TensorSpace(SplineSpace(p, BREAKS, around_u), SplineSpace(q, 1.0 - BREAKS[::-1], around_v))
    for p, q in ((3, 3), (1, 2), (4, 3))
    for around_u, around_v in ((False, False), (True, False), (True, True))
]
HOLE = (np.array([2.0, 1.0, 0.183]), 0.3)


def some_net(space, rational=True):
    random = np.random.default_rng(2)
    weights = random.uniform(0.5, 2.0, space.shape) if rational else np.ones(space.shape)
    points = random.normal(size=(*space.shape, 3))
    return np.concatenate([points * weights[..., None], weights[..., None]], axis=2)


@pytest.fixture(scope="module")
def fits():
    """One fit of each kind of scan, at about as many control points as its waves need."""
    scans = {"disc": sheet(40), "cylinder": tube(40), "torus": torus(40)}
    return {name: (scan, fit_sheet(scan, SplineOptions(control_points=400))) for name, scan in scans.items()}


@pytest.mark.parametrize("space", SPACES)
def test_the_net_and_the_clamped_surface_are_one(space):
    net, uv = some_net(space), np.random.default_rng(3).random((200, 2))
    here = walk_net_feet(space, net, np.zeros((200, 3)), uv, max_steps=0)
    surface = space.surface(net)
    assert_allclose(surface.point(uv), here.positions, atol=1e-12)
    assert_allclose(surface.derivative(uv, 1, 0), here.by_u, atol=1e-10)
    assert_allclose(surface.derivative(uv, 0, 1), here.by_v, atol=1e-10)
    shares = net_rows(space, net, uv).matrix(space.n_control)
    assert_allclose(shares @ (net[..., :3] / net[..., 3:]).reshape(-1, 3), here.positions, atol=1e-12)


@pytest.mark.parametrize("space", SPACES)
def test_more_knots_leave_the_surface_where_it_is(space):
    net, uv = some_net(space), np.random.default_rng(4).random((200, 2))
    finer, moved = space.with_breaks(np.array([0.3, 0.6]), np.array([0.31]), net)
    assert finer.shape == (space.shape[0] + 2, space.shape[1] + 1)
    assert_allclose(finer.surface(moved).point(uv), space.surface(net).point(uv), atol=1e-11)


def test_feet_are_as_near_as_a_dense_search_finds(fits):
    for scan, fit in fits.values():
        t = np.linspace(0.0, 1.0, 251)
        drawn = fit.surface.grid(t, t)
        number = np.arange(251 * 251).reshape(251, 251)
        p, q, r, s = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
        faces = np.concatenate([np.stack([p, q, r], -1).reshape(-1, 3), np.stack([p, r, s], -1).reshape(-1, 3)])
        chosen = np.arange(0, scan.n_vertices, 61)
        dense = closest_points(scan.vertices[chosen], drawn.reshape(-1, 3), faces).distances
        # the flat triangles of the dense search are off the surface by less than this
        assert np.abs(fit.distances[chosen] - dense).max() < 1.5e-4 * fit.diagonal


def test_errors_are_those_of_the_distances(fits):
    scan, fit = fits["torus"]
    assert len(fit.distances) == scan.n_vertices
    assert_allclose(fit.errors.maximum, 100.0 * fit.distances.max() / fit.diagonal)
    assert_allclose(fit.errors.rms, 100.0 * np.sqrt(np.mean(fit.distances**2)) / fit.diagonal)


@pytest.mark.parametrize("name, kind", [("disc", "disc"), ("cylinder", "cylinder"), ("torus", "torus")])
def test_a_fit_is_near_and_has_no_fold(fits, name, kind):
    scan, fit = fits[name]
    assert fit.sheet.kind is ScanKind(kind)
    assert fit.space.n_control <= 400 and fit.stopped_by is StoppedBy.CONTROL_POINTS
    assert fit.errors.rms < 0.02 and fit.folds == 0
    drawn = fit.drawn(2)
    assert len(fold_places(drawn.vertices, drawn.face_vertices)) == 0
    corners = fit.places[fit.sheet.mesh.face_vertices]
    between = corners[np.ptp(corners, axis=1).max(axis=1) < 0.5].mean(axis=1)
    back = closest_points(fit.surface.point(between), scan.vertices, scan.face_vertices).distances
    # the scan is triangles: a surface through its points leaves their planes by about this
    assert back.max() < 0.01 * fit.diagonal


def test_normals_face_as_the_scan_does(fits):
    for scan, fit in fits.values():
        at = nearest_net_feet(fit.space, fit.net, scan.corners().mean(axis=1))
        assert np.einsum("ij,ij->i", at.normals, scan.area_vectors()).min() > 0.0


def test_a_surface_that_runs_around_is_smooth_over_its_seam(fits):
    surface = fits["torus"][1].surface
    t = np.linspace(0.0, 1.0, 50)
    for order in ((0, 0), (1, 0), (0, 1)):
        ends = [surface.derivative(np.stack([np.full(50, x), t], axis=1), *order) for x in (0.0, 1.0)]
        assert_allclose(*ends, atol=1e-8)
        ends = [surface.derivative(np.stack([t, np.full(50, x)], axis=1), *order) for x in (0.0, 1.0)]
        assert_allclose(*ends, atol=1e-8)


def test_what_is_laid_over_a_hole_draws_nothing_in():
    scan = cliff()
    fit = fit_sheet(scan, SplineOptions(control_points=1200))
    assert len(fit.sheet.holes) == 1 and fit.folds == 0
    assert fit.errors.maximum < 0.15
    top = int(scan.vertices[:, 2].argmax())
    assert fit.distances[top] < 1e-3 * fit.diagonal


def test_faces_over_holes_are_not_sampled_and_weigh_what_is_asked():
    scan = pierced(sheet(30), (HOLE[0], 0.7))
    filled = fill_loops(scan, boundary_loops(scan.face_vertices)[-1:])
    n, many = scan.n_vertices, 1500
    whole = scan_data(filled, many, n_measured=n)
    bare = scan_data(filled, many, n_measured=n, n_sampled=scan.n_faces, fill_weight=0.25)
    assert len(whole.sampled_faces) > len(bare.sampled_faces) and bare.sampled_faces.max(initial=0) < scan.n_faces
    assert_allclose(bare.weights[:n], 1.0)
    assert_allclose(bare.weights[n : filled.n_vertices], 0.25)


def test_noise_is_smoothed_and_not_followed():
    clean, rough = torus(24, waves=0.0), torus(24, waves=0.0, noise=0.01)
    fit = fit_sheet(rough, SplineOptions(control_points=120, plain=True))
    off = nearest_net_feet(fit.space, fit.net, clean.vertices)
    rms = np.sqrt(np.mean(np.sum((off.positions - clean.vertices) ** 2, axis=1)))
    assert rms < 0.5 * 0.01 and fit.folds == 0


@pytest.mark.parametrize("kind", SplineKind)
def test_a_tolerance_is_kept_and_named(kind):
    scan = tube(30)
    fit = fit_sheet(scan, SplineOptions(kind=kind, tolerance=0.02))
    assert fit.stopped_by is StoppedBy.TOLERANCE
    assert fit.distances.max() <= 0.02


def test_weights_bring_the_surface_nearer():
    scan = torus(30, waves=0.0)
    options = SplineOptions(control_points=300, plain=True, degree=2)  # circles are rational ones of that degree
    plain, free = (fit_sheet(scan, replace(options, kind=kind)) for kind in SplineKind)
    assert plain.surface.weights is None and free.surface.weights is not None
    assert free.errors.rms < 0.9 * plain.errors.rms


@pytest.mark.parametrize("update", Update)
def test_every_update_brings_the_surface_nearer(update):
    fit = fit_sheet(sheet(20), SplineOptions(control_points=150, plain=True, update=update, rounds=5))
    assert fit.stopped_by is StoppedBy.ROUNDS and len(fit.rounds) == 5
    assert fit.rounds[-1].errors.rms <= fit.rounds[0].errors.rms
    assert fit.errors.rms < 0.2


def test_outliers_count_little_where_that_is_asked_for():
    scan = torus(30)
    struck = np.random.default_rng(5).choice(scan.n_vertices, 40, replace=False)
    vertices = scan.vertices.copy()
    vertices[struck] *= 1.1
    others = np.setdiff1d(np.arange(scan.n_vertices), struck)
    off = [
        fit_sheet(TriangleMesh(vertices, scan.face_vertices), SplineOptions(control_points=300, robust=r)).distances
        for r in (False, True)
    ]
    assert off[1][others].mean() < 0.5 * off[0][others].mean()


def test_a_knot_is_worth_most_where_and_in_the_direction_in_which_the_error_is():
    space = TensorSpace(SplineSpace(3, np.linspace(0, 1, 9)), SplineSpace(3, np.linspace(0, 1, 9)))
    uv = np.random.default_rng(6).random((20000, 2))
    x = 8.0 * uv[:, 0] - 5.0
    height = np.where((x > 0) & (x < 1), np.sin(np.pi * np.clip(x, 0, 1)) ** 2, 0.0) * (1.0 + uv[:, 1])
    rows = net_rows(space, np.ones((*space.shape, 4)), uv).matrix(space.n_control)
    left = height - rows @ np.linalg.lstsq(rows.toarray(), height, rcond=None)[0]
    gain_u, gain_v = knot_gains(space, uv, left, np.ones(len(uv)))
    assert int(np.argmax(gain_u)) == 5 and gain_u[5] > 20.0 * gain_v.max()


def test_the_plate_does_not_bend_what_is_straight():
    for space in SPACES[:1]:
        u, v = np.meshgrid(space.u.abscissae(), space.v.abscissae(), indexing="ij")
        energy = NetEnergy(space).matrix(np.ones(space.n_control))
        assert_allclose(energy @ (3.0 * u - 2.0 * v + 1.0).ravel(), 0.0, atol=1e-10)
        bent = (u * u).ravel()
        assert float(bent @ np.asarray(energy @ bent)) > 1e-4


def test_a_fold_is_seen_where_it_is():
    space = TensorSpace(SplineSpace(3, np.linspace(0, 1, 11)), SplineSpace(3, np.linspace(0, 1, 11)))
    u, v = np.meshgrid(space.u.abscissae(), space.v.abscissae(), indexing="ij")
    flat = np.stack([u, v, 0.0 * u], axis=-1)
    scan = scan_data(sheet(20), 100)
    guards = NetGuards(space, np.ones(space.shape), scan, np.random.default_rng(7).random((5000, 2)))
    assert not guards.folded(flat.reshape(-1, 3)).any()
    folded = flat.copy()
    folded[6, 6, 0] -= 0.45
    found = np.flatnonzero(guards.folded(folded.reshape(-1, 3)))
    assert 6 * space.shape[1] + 6 in found and len(found) < 60


def test_the_surface_beyond_the_scan_goes_on_as_it_was():
    scan = pierced(sheet(40), HOLE)
    fit = fit_sheet(scan, SplineOptions(control_points=400))
    u, v = np.linspace(0, 1, 80), np.linspace(0, 1, 80)
    points = fit.surface.grid(u, v).reshape(-1, 3)
    low, high = scan.vertices.min(axis=0), scan.vertices.max(axis=0)
    # the rectangle reaches beyond the border by a fiftieth of its sides, at corners of the waves by more
    assert (points > low - 0.2 * fit.diagonal).all() and (points < high + 0.2 * fit.diagonal).all()


def test_a_disc_is_cut_along_its_border_and_its_holes():
    scan = pierced(sheet(40), HOLE)
    fit = fit_sheet(scan, SplineOptions(control_points=400))
    cut = trimmed_sheet(fit)
    assert len(cut.loops) == 2 and cut.n_lost == 0
    TrimmedSurface(cut.surface, cut.loops)  # the border counter-clockwise, the hole clockwise
    hole = cut.surface.point(cut.loops[1].polygon(200))
    assert_allclose(np.linalg.norm(hole[:, :2] - HOLE[0][:2], axis=1), 0.31, atol=0.06)
    assert len(trimmed_sheet(fit, with_holes=False).loops) == 1


def test_the_seam_of_a_torus_keeps_clear_of_a_hole():
    for place in ([4.0, 0.0, 0.0], [-2.0, 0.0, 0.0], [0.0, 3.0, 1.0]):
        cut = trimmed_sheet(fit_sheet(pierced(torus(30), (place, 0.6)), SplineOptions(control_points=300)))
        ring = cut.loops[0].polygon(200)
        (u0, u1), (v0, v1) = cut.surface.domain
        assert (ring > [u0, v0]).all() and (ring < [u1, v1]).all()
        off = np.linalg.norm(cut.surface.point(ring) - place, axis=1)
        assert off.min() > 0.3 and off.max() < 1.2


def test_caps_end_where_the_tube_does(fits):
    surface = fits["cylinder"][1].surface
    t = np.linspace(0.0, 1.0, 40)
    for cap, end in zip(end_caps(surface), (0.0, 1.0)):
        rim = np.stack([t, np.full(40, end)], axis=1)
        assert_allclose(cap.point(np.stack([t, np.zeros(40)], axis=1)), surface.point(rim), atol=1e-12)
        assert np.ptp(cap.point(np.stack([t, np.ones(40)], axis=1)), axis=0).max() < 1e-12


def test_scans_of_other_kinds_and_bad_options_are_refused():
    for scan in (bumpy_ball(300), double_torus()):
        with pytest.raises(NoSurface, match="--surface loop"):
            fit_sheet(scan)
    strip = np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4], [1, 0, 5]])
    with pytest.raises(NotManifold, match="edge"):
        fit_sheet(TriangleMesh(np.random.default_rng(1).random((6, 3)), strip))
    for bad in ({"degree": 0}, {"control_points": 10}, {"tolerance": -1.0}, {"rounds": 0}):
        with pytest.raises(BadOption):
            replace(SplineOptions(), **bad)

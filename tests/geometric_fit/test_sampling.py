"""Points that stand for others, and what the rounds of a fit do with them and with control points that folds hold."""

import numpy as np
import pytest

from recon.geometric_fit.folding import stepped
from recon.geometric_fit.foot_points import nearest_feet
from recon.geometric_fit.options import FitOptions
from recon.geometric_fit.patch_rows import Metric, mean_move, patch_columns, patch_part
from recon.geometric_fit.pipeline import fit_surface
from recon.geometric_fit.sampling import IN_PATCH, joined_by, sample_of
from recon.geometric_fit.scan_data import scan_data
from recon.geometry.control_mesh import ControlMesh
from recon.geometry.mesh import TriangleMesh
from recon.subdivision.limit_surface import limit_patches, tessellate

OCTAHEDRON = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], dtype=float)
SIDES = np.array([[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]])


def dense_scan(halvings: int = 5) -> TriangleMesh:
    return tessellate(ControlMesh.from_faces(OCTAHEDRON, SIDES), halvings=halvings)


def patches_of(scan):
    patches = limit_patches(ControlMesh.from_faces(OCTAHEDRON, SIDES))
    return nearest_feet(patches, patches.points @ OCTAHEDRON, scan.points).patch, len(patches.sheets.faces)


def test_every_point_has_the_nearest_of_its_patch_to_stand_for_it():
    scan = scan_data(dense_scan(), 6)
    patch, n_patches = patches_of(scan)
    sample = sample_of(scan, patch, n_patches)
    kept = np.bincount(patch[sample.at], minlength=n_patches)
    assert (kept == np.minimum(np.bincount(patch, minlength=n_patches), IN_PATCH)).all()
    for i, stands in enumerate(sample.at[sample.nearest]):
        beside = sample.at[patch[sample.at] == patch[i]]
        away = np.linalg.norm(scan.points[beside] - scan.points[i], axis=1)
        assert patch[stands] == patch[i]
        assert np.linalg.norm(scan.points[stands] - scan.points[i]) == pytest.approx(away.min())


def test_a_sample_counts_as_much_as_all_points_before_and_after_others_join():
    scan = scan_data(dense_scan(), 6)
    sample = sample_of(scan, *patches_of(scan))
    others = np.setdiff1d(np.arange(len(scan.points)), sample.at)[::7]
    wider = joined_by(sample, scan, others)
    for each in (sample, wider):
        assert each.counts.sum() == scan.n_measured
        assert each.weights.sum() == pytest.approx(scan.weights.sum())
    assert np.isin(others, wider.at).all()
    assert (wider.at[wider.nearest[others]] == others).all()


def test_a_thin_scan_is_its_own_sample():
    scan = scan_data(dense_scan(2), 6)
    patch, n_patches = patches_of(scan)
    assert sample_of(scan, patch, n_patches).is_whole


def test_the_errors_of_a_fit_to_a_sample_are_those_of_all_points():
    scan = dense_scan(6)
    fit = fit_surface(scan, FitOptions(control_points=40, plain=True, crease_angle=np.pi))
    assert len(fit.distances) == scan.n_vertices
    # the last round told the errors of its sample
    assert fit.rounds[-1].errors.rms == pytest.approx(fit.errors.rms, rel=0.1)


def test_the_mean_move_brings_a_shifted_surface_back_by_no_more_than_it_is_off():
    mesh, scan = ControlMesh.from_faces(OCTAHEDRON, SIDES), dense_scan(4)
    patches = limit_patches(mesh)
    feet = nearest_feet(patches, patches.points @ mesh.vertices, scan.vertices)
    off = np.array([0.01, -0.02, 0.005])
    part = patch_part(
        patch_columns(patches), feet, feet.positions + off, np.ones(scan.n_vertices), Metric(normal=0.0, tangent=1.0)
    )
    np.testing.assert_allclose(mean_move((part,)), np.tile(off, (6, 1)), rtol=1e-5)


class _Wall:
    """Control points beyond 1 on the x axis are folded; none has neighbours."""

    def folded(self, points):
        return points[:, 0] > 1.0

    def widened(self, points):
        return points


def test_a_careful_move_is_taken_where_no_half_of_a_step_helps():
    old, new = np.zeros((3, 3)), np.array([[0.5, 0, 0], [100.0, 0, 0], [100.0, 0, 0]])
    careful = np.array([[0.1, 0, 0], [0.9, 0, 0], [30.0, 0, 0]])
    step = stepped(_Wall(), old, new, careful)
    np.testing.assert_allclose(step.points[:, 0], [0.5, 0.9, 0.0])
    assert step.folding.tolist() == [False, True, True]
    assert not step.folded.any()
    assert step.held.tolist() == [False, True, True]

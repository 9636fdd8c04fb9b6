"""Scans unrolled: what kind they are, no triangle turned over, lengths kept where they can be."""

import numpy as np
import pytest
from hull_meshes import ball
from numpy.testing import assert_allclose
from sheets import double_torus, pierced, sheet, torus, tube

from recon.errors import NoSurface
from recon.geometric_fit.scan_kind import ScanKind, sheet_scans
from recon.geometric_fit.unrolling import unrolled
from recon.geometry.mesh import TriangleMesh
from recon.numerics.halfedges import boundary_loops

HOLE = (np.array([2.0, 1.0, -0.07]), 0.3)
SCANS = {
    "disc": (sheet(30), ScanKind.DISC, 0),
    "rough disc": (sheet(30, noise=0.01), ScanKind.DISC, 0),
    "disc with a hole": (pierced(sheet(30), HOLE), ScanKind.DISC, 1),
    "cylinder": (tube(25), ScanKind.CYLINDER, 0),
    "cylinder with a hole": (pierced(tube(25), ([1.3, 0.0, 2.5], 0.5)), ScanKind.CYLINDER, 1),
    "torus": (torus(25), ScanKind.TORUS, 0),
    "torus with a hole": (pierced(torus(25), ([4.0, 0.0, 0.0], 0.5)), ScanKind.TORUS, 1),
}


def signed_areas(corners):
    a, b, c = corners.transpose(1, 0, 2)
    return 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])


@pytest.mark.parametrize("scan, kind, n_holes", SCANS.values(), ids=SCANS)
def test_no_triangle_is_turned_over(scan, kind, n_holes):
    flat = unrolled(scan)
    found = flat.sheet
    assert found.kind is kind and len(found.holes) == n_holes
    areas = signed_areas(flat.face_corners())
    assert areas[: found.n_faces].min() > 0.0
    assert flat.places.min() >= 0.0 and flat.places.max() <= 1.0
    if kind is not ScanKind.DISC:
        # a triangulation of the whole square, once: no two triangles overlap
        assert_allclose(areas.sum(), 1.0, rtol=1e-9)


def test_the_rims_of_a_tube_are_two_sides_of_the_square():
    flat = unrolled(tube(25))
    found = flat.sheet
    assert_allclose(flat.places[found.rims[0]][:, 1], 0.0)
    assert_allclose(flat.places[found.rims[1]][:, 1], 1.0)


def test_a_cylinder_unrolls_to_its_circumference_and_height():
    mesh = tube(30)
    b = mesh.vertices[:, 2] / 5.0
    angle = np.arctan2(mesh.vertices[:, 1], mesh.vertices[:, 0] - b * b)
    round_tube = TriangleMesh(np.stack([np.cos(angle), np.sin(angle), 3.0 * b], axis=1), mesh.face_vertices)
    assert_allclose(unrolled(round_tube).sides, [2.0 * np.pi, 3.0], rtol=0.01)


def test_a_sheet_with_a_wide_hole_is_no_tube():
    scan = pierced(sheet(30), ([2.0, 1.0, 0.183], 0.8))
    assert [each.kind for each in sheet_scans(scan)] == [ScanKind.CYLINDER, ScanKind.DISC]
    assert unrolled(scan).sheet.kind is ScanKind.DISC


@pytest.mark.parametrize("scale", [1e-4, 1e5])
def test_size_and_place_do_not_matter(scale):
    scan = torus(20)
    moved = TriangleMesh(scan.vertices[:, [1, 2, 0]] * scale + 7.0 * scale, scan.face_vertices)
    one, two = (unrolled(each) for each in (scan, moved))
    # places just before and just behind a seam are the same
    assert_allclose(*(np.exp(2j * np.pi * each.places) for each in (two, one)), atol=1e-9)
    assert_allclose(two.sides, one.sides * scale, rtol=1e-9)


def test_stretch_is_one_where_lengths_are_kept_and_more_where_they_are_not():
    x, y = np.meshgrid(np.linspace(0, 3, 31), np.linspace(0, 1, 11), indexing="ij")
    bent = np.stack([3.0 * np.sin(x / 3.0), 3.0 * np.cos(x / 3.0), y], axis=-1).reshape(-1, 3)  # of a cylinder
    number = np.arange(bent.shape[0]).reshape(x.shape)
    p, q, r, s = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    faces = np.concatenate([np.stack([p, q, r], -1).reshape(-1, 3), np.stack([p, r, s], -1).reshape(-1, 3)])
    flat = unrolled(TriangleMesh(np.column_stack([x.ravel(), y.ravel(), 0 * y.ravel()]), faces))
    assert flat.stretch == pytest.approx(1.0, abs=1e-9)
    assert 1.0 - 1e-9 < unrolled(TriangleMesh(bent, faces)).stretch < 1.1
    # around the torus at its inside lengths are a third less than in the mean, at its outside a third more
    ring = np.linspace(0, 2 * np.pi, 100_001)
    around, area = 3.0 + np.cos(ring), (3.0 + np.cos(ring)) / 3.0
    least = np.sqrt(np.sqrt(np.average(around**2, weights=area)) / 3.0)
    assert unrolled(torus(40, waves=0.0)).stretch == pytest.approx(least, abs=0.02)


def test_borders_that_touch_in_a_vertex_are_taken_apart():
    scan = sheet(10)
    middle = 10 * 10 + 5
    around = np.flatnonzero((scan.face_vertices == middle).any(axis=1))
    shared = [len(np.intersect1d(*scan.face_vertices[[around[0], other]])) for other in around]
    opposite = scan.part(np.setdiff1d(np.arange(scan.n_faces), [around[0], around[shared.index(1)]]))
    found = sheet_scans(opposite)[0]
    assert len(found.origins) == opposite.n_vertices + 1
    assert np.bincount(found.origins).max() == 2
    # both triangles together are one hole around the vertex, and it is laid over
    assert len(found.holes) == 1 and len(boundary_loops(found.mesh.face_vertices)) == 1


@pytest.mark.parametrize(
    "scan, words",
    [
        (ball(200, 1), "closed as a sphere"),
        (double_torus(), "2 handles"),
        (
            TriangleMesh(
                np.concatenate([sheet(5).vertices, sheet(5).vertices + 9.0]),
                np.concatenate([sheet(5).face_vertices, sheet(5).face_vertices + 50]),
            ),
            "2 parts",
        ),
    ],
    ids=["sphere", "two handles", "two parts"],
)
def test_other_scans_are_refused_with_what_to_do(scan, words):
    with pytest.raises(NoSurface, match=words) as problem:
        sheet_scans(scan)
    assert "loop" in str(problem.value) or "alone" in str(problem.value)

import numpy as np
import pytest
from exact_shapes import area, edges_of, is_valid, shapes_in
from numpy.testing import assert_allclose
from OCP.BRep import BRep_Tool
from OCP.TopoDS import TopoDS

from brep_export.curves import curve_from_kernel
from brep_export.faces import straight_pcurve, trimmed_face
from brep_export.surfaces import kernel_surface
from recon.geometry.bspline import BSplineCurve, BSplineSurface
from recon.geometry.trimmed import TrimLoop, TrimmedSurface
from recon.numerics.bspline_basis import uniform_knots
from recon.tolerance import Tolerance

FLAT = BSplineSurface(
    1, 1, [0, 0, 1, 1], [0, 0, 1, 1], np.array([[[0, 0, 0], [0, 8, 0]], [[8, 0, 0], [8, 8, 0]]], dtype=float)
)
CIRCLE = np.array([[1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1], [1, -1], [1, 0]], dtype=float)


def circle(radius, clockwise=False):
    points = 0.5 + radius * (CIRCLE[::-1] if clockwise else CIRCLE)
    knots = np.array([0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 4], dtype=float)
    return BSplineCurve(2, knots, points, np.array([1, 0.5**0.5] * 4 + [1]))


def polygon(*points):
    around = np.array([*points, points[0]], dtype=float)
    return BSplineCurve(1, np.concatenate([[0], np.arange(len(around)), [len(around) - 1]]), around)


def wavy(radius, waves=7):
    """Closed cubic pcurve through a wavy circle."""
    n = 60
    turn = np.linspace(0, 2 * np.pi, n)
    ring = (radius + 0.03 * np.sin(waves * turn))[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1) + 0.5
    ring[-1] = ring[0]
    return BSplineCurve(3, uniform_knots(n, 3), ring)


def bumpy(seed=0, n=20):
    x, y = np.meshgrid(np.linspace(0, 8, n), np.linspace(0, 8, n), indexing="ij")
    height = np.random.default_rng(seed).uniform(-0.3, 0.3, x.shape)
    return BSplineSurface(3, 3, uniform_knots(n, 3), uniform_knots(n, 3), np.stack([x, y, height], axis=-1))


def test_a_disk_with_a_round_hole_has_the_area_of_a_ring():
    face = trimmed_face(TrimmedSurface(FLAT, (TrimLoop((circle(0.4),)), TrimLoop((circle(0.2, True),)))), Tolerance())
    assert is_valid(face)
    assert len(shapes_in(face, "WIRE")) == 2
    assert_allclose(area(face), np.pi * 64 * (0.4**2 - 0.2**2), rtol=1e-6)


def test_a_pcurve_with_corners_makes_an_edge_for_each_side():
    loop = TrimLoop((polygon((0.1, 0.1), (0.9, 0.1), (0.5, 0.8)),))
    face = trimmed_face(TrimmedSurface(bumpy(), (loop,)), Tolerance())
    assert is_valid(face)
    assert len(edges_of(face)) == 3 and len(shapes_in(face, "VERTEX")) == 3


@pytest.mark.parametrize("fit", [1e-5, 1e-3, 0.05])
def test_edges_stay_within_fit_and_their_tolerance_covers_what_they_miss(fit):
    trimmed = TrimmedSurface(bumpy(), (TrimLoop((wavy(0.35),)), TrimLoop((circle(0.1, True),))))
    face = TopoDS.Face_s(trimmed_face(trimmed, Tolerance(fit=fit)))
    assert is_valid(face)
    pcurves = [c for loop in trimmed.loops for c in loop.pcurves]
    for edge in edges_of(face):
        domain = BRep_Tool.Range_s(edge)
        at = np.linspace(*domain, 3001)
        pcurve = curve_from_kernel(BRep_Tool.CurveOnSurface_s(edge, face, *domain))
        in_space = curve_from_kernel(BRep_Tool.Curve_s(edge, *domain)).point(at)
        gap = np.linalg.norm(in_space - trimmed.surface.point(pcurve.point(at)), axis=1).max()
        assert gap <= BRep_Tool.Tolerance_s(edge) <= fit
        assert any(np.abs(pcurve.point(at[:1]) - c.point(at[:1])).max() < 1e-12 for c in pcurves)


def test_the_face_looks_where_the_surface_normal_points():
    face = trimmed_face(TrimmedSurface(FLAT, (TrimLoop((circle(0.4),)),)), Tolerance())
    from cadquery import Shape

    assert_allclose(Shape.cast(face).normalAt().toTuple(), (0, 0, 1), atol=1e-12)


@pytest.mark.parametrize(("start", "end"), [((0, 0.5), (1, 0.5)), ((1, 0.5), (0, 0.5)), ((0.2, 0), (0.2, 5))])
def test_a_straight_pcurve_runs_evenly_over_its_range(start, end):
    domain = (2.0, 3.0)
    pcurve = straight_pcurve(np.array(start, dtype=float), np.array(end, dtype=float), domain)
    for share in (0.0, 0.25, 1.0):
        got = pcurve.Value(2.0 + share).Coord()
        assert_allclose(got, np.array(start) + share * (np.array(end) - np.array(start)), atol=1e-14)


def test_the_kernel_surface_under_the_face_is_the_one_given():
    face = trimmed_face(TrimmedSurface(bumpy(), (TrimLoop((wavy(0.3),)),)), Tolerance())
    kernel = kernel_surface(bumpy())
    under = BRep_Tool.Surface_s(TopoDS.Face_s(face))
    assert under.Value(0.3, 0.7).Coord() == kernel.Value(0.3, 0.7).Coord()

"""One spline face as a shell: cut by loops, or around a seam with holes in it."""

import numpy as np
import pytest
from sheets import pierced, sheet

from brep_export.check import ShapeKind, check
from brep_export.measures import measure
from brep_export.sheets import pierced_shell, trimmed_shell
from brep_export.shells import network_shell
from brep_export.solids import network_solid
from recon.geometric_fit.spline_fit import fit_sheet
from recon.geometric_fit.trimming import trimmed_sheet
from recon.geometry.bspline import BSplineCurve, BSplineSurface
from recon.geometry.patches import connect
from recon.geometry.trimmed import TrimLoop, TrimmedSurface
from recon.numerics.bspline_basis import clamped_knots, greville
from recon.tolerance import Tolerance

TOLERANCE = Tolerance(merge=1e-7, fit=1e-4, angle=1e-3)
BREAKS = np.linspace(0.0, 1.0, 41)
KNOTS = clamped_knots(BREAKS, 3)


def interpolating(points_at):
    """A bicubic through a function of (u, v) at the abscissae."""
    from scipy.interpolate import make_interp_spline

    at = np.clip(greville(KNOTS, 3), 0.0, 1.0)
    u, v = np.meshgrid(at, at, indexing="ij")
    points = np.stack(points_at(u, v), axis=-1)
    net = make_interp_spline(at, points, k=3, t=KNOTS).c
    net = make_interp_spline(at, net.transpose(1, 0, 2), k=3, t=KNOTS).c.transpose(1, 0, 2)
    return BSplineSurface(3, 3, KNOTS, KNOTS, net)


def tube():
    def at(u, v):
        return np.cos(2 * np.pi * u), np.sin(2 * np.pi * u), 3.0 * v

    return interpolating(at)


def torus():
    def at(u, v):
        out = 3.0 + np.cos(2 * np.pi * v)
        return out * np.cos(2 * np.pi * u), out * np.sin(2 * np.pi * u), np.sin(2 * np.pi * v)

    return interpolating(at)


def ring(middle, radius, *, clockwise):
    """A closed cubic about a circle in the plane of the parameters."""
    a = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False) * (-1.0 if clockwise else 1.0)
    from recon.geometric_fit.spline_space import SplineSpace

    control = np.asarray(middle) + radius * np.stack([np.cos(a), np.sin(a)], axis=1)
    curve: BSplineCurve = SplineSpace(3, np.arange(25.0), periodic=True).curve(control)
    return TrimLoop((curve,))


def test_a_plane_cut_by_two_circles_has_the_area_between_them():
    knots = np.array([0.0, 0.0, 1.0, 1.0])
    plane = BSplineSurface(1, 1, knots, knots, [[[0, 0, 0], [0, 8, 0]], [[8, 0, 0], [8, 8, 0]]])
    loops = ring([0.5, 0.5], 0.4, clockwise=False), ring([0.5, 0.5], 0.1, clockwise=True)
    report = check(trimmed_shell(TrimmedSurface(plane, loops), TOLERANCE), TOLERANCE, expect=ShapeKind.SHELL)
    report.require()
    figures = report.as_json()
    outer, inner = (64.0 * abs(loop.signed_area()) for loop in loops)
    # the kernel's rule along the loops is not nearer than this
    assert figures["area"] == pytest.approx(outer - inner, rel=3e-3)
    assert figures["free_edges"] == 2 and not figures["closed"]


def test_the_face_of_a_scan_with_a_hole_has_the_area_of_the_scan():
    scan = pierced(sheet(40), (np.array([2.0, 1.0, 0.183]), 0.3))
    cut = trimmed_sheet(fit_sheet(scan))
    shape = trimmed_shell(TrimmedSurface(cut.surface, cut.loops), Tolerance(merge=1e-6, fit=1e-3))
    area = float(np.linalg.norm(scan.area_vectors(), axis=1).sum())
    assert measure(shape).area == pytest.approx(area, rel=5e-3)


def test_a_tube_has_one_face_a_seam_and_two_free_edges():
    report = check(network_shell(connect([tube()], 1e-6), TOLERANCE), TOLERANCE, expect=ShapeKind.SHELL)
    report.require()
    figures = report.as_json()
    assert (figures["faces"], figures["edges"], figures["free_edges"]) == (1, 3, 2)
    assert figures["area"] == pytest.approx(6.0 * np.pi, rel=1e-4)


def test_a_hole_in_a_torus_opens_it():
    closed = check(network_solid(connect([torus()], 1e-6), TOLERANCE), TOLERANCE)
    closed.require()
    assert closed.as_json()["volume"] == pytest.approx(6.0 * np.pi**2, rel=1e-4)
    hole = ring([0.5, 0.5], 0.1, clockwise=True)
    report = check(pierced_shell(connect([torus()], 1e-6), [hole], TOLERANCE), TOLERANCE, expect=ShapeKind.SHELL)
    report.require()
    figures = report.as_json()
    assert figures["free_edges"] == 1 and not figures["closed"]
    # around v = 1/2, the inside of the torus, a step in u is 2 and in v 1 times 2 pi long
    lost = 2.0 * (2.0 * np.pi) ** 2 * abs(hole.signed_area())
    assert figures["area"] == pytest.approx(12.0 * np.pi**2 - lost, rel=5e-3)

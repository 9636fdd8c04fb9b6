"""Trim loops are closed, outer ones counter-clockwise, and a thick piece has a wall surface for every curve."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from recon.errors import BadGeometry
from recon.geometry.bspline import BSplineCurve, BSplineSurface
from recon.geometry.trimmed import LipPiece, ThickPiece, TrimLoop, TrimmedSurface

PLANE = BSplineSurface(1, 1, [0, 0, 1, 1], [0, 0, 1, 1], [[[0, 0, 0], [0, 1, 0]], [[1, 0, 0], [1, 1, 0]]])


def polygon(*corners):
    pairs = zip(corners, (*corners[1:], corners[0]))
    return TrimLoop(tuple(BSplineCurve(1, [0, 0, 1, 1], [a, b]) for a, b in pairs))


SQUARE = polygon((0.1, 0.1), (0.9, 0.1), (0.9, 0.9), (0.1, 0.9))
TURNED = polygon((0.4, 0.4), (0.4, 0.6), (0.6, 0.6), (0.6, 0.4))


def test_signed_area_tells_the_direction():
    assert_allclose(SQUARE.signed_area(), 0.64)
    assert_allclose(TURNED.signed_area(), -0.04)


def test_a_hole_runs_clockwise():
    assert len(TrimmedSurface(PLANE, (SQUARE, TURNED)).loops) == 2
    with pytest.raises(BadGeometry, match="loop 1 runs counter-clockwise"):
        TrimmedSurface(PLANE, (SQUARE, SQUARE))
    with pytest.raises(BadGeometry, match="loop 0 runs clockwise"):
        TrimmedSurface(PLANE, (TURNED,))


def test_a_loop_with_a_gap_is_refused_with_the_curve_and_the_gap():
    open_row = SQUARE.pcurves[:3]
    with pytest.raises(BadGeometry, match=r"curve 2 ends 0\.8 away"):
        TrimLoop(open_row)


def test_a_thick_piece_needs_a_wall_for_every_curve():
    sheet = TrimmedSurface(PLANE, (SQUARE,))
    with pytest.raises(BadGeometry, match="one loop of 1 curves"):
        ThickPiece(sheet, sheet, (PLANE,))


def test_a_space_curve_is_no_pcurve():
    with pytest.raises(BadGeometry, match=r"\(u, v\)"):
        TrimLoop((BSplineCurve(1, [0, 0, 1, 1], np.zeros((2, 3))),))


def test_a_piece_of_a_rim_needs_two_curves_a_wall_and_a_fracture_that_ends_in_points():
    face = TrimmedSurface(PLANE, (SQUARE,))
    with pytest.raises(BadGeometry, match="one loop of 2 curves"):
        LipPiece(face, (PLANE,))
    with pytest.raises(BadGeometry, match="first wall does not end in a point"):
        LipPiece(face, (PLANE, PLANE))


def test_places_on_a_loop_run_from_curve_to_curve_and_round():
    assert_allclose(SQUARE.at(np.array([0.0, 1.0, 4.0])), [(0.1, 0.1), (0.9, 0.1), (0.1, 0.1)])
    assert_allclose(SQUARE.at(np.array([2.5, -1.5, 6.5])), [(0.5, 0.9)] * 3)

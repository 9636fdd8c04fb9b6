"""Blocks: a patch network closed by walls and a base."""

import numpy as np
import pytest

from brep_export.blocks import block_solid
from brep_export.check import ShapeKind, check
from recon.errors import NotManifold
from recon.geometry.bspline import BSplineSurface
from recon.geometry.patches import connect
from recon.tolerance import Tolerance

TOLERANCE = Tolerance(merge=1e-6, fit=1e-3)
KNOTS = np.repeat([0.0, 1.0], 2)


def saddle(x: float, y: float) -> BSplineSurface:
    """z = x y over the unit square at (x, y): bilinear."""
    corners = [[[x + i, y + j, (x + i) * (y + j)] for j in (0, 1)] for i in (0, 1)]
    return BSplineSurface(1, 1, KNOTS, KNOTS, np.array(corners))


def test_the_volume_is_that_under_the_network():
    network = connect([saddle(i, j) for i in range(3) for j in range(2)], 1e-9)
    report = check(block_solid(network, -1.0, TOLERANCE), TOLERANCE, expect=ShapeKind.SOLID)
    assert report.defects == ()
    assert report.measures is not None
    assert report.measures.faces == 6 + 4 + 1
    assert report.measures.volume == pytest.approx(9 / 2 * 4 / 2 + 6, rel=1e-9)  # integral of x y, and one below zero


def test_a_hole_in_the_network_goes_through_the_block():
    cells = [(i, j) for i in range(3) for j in range(3) if (i, j) != (1, 1)]
    network = connect([saddle(i, j) for i, j in cells], 1e-9)
    report = check(block_solid(network, -1.0, TOLERANCE), TOLERANCE, expect=ShapeKind.SOLID)
    assert report.defects == ()
    assert report.measures is not None
    assert report.measures.faces == 8 + 8 + 1
    assert report.measures.volume == pytest.approx(81 / 4 - 9 / 4 + 8, rel=1e-9)


def test_a_base_that_reaches_the_network_is_refused():
    network = connect([saddle(1, 1)], 1e-9)
    with pytest.raises(NotManifold, match="does not lie below"):
        block_solid(network, 1.5, TOLERANCE)

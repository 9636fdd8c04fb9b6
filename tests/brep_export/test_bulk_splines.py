"""Splines in the kernel's binary form: the numbers are those that it gives one by one."""

import numpy as np
import pytest
from OCP.Geom import Geom_BSplineCurve, Geom_BSplineSurface
from OCP.TColStd import TColStd_Array1OfReal, TColStd_Array2OfReal

from brep_export.bulk_splines import curve_records, surface_records
from brep_export.curves import full_knots, kernel_curve
from brep_export.occ_arrays import integers_to_kernel, point_grid_to_kernel, points_to_kernel, reals_to_kernel
from brep_export.surfaces import kernel_surface
from recon.geometry.bspline import BSplineCurve, BSplineSurface

RANDOM = np.random.default_rng(3)


def knots(degree, *inner):
    return np.r_[np.zeros(degree + 1), inner, np.ones(degree + 1)]


def surface(p, q, u, v):
    net = RANDOM.normal(size=(len(u) - p - 1, len(v) - q - 1, 3))
    return BSplineSurface(p, q, u, v, net)


SURFACES = [
    surface(1, 1, knots(1), knots(1)),
    surface(8, 5, knots(8), knots(5)),
    surface(3, 2, knots(3, 0.25, 0.5, 0.5), knots(2, 0.75)),
]


def test_surfaces_keep_their_numbers_and_their_order():
    made = [kernel_surface(SURFACES[k]) for k in (2, 0, 1, 0)]
    made.append(made[1])  # the same surface of the kernel twice
    for record, k in zip(surface_records(made), (2, 0, 1, 0, 0), strict=True):
        one = SURFACES[k]
        assert record.degrees == (one.degree_u, one.degree_v) and record.counts == one.control_net.shape[:2]
        assert (record.poles == one.control_net.reshape(-1, 3)).all()
        (u, repeat_u), (v, repeat_v) = record.knots()
        assert (full_knots(u, repeat_u) == one.knots_u).all() and (full_knots(v, repeat_v) == one.knots_v).all()


@pytest.mark.parametrize("inner", [(), (0.5,), (0.2, 0.2, 0.9)])
def test_curves_keep_their_numbers(inner):
    row = knots(3, *inner)
    one = BSplineCurve(3, row, RANDOM.normal(size=(len(row) - 4, 3)))
    (record,) = curve_records([kernel_curve(one)])
    assert record.degrees == (3,) and (record.poles == one.control_points).all()
    assert (full_knots(*record.knots()[0]) == row).all()


def test_rational_ones_are_left_out_and_those_after_them_are_not():
    poles, ends = (
        RANDOM.normal(size=(3, 3)),
        (reals_to_kernel(np.array([0.0, 1.0])), integers_to_kernel(np.array([3, 3]))),
    )
    weights = TColStd_Array1OfReal(1, 3)
    for i, w in enumerate((1.0, 0.5, 1.0), 1):
        weights.SetValue(i, w)
    rational = Geom_BSplineCurve(points_to_kernel(poles), weights, *ends, 2)
    plain = Geom_BSplineCurve(points_to_kernel(poles), *ends, 2)
    first, second = curve_records([rational, plain])
    assert first is None and (second.poles == poles).all()
    net, grid = RANDOM.normal(size=(3, 3, 3)), TColStd_Array2OfReal(1, 3, 1, 3)
    for i in range(1, 4):
        for j in range(1, 4):
            grid.SetValue(i, j, 1.0 + (i == 2))
    curved = Geom_BSplineSurface(point_grid_to_kernel(net), grid, ends[0], ends[0], ends[1], ends[1], 2, 2)
    first, second = surface_records([curved, kernel_surface(SURFACES[1])])
    assert first is None and (second.poles == SURFACES[1].control_net.reshape(-1, 3)).all()


def test_none_at_all():
    assert surface_records([]) == [] and curve_records([]) == []

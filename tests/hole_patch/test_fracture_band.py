"""Rungs between two sheets: they stay between them, whatever relief says and however the sheets bend."""

from collections.abc import Callable

import numpy as np
from scipy.interpolate import make_interp_spline

from recon.geometry.bspline import BSplineSurface
from recon.hole_patch.fracture_band import HEIGHTS, FractureBand

ANGLE = np.linspace(0.0, 2.0 * np.pi, 121)
THICK = 3.0


def graph(height: Callable[[np.ndarray], np.ndarray]) -> BSplineSurface:
    """z as a function of the distance from the origin, over a square of 28 mm; u and v are x and y."""
    at = np.linspace(-14.0, 14.0, 57)
    x, y = np.meshgrid(at, at, indexing="ij")
    points = np.stack([x, y, height(np.hypot(x, y))], axis=-1)
    rows = make_interp_spline(at, points, k=3)
    net = make_interp_spline(at, rows.c.transpose(1, 0, 2), k=3)
    return BSplineSurface(3, 3, rows.t, net.t, net.c.transpose(1, 0, 2))


def flat(level: float) -> BSplineSurface:
    return graph(lambda r: np.full_like(r, level))


def circle(radius: float) -> np.ndarray:
    uv = radius * np.column_stack([np.cos(ANGLE), np.sin(ANGLE)])
    uv[-1] = uv[0]
    return uv


def between(outer: BSplineSurface, inner: BSplineSurface, radii: tuple[float, float]) -> FractureBand:
    return FractureBand.along((outer, inner), (circle(radii[0]), circle(radii[1])))


def tooth(height: float) -> np.ndarray:
    """Relief that leads the upper part of a few rungs inwards and up by a height."""
    relief = np.zeros((len(ANGLE), len(HEIGHTS), 3))
    near = np.exp(-(((ANGLE - 2.0) / 0.25) ** 2))
    inwards = -np.column_stack([np.cos(ANGLE), np.sin(ANGLE), np.zeros_like(ANGLE)])
    relief[:, 0] = near[:, None] * (1.0 * inwards + [0.0, 0.0, height])
    relief[-1] = relief[0]
    return relief


def test_relief_that_leads_through_a_sheet_is_taken_back() -> None:
    band = between(flat(0.0), flat(-THICK), (10.0, 10.0)).following(relief=tooth(1.5))
    assert band.enters().any()
    kept = band.unfolded()
    assert not kept.enters().any()
    assert not kept.folds().any()


def test_relief_between_the_sheets_is_kept_as_it_is() -> None:
    band = between(flat(0.0), flat(-THICK), (10.0, 10.0)).following(relief=0.3 * tooth(0.0))
    np.testing.assert_array_equal(band.unfolded().rows, band.rows)


def test_straight_rungs_over_a_hollow_of_the_sheet_are_pushed_below_it() -> None:
    hollow = graph(lambda r: -0.6 * np.exp(-(((r - 7.0) / 2.0) ** 2)))
    band = between(hollow, flat(-0.9), (10.0, 4.0))
    assert band.enters().all()
    kept = band.unfolded()
    assert not kept.enters().any()
    np.testing.assert_array_equal(kept.ends(), band.ends())
    for moved, plain in zip(kept.rows[:, 10:], band.rows[:, 10:]):
        assert np.linalg.norm(moved - plain) < 3.0 * 0.6

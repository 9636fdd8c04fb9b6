"""Contours to splines: what is asked of them beside a border."""

import numpy as np
import pytest

from recon.geometry.contour_map import ContourMap
from recon.terrain.resampling import ContourFits, contour_samples

SPACING, TOLERANCE = 10.0, 2.6
SLANT = np.radians(8.0)  # between the contour and the border on which it ends


def slanting_contour() -> ContourMap:
    """One that comes down to the western border at a small angle, wavering by a metre as those of grids do."""
    along = SPACING * np.arange(1.0, 40.0)
    waver = 1.2 * np.sin(2.1 * along / SPACING) * np.minimum(along / 20.0, 1.0)
    x, y = np.sin(SLANT) * along + waver * np.cos(SLANT), np.cos(SLANT) * along - waver * np.sin(SLANT)
    line = np.vstack([np.column_stack([x, y])[::-1], [[0.0, 0.0]]])
    extent = np.array([[0.0, -200.0], [300.0, 600.0]])
    return ContourMap((line,), np.array([10.0]), extent)


def end_told(contours: ContourMap):
    ends = np.full((1, 2, 2, 2), np.nan)
    ends[0, 1] = [-np.sin(SLANT), -np.cos(SLANT)], [0.0, 0.0]
    return contour_samples(contours, SPACING, ends)


def test_a_contour_that_is_told_how_to_end_does_not_follow_every_waver_beside_the_border():
    curves = ContourFits(end_told(slanting_contour())).curves(TOLERANCE)
    assert curves.lengths().min() > 2 * SPACING
    assert (curves.bezier[:, :, 0].ravel()[:-1] > 0.0).all()  # and it stays on the map
    way = curves.bezier[-1, 3] - curves.bezier[-1, 2]
    assert way / np.linalg.norm(way) == pytest.approx([-np.sin(SLANT), -np.cos(SLANT)], abs=1e-9)


def test_one_that_is_not_told_keeps_within_its_room():
    """Free to turn, it might cross the border: there it follows its points closely."""
    samples = contour_samples(slanting_contour(), SPACING)
    near = samples.points[:, 1] < 30.0
    told = end_told(slanting_contour())
    assert np.isfinite(samples.room[near]).any() and not np.isfinite(told.room[near]).any()

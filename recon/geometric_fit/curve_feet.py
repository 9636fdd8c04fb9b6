"""Foot points of data points on a spline curve, by Newton's method along the curve.

        p          g(t) = (C(t) - p) . C'(t) = 0,     dt = -g / (C' . C' + (C - p) . C'')
        |
    ----+----> C   where the second term would turn the step around, at a centre of curvature, it is left out

Paper  [maekawa2009]: the foot points of a fit.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from recon.geometric_fit.spline_space import SplineSpace

__all__ = ["curve_lengths", "nearest_curve_feet", "walk_curve_feet"]

Floats = NDArray[np.float64]

ROUNDS = 12
SAMPLES = 8  # a span, where the nearest of them is the start of Newton's method
HALVINGS = 4


def walk_curve_feet(space: SplineSpace, control: Floats, points: Floats, t: Floats, *, rounds: int = ROUNDS) -> Floats:
    """(n,) parameters of the feet of points (n, d), from parameters nearby; no step leads away from its point."""
    t = space.within(t)
    longest = float(np.diff(space.breaks).max())
    away = _squares(space.rows(t) @ control - points)
    moving = np.arange(len(t))
    for _ in range(rounds):
        at, p = t[moving], points[moving]
        off = space.rows(at) @ control - p
        first, second = space.rows(at, 1) @ control, space.rows(at, 2) @ control
        slope = np.einsum("ij,ij->i", off, first)
        speed = np.einsum("ij,ij->i", first, first)
        bend = np.maximum(speed + np.einsum("ij,ij->i", off, second), 0.1 * speed)
        step = np.clip(-slope / np.maximum(bend, 1e-300), -longest, longest)
        for _ in range(HALVINGS):
            tried = space.within(at + step)
            distance = _squares(space.rows(tried) @ control - p)
            worse = distance > away[moving]
            if not worse.any():
                break
            step = np.where(worse, 0.5 * step, step)
        better = ~worse
        t[moving[better]], away[moving[better]] = tried[better], distance[better]
        moving = moving[better & (np.abs(step) > 1e-12 * (space.breaks[-1] - space.breaks[0]))]
        if not len(moving):
            break
    return t


def nearest_curve_feet(space: SplineSpace, control: Floats, points: Floats) -> Floats:
    """(n,) parameters of the nearest points of the whole curve, found from samples of all of it."""
    samples = _samples(space)
    nearest = cKDTree(space.rows(samples) @ control).query(points)[1]
    return walk_curve_feet(space, control, points, samples[nearest])


def curve_lengths(space: SplineSpace, control: Floats) -> tuple[Floats, Floats]:
    """Parameters (k,) all along the curve, and the length of the curve up to each."""
    samples = _samples(space)
    points = space.rows(samples) @ control
    return samples, np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])


def _samples(space: SplineSpace) -> Floats:
    share = np.arange(SAMPLES) / SAMPLES
    return np.append((space.breaks[:-1, None] + share * np.diff(space.breaks)[:, None]).ravel(), space.breaks[-1])


def _squares(vectors: Floats) -> Floats:
    return np.asarray(np.einsum("ij,ij->i", vectors, vectors))

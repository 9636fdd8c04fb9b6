"""The record of a fit: one row a round, and why it ended."""

from enum import StrEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Norms", "Round", "StoppedBy", "norms"]

Floats = NDArray[np.float64]


class StoppedBy(StrEnum):
    """What ended a fit."""

    TOLERANCE = "tolerance"
    CONTROL_POINTS = "control points"
    ROUNDS = "rounds"
    STAGNATION = "stagnation"


class Norms(NamedTuple):
    """Distances of data points from the surface in per cent of the diagonal: mean, root mean square, largest."""

    mean: float
    rms: float
    maximum: float


class Round(NamedTuple):
    """One round: its number, the control points, the errors after it, and the seconds since the fit began."""

    number: int
    control_points: int
    errors: Norms
    seconds: float


def norms(distances: Floats, diagonal: float, counts: Floats | None = None) -> Norms:
    """Errors of distances (N,) as shares of the diagonal, in per cent.

    counts  (N,) for how many points each distance stands, if not for one
    """
    share = 100.0 / diagonal
    if counts is not None:
        distances, counts = distances[counts > 0], counts[counts > 0]
    mean = float(np.average(distances, weights=counts))
    rms = float(np.sqrt(np.average(distances * distances, weights=counts)))
    return Norms(share * mean, share * rms, share * float(distances.max()))

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


def norms(distances: Floats, diagonal: float) -> Norms:
    """Errors of distances (N,) as shares of the diagonal, in per cent."""
    share = 100.0 / diagonal
    rms = float(np.sqrt(np.mean(distances * distances)))
    return Norms(share * float(distances.mean()), share * rms, share * float(distances.max()))

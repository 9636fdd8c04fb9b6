"""Lengths that a user gives as they are, or as shares of the size of what is fitted."""

import numpy as np
from numpy.typing import NDArray

from recon.errors import BadOption

__all__ = ["tolerance_length"]


def tolerance_length(text: str | None, points: NDArray[np.float64]) -> float | None:
    """A tolerance as a length: a number is one already, a percentage is a share of the diagonal of the points' box.

    Raises  BadOption.
    """
    if text is None:
        return None
    try:
        if text.strip().endswith("%"):
            return float(text.strip()[:-1]) / 100.0 * float(np.linalg.norm(np.ptp(points, axis=0)))
        return float(text)
    except ValueError as problem:
        raise BadOption("--tolerance", f"must be a length, or a share of the diagonal as 0.1%, not {text}") from problem

"""How much each point counts in the next round: those far off more, or, among outliers, less."""

import numpy as np
from numpy.typing import NDArray

__all__ = ["GENTLE", "STEEP", "reweighed"]

Floats = NDArray[np.float64]

# root mean squares from where on a point counts more, and how many times as far it is at most
# gentle where there are borders, as a ragged one is never met, and edges put back, which points near them cut off
GENTLE = (3.0, 6.0)
STEEP = (1.5, 12.0)
OUTLYING = 2.5  # standard deviations from where on a point counts little, where outliers are expected


def reweighed(
    weights: Floats,
    given: Floats,
    distance: Floats,
    counts: Floats,
    *,
    growth: tuple[float, float] = GENTLE,
    robust: bool,
) -> Floats:
    """(n,) the weights after a round that left points (n,) so far off: up to 37 or 145 times those `given`, as the
    largest error is to fall; robust: small ones for outliers.

    counts  (n,) for how many measured points each stands, which say what is usual
    """
    if robust:
        usual = 1.4826 * float(np.median(distance[counts > 0]))
        return np.asarray(given / (1.0 + (distance / max(OUTLYING * usual, 1e-300)) ** 2) ** 2)
    spread = float(np.sqrt(np.average(distance**2, weights=counts)))
    far = np.minimum(distance / max(growth[0] * spread, 1e-300), growth[1]) ** 2
    return np.asarray(0.5 * weights + 0.5 * given * (1.0 + far))

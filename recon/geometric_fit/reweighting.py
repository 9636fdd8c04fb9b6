"""How much each point counts in the next round: those far off more, or, among outliers, less."""

import numpy as np
from numpy.typing import NDArray

from recon.geometric_fit.scan_data import ScanData

__all__ = ["GENTLE", "STEEP", "reweighed"]

Floats = NDArray[np.float64]

# root mean squares from where on a point counts more, and how many times as far it is at most
# gentle where there are borders, as a ragged one is never met, and edges put back, which points near them cut off
GENTLE = (3.0, 6.0)
STEEP = (1.5, 12.0)
OUTLYING = 2.5  # standard deviations from where on a point counts little, where outliers are expected


def reweighed(
    weights: Floats, scan: ScanData, distance: Floats, growth: tuple[float, float] = GENTLE, *, robust: bool
) -> Floats:
    """(N,) the weights after a round that left points (N,) so far off: up to 37 or 145 times as large, as the largest
    error is to fall; robust: small ones for outliers."""
    measured = distance[: scan.n_measured]
    if robust:
        usual = 1.4826 * float(np.median(measured))
        return np.asarray(scan.weights / (1.0 + (distance / max(OUTLYING * usual, 1e-300)) ** 2) ** 2)
    spread = float(np.sqrt(np.mean(measured**2)))
    far = np.minimum(distance / max(growth[0] * spread, 1e-300), growth[1]) ** 2
    return np.asarray(0.5 * weights + 0.5 * scan.weights * (1.0 + far))

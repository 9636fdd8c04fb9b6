"""Points at exactly the same place, found by what their coordinates are made of."""

import numpy as np
from numpy.typing import NDArray

__all__ = ["first_equal"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def first_equal(points: Floats) -> Ints:
    """(n,) for every point (n, 3) the lowest number of a point with exactly the same coordinates; 0 and -0 are one."""
    # Random projections of the bit patterns sort ten times faster than rows; a collision is seen, and sorted properly.
    bits = (points + 0.0).view(np.uint64)
    mixed = (bits ^ (bits >> np.uint64(29))) * np.array(
        [0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], dtype=np.uint64
    )
    keys = np.bitwise_xor.reduce(mixed ^ (mixed >> np.uint64(32)), axis=1)
    _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
    found = first[inverse]
    if (points[found] != points).any():
        _, first, inverse = np.unique(points + 0.0, axis=0, return_index=True, return_inverse=True)
        found = first[inverse.ravel()]
    return np.asarray(found)

"""The box of a map that `--clip` names."""

import numpy as np
from numpy.typing import NDArray

from recon.errors import BadOption

__all__ = ["clip_box"]


def clip_box(text: str) -> NDArray[np.float64]:
    """(2, 2) lower left and upper right corner from west,south,east,north; raises BadOption where it is none."""
    try:
        return np.array([float(word) for word in text.split(",")]).reshape(2, 2)
    except ValueError as problem:
        raise BadOption(
            "--clip", f"give four numbers, west,south,east,north, or a GeoJSON file of a polygon, not {text!r}"
        ) from problem

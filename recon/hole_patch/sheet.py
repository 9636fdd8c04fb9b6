"""A sheet: one wall of the missing piece as a trimmed surface, with figures that say how well it meets its neighbours.

Both ways to a sheet, the box of the pottery paper and the wheel, end in this type.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from recon.geometry.arrays import frozen_floats
from recon.geometry.bspline import BSplineSurface
from recon.geometry.trimmed import TrimmedSurface

__all__ = ["Sheet"]


@dataclass(frozen=True, eq=False)
class Sheet:
    """One wall of the missing piece.

    trimmed        the surface, its normal pointing away from the vessel's inside, bounded by the hole's edge
    edge_distance  (n,) distance of each measured point of the hole's edge from the surface, in millimetres
    rejected       share of the measured edge points that were taken for chips and left out of it
    samples        number of measured points the surface was fitted to
    sides          number of sides on which the wall surrounds the hole: 4, or 3 where it runs out into a rim
    box_angle_deg  angle by which the box was turned, or None where there was no box
    base           the patch before it was fitted, or None
    lip            v of the lip's tip where the sheet runs over it from the outer wall to the inner one, else None
    sound          (m,) which points of the hole's edge the face was drawn to, neither bridges nor chips; None where it
                   was not drawn to the edge
    notes          sentences for the report about anything that was done differently than asked
    """

    trimmed: TrimmedSurface
    edge_distance: NDArray[np.float64]
    samples: int
    sides: int
    box_angle_deg: float | None = None
    base: BSplineSurface | None = None
    rejected: float = 0.0
    lip: float | None = None
    sound: NDArray[np.bool_] | None = None
    notes: tuple[str, ...] = field(default=())

    def __post_init__(self) -> None:
        object.__setattr__(self, "edge_distance", frozen_floats(self.edge_distance, (None,), "sheet: edge_distance"))
        object.__setattr__(self, "notes", tuple(self.notes))

"""What a user may choose of a missing piece."""

from dataclasses import dataclass
from enum import Enum, StrEnum

import numpy as np
from numpy.typing import NDArray

from recon.errors import BadOption

__all__ = ["PatchMethod", "PatchOptions", "Relief", "WallThickness"]

Floats = NDArray[np.float64]


class PatchMethod(StrEnum):
    """How the surface over the hole is found."""

    WHEEL = "wheel"
    BOX = "box"


class WallThickness(Enum):
    """Where the thickness of a wall of which only the outer side was meant to be scanned comes from."""

    SHOWN = "auto"


class Relief(StrEnum):
    """What becomes of the pattern on the outer wall."""

    NONE = "none"
    CONTINUE = "continue"
    DRAW = "draw"


@dataclass(frozen=True, eq=False)
class PatchOptions:
    """What a user may choose.

    method      WHEEL or BOX
    thickness   of the wall in millimetres, where only the outer wall was scanned; SHOWN takes it from where the scans
                show both sides of the wall; None leaves the piece a face
    picks       (3, 3) points on the wall around the hole, for BOX; None lets the program find them
    pass_band   k_PB of the filter that removes the relief
    hole        number of the hole among `find_holes`, 0 the longest; None takes the longest that can be patched
    relief      CONTINUE reproduces the pattern of the rest of the vessel on the outer wall, for WHEEL; DRAW does so
                too, and where nothing on the vessel foretells the pattern draws one like it
    clearance   in millimetres, that the piece keeps from its neighbours: room for glue
    settle      whether the sherds are settled against each other first; the piece then fits them as settled
    Raises  BadOption.
    """

    method: PatchMethod = PatchMethod.WHEEL
    thickness: float | WallThickness | None = None
    picks: Floats | None = None
    pass_band: float = 0.01
    hole: int | None = None
    relief: Relief = Relief.NONE
    clearance: float = 0.0
    settle: bool = True

    def __post_init__(self) -> None:
        if isinstance(self.thickness, int | float) and not 0 < self.thickness < np.inf:
            raise BadOption("--thickness", f"must be a positive length in mm, not {self.thickness}")
        if not 0 <= self.clearance < np.inf:
            raise BadOption("--clearance", f"must be a length in mm, not {self.clearance}")
        if self.picks is not None and self.method is not PatchMethod.BOX:
            raise BadOption("--picks", "three points drive the box; give --method box with them")
        if self.relief is not Relief.NONE and self.method is PatchMethod.BOX:
            raise BadOption("--relief", "is continued around the wheel's axis; leave --method box away")
        if self.picks is not None and self.hole is not None:
            raise BadOption("--hole", "the picks already say which hole is meant")

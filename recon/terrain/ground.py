"""A ground as it comes out of the pipeline, and what a user may choose about it."""

from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from recon.errors import BadOption
from recon.terrain.merging import PatchLayout
from recon.terrain.patch_group import PatchGroup
from recon.terrain.second_derivatives import VertexJets
from recon.terrain.tiling import Tiling

__all__ = ["PatchKind", "Terrain", "TerrainOptions"]

Floats = NDArray[np.float64]


class PatchKind(StrEnum):
    """What lies within the curve mesh."""

    POLYNOMIAL = "polynomial"
    GREGORY = "gregory"


@dataclass(frozen=True)
class TerrainOptions:
    """What a user may choose.

    tolerance  metres that a contour's curve may stay from the points given; None: 0.28 of their spacing
    mend       leave out contours that repeat another
    patches    POLYNOMIAL, or the paper's GREGORY patches, which become B-splines
    angle      degrees between the tangent planes of neighbours that the B-splines of Gregory patches keep within
    Raises  BadOption.
    """

    tolerance: float | None = None
    mend: bool = False
    patches: PatchKind = PatchKind.POLYNOMIAL
    angle: float = 0.1

    def __post_init__(self) -> None:
        if self.tolerance is not None and not 0 < self.tolerance < np.inf:
            raise BadOption("--tolerance", f"must be a positive length in metres, not {self.tolerance}")
        if not 0 < self.angle <= 90:
            raise BadOption("--angle", f"must be an angle in degrees, up to 90, not {self.angle}")


@dataclass(frozen=True, eq=False)
class Terrain:
    """A smooth ground over a map rectangle.

    origin   (2,) place of the map at which the patches have their x = y = 0
    tiling, layout, jets   what the patches were made from, in local coordinates
    nets     the patches, in local coordinates: polynomial ones with a contour side and those without, or Gregory's
    extent   (2, 2) corners of the map, in local coordinates
    interval metres of height between neighbouring contours
    tolerance  metres, as used
    strip    (F,) strip of every triangle of the tiling: strips are parted by contours
    crs      name of the coordinate reference system, or an empty text
    notes    what a user should know about how it was made
    """

    origin: Floats
    tiling: Tiling
    layout: PatchLayout
    jets: VertexJets
    nets: tuple[PatchGroup, ...]
    extent: Floats
    interval: float
    tolerance: float
    strip: NDArray[np.int64]
    crs: str = ""
    notes: tuple[str, ...] = field(default=())

    @property
    def n_patches(self) -> int:
        return len(self.layout.corners)

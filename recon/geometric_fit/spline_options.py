"""What a user may choose of a spline fit, and what comes out of it."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from recon.errors import BadOption
from recon.geometric_fit.convergence import Norms, Round, StoppedBy
from recon.geometric_fit.net_guards import drawn_net
from recon.geometric_fit.scan_kind import SheetScan
from recon.geometric_fit.tensor_space import MOST_DEGREE, TensorSpace
from recon.geometric_fit.updates import Update
from recon.geometry.bspline import BSplineSurface
from recon.geometry.mesh import TriangleMesh

__all__ = ["FittedSheet", "SplineKind", "SplineOptions"]

Floats = NDArray[np.float64]


class SplineKind(StrEnum):
    """What the surface is made of."""

    BSPLINE = "bspline"
    NURBS = "nurbs"


@dataclass(frozen=True)
class SplineOptions:
    """What a user may choose.

    kind            BSPLINE, or NURBS: weights are found as well
    degree          in both directions
    control_points  at most so many; None: as many as the tolerance needs, or a twentieth of the points without one
    tolerance       length that no data point may be off by; None: no limit
    update          the rule by which control points move
    plain           all control points from the start, equal spans, no refinement and no reweighting
    rounds          on the last control net
    robust          points far off count less, not more: for scans with outliers
    Raises  BadOption.
    """

    kind: SplineKind = SplineKind.BSPLINE
    degree: int = 3
    control_points: int | None = None
    tolerance: float | None = None
    update: Update = Update.TANGENT
    plain: bool = False
    rounds: int = 6
    robust: bool = False

    def __post_init__(self) -> None:
        if not 1 <= self.degree <= MOST_DEGREE:
            raise BadOption("--degree", f"must be 1 to {MOST_DEGREE}, not {self.degree}")
        if self.control_points is not None and self.control_points < self.least:
            raise BadOption("--control-points", f"a net of degree {self.degree} needs {self.least}")
        if self.rounds < 1:
            raise BadOption("--rounds", f"must be at least 1, not {self.rounds}")
        if self.tolerance is not None and not 0 < self.tolerance < np.inf:
            raise BadOption("--tolerance", f"must be a positive length, not {self.tolerance}")

    @property
    def least_side(self) -> int:
        """Control points in one direction without which there is no net, periodic or not."""
        return self.degree + 2

    @property
    def least(self) -> int:
        return self.least_side**2


@dataclass(frozen=True, eq=False)
class FittedSheet:
    """What was found.

    space, net   of the surface: in a periodic direction nothing is repeated
    sheet        the scan as it was unrolled
    places       (n, 2) feet of the vertices of `sheet`
    distances    (N,) of the scan's points from the surface, foot points exact
    errors       their norms in per cent of the diagonal
    diagonal     of the box around the scan
    rounds       the record, one row a round
    stopped_by   what ended the fit
    stretch      of the scan when it was unrolled, root mean square; 1 where all lengths are kept
    folds        control points around which the surface still folds where the scan does not
    """

    space: TensorSpace
    net: Floats
    sheet: SheetScan
    places: Floats
    distances: Floats
    errors: Norms
    diagonal: float
    rounds: tuple[Round, ...]
    stopped_by: StoppedBy
    stretch: float
    folds: int

    @property
    def surface(self) -> BSplineSurface:
        """Clamped; where the scan runs around, it begins and ends at a seam, as smooth there as elsewhere."""
        return self.space.surface(self.net)

    def drawn(self, cells: int) -> TriangleMesh:
        """The surface in triangles, twice so many cells a span, without cells that lie beyond the scan."""
        return drawn_net(self.space, self.net, self.places, cells)

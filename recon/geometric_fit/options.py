"""What a user may choose of a fit, and what comes out of it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.errors import BadOption
from recon.geometric_fit.convergence import Norms, Round, StoppedBy
from recon.geometric_fit.updates import Update
from recon.geometry.control_mesh import ControlMesh
from recon.subdivision.limit_surface import Scheme

__all__ = ["FitOptions", "FittedSurface"]

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class FitOptions:
    """What a user may choose.

    scheme          whose surface is fitted
    control_points  at most so many; None: as many as the tolerance needs, or a twentieth of the points without one
    tolerance       length that no data point may be off by; None: no limit
    update          the rule by which control points move
    plain           all control points from the start, no refinement and no reweighting
    rounds          on the last control mesh; None: 6, or 12 of a refined one without sharp edges
    crease_angle    radians between two faces from which on an edge of the scan stays sharp, unless the fit is nearer
                    without any sharp edge; pi: nowhere
    close           fill the holes of the scan first
    start           control mesh to begin with, of the scheme's kind of faces; None: one is made
    robust          points far off count less, not more: for scans with outliers
    Raises  BadOption.
    """

    scheme: Scheme = Scheme.LOOP
    control_points: int | None = None
    tolerance: float | None = None
    update: Update = Update.TANGENT
    plain: bool = False
    rounds: int | None = None
    crease_angle: float = np.radians(40.0)
    close: bool = False
    robust: bool = False
    start: ControlMesh | None = None

    def __post_init__(self) -> None:
        if self.control_points is not None and self.control_points < 4:
            raise BadOption("--control-points", f"a closed surface needs 4, not {self.control_points}")
        if self.rounds is not None and self.rounds < 1:
            raise BadOption("--rounds", f"must be at least 1, not {self.rounds}")
        if self.tolerance is not None and not 0 < self.tolerance < np.inf:
            raise BadOption("--tolerance", f"must be a positive length, not {self.tolerance}")


@dataclass(frozen=True, eq=False)
class FittedSurface:
    """What was found.

    mesh        the control mesh of the surface
    scheme      how it is read
    distances   (N,) of the scan's vertices from the surface, foot points exact
    errors      their norms in per cent of the diagonal
    diagonal    of the box around the scan
    rounds      the record, one row a round
    stopped_by  what ended the fit
    folds       control points whose faces still fold where the scan does not
    n_closed    holes of the scan that were filled
    """

    mesh: ControlMesh
    scheme: Scheme
    distances: Floats
    errors: Norms
    diagonal: float
    rounds: tuple[Round, ...]
    stopped_by: StoppedBy
    folds: int
    n_closed: int

"""What a user may choose of a fit, and what comes out of it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.errors import BadOption
from recon.geometric_fit.convergence import Norms, Round, StoppedBy
from recon.geometric_fit.updates import Update
from recon.geometry.control_mesh import ControlMesh

__all__ = ["FitOptions", "FittedSurface"]

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class FitOptions:
    """What a user may choose.

    control_points  at most so many; None: as many as the tolerance needs, or a twentieth of the points without one
    tolerance       length that no data point may be off by; None: no limit
    update          the rule by which control points move
    plain           all control points from the start, six rounds, no refinement and no reweighting
    crease_angle    radians between two faces from which on an edge of the scan stays sharp; pi: nowhere
    close           fill the holes of the scan first
    robust          points far off count less, not more: for scans with outliers
    Raises  BadOption.
    """

    control_points: int | None = None
    tolerance: float | None = None
    update: Update = Update.TANGENT
    plain: bool = False
    crease_angle: float = np.radians(40.0)
    close: bool = False
    robust: bool = False

    def __post_init__(self) -> None:
        if self.control_points is not None and self.control_points < 4:
            raise BadOption("--control-points", f"a closed surface needs 4, not {self.control_points}")
        if self.tolerance is not None and not 0 < self.tolerance < np.inf:
            raise BadOption("--tolerance", f"must be a positive length, not {self.tolerance}")


@dataclass(frozen=True, eq=False)
class FittedSurface:
    """What was found.

    mesh        the control mesh of the Loop surface
    distances   (N,) of the scan's vertices from the surface, foot points exact
    errors      their norms in per cent of the diagonal
    diagonal    of the box around the scan
    rounds      the record, one row a round
    stopped_by  what ended the fit
    folds       control points whose faces still fold where the scan does not
    n_closed    holes of the scan that were filled
    """

    mesh: ControlMesh
    distances: Floats
    errors: Norms
    diagonal: float
    rounds: tuple[Round, ...]
    stopped_by: StoppedBy
    folds: int
    n_closed: int

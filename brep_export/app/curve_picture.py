"""The picture of a fitted curve: points, control polygon and curve, and the error along the row."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from brep_export.app.pictures import CLAY, MADE
from recon.geometric_fit.curve_fit import FittedCurve

__all__ = ["draw_curve"]

Floats = NDArray[np.float64]

SAMPLES = 16  # a control point


def draw_curve(path: Path, points: Floats, fitted: FittedCurve) -> None:
    """Draw into a PNG file; points (n, 2) or (n, 3)."""
    figure = Figure(figsize=(12, 6), layout="constrained")
    solid = points.shape[1] == 3
    shape: Any = figure.add_subplot(1, 2, 1, projection="3d") if solid else figure.add_subplot(1, 2, 1)
    t = np.linspace(*fitted.curve.domain, SAMPLES * len(fitted.polygon))
    shape.plot(*points.T, ".", color=CLAY[1], markersize=3, label="points")
    shape.plot(*fitted.polygon.T, "o--", color="#888888", markersize=3, linewidth=0.7, label="control polygon")
    shape.plot(*fitted.curve.point(t).T, color=MADE, label="curve")
    shape.set_aspect("equal")
    shape.legend(loc="best", fontsize=8)
    error = figure.add_subplot(1, 2, 2)
    error.plot(100.0 * fitted.distances / fitted.diagonal, color=MADE, linewidth=0.8)
    error.set_xlabel("point of the row")
    error.set_ylabel("distance, % of the diagonal")
    figure.savefig(path, dpi=110, format="png")

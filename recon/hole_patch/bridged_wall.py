"""An inner wall that no wheel tells: bridged from edge to edge of its hole.

Inside a vessel nobody smoothed the clay: lumps, spilt glaze and the roots of handles stand on the wall, and what a
scanner did not see it bridged. The outer wall is as the wheel left it all the same, and so is the piece's. The inner
one is carried from edge to edge, as far off as the edges are, and what lies between them is marked as invented.

      e ^  x- . _                         e   what the edge stands off from profile and plate
        |         ' - . _                 x   the edge as measured, at p_i
        |                 ' - . _ x       e(p) = w + Σ w_i |p - p_i|,  Σ w_i = 0
        +--------------------------->
              across the hole

Paper  [wahba1990], splines in several variables.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RBFInterpolator

from recon.errors import NoSurface
from recon.hole_patch.sheet import Sheet
from recon.hole_patch.surroundings import Axis, Wall
from recon.hole_patch.wheel_edge import ASTRAY, even_edge, loop_length, unchipped
from recon.hole_patch.wheel_sheet import WallFit, fit_any_wall, sheet_of_fit
from recon.numerics.foot_points import foot_points

__all__ = ["bridged_sheet"]

Floats = NDArray[np.float64]

EVERY = 4  # points of the even edge: shorter turns of it are what the face is drawn to afterwards
THIN = 0.75  # of the usual thickness: where an edge stands off and the wall is thinner, it ran down into the fracture
MOST_THIN = 0.02  # of the edge's points


def bridged_sheet(wall: Wall, axis: Axis, outer: Sheet, *, n_curves: int = 4) -> Sheet:
    """An inner wall of the missing piece that meets the edge of its hole wherever that stands.

    outer     the outer wall of the same piece
    n_curves  number of curves that the trim loop is cut into
    Raises    NoSurface when what stands off lies under the wall: that is fracture which was taken for wall; and where
              the wall gives no profile or no ring.
    """
    fit = fit_any_wall(wall, axis)
    _check_swollen(fit, outer)
    left, measured = fit.left(), fit.wall.edge.sherds >= 0
    sound = unchipped(left, loop_length(fit.wall.edge.points), measured, fit.unit)
    edge = even_edge(fit.edge, left, sound)[::EVERY]
    spread = RBFInterpolator(fit.chart.unfolded(edge[:, :2]), edge[:, 2], kernel="linear")
    carried = replace(fit, sound=sound, bridge=lambda uv: spread(fit.chart.unfolded(uv)))
    return sheet_of_fit(carried, n_curves=n_curves)


def _check_swollen(fit: WallFit, outer: Sheet) -> None:
    """Raises  NoSurface where much of the edge stands off and the wall is thinner there: it lies in the fracture."""
    measured, left = fit.wall.edge.sherds >= 0, fit.left()
    astray = np.abs(left - np.median(left[measured])) > ASTRAY
    points, surface = fit.wall.edge.points * fit.unit, outer.trimmed.surface
    thickness = np.linalg.norm(surface.point(foot_points(surface, points)) - points, axis=1)
    thin = measured & astray & (thickness < THIN * np.median(thickness[measured]))
    if thin.sum() > MOST_THIN * measured.sum():
        x, y, z = np.median(points[thin], axis=0)
        there, elsewhere = np.median(thickness[thin]), np.median(thickness[measured])
        raise NoSurface(
            f"The edge of the inner wall runs down into the fracture near ({x:.3g}, {y:.3g}, {z:.3g}): the wall seems"
            f" to be {there:.2g} mm thick there, and {elsewhere:.2g} mm elsewhere."
        )

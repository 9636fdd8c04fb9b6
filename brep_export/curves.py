"""B-spline curves to kernel curves and back.

Knots and multiplicities exist on the kernel's side only: `compressed_knots` and `full_knots` are the way over.

    knot_vector    0 0 0 0 1/2 1 1 1 1
    knots          0       1/2 1          multiplicities  4 1 4
"""

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from OCP.Geom import Geom_BSplineCurve
from OCP.Geom2d import Geom2d_BSplineCurve

from brep_export.occ_arrays import (
    integers_to_kernel,
    numbers_from_kernel,
    plane_points_to_kernel,
    points_from_kernel,
    points_to_kernel,
    reals_to_kernel,
)
from recon.errors import BadGeometry
from recon.geometry.bspline import BSplineCurve

__all__ = [
    "kernel_curve",
    "kernel_pcurve",
    "curve_from_kernel",
    "smooth_stretches",
    "compressed_knots",
    "full_knots",
    "kernel_knots",
]

Floats = NDArray[np.float64]
MAX_DEGREE = Geom_BSplineCurve.MaxDegree_s()


def kernel_curve(curve: BSplineCurve) -> Geom_BSplineCurve:
    """The curve in space as a kernel curve, over the same parameter range.

    Raises  BadGeometry when the kernel cannot hold it: degree above 25, an inner knot repeated more than degree times,
            or a curve in the plane.
    """
    if curve.control_points.shape[1] != 3:
        raise BadGeometry("curve", "lies in a plane where one in space is needed")
    rest = *kernel_knots(curve.knots, curve.degree), curve.degree
    poles = points_to_kernel(curve.control_points)
    if curve.weights is None:
        return Geom_BSplineCurve(poles, *rest)
    return Geom_BSplineCurve(poles, reals_to_kernel(curve.weights), *rest)


def kernel_pcurve(curve: BSplineCurve) -> Geom2d_BSplineCurve:
    """The curve in a parameter plane as a kernel curve, over the same parameter range; raises as `kernel_curve`."""
    if curve.control_points.shape[1] != 2:
        raise BadGeometry("pcurve", "lies in space where one in a parameter plane is needed")
    rest = *kernel_knots(curve.knots, curve.degree), curve.degree
    poles = plane_points_to_kernel(curve.control_points)
    if curve.weights is None:
        return Geom2d_BSplineCurve(poles, *rest)
    return Geom2d_BSplineCurve(poles, reals_to_kernel(curve.weights), *rest)


def curve_from_kernel(curve: Geom_BSplineCurve | Geom2d_BSplineCurve) -> BSplineCurve:
    """A kernel curve, in space or in a plane, as a clamped B-spline; a periodic one is opened at its seam."""
    first, last = curve.FirstParameter(), curve.LastParameter()
    curve = curve.Copy()
    if curve.IsPeriodic():
        curve.SetNotPeriodic()
    if min(curve.Multiplicity(1), curve.Multiplicity(curve.NbKnots())) <= curve.Degree():
        curve.Segment(first, last)  # the kernel opens a curve without clamping it
    knots = full_knots(numbers_from_kernel(curve.Knots()), numbers_from_kernel(curve.Multiplicities()))
    weights = numbers_from_kernel(curve.Weights()) if curve.IsRational() else None
    return BSplineCurve(curve.Degree(), knots, points_from_kernel(curve.Poles()), weights)


def smooth_stretches(curve: BSplineCurve) -> list[BSplineCurve]:
    """The curve cut at its inner knots of multiplicity `degree`, where it may have a corner; parameters are kept."""
    p, (knots, counts) = curve.degree, compressed_knots(curve.knots, curve.degree)
    cuts = knots[1:-1][counts[1:-1] == p]
    # the control point before the first of p equal knots lies on the curve: it ends one stretch and begins the next
    joints = np.searchsorted(curve.knots, cuts, side="left") - 1
    first, last = [0, *joints], [*joints, len(curve.control_points) - 1]
    return [_stretch(curve, int(i), int(j)) for i, j in zip(first, last)]


def _stretch(curve: BSplineCurve, first: int, last: int) -> BSplineCurve:
    p, t = curve.degree, curve.knots
    inner = t[first + p + 1 : last + 1]
    knots = np.concatenate([np.full(p + 1, t[first + p]), inner, np.full(p + 1, t[last + 1])])
    pick = slice(first, last + 1)
    return BSplineCurve(p, knots, curve.control_points[pick], None if curve.weights is None else curve.weights[pick])


def kernel_knots(knot_vector: Floats, degree: int) -> tuple[Any, Any]:
    """Kernel rows of the different knots and of how often each one occurs; raises as `compressed_knots`."""
    return _kernel_knots(knot_vector.tobytes(), degree)


@lru_cache(maxsize=256)  # most patches of a network have the same knots, and the kernel copies them
def _kernel_knots(knot_vector: bytes, degree: int) -> tuple[Any, Any]:
    knots, multiplicities = compressed_knots(np.frombuffer(knot_vector), degree)
    return reals_to_kernel(knots), integers_to_kernel(multiplicities)


def compressed_knots(knot_vector: Floats, degree: int) -> tuple[Floats, NDArray[np.int64]]:
    """Different knots, and how often each one occurs.

    Raises  BadGeometry when the degree is above the kernel's 25 or an inner knot occurs more than `degree` times.
    """
    if degree > MAX_DEGREE:
        raise BadGeometry("knot vector", f"degree {degree} is above {MAX_DEGREE}, the highest the kernel knows")
    knots, counts = np.unique(knot_vector, return_counts=True)
    if (counts[1:-1] > degree).any():
        inner = 1 + int(np.argmax(counts[1:-1] > degree))
        raise BadGeometry(
            "knot vector",
            f"inner knot {knots[inner]:.6g} occurs {counts[inner]} times where degree {degree} allows {degree}: "
            "split the curve or surface there",
        )
    return knots, counts.astype(np.int64)


def full_knots(knots: Floats, multiplicities: NDArray[np.int64]) -> Floats:
    """Every knot as often as it counts."""
    return np.repeat(np.asarray(knots, dtype=np.float64), multiplicities)

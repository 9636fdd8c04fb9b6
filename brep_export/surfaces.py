"""B-spline surfaces to kernel surfaces and back."""

from OCP.Geom import Geom_BSplineSurface

from brep_export.curves import full_knots, kernel_knots
from brep_export.occ_arrays import (
    numbers_from_kernel,
    point_grid_from_kernel,
    point_grid_to_kernel,
    real_grid_from_kernel,
    real_grid_to_kernel,
)
from recon.geometry.bspline import BSplineSurface

__all__ = ["kernel_surface", "surface_from_kernel"]


def kernel_surface(surface: BSplineSurface) -> Geom_BSplineSurface:
    """The surface as a kernel surface, over the same parameter rectangle.

    Raises  BadGeometry when a degree is above 25 or an inner knot is repeated more than degree times.
    """
    knots_u, multiplicities_u = kernel_knots(surface.knots_u, surface.degree_u)
    knots_v, multiplicities_v = kernel_knots(surface.knots_v, surface.degree_v)
    rest = knots_u, knots_v, multiplicities_u, multiplicities_v, surface.degree_u, surface.degree_v
    poles = point_grid_to_kernel(surface.control_net)
    if surface.weights is None:
        return Geom_BSplineSurface(poles, *rest)
    return Geom_BSplineSurface(poles, real_grid_to_kernel(surface.weights), *rest)


def surface_from_kernel(surface: Geom_BSplineSurface) -> BSplineSurface:
    """A kernel surface as a clamped B-spline; a periodic one is opened at its seams."""
    first_u, last_u, first_v, last_v = surface.Bounds()
    surface = surface.Copy()
    if surface.IsUPeriodic():
        surface.SetUNotPeriodic()
    if surface.IsVPeriodic():
        surface.SetVNotPeriodic()
    ends_u = surface.UMultiplicity(1), surface.UMultiplicity(surface.NbUKnots())
    ends_v = surface.VMultiplicity(1), surface.VMultiplicity(surface.NbVKnots())
    if min(ends_u) <= surface.UDegree() or min(ends_v) <= surface.VDegree():
        surface.Segment(first_u, last_u, first_v, last_v)  # the kernel opens a surface without clamping it
    return BSplineSurface(
        surface.UDegree(),
        surface.VDegree(),
        full_knots(numbers_from_kernel(surface.UKnots()), numbers_from_kernel(surface.UMultiplicities())),
        full_knots(numbers_from_kernel(surface.VKnots()), numbers_from_kernel(surface.VMultiplicities())),
        point_grid_from_kernel(surface.Poles()),
        real_grid_from_kernel(surface.Weights()) if surface.IsURational() or surface.IsVRational() else None,
    )

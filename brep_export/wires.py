"""Curves alone to kernel edges."""

import numpy as np
from OCP.TopoDS import TopoDS_Edge

from brep_export.curves import kernel_curve
from brep_export.faces import make_edge, make_vertex
from recon.geometry.bspline import BSplineCurve

__all__ = ["curve_edge"]


def curve_edge(curve: BSplineCurve) -> TopoDS_Edge:
    """Kernel edge along a whole curve; one in a plane lies at z = 0, one that ends where it begins is closed.

    Raises  BadGeometry when the kernel cannot hold the curve.
    """
    points = curve.control_points
    if points.shape[1] == 2:
        points = np.column_stack([points, np.zeros(len(points))])
    in_space = BSplineCurve(curve.degree, curve.knots, points, curve.weights)
    first = make_vertex(points[0])
    last = first if (points[0] == points[-1]).all() else make_vertex(points[-1])
    return make_edge(kernel_curve(in_space), in_space.domain, (first, last))

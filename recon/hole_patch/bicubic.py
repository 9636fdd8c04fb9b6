"""One bicubic Bezier patch on four boundary curves: the base patch.

       P03 --- P13 --- P23 --- P33        E0, E3: legs across the boundary v = 0 at its two ends,
        |       |       |       |         known from the neighbouring boundaries;
       P02 -- (P12) - (P22) -- P32        E1, E2: the legs between, interpolated linearly:
        |       |       |       |             E1 = (2 E0 + E3)/3,   E2 = (E0 + 2 E3)/3
    E0 ^|     ^ E1    ^ E2     ^|E3
       P00 --- P10 --- P20 --- P30        Each inner point is reached from two boundaries: the mean is taken.

Paper  [kinoshita], section 3.2 step 4 (basis-patch method).
"""

from dataclasses import replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from recon.geometry.bspline import BSplineSurface
from recon.hole_patch.box import Box
from recon.numerics.bernstein import bernstein, bernstein_derivative, reparametrization

__all__ = ["basis_patch_net", "base_surface", "extended", "mean_distance"]

Floats = NDArray[np.float64]
THIRDS = np.array([0.0, 1.0, 2.0, 3.0]) / 3.0
BEZIER_KNOTS = np.array([0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0])


def basis_patch_net(sides: Floats) -> Floats:
    """(4, 4, d) control net, [i, j] for u and v, of the patch on four cubic Bezier curves (4, 4, d).

    sides     as `recon.geometry.patches` numbers and directs them; neighbours meet at the corners
    Promises  the patch has these boundaries; it is bilinear or planar when they are.
    """
    net = np.zeros((4, 4, *sides.shape[2:]))
    net[:, 0], net[-1, :], net[:, -1], net[0, :] = sides
    for i, j in product((1, 2), (1, 2)):
        net[i, j] = (_reached(net, i, j) + _reached(net.swapaxes(0, 1), j, i)) / 2.0
    return net


def base_surface(ordinates: Floats, box: Box) -> BSplineSurface:
    """The patch in space over the rectangle of a box, from the heights (4, 4) of its boundary curves.

    Promises  a graph over the rectangle: u and v grow evenly along the box's x and y axes; the normal is on the
              box's side.
    """
    x, y = (box.low[k] + THIRDS * (box.high[k] - box.low[k]) for k in (0, 1))
    heights = basis_patch_net(ordinates[..., None])[..., 0]
    local = np.stack([*np.meshgrid(x, y, indexing="ij"), heights], axis=-1)
    return BSplineSurface(3, 3, BEZIER_KNOTS, BEZIER_KNOTS, box.point(local))


def extended(patch: BSplineSurface, share: float) -> BSplineSurface:
    """The same bicubic polynomial over a domain longer by `share` of its length at each end of u and of v."""
    wider = reparametrization(3, -share, 1.0 + share)
    return replace(patch, control_net=np.einsum("ai,bj,ijk->abk", wider, wider, patch.control_net))


def mean_distance(ordinates: Floats, box: Box, local: Floats, trust: Floats) -> float:
    """Mean distance of points inside the box from the patch, in millimetres; infinite when there are none.

    local    (m, 3) points in the box's frame
    trust    (m,) weights
    The patch is a graph over the box's rectangle, so the distance is taken along the normal of the box, shortened by
    the patch's slope there: exact to first order.
    """
    uv = (local[:, :2] - box.low) / (box.high - box.low)
    inside = ((uv >= 0) & (uv <= 1)).all(axis=1)
    if not inside.any():
        return float("inf")
    uv, height = uv[inside], local[inside, 2]
    net = basis_patch_net(ordinates[..., None])[..., 0]
    bu, bv = bernstein(3, uv[:, 0]), bernstein(3, uv[:, 1])
    across_u, across_v = bu @ net, bv @ net.T
    slope_u = np.einsum("mi,mi->m", bernstein_derivative(3, uv[:, 0]), across_v) / (box.high[0] - box.low[0])
    slope_v = np.einsum("mi,mi->m", bernstein_derivative(3, uv[:, 1]), across_u) / (box.high[1] - box.low[1])
    distance = np.abs(np.einsum("mi,mi->m", across_u, bv) - height) / np.sqrt(1.0 + slope_u**2 + slope_v**2)
    return float(np.average(distance, weights=trust[inside]))


def _reached(net: Floats, i: int, j: int) -> Floats:
    """Inner point [i, j] as reached from the boundary of v that is nearer to it."""
    base, leg = (0, 1) if j == 1 else (3, 2)
    first, last = net[0, leg] - net[0, base], net[3, leg] - net[3, base]
    return np.asarray(net[i, base] + ((3 - i) * first + i * last) / 3.0)

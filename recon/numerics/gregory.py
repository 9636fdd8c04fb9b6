"""Bicubic Gregory patches: tangent planes that agree along shared cubics, and their B-splines at a promised angle.

A Gregory patch is a bicubic Bezier patch whose four inner points depend on where one looks from, so that the two twists
at a corner may differ:

      b03---b13---b23---b33          b11(u, v) = (u p + v q) / (u + v)
       |   q p   p q   |                 p   what side v = 0 asks for: its cross derivative is exact along v = 0
      b02            b32                 q   what side u = 0 asks for
       |               |
      b01  q p   p q  b31            a collapsed side is one point; what it asks for follows from its neighbours
       |               |
      b00---b10---b20---b30

Along a shared cubic with legs D_0, D_1, D_2 both patches lay their cross legs E(t) = k(t) A(t) + h(t) D(t), where A is
linear between unit vectors that both know, and k, h are linear from the values that each patch has at the corners: so
their tangent planes, spanned by A and D, agree.

    net_s, net_t  (n, 4, 4, 3) control points as the sides v = 0, 1 and as the sides u = 0, 1 ask for them

Paper  [zhang2006], section 5, with the full condition of [chiyokura1983] in place of its shortcut (7).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.numerics.bernstein import bernstein, bernstein_derivative
from recon.numerics.bspline_basis import basis_matrix, clamped_knots, greville
from recon.numerics.rows import unit_vectors

__all__ = ["GregoryNets", "cross_legs", "gregory_nets", "spline_nets"]

Floats = NDArray[np.float64]
INNER = ((1, 1), (2, 1), (1, 2), (2, 2))
BORDER = np.array([0, 1, -2, -1])  # control points that a side and its cross derivative take


@dataclass(frozen=True, eq=False)
class GregoryNets:
    """Control points of n patches, which differ in the inner four alone.

    net_s  (n, 4, 4, 3) as the sides v = 0 and v = 1 ask for them
    net_t  (n, 4, 4, 3) as the sides u = 0 and u = 1 do
    """

    net_s: Floats
    net_t: Floats

    def part(self, rows: NDArray[np.int64] | NDArray[np.bool_]) -> "GregoryNets":
        return GregoryNets(self.net_s[rows], self.net_t[rows])

    @property
    def corner(self) -> Floats:
        """(n, 1, 1, 3) corner u = v = 0: counted from it, small patches far from the origin lose nothing."""
        return self.net_s[:, :1, :1]

    def moved(self, by: Floats) -> "GregoryNets":
        """The patches moved by (n, 1, 1, 3) vectors."""
        return GregoryNets(self.net_s + by, self.net_t + by)

    def points(self, uv: Floats) -> tuple[Floats, Floats, Floats]:
        """(n, m, 3) points of every patch at parameters (m, 2) or, a row a patch, (n, m, 2), and both derivatives."""
        uv = np.broadcast_to(uv, (len(self.net_s), *uv.shape[-2:]))
        shape = uv.shape[:2]
        bu, bv = (bernstein(3, uv[..., k]).reshape(*shape, 4) for k in (0, 1))
        du, dv = (bernstein_derivative(3, uv[..., k]).reshape(*shape, 4) for k in (0, 1))
        point, along_u, along_v = (
            np.einsum("nmi,nijd,nmj->nmd", a, self.net_s, b, optimize=True) for a, b in ((bu, bv), (du, bv), (bu, dv))
        )
        share, share_u, share_v = _shares(uv[..., 0], uv[..., 1])
        for k, (i, j) in enumerate(INNER):
            apart = (self.net_t - self.net_s)[:, None, i, j]
            f, f_u, f_v = bu[..., i] * bv[..., j], du[..., i] * bv[..., j], bu[..., i] * dv[..., j]
            s = share[k]
            point = point + (f * s)[..., None] * apart
            along_u = along_u + (f_u * s + f * share_u[k])[..., None] * apart
            along_v = along_v + (f_v * s + f * share_v[k])[..., None] * apart
        return point, along_u, along_v


def _shares(u: Floats, v: Floats) -> tuple[list[Floats], list[Floats], list[Floats]]:
    """Shares of `net_t` in the inner points, in the order of INNER, and their derivatives; half and 0 at the corners,
    where the points have no weight.
    """
    share, by_u, by_v = [], [], []
    for i, j in INNER:
        a, sign_u = (u, 1.0) if i == 1 else (1.0 - u, -1.0)
        b, sign_v = (v, 1.0) if j == 1 else (1.0 - v, -1.0)
        total = a + b
        sound = total > 0.0
        safe = np.where(sound, total, 1.0)
        share.append(np.where(sound, b / safe, 0.5))
        by_u.append(np.where(sound, -sign_u * b / safe**2, 0.0))
        by_v.append(np.where(sound, sign_v * a / safe**2, 0.0))
    return share, by_u, by_v


def cross_legs(curve: Floats, first: Floats, last: Floats, normals: tuple[Floats, Floats], up: Floats | None) -> Floats:
    """(n, 4, 3) cross legs E_0 .. E_3 along cubics (n, 4, 3), that lie in tangent planes both sides of them know.

    first, last  (n, 3) E_0 and E_3: legs of the patch's neighbouring sides
    normals      (n, 3) unit normals at both ends, across which the curve and E_0, E_3 lie
    up           (3,) direction seen along which A is square to the curve's ends; None: square in space
    """
    legs = np.diff(curve, axis=1)
    a, k, h = [], [], []
    for normal, leg, cross in ((normals[0], legs[:, 0], first), (normals[1], legs[:, 2], last)):
        sight = normal if up is None else np.broadcast_to(up, normal.shape)
        beside = np.cross(sight, leg)
        beside = beside - (_dot(beside, normal) / _dot(sight, normal))[:, None] * sight
        beside = unit_vectors(beside)
        # both lie across the normal, so two products with it tell the shares
        area = _dot(np.cross(leg, beside), normal)
        area = np.where(area == 0.0, 1.0, area)
        a.append(beside)
        k.append((_dot(np.cross(leg, cross), normal) / area)[:, None])
        h.append((_dot(np.cross(cross, beside), normal) / area)[:, None])
    second = (k[0] * (a[0] + a[1]) + k[1] * a[0] + 2.0 * h[0] * legs[:, 1] + h[1] * legs[:, 0]) / 3.0
    third = (k[1] * (a[0] + a[1]) + k[0] * a[1] + h[0] * legs[:, 2] + 2.0 * h[1] * legs[:, 1]) / 3.0
    return np.stack([first, second, third, last], axis=1)


def gregory_nets(
    sides: tuple[Floats, Floats, Floats, Floats], normals: Floats, up: Floats | None = None
) -> GregoryNets:
    """Patches within four cubics.

    sides    (n, 4, 3) control points of the sides v = 0, u = 1, v = 1, u = 0, along growing u or v; side v = 1 may be
             one point
    normals  (n, 4, 3) unit normals at the corners (0, 0), (1, 0), (1, 1), (0, 1)
    up       as of `cross_legs`, the same for neighbours: what is seen along it does not depend on the normals
    """
    bottom, right, top, left = sides
    net = np.zeros((len(bottom), 4, 4, 3))
    net[:, :, 0], net[:, :, 3], net[:, 0, :], net[:, 3, :] = bottom, top, left, right
    net_s, net_t = net.copy(), net.copy()
    corner = normals.transpose(1, 0, 2)
    for into, curve, ends, legs in (
        (net_s[:, :, 1], bottom, (0, 1), (left[:, 1] - left[:, 0], right[:, 1] - right[:, 0])),
        (net_s[:, :, 2], top, (3, 2), (left[:, 2] - left[:, 3], right[:, 2] - right[:, 3])),
        (net_t[:, 1], left, (0, 3), (bottom[:, 1] - bottom[:, 0], top[:, 1] - top[:, 0])),
        (net_t[:, 2], right, (1, 2), (bottom[:, 2] - bottom[:, 3], top[:, 2] - top[:, 3])),
    ):
        legs_across = cross_legs(curve, *legs, (corner[ends[0]], corner[ends[1]]), up)
        into[:, 1:3] = (curve + legs_across)[:, 1:3]
    point = (np.ptp(top, axis=1) == 0.0).all(axis=1)
    net_s[point, 1:3, 2] = net_t[point, 1:3, 2]
    return GregoryNets(net_s, net_t)


def spline_nets(patches: GregoryNets, breaks: Floats) -> Floats:
    """(n, k, k, 3) control nets of bicubic B-splines over `clamped_knots(breaks, 3)` in u and v.

    breaks    (b,) from 0 to 1, symmetric, at least five
    Promises  the boundary cubics are kept, and so are the cross derivatives along them but within the first and last
              span, where the two that meet in a corner are averaged; inside the surface meets the patch at the Greville
              abscissae.
    """
    knots = clamped_knots(breaks, 3)
    at = greville(knots, 3)
    n, inner = len(at), slice(2, -2)
    over_knots = np.linalg.solve(basis_matrix(knots, 3, at).toarray(), bernstein(3, at))  # (n, 4), of a cubic
    net = np.zeros((len(patches.net_s), n, n, 3))
    net[:, :, BORDER] = _border(patches.net_s, over_knots, breaks[1])
    across = _border(patches.net_t.transpose(0, 2, 1, 3), over_knots, breaks[1]).transpose(0, 2, 1, 3)
    net[:, BORDER, inner] = across[:, :, inner]
    met = np.ix_(np.arange(len(net)), BORDER, BORDER)
    net[met] = 0.5 * (net[met] + across[:, :, BORDER])
    rows = basis_matrix(knots, 3, at[inner]).toarray()
    u, v = np.meshgrid(at[inner], at[inner], indexing="ij")
    wanted = patches.points(np.column_stack([u.ravel(), v.ravel()]))[0].reshape(len(net), n - 4, n - 4, 3)
    missing = wanted - np.einsum("ia,nabd,jb->nijd", rows, net, rows, optimize=True)
    inverse = np.linalg.inv(rows[:, inner])
    net[:, inner, inner] = np.einsum("ia,nabd,jb->nijd", inverse, missing, inverse, optimize=True)
    return net


def _border(net: Floats, over_knots: Floats, first: float) -> Floats:
    """(n, k, 4, 3) control points of the two rows beside v = 0 and the two beside v = 1 over the finer knots.

    The row beside a side lies as much of the way to the patch's own as the `first` span is of the whole.
    """
    low, high = net[:, :, 0], net[:, :, 3]
    border = np.stack([low, low + first * (net[:, :, 1] - low), high + first * (net[:, :, 2] - high), high], axis=2)
    return np.asarray(np.einsum("ka,nabd->nkbd", over_knots, border))


def _dot(a: Floats, b: Floats) -> Floats:
    return np.asarray(np.einsum("nd,nd->n", a, b))

"""Volume of the cone over a surface, whole or trimmed, from its control points.

The cones over all faces of a solid, from any one apex, add up to its volume: the divergence theorem. Over a face

    V = 1/3 integral of f(u, v) du dv,   f = (S - apex) . (S_u x S_v)
      = 1/3 sum over the loops of  F(u, v) dv,   F(u, v) = integral of f(s, v) ds from s = a to u     (Green)

    v ^      .---<---.
      |   a--|===u   |         F at a point of a loop runs along the row of constant v from s = a to it:
      |      '--->---'         span by span, by Gauss-Legendre rules that are exact for polynomial surfaces
      +---------------> u

Along a loop every span of a pcurve is cut into pieces about as long as the surface's own spans.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from math import ceil

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse

from recon.geometry.bspline import BSplineCurve, BSplineSurface
from recon.numerics.bspline_basis import basis_matrix

__all__ = ["cone_volume", "surface_moments", "surface_tangents", "trimmed_cone_volume"]

Floats = NDArray[np.float64]

RATIONAL = 8  # more points a span where the surface is a quotient: a quarter circle to 1e-12
ALONG = 4  # points a piece of a loop
SHORT = 64  # knots of a vector whose rule is worth keeping: those of long ones, a face each, would fill the memory
AT_ONCE = 2048  # rows of constant v, which bounds the memory
ORIGIN = (0.0, 0.0, 0.0)


def cone_volume(surface: BSplineSurface, apex: ArrayLike = ORIGIN) -> float:
    """Signed volume of the cone from the apex over a whole surface; positive where its normal points away from there.

    apex      (3,) near the solid, or the volumes of its faces are large and cancel
    Promises  exact to rounding for polynomial surfaces.
    """
    net = _homogeneous(surface, apex)
    more = 0 if surface.weights is None else RATIONAL
    u, slope_u, weight_u = _rule(surface.degree_u, surface.knots_u, more)
    v, slope_v, weight_v = _rule(surface.degree_v, surface.knots_v, more)
    rows, rows_u = (np.tensordot(b, net, axes=1) for b in (u, slope_u))
    s, s_u, s_v = (
        np.tensordot(r, b, axes=(1, 1)) for r, b in ((rows, v), (rows_u, v), (rows, slope_v))
    )  # (i, 4, j) each
    f = _integrand(*(x.transpose(0, 2, 1) for x in (s, s_u, s_v)))
    return float(weight_u @ f @ weight_v) / 3.0


def surface_moments(nets: Floats, degrees: tuple[int, int], knots: tuple[Floats, Floats]) -> Floats:
    """Areas of many whole polynomial surfaces over the same knots, cones over them from the origin, and their centres.

    nets      (n, nu, nv, 3) control points
    Returns   (n, 8) area, area times its centre (3), signed volume of the cone, volume times its centre (3)
    Promises  volumes exact to rounding; areas and volumes' centres by a rule of 1.5 points a degree and span.
    """
    (u, slope_u, weight_u), (v, slope_v, weight_v) = (_rule(p, t, 0) for p, t in zip(degrees, knots))
    s, s_u, s_v = (
        np.einsum("iu,nuvd,jv->dnij", a, nets, b, optimize=True) for a, b in ((u, v), (slope_u, v), (u, slope_v))
    )
    normal = [s_u[i - 2] * s_v[i - 1] - s_u[i - 1] * s_v[i - 2] for i in range(3)]
    weight = weight_u[:, None] * weight_v
    area = np.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2) * weight
    cone = (s[0] * normal[0] + s[1] * normal[1] + s[2] * normal[2]) * weight / 3.0
    found = np.empty((len(nets), 8))
    for columns, share, reach in ((np.s_[:4], area, 1.0), (np.s_[4:], cone, 0.75)):
        # the middle of a thin cone lies three quarters of the way from its apex
        found[:, columns] = np.stack([share.sum(axis=(1, 2)), *reach * np.einsum("nij,dnij->dn", share, s)], axis=1)
    return found


def surface_tangents(
    surfaces: tuple[Floats, tuple[int, int], tuple[Floats, Floats]], rows: NDArray[np.int64], uv: Floats
) -> Floats:
    """(m, n, 6) both first derivatives of polynomial surfaces over the same knots, each at places of its own.

    surfaces  their control nets (k, nu, nv, 3), degrees and knots
    rows      (m,) numbers of surfaces
    uv        (m, n, 2) parameter pairs
    """
    nets, (p, q), (knots_u, knots_v) = surfaces
    found = np.empty((*uv.shape[:2], 6))
    for first in range(0, len(rows), AT_ONCE):
        some = slice(first, first + AT_ONCE)
        m, n = uv[some].shape[:2]
        u, v = uv[some].reshape(-1, 2).T
        at_u, along_u = (basis_matrix(knots_u, p, u, order).toarray().reshape(m, n, -1) for order in (0, 1))
        at_v, along_v = (basis_matrix(knots_v, q, v, order).toarray().reshape(m, n, 1, -1) for order in (0, 1))
        net = nets[rows[some]].reshape(m, nets.shape[1], -1)
        shape = m, n, nets.shape[2], 3
        found[some, :, :3] = (at_v @ (along_u @ net).reshape(shape))[:, :, 0]
        found[some, :, 3:] = (along_v @ (at_u @ net).reshape(shape))[:, :, 0]
    return found


def trimmed_cone_volume(surface: BSplineSurface, pcurves: Iterable[BSplineCurve], apex: ArrayLike = ORIGIN) -> float:
    """The same over the part of a surface inside closed loops of pcurves.

    pcurves   of all loops, in any order: outer loops counter-clockwise in the parameter plane, holes clockwise
    Promises  within about 1e-8 of the volume over the whole surface.
    """
    rows = _Rows.of(surface, apex)
    total = 0.0
    for pcurve in pcurves:
        uv, dv = _along(pcurve, surface)
        moving = dv != 0.0
        uv, dv = uv[moving], dv[moving]
        for first in range(0, len(dv), AT_ONCE):
            part = slice(first, first + AT_ONCE)
            total += float(rows.integrals(uv[part]) @ dv[part])
    return total / 3.0


def _homogeneous(surface: BSplineSurface, apex: ArrayLike) -> Floats:
    """(nu, nv, 4) control points from the apex times their weights, and the weights."""
    scale = np.ones(surface.control_net.shape[:2]) if surface.weights is None else surface.weights
    away = surface.control_net - np.asarray(apex, dtype=np.float64)
    return np.concatenate([away * scale[..., None], scale[..., None]], axis=2)


def _rule(degree: int, knots: Floats, more: int) -> tuple[Floats, Floats, Floats]:
    """Basis (k, n), its derivative (k, n) and weights (k,) at the points of a rule over all spans of a knot vector."""
    return _kept_rule(degree, knots.tobytes(), more) if len(knots) <= SHORT else _made_rule(degree, knots, more)


@lru_cache(maxsize=256)
def _kept_rule(degree: int, knots: bytes, more: int) -> tuple[Floats, Floats, Floats]:
    return _made_rule(degree, np.frombuffer(knots), more)


def _made_rule(degree: int, t: Floats, more: int) -> tuple[Floats, Floats, Floats]:
    points, weights = _gauss(np.unique(t), ceil(1.5 * degree) + more)
    return basis_matrix(t, degree, points).toarray(), basis_matrix(t, degree, points, 1).toarray(), weights


def _along(pcurve: BSplineCurve, surface: BSplineSurface) -> tuple[Floats, Floats]:
    """Points (m, 2) of a pcurve and their weights (m,) times dv/dt, so that a sum is an integral over dv."""
    breaks = np.unique(pcurve.knots)
    ends = pcurve.point(breaks)
    spans = [
        np.searchsorted(np.unique(knots), ends[:, k]) for k, knots in enumerate((surface.knots_u, surface.knots_v))
    ]
    pieces = 1 + np.abs(np.diff(spans, axis=1)).max(axis=0)
    inner = [np.linspace(a, b, n, endpoint=False) for a, b, n in zip(breaks[:-1], breaks[1:], pieces)]
    t, weight = _gauss(np.concatenate([*inner, breaks[-1:]]), ALONG)
    return pcurve.point(t), weight * pcurve.derivative(t)[:, 1]


def _gauss(breaks: Floats, n: int) -> tuple[Floats, Floats]:
    """Points and weights of the rule with n points a span, span after span."""
    x, w = np.polynomial.legendre.leggauss(n)
    half = 0.5 * np.diff(breaks)[:, None]
    middle = 0.5 * (breaks[:-1] + breaks[1:])[:, None]
    return (middle + half * x).ravel(), (half * w).ravel()


@dataclass(frozen=True, eq=False)
class _Rows:
    """A surface to be integrated along rows of constant v.

    net     (nu, nv, 4) control points from the apex times their weights, and the weights
    breaks  different knots in u
    n       points a span
    weights (k,) of the rule over all spans
    basis   (k, nu) sparse rows of S and S_u at its points
    """

    surface: BSplineSurface
    net: Floats
    breaks: Floats
    n: int
    weights: Floats
    basis: tuple[sparse.csr_array, sparse.csr_array]

    @classmethod
    def of(cls, surface: BSplineSurface, apex: ArrayLike) -> "_Rows":
        net = _homogeneous(surface, apex)
        breaks = np.unique(surface.knots_u)
        n = ceil(1.5 * surface.degree_u) + (0 if surface.weights is None else RATIONAL)
        points, weights = _gauss(breaks, n)
        basis, slopes = (basis_matrix(surface.knots_u, surface.degree_u, points, order) for order in (0, 1))
        return cls(surface, net, breaks, n, weights, (basis, slopes))

    def integrals(self, uv: Floats) -> Floats:
        """(m,) F at parameter pairs (m, 2): the spans before each, and the share of its own."""
        along = [self._contracted(uv[:, 1], order) for order in (0, 1)]
        spans = self._whole_spans(*along)
        before = np.concatenate([np.zeros((1, len(uv))), np.cumsum(spans, axis=0)])
        span = np.clip(np.searchsorted(self.breaks, uv[:, 0], side="right") - 1, 0, len(self.breaks) - 2)
        return before[span, np.arange(len(uv))] + self._share(uv[:, 0], self.breaks[span], *along)

    def _contracted(self, v: Floats, order: int) -> Floats:
        """(nu, m, 4) control points of the rows of constant v, or of their derivatives by v."""
        bv = basis_matrix(self.surface.knots_v, self.surface.degree_v, v, order)
        nu, nv, k = self.net.shape
        return np.asarray(bv @ self.net.transpose(1, 0, 2).reshape(nv, nu * k)).reshape(-1, nu, k).transpose(1, 0, 2)

    def _whole_spans(self, row: Floats, row_v: Floats) -> Floats:
        """(spans, m) integrals of f over every span of every row."""
        nu, m, k = row.shape
        at = [np.asarray(b @ row.reshape(nu, m * k)).reshape(-1, m, k) for b in self.basis]
        at.append(np.asarray(self.basis[0] @ row_v.reshape(nu, m * k)).reshape(-1, m, k))
        return np.asarray((_integrand(*at) * self.weights[:, None]).reshape(-1, self.n, m).sum(axis=1))

    def _share(self, u: Floats, start: Floats, row: Floats, row_v: Floats) -> Floats:
        """(m,) integrals of f from the start of a span to u, each along its own row."""
        x, w = np.polynomial.legendre.leggauss(self.n)
        half = 0.5 * (u - start)[:, None]
        s = (start[:, None] + half * (1.0 + x)).ravel()
        at = []
        for order, values in ((0, row), (1, row), (0, row_v)):
            basis = basis_matrix(self.surface.knots_u, self.surface.degree_u, s, order)
            at.append(_own_rows(basis, values.transpose(1, 0, 2)))
        return np.asarray((_integrand(*at).reshape(-1, self.n) * (half * w)).sum(axis=1))


def _own_rows(basis: sparse.csr_array, values: Floats) -> Floats:
    """(m n, 4) products of the n-th part of the rows of a basis (m n, nu) with control points (m, nu, 4) of its own."""
    m, nu, k = values.shape
    own = np.repeat(np.repeat(np.arange(m), basis.shape[0] // m), np.diff(basis.indptr))
    spread = sparse.csr_array((basis.data, basis.indices + nu * own, basis.indptr), shape=(basis.shape[0], m * nu))
    return np.asarray(spread @ values.reshape(m * nu, k))


def _integrand(s: Floats, s_u: Floats, s_v: Floats) -> Floats:
    """(...,) triple product of position, S_u and S_v from homogeneous (..., 4) ones.

    With S = A / w the parts of S_u and S_v along S drop out of the product: it is A . (A_u x A_v) / w^3.
    """
    (ax, ay, az, w), (bx, by, bz, _), (cx, cy, cz, _) = (np.moveaxis(x, -1, 0) for x in (s, s_u, s_v))
    triple = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
    return np.asarray(triple / w**3)

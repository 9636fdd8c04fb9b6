"""All tensor-product splines over the same breaks in two directions, and what is asked of one at many places.

A control net is homogeneous: (nu, nv, 4) rows (w x, w y, w z, w), with w = 1 everywhere of a B-spline surface.

    N_k     product of two basis functions,  W = sum N_k w_k
    R_k     N_k w_k / W, the weight of control point k at a place; S = sum R_k P_k

Paper  [piegl1997], algorithm A2.2 and equations 4.12 and 4.20.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial import cKDTree

from recon.geometric_fit.spline_space import SplineSpace
from recon.geometric_fit.tangent_distance import BasisRows
from recon.geometry.bspline import BSplineSurface
from recon.numerics.bspline_basis import clamped_knots

__all__ = ["NetFeet", "TensorSpace", "homogeneous", "net_rows", "nearest_net_feet", "walk_net_feet"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

MOST_DEGREE = 9
SAMPLES = 3  # a span, where the nearest of them is the start of a walk
HALVINGS = 6
ROUGH, EXACT = 1e-5, 1e-9  # how far a foot may still have to go, as a share of the size of the data


class _Arrays(NamedTuple):
    """Both directions as compiled code wants them."""

    degree_u: int
    degree_v: int
    knots_u: Floats
    knots_v: Floats
    periodic_u: bool
    periodic_v: bool


@dataclass(frozen=True, eq=False)
class TensorSpace:
    """Products of splines in u and splines in v."""

    u: SplineSpace
    v: SplineSpace

    @property
    def shape(self) -> tuple[int, int]:
        return self.u.n_control, self.v.n_control

    @property
    def n_control(self) -> int:
        return self.u.n_control * self.v.n_control

    @property
    def arrays(self) -> _Arrays:
        u, v = self.u, self.v
        return _Arrays(u.degree, v.degree, u.knots, v.knots, u.periodic, v.periodic)

    def within(self, uv: Floats) -> Floats:
        """(n, 2) places brought into the domain."""
        return np.stack([self.u.within(uv[:, 0]), self.v.within(uv[:, 1])], axis=1)

    def grid(self, net: Floats, u: Floats, v: Floats) -> Floats:
        """(len(u), len(v), 3) points of the surface."""
        return projected(_both(self.u.rows(u), self.v.rows(v), net))

    def changed(self, other: "TensorSpace", net: Floats) -> Floats:
        """The net of the same surface in a finer space, or of one through its points there in a coarser space."""
        changed = other.interpolated(_both(self.u.rows(other.u.abscissae()), self.v.rows(other.v.abscissae()), net))
        if not is_rational(net):
            changed[..., 3] = 1.0  # but for rounding they are
        return changed

    def interpolated(self, values: Floats) -> Floats:
        """(nu, nv, d) net of the surface that takes values of that shape at the abscissae."""
        first = self.u.interpolated(values.reshape(values.shape[0], -1)).reshape(-1, *values.shape[1:])
        turned = first.transpose(1, 0, 2)
        second = self.v.interpolated(turned.reshape(turned.shape[0], -1)).reshape(-1, *turned.shape[1:])
        return np.ascontiguousarray(second.transpose(1, 0, 2))

    def with_breaks(self, u: Floats, v: Floats, net: Floats) -> tuple["TensorSpace", Floats]:
        """The space with more breaks, and the net there of the same surface."""
        breaks = [np.unique(np.concatenate([old.breaks, new])) for old, new in ((self.u, u), (self.v, v))]
        finer = TensorSpace(
            SplineSpace(self.u.degree, breaks[0], self.u.periodic),
            SplineSpace(self.v.degree, breaks[1], self.v.periodic),
        )
        return finer, self.changed(finer, net)

    def evened(self, net: Floats) -> tuple["TensorSpace", Floats]:
        """The space with spans that change by little from one to the next, and a net there of about the same surface.

        Weights are 1 there: between other breaks they would no longer be positive for sure.
        """
        even = TensorSpace(self.u.evened(), self.v.evened())
        points = even.interpolated(self.grid(net, even.u.abscissae(), even.v.abscissae()))
        return even, np.concatenate([points, np.ones((*points.shape[:2], 1))], axis=2)

    def surface(self, net: Floats) -> BSplineSurface:
        """The clamped surface of a net; a periodic one begins and ends at its seam."""
        first = self.u.clamped(net.reshape(net.shape[0], -1)).reshape(-1, *net.shape[1:])
        turned = first.transpose(1, 0, 2)
        second = self.v.clamped(turned.reshape(turned.shape[0], -1)).reshape(-1, *turned.shape[1:])
        clamped = second.transpose(1, 0, 2)
        weights = clamped[..., 3] if is_rational(net) else None
        points = clamped[..., :3] if weights is None else projected(clamped)
        knots_u, knots_v = (clamped_knots(space.breaks, space.degree) for space in (self.u, self.v))
        return BSplineSurface(self.u.degree, self.v.degree, knots_u, knots_v, points, weights)


def is_rational(net: Floats) -> bool:
    """Whether some weight is another than 1."""
    return bool((net[..., 3] != 1.0).any())


def projected(net: Floats) -> Floats:
    """(..., 3) points of homogeneous rows (..., 4)."""
    return np.asarray(net[..., :3] / net[..., 3:])


def _both(rows_u: sparse.csr_array, rows_v: sparse.csr_array, net: Floats) -> Floats:
    first = np.asarray(rows_u @ net.reshape(net.shape[0], -1)).reshape(-1, *net.shape[1:])
    turned = np.ascontiguousarray(first.transpose(1, 0, 2))
    second = np.asarray(rows_v @ turned.reshape(turned.shape[0], -1)).reshape(-1, *turned.shape[1:])
    return np.ascontiguousarray(second.transpose(1, 0, 2))


class NetFeet(NamedTuple):
    """A place on the surface for every data point.

    uv         (n, 2) where
    positions  (n, 3) the point of the surface there
    by_u, by_v (n, 3) its derivatives
    """

    uv: Floats
    positions: Floats
    by_u: Floats
    by_v: Floats

    @property
    def normals(self) -> Floats:
        """(n, 3) unit normals."""
        normals = np.cross(self.by_u, self.by_v)
        return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300))

    def chosen(self, which: Ints) -> "NetFeet":
        """Those of the numbers `which`."""
        return NetFeet(*(column[which] for column in self))


def walk_net_feet(
    space: TensorSpace,
    net: Floats,
    points: Floats,
    start: Floats,
    *,
    step: float = ROUGH,
    max_steps: int = 30,
    along_u: bool = False,
) -> NetFeet:
    """Walk from places (n, 2) to the feet of points (n, 3), by Gauss-Newton steps none of which leads away.

    step     the length of the last step, as a share of the size of the points
    along_u  v stays as it is, as on a rim
    """
    uv = space.within(start)
    allowed = step * float(np.linalg.norm(np.ptp(points, axis=0))) if len(points) else 0.0
    net = np.ascontiguousarray(net)
    return NetFeet(uv, *_walk(space.arrays, net, points, uv, allowed * allowed, max_steps, along_u))


def nearest_net_feet(space: TensorSpace, net: Floats, points: Floats, *, step: float = EXACT) -> NetFeet:
    """Feet from scratch: from the nearest of samples of the whole surface."""
    u, v = _samples(space.u), _samples(space.v)
    nearest = cKDTree(space.grid(net, u, v).reshape(-1, 3), balanced_tree=False).query(points)[1]
    start = np.stack([u[nearest // len(v)], v[nearest % len(v)]], axis=1)
    return walk_net_feet(space, net, points, start, step=step)


def _samples(space: SplineSpace) -> Floats:
    share = np.arange(SAMPLES) / SAMPLES
    inner = (space.breaks[:-1, None] + share * np.diff(space.breaks)[:, None]).ravel()
    return inner if space.periodic else np.append(inner, space.breaks[-1])


def net_rows(space: TensorSpace, net: Floats, uv: Floats) -> BasisRows:
    """The weights R_k of the control points at places (n, 2)."""
    size = (space.u.degree + 1) * (space.v.degree + 1)
    columns, values = _rows(space.arrays, np.ascontiguousarray(net[..., 3]), space.within(uv), size)
    return BasisRows(np.arange(0, size * len(uv) + 1, size), columns.ravel(), values.ravel())


@njit(cache=True, nogil=True)
def _span(knots: Floats, degree: int, x: float) -> int:
    low, high = degree, len(knots) - degree - 1
    while high - low > 1:
        middle = (low + high) // 2
        if x >= knots[middle]:
            low = middle
        else:
            high = middle
    return low


@njit(cache=True, nogil=True)
def _basis(knots: Floats, p: int, span: int, x: float, values: Floats, slopes: Floats) -> None:
    """The p + 1 basis functions that are not zero in a span, and their derivatives."""
    values[0] = 1.0
    slopes[0] = 0.0
    for j in range(1, p + 1):
        if j == p:
            for r in range(p + 1):
                slopes[r] = 0.0
            for r in range(p):
                part = p * values[r] / (knots[span + r + 1] - knots[span + r + 1 - p])
                slopes[r] -= part
                slopes[r + 1] += part
        saved = 0.0
        for r in range(j):
            right, left = knots[span + r + 1], knots[span + r + 1 - j]
            part = values[r] / (right - left)
            values[r] = saved + (right - x) * part
            saved = (x - left) * part
        values[j] = saved


@njit(cache=True, nogil=True)
def _evaluate(a: _Arrays, net: Floats, u: float, v: float, bases: Floats, out: Floats) -> None:
    """Point and first derivatives at a place, rows of `out`; `bases` (4, MOST_DEGREE + 1) is room to work in."""
    span_u, span_v = _span(a.knots_u, a.degree_u, u), _span(a.knots_v, a.degree_v, v)
    _basis(a.knots_u, a.degree_u, span_u, u, bases[0], bases[1])
    _basis(a.knots_v, a.degree_v, span_v, v, bases[2], bases[3])
    nu, nv = net.shape[0], net.shape[1]
    h = np.zeros((3, 4))
    for i in range(a.degree_u + 1):
        row = (span_u - a.degree_u + i) % nu
        for k in range(4):
            along, slope = 0.0, 0.0
            for j in range(a.degree_v + 1):
                x = net[row, (span_v - a.degree_v + j) % nv, k]
                along += bases[2, j] * x
                slope += bases[3, j] * x
            h[0, k] += bases[0, i] * along
            h[1, k] += bases[1, i] * along
            h[2, k] += bases[0, i] * slope
    for k in range(3):
        out[0, k] = h[0, k] / h[0, 3]
        out[1, k] = (h[1, k] - h[1, 3] * out[0, k]) / h[0, 3]
        out[2, k] = (h[2, k] - h[2, 3] * out[0, k]) / h[0, 3]


@njit(cache=True, nogil=True)
def _moved(x: float, step: float, knots: Floats, degree: int, periodic: bool) -> float:
    low, high = knots[degree], knots[len(knots) - degree - 1]
    x += step
    if periodic:
        return low + (x - low) % (high - low)
    return min(max(x, low), high)


@njit(cache=True, nogil=True)
def _step(a: _Arrays, at: Floats, r: Floats, s: Floats, along_u: bool) -> tuple[float, float]:
    """Gauss-Newton's step, along a side of the domain where it would lead over it."""
    aa = s[1, 0] * s[1, 0] + s[1, 1] * s[1, 1] + s[1, 2] * s[1, 2]
    ab = s[1, 0] * s[2, 0] + s[1, 1] * s[2, 1] + s[1, 2] * s[2, 2]
    bb = s[2, 0] * s[2, 0] + s[2, 1] * s[2, 1] + s[2, 2] * s[2, 2]
    ar = s[1, 0] * r[0] + s[1, 1] * r[1] + s[1, 2] * r[2]
    br = s[2, 0] * r[0] + s[2, 1] * r[1] + s[2, 2] * r[2]
    if along_u:
        return ar / max(aa, 1e-300), 0.0
    determinant = aa * bb - ab * ab
    if determinant > 1e-8 * aa * bb:
        du, dv = (bb * ar - ab * br) / determinant, (aa * br - ab * ar) / determinant
    else:
        du, dv = ar / max(2.0 * aa, 1e-300), br / max(2.0 * bb, 1e-300)
    end_u, end_v = len(a.knots_u) - a.degree_u - 1, len(a.knots_v) - a.degree_v - 1
    if not a.periodic_u and ((at[0] <= a.knots_u[0] and du < 0.0) or (at[0] >= a.knots_u[end_u] and du > 0.0)):
        return 0.0, br / max(bb, 1e-300)
    if not a.periodic_v and ((at[1] <= a.knots_v[0] and dv < 0.0) or (at[1] >= a.knots_v[end_v] and dv > 0.0)):
        return ar / max(aa, 1e-300), 0.0
    return du, dv


@njit(cache=True, nogil=True)
def _walk(
    a: _Arrays, net: Floats, points: Floats, uv: Floats, allowed: float, max_steps: int, along_u: bool
) -> tuple[Floats, Floats, Floats]:
    """Positions and derivatives where the walks end; `uv` is moved."""
    n = len(points)
    positions, by_u, by_v = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3))
    bases, now, tried, r, at = (
        np.zeros((4, MOST_DEGREE + 1)), np.empty((3, 3)), np.empty((3, 3)), np.empty(3), np.empty(2),
    )  # fmt: skip
    for i in range(n):
        _evaluate(a, net, uv[i, 0], uv[i, 1], bases, now)
        away = 0.0
        for k in range(3):
            r[k] = points[i, k] - now[0, k]
            away += r[k] * r[k]
        for _ in range(max_steps):
            du, dv = _step(a, uv[i], r, now, along_u)
            length = 0.0
            for k in range(3):
                length += (du * now[1, k] + dv * now[2, k]) ** 2
            better = False
            for _ in range(HALVINGS):
                at[0] = _moved(uv[i, 0], du, a.knots_u, a.degree_u, a.periodic_u)
                at[1] = _moved(uv[i, 1], dv, a.knots_v, a.degree_v, a.periodic_v)
                _evaluate(a, net, at[0], at[1], bases, tried)
                distance = 0.0
                for k in range(3):
                    distance += (points[i, k] - tried[0, k]) ** 2
                if distance <= away:
                    better = True
                    break
                du, dv = 0.5 * du, 0.5 * dv
            if not better:
                break
            uv[i, 0], uv[i, 1], away = at[0], at[1], distance
            for k in range(3):
                r[k] = points[i, k] - tried[0, k]
                for j in range(3):
                    now[j, k] = tried[j, k]
            if length <= allowed:
                break
        positions[i], by_u[i], by_v[i] = now[0], now[1], now[2]
    return positions, by_u, by_v


@njit(cache=True, nogil=True)
def _rows(a: _Arrays, weights: Floats, uv: Floats, size: int) -> tuple[NDArray[np.int32], Floats]:
    columns, values = np.empty((len(uv), size), dtype=np.int32), np.empty((len(uv), size))
    bases = np.zeros((4, MOST_DEGREE + 1))
    nu, nv = weights.shape
    for m in range(len(uv)):
        span_u, span_v = _span(a.knots_u, a.degree_u, uv[m, 0]), _span(a.knots_v, a.degree_v, uv[m, 1])
        _basis(a.knots_u, a.degree_u, span_u, uv[m, 0], bases[0], bases[1])
        _basis(a.knots_v, a.degree_v, span_v, uv[m, 1], bases[2], bases[3])
        total, place = 0.0, 0
        for i in range(a.degree_u + 1):
            row = (span_u - a.degree_u + i) % nu
            for j in range(a.degree_v + 1):
                column = (span_v - a.degree_v + j) % nv
                columns[m, place] = row * nv + column
                values[m, place] = bases[0, i] * bases[2, j] * weights[row, column]
                total += values[m, place]
                place += 1
        for place in range(size):
            values[m, place] /= total
    return columns, values


def homogeneous(points: Floats, weights: Floats) -> Floats:
    """(n_u, n_v, 4) net of points (n_u * n_v, 3) and weights (n_u, n_v)."""
    net = np.empty((*weights.shape, 4))
    net[..., :3] = points.reshape(*weights.shape, 3) * weights[..., None]
    net[..., 3] = weights
    return net

"""B-spline and NURBS curves and surfaces with clamped knot vectors.

A curve evaluates and differentiates, nothing else; algorithms live in modules.
Paper  [piegl1997], chapters 3 and 4.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse
from scipy.interpolate import BSpline, NdBSpline

from recon.errors import BadGeometry
from recon.geometry.arrays import frozen_floats, whole_number
from recon.numerics.bspline_basis import basis_matrix

__all__ = ["BSplineCurve", "BSplineSurface"]

Floats = NDArray[np.float64]
SHORT = 64  # knots of a vector that is worth keeping


def _checked_knots(knots: ArrayLike, degree: int, n_control: int, what: str) -> Floats:
    degree = whole_number(degree, f"{what}: degree", least=1)
    if type(knots) is not np.ndarray or knots.dtype != np.float64 or knots.size > SHORT:
        return _sound_knots(knots, degree, n_control, what)
    return _known_knots(knots.tobytes(), knots.shape, degree, n_control, what)


@lru_cache(maxsize=256)  # the thousands of patches of a network have a handful of knot vectors
def _known_knots(content: bytes, shape: tuple[int, ...], degree: int, n_control: int, what: str) -> Floats:
    return _sound_knots(np.frombuffer(content).reshape(shape), degree, n_control, what)


def _sound_knots(knots: ArrayLike, degree: int, n_control: int, what: str) -> Floats:
    t = frozen_floats(knots, (None,), what)
    if len(t) != n_control + degree + 1:
        raise BadGeometry(
            what, f"{len(t)} knots where {n_control} control points of degree {degree} need {n_control + degree + 1}"
        )
    if (np.diff(t) < 0).any():
        raise BadGeometry(what, "the knots decrease")
    if t[0] != t[degree] or t[-1] != t[-degree - 1] or t[0] == t[-1]:
        raise BadGeometry(what, f"the ends of the knot vector are not repeated {degree + 1} times")
    return t


def _checked_weights(weights: ArrayLike | None, shape: tuple[int, ...], what: str) -> Floats | None:
    if weights is None:
        return None
    w = frozen_floats(weights, shape, what)
    if (w <= 0).any():
        raise BadGeometry(what, "a weight is not positive")
    return w


@dataclass(frozen=True, eq=False)
class BSplineCurve:
    """Clamped B-spline curve in 2 or 3 dimensions; NURBS when `weights` is given.

    degree          p >= 1
    knots           (n + p + 1,) non-decreasing, clamped
    control_points  (n, d), d = 2 for a pcurve, 3 in space
    weights         (n,) positive, or None
    Raises  BadGeometry.
    """

    degree: int
    knots: Floats
    control_points: Floats
    weights: Floats | None = None

    def __post_init__(self) -> None:
        points = frozen_floats(self.control_points, (None, None), "curve: control_points")
        if points.shape[1] not in (2, 3):
            raise BadGeometry("curve", f"has control points of {points.shape[1]} coordinates where 2 or 3 are needed")
        object.__setattr__(self, "control_points", points)
        object.__setattr__(self, "knots", _checked_knots(self.knots, self.degree, len(points), "curve: knots"))
        object.__setattr__(self, "weights", _checked_weights(self.weights, (len(points),), "curve: weights"))

    @classmethod
    def of_checked(cls, degree: int, knots: Floats, control_points: Floats, weights: Floats | None) -> "BSplineCurve":
        """A curve out of locked arrays of a surface or curve that was checked: nothing is copied or checked again."""
        curve = object.__new__(cls)
        for name, value in zip(
            ("degree", "knots", "control_points", "weights"), (degree, knots, control_points, weights)
        ):
            object.__setattr__(curve, name, value)
        return curve

    @property
    def domain(self) -> tuple[float, float]:
        return float(self.knots[0]), float(self.knots[-1])

    def point(self, t: ArrayLike) -> Floats:
        """(m, d) points at the parameters (m,)."""
        return self.derivative(t, 0)

    def derivative(self, t: ArrayLike, order: int = 1) -> Floats:
        """(m, d) derivative of the given order (0 to 2 for NURBS, any for B-splines) at the parameters (m,)."""
        if self.weights is None:
            return self._sum(t, order, self.control_points)
        points, weights = self.control_points * self.weights[:, None], self.weights[:, None]
        weighted = [self._sum(t, k, points) for k in range(order + 1)]
        scale = [self._sum(t, k, weights) for k in range(order + 1)]
        return _rational(weighted, scale, order)

    def _sum(self, t: ArrayLike, order: int, points: Floats) -> Floats:
        at = np.clip(np.asarray(t, dtype=np.float64).ravel(), *self.domain)
        return np.asarray(BSpline.construct_fast(self.knots, points, self.degree)(at, nu=order))

    def reversed(self) -> "BSplineCurve":
        """The same curve over the same domain, run through the other way."""
        knots = sum(self.domain) - self.knots[::-1]
        knots.setflags(write=False)
        weights = None if self.weights is None else self.weights[::-1]
        return BSplineCurve.of_checked(self.degree, knots, self.control_points[::-1], weights)


def _rational(weighted: list[Floats], scale: list[Floats], order: int) -> Floats:
    """Derivative of a quotient from those of its two parts; [piegl1997], equation 4.8."""
    point = weighted[0] / scale[0]
    if order == 0:
        return point
    first = (weighted[1] - scale[1] * point) / scale[0]
    if order == 1:
        return first
    if order == 2:
        return (weighted[2] - 2 * scale[1] * first - scale[2] * point) / scale[0]
    raise ValueError("derivatives of rational curves are given up to order 2")


@dataclass(frozen=True, eq=False)
class BSplineSurface:
    """Clamped tensor-product B-spline surface; NURBS when `weights` is given.

    degree_u, degree_v   >= 1
    knots_u, knots_v     clamped, of control_net.shape[0] + degree_u + 1 and control_net.shape[1] + degree_v + 1 entries
    control_net          (nu, nv, 3)
    weights              (nu, nv) positive, or None
    The normal is S_u x S_v.
    Raises  BadGeometry.
    """

    degree_u: int
    degree_v: int
    knots_u: Floats
    knots_v: Floats
    control_net: Floats
    weights: Floats | None = None

    def __post_init__(self) -> None:
        net = frozen_floats(self.control_net, (None, None, 3), "surface: control_net")
        object.__setattr__(self, "control_net", net)
        object.__setattr__(
            self, "knots_u", _checked_knots(self.knots_u, self.degree_u, net.shape[0], "surface: knots_u")
        )
        object.__setattr__(
            self, "knots_v", _checked_knots(self.knots_v, self.degree_v, net.shape[1], "surface: knots_v")
        )
        object.__setattr__(self, "weights", _checked_weights(self.weights, net.shape[:2], "surface: weights"))

    @property
    def domain(self) -> tuple[tuple[float, float], tuple[float, float]]:
        return (float(self.knots_u[0]), float(self.knots_u[-1])), (float(self.knots_v[0]), float(self.knots_v[-1]))

    def point(self, uv: ArrayLike) -> Floats:
        """(m, 3) points at the parameter pairs (m, 2)."""
        return self.derivative(uv, 0, 0)

    def derivative(self, uv: ArrayLike, order_u: int, order_v: int) -> Floats:
        """(m, 3) mixed derivative at the parameter pairs (m, 2); for NURBS order_u + order_v <= 1."""
        uv = np.asarray(uv, dtype=np.float64).reshape(-1, 2)
        if self.weights is None:
            return self._sum(uv, order_u, order_v, self.control_net)
        if order_u + order_v > 1:
            raise ValueError("derivatives of rational surfaces are given up to first order")
        weighted = self.control_net * self.weights[..., None]
        scale = self._sum(uv, 0, 0, self.weights[..., None])
        point = self._sum(uv, 0, 0, weighted) / scale
        if order_u + order_v == 0:
            return point
        return (
            self._sum(uv, order_u, order_v, weighted) - self._sum(uv, order_u, order_v, self.weights[..., None]) * point
        ) / scale

    def normal(self, uv: ArrayLike) -> Floats:
        """(m, 3) unit normals S_u x S_v; zero where the surface is singular."""
        n = np.cross(self.derivative(uv, 1, 0), self.derivative(uv, 0, 1))
        size = np.linalg.norm(n, axis=1, keepdims=True)
        return np.divide(n, size, out=np.zeros_like(n), where=size > 0)

    def grid(self, u: ArrayLike, v: ArrayLike) -> Floats:
        """(len(u), len(v), 3) points of the tensor grid, faster than as many single points."""
        bu = basis_matrix(self.knots_u, self.degree_u, u)
        bv = basis_matrix(self.knots_v, self.degree_v, v)
        if self.weights is None:
            return _tensor(bu, bv, self.control_net)
        return _tensor(bu, bv, self.control_net * self.weights[..., None]) / _tensor(bu, bv, self.weights[..., None])

    def _sum(self, uv: Floats, order_u: int, order_v: int, net: Floats) -> Floats:
        low, high = np.transpose(self.domain)
        spline = NdBSpline((self.knots_u, self.knots_v), net, (self.degree_u, self.degree_v))
        return np.asarray(spline(np.clip(uv, low, high), nu=(order_u, order_v)))


def _tensor(bu: sparse.csr_array, bv: sparse.csr_array, net: Floats) -> Floats:
    first = np.asarray(bu @ net.reshape(net.shape[0], -1)).reshape(-1, net.shape[1], net.shape[2])
    turned = first.transpose(1, 0, 2).reshape(net.shape[1], -1)
    return np.asarray(bv @ turned).reshape(-1, first.shape[0], net.shape[2]).transpose(1, 0, 2)

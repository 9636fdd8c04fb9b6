"""Least squares fits of planes, cylinders, cones and spheres to points with normals.

The first guess comes from the normals: those of a cylinder lie in a plane through the origin, those of a cone in a
plane beside it, and the axis is that plane's normal.  Then Gauss-Newton steps on the distances to the surface.

    x  (n, 3) points    m  (n, 3) unit normals    u  unit vector from the axis to a point    t  height along the axis
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from recon.geometry.analytic import AnalyticSurface, Cone, Cylinder, Plane, Sphere

__all__ = ["FITS", "fit_cone", "fit_cylinder", "fit_plane_through", "fit_sphere"]

Floats = NDArray[np.float64]

STEPS = 6
MOST = 4000  # points a fit takes: evenly picked from more


def _picked(x: Floats, m: Floats) -> tuple[Floats, Floats]:
    step = max(1, len(x) // MOST)
    return x[::step], m[::step]


def fit_plane_through(x: Floats, m: Floats) -> Plane:
    """Plane with the least sum of squares, its normal on the side of the points' normals."""
    centre = x.mean(axis=0)
    normal = np.linalg.eigh((x - centre).T @ (x - centre))[1][:, 0]
    normal = normal if normal @ m.mean(axis=0) >= 0 else -normal
    return Plane(normal, float(normal @ centre))


def fit_cylinder(x: Floats, m: Floats) -> Cylinder | None:
    """Cylinder with the least sum of squares; None where the points show no round one."""
    x, m = _picked(x, m)
    axis = np.linalg.eigh(m.T @ m)[1][:, 0]
    centre = x.mean(axis=0)
    e1, e2 = across(axis)
    p = (x - centre) @ np.stack([e1, e2], axis=1)
    solved = np.linalg.lstsq(np.column_stack([2 * p, np.ones(len(p))]), (p**2).sum(axis=1), rcond=None)[0]
    square = solved[2] + solved[:2] @ solved[:2]
    if not square > 0:
        return None
    found = Cylinder(centre + solved[0] * e1 + solved[1] * e2, axis, float(np.sqrt(square)))
    for _ in range(STEPS):
        e1, e2 = across(found.axis)
        arm = x - found.point
        t = arm @ found.axis
        u = found.normal(x)
        jacobian = np.column_stack([-u @ e1, -u @ e2, -t * (u @ e1), -t * (u @ e2), -np.ones(len(x))])
        step = _step(jacobian, found.distance(x))
        radius = found.radius + step[4]
        if not 0 < radius < 1e5:
            return None
        point = found.point + step[0] * e1 + step[1] * e2
        axis = _unit(found.axis + step[2] * e1 + step[3] * e2)
        found = Cylinder(point + ((centre - point) @ axis) * axis, axis, float(radius))
    return found


def fit_cone(x: Floats, m: Floats) -> Cone | None:
    """Cone with the least sum of squares; None where the points show none between needle and disk."""
    x, m = _picked(x, m)
    spread = m - m.mean(axis=0)
    axis = np.linalg.eigh(spread.T @ spread)[1][:, 0]
    apex = np.linalg.lstsq(m, np.einsum("ij,ij->i", m, x), rcond=None)[0]
    axis = axis if (x - apex).mean(axis=0) @ axis >= 0 else -axis
    tilt = float(np.clip(-(m @ axis).mean(), -1, 1))
    hollow = tilt < 0  # seen from inside the normals look along the axis
    found = Cone(apex, axis, abs(float(np.arcsin(tilt))))
    for _ in range(STEPS):
        if not 0.03 < found.half_angle < 1.5 or (hollow and found.half_angle <= 0):
            return None
        e1, e2 = across(found.axis)
        arm = x - found.apex
        t = arm @ found.axis
        w = arm - t[:, None] * found.axis
        size = np.maximum(np.linalg.norm(w, axis=1), 1e-9)
        u = w / size[:, None]
        cos, sin = np.cos(found.half_angle), np.sin(found.half_angle)
        lean = -(t * cos + size * sin)
        jacobian = np.column_stack([-found.normal(x), lean * (u @ e1), lean * (u @ e2), -size * sin - t * cos])
        step = _step(jacobian, found.distance(x))
        found = Cone(
            found.apex + step[:3], _unit(found.axis + step[3] * e1 + step[4] * e2), found.half_angle + float(step[5])
        )
    return found if 0.03 < found.half_angle < 1.5 else None


def fit_sphere(x: Floats, m: Floats) -> Sphere | None:
    """Sphere with the least sum of squares of distances; None where the points are as good as flat."""
    x, m = _picked(x, m)
    centre = x.mean(axis=0)
    p = x - centre
    solved = np.linalg.lstsq(np.column_stack([2 * p, np.ones(len(p))]), (p**2).sum(axis=1), rcond=None)[0]
    square = solved[3] + solved[:3] @ solved[:3]
    if not 0 < square < 1e10:
        return None
    found = Sphere(centre + solved[:3], float(np.sqrt(square)))
    for _ in range(STEPS):
        step = _step(np.column_stack([-found.normal(x), -np.ones(len(x))]), found.distance(x))
        found = Sphere(found.centre + step[:3], found.radius + float(step[3]))
        if not 0 < found.radius < 1e5:
            return None
    return found


FITS: tuple[Callable[[Floats, Floats], AnalyticSurface | None], ...] = (
    fit_plane_through,
    fit_cylinder,
    fit_sphere,
    fit_cone,
)


def across(axis: Floats) -> tuple[Floats, Floats]:
    """Two unit vectors at right angles to an axis and to each other."""
    e1 = _unit(np.cross(axis, np.eye(3)[int(np.abs(axis).argmin())]))
    return e1, np.cross(axis, e1)


def _unit(v: Floats) -> Floats:
    return np.asarray(v / np.linalg.norm(v))


def _step(jacobian: Floats, residual: Floats) -> Floats:
    """The Gauss-Newton step, without directions that the points leave open."""
    return np.asarray(np.linalg.lstsq(jacobian, -residual, rcond=1e-8)[0])

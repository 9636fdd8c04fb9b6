"""Rounded edges told from surfaces of their own: regions on which a ball rolls along two larger ones.

A torus between a round wall and a flat end, or the corner where three roundings meet, is grown as a handful of
cylinders, cones and spheres, none of which the part has.  So, the largest first, a region is held against the roundings
of every two larger surfaces: where most of its vertices lie on one, or on several and the balls between them, it is a
rounding.  A chamfer is not: its normals are those of its own plane, all over the strip that the rounding would take.

All lengths in voxels.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from recon.geometry.analytic import AnalyticSurface, Plane
from recon.voxel_mesh.regions import Region, SmoothSurface
from recon.voxel_mesh.rolling_ball import Rolled, rolled

__all__ = ["Rounding", "corner_centre", "without_roundings"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

WITHIN, SHARE = 0.8, 0.85  # a region is a rounding where this share of its vertices is that near to it
BETWEEN = 0.6  # of its vertices lie on it, the others on the two surfaces where it ends
ONE_SIDE, TOUCHING = 0.9, 0.5  # share of its vertices that lie on one side of either surface, or so near, in voxels
SHARP, LARGEST = 3.0, 40.0  # voxels of radius: smoothing rounds a sharp edge by the one
PICKED = 150  # vertices of a region that are asked
LEAST_STRIP = 40  # vertices of a rounding that no region shows
LARGER = 1.5  # times as many vertices has a surface that a region may round the edge of
BEYOND = 1.0  # voxels from a rounding of what else may lie in its strip
OWN, SAME_NORMAL = 1.3, 1.0  # times, and degrees, that normals may stray more from the rounding's than from the own
EDGE, FREE = 0.45, 0.8  # of the radius, how far from the rounding the sharp edge is; share of what is on the rounding
WIDER, WIDEST = 0.5, 10.0  # of the radius, at most in voxels, by which the box of a region is widened
RMS = 0.4  # voxels of what lies on a rounding
NO_WORSE = 0.1  # voxels by which the mean distance of larger surfaces' rounding may be more
ALIKE = 0.4  # of two radii, the logarithm of their ratio, that may be those of one corner


@dataclass(frozen=True, eq=False)
class Rounding:
    """A ball of a radius rolls along two regions, on the given sides of their surfaces; vertices (n,) lie on it."""

    first: Region
    second: Region
    sides: tuple[float, float]
    radius: float
    vertices: Ints

    def at(self, x: Floats) -> Rolled:
        return rolled(x, self.first.surface, self.second.surface, sides=self.sides, radius=self.radius)


def without_roundings(s: SmoothSurface, regions: Sequence[Region]) -> tuple[list[Region], list[Rounding]]:
    """Regions that are surfaces of their own, the largest first, and the roundings that others are.

    A region that is neither is a corner where roundings meet.
    """
    left = sorted(regions, key=lambda r: -len(r.vertices))
    known: _Known = {}
    while True:
        own, found = _parted(s, left, known)
        found += _overgrown(s, own, found)
        corners = [r for r in own if _is_made_of(s, r, found)]
        if not corners:
            return own, found
        left = [r for r in left if all(r is not c for c in corners)]


_Known = dict[tuple[int, ...], Rounding | None]


def _parted(s: SmoothSurface, regions: list[Region], known: _Known) -> tuple[list[Region], list[Rounding]]:
    """Surfaces and roundings: a bent region may round the edge of planes smaller than itself, a flat one is no rounding
    but of larger surfaces, and once it is one, nothing rolls along it.
    """
    strips: list[Region] = []
    while True:
        own = [r for r in regions if isinstance(r.surface, Plane) and all(r is not strip for strip in strips)]
        found: list[Rounding] = []
        for region in [r for r in regions if not isinstance(r.surface, Plane)]:
            rounding = _known_rounding(s, region, own, known)
            if rounding is None:
                own.append(region)
            else:
                found.append(rounding)
        flat = [r for r in regions if isinstance(r.surface, Plane)]
        narrow = {id(r): f for r in flat if (f := _known_rounding(s, r, own, known)) is not None}
        if all(any(r is strip for strip in strips) for r in flat if id(r) in narrow):
            return sorted(own, key=lambda r: -len(r.vertices)), [*found, *narrow.values()]
        strips += [r for r in flat if id(r) in narrow and all(r is not strip for strip in strips)]


def _known_rounding(s: SmoothSurface, region: Region, own: list[Region], known: _Known) -> Rounding | None:
    near = _near(s, region, own)
    key = (id(region), *(id(other) for other, _ in near))
    if key not in known:
        known[key] = _as_rounding(s, region, near)
    return known[key]


def _near(s: SmoothSurface, region: Region, own: list[Region]) -> list[tuple[Region, float]]:
    """Regions on one side of whose surfaces a region lies, near enough, and the side."""
    x = s.smooth[_picked(region)]
    found = []
    for other in own:
        is_base = isinstance(other.surface, Plane) and not isinstance(region.surface, Plane)
        if other is not region and (is_base or len(other.vertices) >= LARGER * len(region.vertices)):
            d = other.surface.distance(x)
            side = float(np.sign(np.median(d)))
            if (side * d > -TOUCHING).mean() >= ONE_SIDE and np.quantile(np.abs(d), 0.9) < LARGEST:
                found.append((other, side))
    return found


def _as_rounding(s: SmoothSurface, region: Region, near: list[tuple[Region, float]]) -> Rounding | None:
    """The rounding that a region is, of the largest two surfaces of those that it fits best; None where it is none."""
    x = s.smooth[_picked(region)]
    fits = [_fitted(x, region.vertices, a, b, (side_a, side_b)) for (a, side_a), (b, side_b) in combinations(near, 2)]
    able = [(r, loss) for r, loss in fits if r.radius > SHARP and _lies_on(r, x) and _bends(s, region, r)]
    if not able:
        return None
    most = NO_WORSE + min(loss for _, loss in able)
    alike = [r for r, loss in able if loss <= most]
    return max(alike, key=lambda r: min(len(r.first.vertices), len(r.second.vertices)))


def _overgrown(s: SmoothSurface, own: list[Region], found: list[Rounding]) -> list[Rounding]:
    """Roundings between surfaces that have others, of whose vertices a region took too few, or too many besides."""
    if not found:
        return []
    most = max(len(f.vertices) for f in found)
    free = np.ones(len(s.smooth), dtype=bool)
    for vertices in [r.vertices for r in own if len(r.vertices) > most] + [f.vertices for f in found]:
        free[vertices] = False
    pool = np.flatnonzero(free)
    sides = {id(r): (r, side) for f in found for r, side in zip((f.first, f.second), f.sides)}
    done = {frozenset((id(f.first), id(f.second))) for f in found}
    radius = float(np.median([f.radius for f in found]))
    more = []
    for (a, side_a), (b, side_b) in combinations(sides.values(), 2):
        if frozenset((id(a), id(b))) not in done:
            rounding = Rounding(a, b, (side_a, side_b), radius, pool)
            ball = rounding.at(s.smooth[pool])
            members = pool[ball.on_it & (np.abs(ball.distance) <= WITHIN)]
            if len(members) >= LEAST_STRIP:
                more.append(
                    _fitted(s.smooth[members[:: max(1, len(members) // PICKED)]], members, a, b, rounding.sides)[0]
                )
    return more


def _picked(region: Region) -> Ints:
    return region.vertices[:: max(1, len(region.vertices) // PICKED)]


def _fitted(x: Floats, vertices: Ints, a: Region, b: Region, sides: tuple[float, float]) -> tuple[Rounding, float]:
    """The rounding of two surfaces nearest to places, and the mean distance of these.

    That is from the rounding, or a voxel more from the surfaces beyond it.
    """

    def loss(radius: float) -> float:
        ball = rolled(x, a.surface, b.surface, sides=sides, radius=radius)
        off = np.where(ball.on_it, np.abs(ball.distance), np.inf)
        for surface in (a.surface, b.surface):
            off = np.minimum(off, BEYOND + np.abs(surface.distance(x)))
        return float(np.minimum(off, 2.0 * BEYOND).mean())

    radii = np.geomspace(1.5, LARGEST, 16)
    k = int(np.argmin([loss(r) for r in radii]))
    span = (float(radii[max(k - 1, 0)]), float(radii[min(k + 1, len(radii) - 1)]))
    found = minimize_scalar(loss, bounds=span, method="bounded", options={"xatol": 1e-3})
    return Rounding(a, b, sides, float(found.x), vertices), float(found.fun)


def _lies_on(rounding: Rounding, x: Floats) -> bool:
    """Whether places lie on a rounding, most of them between its ends and few on the surfaces beyond."""
    ball = rounding.at(x)
    on_it = ball.on_it & (np.abs(ball.distance) <= WITHIN)
    beyond = [np.abs(r.surface.distance(x)) <= WITHIN for r in (rounding.first, rounding.second)]
    return bool((on_it | beyond[0] | beyond[1]).mean() >= SHARE and on_it.mean() >= BETWEEN)


def _bends(s: SmoothSurface, region: Region, rounding: Rounding) -> bool:
    """Whether what lies beside a region is as round as the rounding: no sharp edge, and no chamfer."""
    beside = s.smooth[_around(s, region.vertices, min(WIDER * rounding.radius, WIDEST))]
    if not _is_round(rounding, rounding.at(beside)):
        return False
    rows = _around(s, region.vertices, 0.5)
    x, ball = s.smooth[rows], rounding.at(s.smooth[rows])
    strip = ball.on_it & (np.abs(ball.distance) < BEYOND)
    if not strip.any() or not _is_round(rounding, ball) or (ball.distance[strip] ** 2).mean() > RMS**2:
        return False
    normal = s.normal[rows][strip]
    stray, own = (_mean_angle(normal, m) for m in ((x - ball.centre)[strip], region.surface.normal(x[strip])))
    return stray <= OWN * own + SAME_NORMAL


def _around(s: SmoothSurface, vertices: Ints, wider: float) -> Ints:
    """All vertices in the box of some, widened by so many voxels."""
    low, high = (end(s.smooth[vertices], axis=0) for end in (np.min, np.max))
    return np.flatnonzero(((s.smooth >= low - wider) & (s.smooth <= high + wider)).all(axis=1))


def _mean_angle(n: Floats, m: Floats) -> float:
    """Mean angle in degrees of unit vectors with directions, whose sign does not matter."""
    cosine = np.abs((n * m).sum(axis=1)) / np.maximum(np.linalg.norm(m, axis=1), 1e-12)
    return float(np.degrees(np.arccos(np.minimum(cosine, 1.0))).mean())


def _is_round(rounding: Rounding, ball: Rolled) -> bool:
    """Whether few places lie beyond a rounding where the sharp edge would be."""
    wedge = ball.on_it & (ball.distance > -WITHIN) & (ball.distance < EDGE * rounding.radius)
    return bool((ball.distance[wedge] <= WITHIN).mean() >= FREE) if wedge.any() else False


def _is_made_of(s: SmoothSurface, region: Region, found: list[Rounding]) -> bool:
    """Whether a region lies on roundings, on the balls where three of them meet, and on their surfaces."""
    x = s.smooth[_picked(region)]
    size = len(region.vertices)
    around = [f for f in found if len(f.first.vertices) > size < len(f.second.vertices)]
    away = np.full(len(x), np.inf)
    for f in around:
        ball = f.at(x)
        away = np.minimum(away, np.where(ball.on_it, np.abs(ball.distance), np.inf))
    if not np.isfinite(away).any():
        return False
    for trio in _trios(around):
        centre = corner_centre(x.mean(axis=0), *trio)
        if centre is not None:
            away = np.minimum(away, np.abs(np.linalg.norm(x - centre, axis=1) - trio[2]))
    for base in {id(r): r for f in around for r in (f.first, f.second)}.values():
        away = np.minimum(away, np.abs(base.surface.distance(x)))
    return bool((away <= WITHIN).mean() >= SHARE)


Trio = tuple[list[AnalyticSurface], list[float], float]


def _trios(found: list[Rounding]) -> list[Trio]:
    """Three surfaces with their sides and a radius, wherever two roundings share one."""
    trios: dict[frozenset[int], Trio] = {}
    for f, g in combinations(found, 2):
        sides = {id(r): (r.surface, side) for h in (f, g) for r, side in zip((h.first, h.second), h.sides)}
        if len(sides) == 3 and abs(np.log(f.radius / g.radius)) < ALIKE:
            key = frozenset(sides)
            surfaces, signs = zip(*sides.values())
            trios.setdefault(key, (list(surfaces), list(signs), 0.5 * (f.radius + g.radius)))
    return list(trios.values())


def corner_centre(
    near: Floats, surfaces: Sequence[AnalyticSurface], sides: Sequence[float], radius: float
) -> Floats | None:
    """Centre of the ball that touches three surfaces on their sides, by Newton's steps; None without one."""
    centre = near[None]
    for _ in range(12):
        normals = np.concatenate([surface.normal(centre) for surface in surfaces])
        if abs(np.linalg.det(normals)) < 0.05:
            return None
        miss = [float(surface.distance(centre)[0]) - side * radius for surface, side in zip(surfaces, sides)]
        centre = centre - np.linalg.solve(normals, np.array(miss))
    return centre[0] if np.abs(miss).max() < 1e-6 else None

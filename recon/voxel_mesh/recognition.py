"""From regions to the surfaces of a part: parallel directions made parallel, coplanar faces one plane, blends told.

    region          vertices on one fitted surface           direction   planes and axes within 1.2 degrees share one
    surface         distinct: one plane for all its regions  blend       a cylinder that touches two planes, its radius
                                                                         fitted again under exact tangency
What the grid leaves open of an offset or a radius is an interval: moved anywhere within it, the surface still passes
between the solid and the empty end of all grid edges of its regions.

All lengths in voxels.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.optimize import minimize_scalar
from scipy.sparse import csgraph

from recon.geometry.analytic import AnalyticSurface, Blend, Cylinder, Plane, Sphere
from recon.voxel_mesh.fits import across, fit_cylinder, fit_plane_through
from recon.voxel_mesh.regions import Region, SmoothSurface

__all__ = ["Recognised", "recognised"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

PARALLEL = np.cos(np.radians(1.2))
LEANING = np.cos(np.radians(6.0))  # an arc or a disk tells its axis no better; made parallel where it fits as well
SAME_OFFSET = 0.15
BESIDE = 1.0  # of the radius between the boxes of two arcs that may be of one cylinder
WITHIN, SHARE = 0.65, 0.85  # a region belongs to a surface that this share of its vertices is that near to
FEW = 400  # vertices
BESIDE_PLANE = 1.5  # voxels from a plane of what may be its rim
LEAST_NARROW = 40  # vertices of a plane that only its direction tells
LEVEL, NARROW_LEVEL = np.cos(np.radians([12.0, 25.0]))  # angle of a plane's normals; those of a narrow one are smoothed
ALIKE = 1.4  # times smaller or larger may the radius of a cylinder become by joining an arc to it
FACING = 0.7  # cosine of the angle to a cylinder's normal, at least, where steps have turned a vertex's own
TANGENT = 0.3  # of the radius: how far the first fit may miss the tangency that the second makes exact


@dataclass(frozen=True, eq=False)
class Recognised:
    """Surfaces of a part.

    surfaces  distinct, blends not among them
    members   vertices of each surface's regions
    blends    rounded edges between two of the planes; blend_members their vertices
    """

    surfaces: tuple[AnalyticSurface, ...]
    members: tuple[Ints, ...]
    blends: tuple[Blend, ...]
    blend_members: tuple[Ints, ...]


def recognised(s: SmoothSurface, regions: list[Region]) -> Recognised:
    """The distinct surfaces under the regions."""
    regions = [_flattened(s, r, LEVEL) for r in regions]
    others = _joined(s, [r for r in regions if not isinstance(r.surface, Plane)])
    planes = [r for r in regions if isinstance(r.surface, Plane) and not _is_part(s, r, others)]
    directions = _directions([(_normal(r), _scatter(s, r)) for r in planes])
    others = _joined(s, [_upright(s, r, directions) for r in others])
    directions = _with_axes(directions, others)
    others, ends = _without_ends(s, others, directions)
    planes += ends
    planes += _narrow_planes(s, regions, directions, [*planes, *others])
    flat = _distinct_planes(s, planes, directions)
    blends, round_ones = _blends(s, others, flat)
    round_ones = _joined(s, [_straightened(s, r, directions) for r in round_ones])
    round_ones = _joined(s, [_filled_up(s, r) for r in round_ones])
    kept = _unabsorbed(s, [*flat, *round_ones], blends)
    number = {id(r): k for k, r in enumerate(kept)}
    told = [
        (replace(b, first=number[id(flat[b.first])], second=number[id(flat[b.second])]), members)
        for b, members in blends
        if id(flat[b.first]) in number and id(flat[b.second]) in number
    ]
    return Recognised(
        tuple(r.surface for r in kept),
        tuple(r.vertices for r in kept),
        tuple(b for b, _ in told),
        tuple(m for _, m in told),
    )


def _normal(region: Region) -> Floats:
    assert isinstance(region.surface, Plane)
    return region.surface.normal_vector


def _scatter(s: SmoothSurface, region: Region) -> Floats:
    x = s.middle[region.vertices]
    x = x - x.mean(axis=0)
    return np.asarray(x.T @ x)


def _directions(fits: list[tuple[Floats, Floats]]) -> list[Floats]:
    """Directions shared by planes, best known first: each the normal that all its planes together ask for."""
    open_ones = sorted(fits, key=lambda f: -np.trace(f[1]))
    found: list[Floats] = []
    while open_ones:
        lead = open_ones[0][0]
        group = [f for f in open_ones if abs(f[0] @ lead) >= PARALLEL]
        open_ones = [f for f in open_ones if abs(f[0] @ lead) < PARALLEL]
        found.append(np.linalg.eigh(np.sum([f[1] for f in group], axis=0))[1][:, 0])
    return found


def _distinct_planes(s: SmoothSurface, planes: list[Region], directions: list[Floats]) -> list[Region]:
    """One region a plane: shared direction, own offset; regions whose offsets agree are one."""
    turned = []
    for region in planes:
        along = max(directions, key=lambda d: abs(d @ _normal(region)))
        normal = along if along @ _normal(region) > 0 else -along
        turned.append((normal, float((s.middle[region.vertices] @ normal).mean()), region.vertices))
    found: list[Region] = []
    while turned:
        normal, offset, _ = turned[0]
        same = [abs(t[0] @ normal) > 1 - 1e-12 and abs(t[1] * (t[0] @ normal) - offset) <= SAME_OFFSET for t in turned]
        members = np.concatenate([t[2] for t, is_same in zip(turned, same) if is_same])
        turned = [t for t, is_same in zip(turned, same) if not is_same]
        found.append(Region(Plane(normal, float((s.middle[members] @ normal).mean())), members))
    return found


def _with_axes(directions: list[Floats], regions: list[Region]) -> list[Floats]:
    """The directions of planes, and the axes of cylinders that are parallel to none of them, the largest first."""
    axes = [r.surface.axis for r in sorted(regions, key=lambda r: -len(r.vertices)) if isinstance(r.surface, Cylinder)]
    found = list(directions)
    for axis in axes:
        if all(abs(d @ axis) < LEANING for d in found):
            found.append(axis)
    return found


def _narrow_planes(
    s: SmoothSurface, regions: list[Region], directions: list[Floats], known: list[Region]
) -> list[Region]:
    """Planes across known directions among what belongs to no region, as the ends of a tube's wall: too narrow for a
    seed. What lies on one of the `known` is its rim, or a step of it.
    """
    left = np.ones(len(s.middle), dtype=bool)
    left[np.concatenate([r.vertices for r in regions])] = False
    graph = sparse.csr_array((np.ones(len(s.neighbour), dtype=np.int8), s.neighbour, s.start))
    found: list[Region] = []
    for normal in [sign * d for d in directions for sign in (1.0, -1.0)]:
        rows = np.flatnonzero(left & (s.normal @ normal > NARROW_LEVEL))
        n, group = csgraph.connected_components(graph[rows][:, rows], directed=False)
        for number in np.flatnonzero(np.bincount(group, minlength=n) >= LEAST_NARROW).tolist():
            members = rows[group == number]
            plane = Plane(normal, float((s.middle[members] @ normal).mean()))
            flat = (np.abs(plane.distance(s.middle[members])) <= WITHIN).all()
            if flat and not any(_is_rim(s, members, r) for r in known):
                found.append(Region(plane, members))
                left[members] = False
    return found


def _is_rim(s: SmoothSurface, vertices: Ints, region: Region) -> bool:
    """Whether vertices lie on a round region's surface, or beside a plane and face as it does."""
    x = s.middle[vertices]
    if not isinstance(region.surface, Plane):
        return _lies_on(region.surface, x)
    alike = float((s.normal[vertices] @ region.surface.normal_vector).mean()) > NARROW_LEVEL
    return alike and float(np.abs(region.surface.distance(x)).max()) < BESIDE_PLANE


def _flattened(s: SmoothSurface, region: Region, level: float) -> Region:
    """A plane in place of a round surface where it fits as well: a wall between two roundings takes some of them in.

    level  cosine that most normals make with the plane's, at least
    """
    if isinstance(region.surface, Plane):
        return region
    x, normals = s.middle[region.vertices], s.normal[region.vertices]
    plane = fit_plane_through(x, normals)
    is_level = (normals @ plane.normal_vector > level).mean() >= SHARE
    return Region(plane, region.vertices) if is_level and _lies_on(plane, x) else region


def _without_ends(
    s: SmoothSurface, regions: list[Region], directions: list[Floats]
) -> tuple[list[Region], list[Region]]:
    """The round regions, and as planes those that are ends across a known direction: narrow ones pass for spheres."""
    round_ones: list[Region] = []
    ends: list[Region] = []
    for region in regions:
        flat = region if isinstance(region.surface, Cylinder) else _flattened(s, region, NARROW_LEVEL)
        is_end = isinstance(flat.surface, Plane) and any(abs(d @ _normal(flat)) > LEANING for d in directions)
        (ends if is_end else round_ones).append(flat if is_end else region)
    return round_ones, ends


def _joined(s: SmoothSurface, regions: list[Region]) -> list[Region]:
    """The regions, those on one cylinder made one: steps along the grid part it into arcs."""
    left = [r for r in regions if isinstance(r.surface, Cylinder)]
    found = [r for r in regions if not isinstance(r.surface, Cylinder)]
    while left:
        lead, *left = sorted(left, key=lambda r: -len(r.vertices))
        n_before = len(left) + 1
        while len(left) < n_before:
            n_before = len(left)
            for other in list(left):
                both = _together(s, lead, other)
                if both is not None:
                    lead = both
                    left.remove(other)
        found.append(lead)
    return found


def _together(s: SmoothSurface, one: Region, other: Region) -> Region | None:
    """One cylinder through both regions; None where they are apart, or it misses either."""
    places = [s.middle[r.vertices] for r in (one, other)]
    low, high = ([end(x, axis=0) for x in places] for end in (np.min, np.max))
    members = np.union1d(one.vertices, other.vertices)
    x = s.middle[members]
    assert isinstance(one.surface, Cylinder)
    if (np.maximum(*low) > np.minimum(*high) + BESIDE * one.surface.radius).any():
        return None
    # an arc alone tells its axis badly: that of the larger region first
    for fit in (_circle(x, one.surface.axis, one.surface), fit_cylinder(x, s.normal[members])):
        if fit is None or not all(_lies_on(fit, part) for part in places):
            continue
        if abs(np.log(fit.radius / one.surface.radius)) > np.log(ALIKE):
            continue  # two quarters of circles lie on many a larger one
        if _side(s, fit, one.vertices) == _side(s, fit, other.vertices):
            return Region(fit, members)
    return None


def _side(s: SmoothSurface, surface: AnalyticSurface, vertices: Ints) -> float:
    """1 where the normals of vertices are those of the surface, -1 where they are turned: a hole, not a boss."""
    return float(np.sign(np.median((surface.normal(s.middle[vertices]) * s.normal[vertices]).sum(axis=1))))


def _lies_on(surface: AnalyticSurface, x: Floats) -> bool:
    return bool((np.abs(surface.distance(x)) <= WITHIN).mean() >= SHARE)


def _upright(s: SmoothSurface, region: Region, directions: list[Floats]) -> Region:
    """A round region as a cylinder along a direction of the planes, where it is one: few vertices tell no cone from the
    rounded edge of a pocket, and a low band no sphere from a cylinder.
    """
    small = len(region.vertices) <= FEW or isinstance(region.surface, Sphere)
    if isinstance(region.surface, Cylinder | Plane) or not small:
        return region
    x = s.middle[region.vertices]
    for along in directions:
        e = np.stack(across(along), axis=1)
        p = (x - x.mean(axis=0)) @ e
        solved = np.linalg.lstsq(np.column_stack([2 * p, np.ones(len(p))]), (p**2).sum(axis=1), rcond=None)[0]
        square = float(solved[2] + solved[:2] @ solved[:2])
        if 0.0 < square < np.ptp(p, axis=0).max() ** 2 * 16.0:
            fit = _circle(x, along, Cylinder(x.mean(axis=0) + e @ solved[:2], along, float(np.sqrt(square))))
            if fit is not None and _lies_on(fit, x):
                return Region(fit, region.vertices)
    return region


def _straightened(s: SmoothSurface, region: Region, directions: list[Floats]) -> Region:
    """A cylinder whose axis is parallel to a direction of the planes gets exactly that axis."""
    surface = region.surface
    if not isinstance(surface, Cylinder) or not directions:
        return region
    along = max(directions, key=lambda d: abs(d @ surface.axis))
    if abs(along @ surface.axis) < LEANING:
        return region
    x = s.middle[region.vertices]
    straight = _circle(x, along, surface)
    if straight is None or (abs(along @ surface.axis) < PARALLEL and not _lies_on(straight, x)):
        return region
    return Region(straight, region.vertices)


def _filled_up(s: SmoothSurface, region: Region) -> Region:
    """A cylinder fitted to all vertices on it as far along its axis as its region goes: steps kept some out."""
    surface = region.surface
    if not isinstance(surface, Cylinder):
        return region
    along = s.middle @ surface.axis
    low, high = np.quantile(along[region.vertices], [0.0, 1.0])
    facing = (surface.normal(s.middle) * s.normal).sum(axis=1)
    side = _side(s, surface, region.vertices)
    near = np.abs(surface.distance(s.middle)) <= WITHIN
    members = np.flatnonzero(near & (along >= low) & (along <= high) & (side * facing > FACING))
    if len(members) < len(region.vertices):
        return region
    fit = _circle(s.middle[members], surface.axis, surface)
    return region if fit is None else Region(fit, members)


def _circle(x: Floats, axis: Floats, first: Cylinder) -> Cylinder | None:
    """Cylinder with a given axis direction, by Gauss-Newton from a first one; None where it becomes another one."""
    e = np.stack(across(axis), axis=1)
    p, centre, radius = x @ e, first.point @ e, first.radius
    for _ in range(8):
        arm = p - centre
        size = np.linalg.norm(arm, axis=1)
        jacobian = np.column_stack([-arm / size[:, None], -np.ones(len(p))])
        step = np.linalg.lstsq(jacobian, radius - size, rcond=None)[0]
        centre, radius = centre + step[:2], radius + step[2]
    if not 0.5 < radius / first.radius < 2.0:
        return None
    return Cylinder(e @ centre + (x @ axis).mean() * axis, axis, float(radius))


def _blends(
    s: SmoothSurface, regions: list[Region], planes: list[Region]
) -> tuple[list[tuple[Blend, Ints]], list[Region]]:
    """Blends with their vertices, and the round regions that are none."""
    blends, rest = [], []
    for region in regions:
        found = _as_blend(s, region, planes) if isinstance(region.surface, Cylinder) else None
        if found is None:
            rest.append(region)
        else:
            blends.append((found, region.vertices))
    return blends, rest


def _as_blend(s: SmoothSurface, region: Region, planes: list[Region]) -> Blend | None:
    cylinder = region.surface
    assert isinstance(cylinder, Cylinder)
    touching = [k for k, r in enumerate(planes) if _touches(cylinder, r.surface)]
    x = s.middle[region.vertices]
    # a sliver of a rounding may pass for a plane of its own: of the pairs that fit, the one of the larger planes
    pairs = sorted(
        ((a, b) for i, a in enumerate(touching) for b in touching[:i]),
        key=lambda p: -min(len(planes[k].vertices) for k in p),
    )
    for a, b in pairs:
        fit = _tangent_fit(x, cylinder, planes[a].surface, planes[b].surface)
        if fit is not None:
            return Blend(a, b, *fit)
    return None


def _touches(cylinder: Cylinder, plane: AnalyticSurface) -> bool:
    assert isinstance(plane, Plane)
    away = abs(float(plane.distance(cylinder.point[None])[0]))
    return bool(
        abs(cylinder.axis @ plane.normal_vector) < 0.1 and abs(away - cylinder.radius) < TANGENT * cylinder.radius
    )


def _tangent_fit(
    x: Floats, cylinder: Cylinder, first: AnalyticSurface, second: AnalyticSurface
) -> tuple[float, Floats] | None:
    """Radius and middle of the cylinder that touches two planes exactly; None where it does not fit."""
    assert isinstance(first, Plane) and isinstance(second, Plane)
    normals = np.stack([first.normal_vector, second.normal_vector])
    side = np.sign([p.distance(cylinder.point[None])[0] for p in (first, second)])
    axis = np.cross(*normals)
    if np.linalg.norm(axis) < 0.2 or side[0] != side[1]:
        return None
    axis = axis / np.linalg.norm(axis)
    system = np.vstack([normals, axis])

    def touching(radius: float) -> Cylinder:
        wanted = np.append(np.array([first.offset, second.offset]) + side * radius, axis @ x.mean(axis=0))
        return Cylinder(np.linalg.solve(system, wanted), axis, radius)

    def square(radius: float) -> float:
        return float((touching(radius).distance(x) ** 2).mean())

    span = (0.5 * cylinder.radius, 1.6 * cylinder.radius)
    radius = float(minimize_scalar(square, bounds=span, method="bounded", options={"xatol": 1e-5}).x)
    if not _lies_on(touching(radius), x):
        return None
    return radius, x[int(np.abs((x - x.mean(axis=0)) @ axis).argmin())]


def _is_part(s: SmoothSurface, region: Region, others: Sequence[Region | AnalyticSurface]) -> bool:
    """Whether a region lies on a surface, or on that of a region more than twice as large: then it is a step of it."""
    x = s.middle[region.vertices]
    for other in others:
        if not isinstance(other, Region):
            surface = other
        elif len(other.vertices) > 2 * len(region.vertices):
            surface = other.surface
        else:
            continue
        if _lies_on(surface, x):
            return True
    return False


def _unabsorbed(s: SmoothSurface, regions: list[Region], blends: list[tuple[Blend, Ints]]) -> list[Region]:
    """Regions but those whose vertices lie on a larger region's surface, or on a blend's."""
    by_size = sorted(regions, key=lambda r: -len(r.vertices))
    cylinders = [_blend_cylinder(b, regions, s.middle[m]) for b, m in blends]
    used = {k for b, _ in blends for k in (b.first, b.second)}
    kept: list[Region] = []
    for region in by_size:
        needed = any(regions[k] is region for k in used)
        if needed or not _is_part(s, region, [*kept, *cylinders]):
            kept.append(region)
    return kept


def _blend_cylinder(blend: Blend, planes: list[Region], x: Floats) -> Cylinder:
    first, second = planes[blend.first].surface, planes[blend.second].surface
    assert isinstance(first, Plane) and isinstance(second, Plane)
    normals = np.stack([first.normal_vector, second.normal_vector])
    axis = np.cross(*normals)
    axis = axis / np.linalg.norm(axis)
    # of the four cylinders that touch both planes, the one that the vertices lie on
    candidates = []
    for side in (-1.0, 1.0):
        wanted = np.append(np.array([first.offset, second.offset]) + side * blend.radius, axis @ x.mean(axis=0))
        candidates.append(Cylinder(np.linalg.solve(np.vstack([normals, axis]), wanted), axis, blend.radius))
    return min(candidates, key=lambda c: float(np.abs(c.distance(x)).mean()))

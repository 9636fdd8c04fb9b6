"""From regions to the surfaces of a part: parallel directions made parallel, coplanar faces one plane, blends told.

    region          vertices on one fitted surface           direction   planes and axes within 1.2 degrees share one
    surface         distinct: one plane for all its regions  blend       where a ball rolls along two surfaces

All lengths in voxels.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from recon.geometry.analytic import AnalyticSurface, Blend, Cylinder, Plane, Sphere
from recon.voxel_mesh.fits import across, fit_cylinder, fit_plane_through
from recon.voxel_mesh.regions import Region, SmoothSurface
from recon.voxel_mesh.roundings import Rounding, without_roundings
from recon.voxel_mesh.settled_surfaces import Faces

__all__ = ["recognised"]

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


def recognised(s: SmoothSurface, regions: list[Region]) -> Faces:
    """The distinct surfaces under the regions, and the roundings of their edges."""
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
    own, roundings = without_roundings(s, [*flat, *others])
    flat = [r for r in own if isinstance(r.surface, Plane)]
    round_ones = _joined(s, [_straightened(s, r, directions) for r in own if not isinstance(r.surface, Plane)])
    round_ones = _joined(s, [_filled_up(s, r) for r in round_ones])
    needed = {id(r) for f in roundings for r in (f.first, f.second)}
    kept = _unabsorbed(s, [*flat, *round_ones], needed)
    blends, blend_members = _as_blends(s, kept, roundings)
    return Faces(tuple(r.surface for r in kept), tuple(r.vertices for r in kept), blends, blend_members)


def _as_blends(
    s: SmoothSurface, kept: list[Region], roundings: list[Rounding]
) -> tuple[tuple[Blend, ...], tuple[Ints, ...]]:
    """One blend for all roundings of two surfaces that hang together, with its vertices."""
    label = np.full(len(s.middle), -1)
    for k, region in reversed(list(enumerate(kept))):
        label[region.vertices] = k
    pairs: dict[tuple[int, int], list[Rounding]] = {}
    for rounding in roundings:
        pair = [_most(label[r.vertices]) for r in (rounding.first, rounding.second)]
        if min(pair) >= 0 and pair[0] != pair[1]:
            pairs.setdefault((pair[0], pair[1]), []).append(rounding)
    blends: list[Blend] = []
    members: list[Ints] = []
    for (a, b), group in pairs.items():
        for run in _runs(s, group):
            vertices = np.unique(np.concatenate([f.vertices for f in run]))
            weights = [len(f.vertices) for f in run]
            x = s.middle[vertices]
            middle = x[int(np.linalg.norm(x - x.mean(axis=0), axis=1).argmin())]
            radius = float(np.average([f.radius for f in run], weights=weights))
            blends.append(Blend(a, b, radius, middle, run[0].sides))
            members.append(vertices)
    return tuple(blends), tuple(members)


def _most(labels: Ints) -> int:
    """The label that most have, -1 where most have none."""
    values, counts = np.unique(labels, return_counts=True)
    return int(values[counts.argmax()])


def _runs(s: SmoothSurface, roundings: list[Rounding]) -> list[list[Rounding]]:
    """Roundings of one edge each: their boxes are nearer to each other than the radius."""
    boxes = [(s.middle[f.vertices].min(axis=0), s.middle[f.vertices].max(axis=0)) for f in roundings]
    links = [
        (np.maximum(a[0], b[0]) - np.minimum(a[1], b[1])).max() <= f.radius
        for a in boxes
        for b, f in zip(boxes, roundings)
    ]
    n, part = csgraph.connected_components(np.array(links).reshape(len(boxes), -1), directed=False)
    return [[f for f, p in zip(roundings, part) if p == number] for number in range(n)]


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


def _unabsorbed(s: SmoothSurface, regions: list[Region], needed: set[int]) -> list[Region]:
    """Regions but those whose vertices lie on a larger region's surface; the needed ones, by identity, stay."""
    kept: list[Region] = []
    for region in sorted(regions, key=lambda r: -len(r.vertices)):
        if id(region) in needed or not _is_part(s, region, kept):
            kept.append(region)
    return kept

"""Surfaces and roundings of a part moved together until the voxel centres lie on their right sides.

What one face leaves open its neighbours tell: a flat wall along the grid may lie anywhere within a voxel, but the
roundings of its edges say where.  So all offsets, radii, axes and directions are free at once, and every centre on the
wrong side of the surface that it belongs to pulls by its depth:

    wanted  the least sum of depth² over all numbers, by Newton's steps: each a least squares over what is wrong there

Planes and axes that are parallel stay so; radii that come out alike are made one, and directions nearly at right angles
exactly so, where that is as good.  All lengths in voxels.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from recon.geometry.analytic import AnalyticSurface, Blend, Cone, Cylinder, Plane, Sphere
from recon.voxel_mesh.damped_newton import damped_newton
from recon.voxel_mesh.fits import across
from recon.voxel_mesh.rolling_ball import Rolled, rolled

__all__ = ["Ends", "Faces", "settled_faces"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

MARGIN = 0.004  # voxels that a centre shall keep from its surface
DEEPEST = 1.0  # voxels: a centre deeper than this belongs to something else
PULL = 0.2  # voxels from which on a depth pulls no harder
STEADY = 1e-4  # of the strongest pull: what holds a number that no centre pulls
STEPS = 12  # Newton's, at most
SMALL = 1e-5  # voxels: step of numerical derivatives
LEVER = 100.0  # voxels at which a unit of a direction's numbers is one voxel
PARALLEL = 1.0 - 1e-9
STRIP = 1.0  # voxels from a rounding of the vertices in its strip
ALIKE = 1.0, 0.3, 0.06  # share by which radii may differ that are one: first as many as can be
LEAST = 20  # vertices of a face that say anything
SQUARE = np.sin(np.radians(0.6))  # of the angle by which directions miss the right one
STRAYS = 0.3, 0.1, 0.05  # voxels on the wrong side beyond which a vertex is another face's, round by round
LEFT = 0.7  # share of a face's vertices that has to be left
WORSE = 2.0  # times the sum may grow by making radii one


@dataclass(frozen=True, eq=False)
class Faces:
    """Surfaces with their vertices, and the blends between them with theirs."""

    surfaces: tuple[AnalyticSurface, ...]
    members: tuple[Ints, ...]
    blends: tuple[Blend, ...]
    blend_members: tuple[Ints, ...]


@dataclass(frozen=True, eq=False)
class Ends:
    """Solid and empty centre (V, 3) beside every vertex, and the outward normal (V, 3) there."""

    solid: Floats
    empty: Floats
    normal: Floats


@dataclass(frozen=True, eq=False)
class _Numbers:
    """Which of all numbers each face has.

    own        for each surface a slice: what moves it along its normal, and across
    lead       directions (n, 3), one a group of parallel surfaces; the numbers of each start at `turn`
    group      for each surface its group, -1 for one that keeps its direction or has none
    along      for each surface 1 or -1, whether it looks the group's way
    radius     for each blend the number of its radius
    pivot      (n, 3) the places about which surfaces turn
    """

    own: list[slice]
    lead: Floats
    turn: int
    group: Ints
    along: Floats
    radius: Ints
    pivot: Floats
    count: int


def settled_faces(faces: Faces, ends: Ends, middle: Floats) -> Faces:
    """The faces with as few centres on the wrong side as can be; members as the roundings tell them apart.

    middle  (V, 3) places of the vertices
    """
    for stray in STRAYS:
        faces = _without_strays(_sorted_out(faces, middle), ends, stray)
        faces = _newton(faces, _numbered(faces, middle), ends)
    square = _squared(faces, middle)
    square = _newton(square, _numbered(square, middle, turning=False), ends)
    is_square = not _is_worse(square, faces, ends)
    faces = square if is_square else faces
    for share in ALIKE:
        same = _alike(faces, share)
        same = _newton(same, _numbered(same, middle, turning=not is_square), ends)
        if not _is_worse(same, faces, ends):
            return same
    return faces


def _is_worse(simpler: Faces, faces: Faces, ends: Ends) -> bool:
    """Whether faces with fewer free numbers have many more, or much deeper, centres on the wrong side."""
    bad, n = _badness(_wrong(faces, ends)), sum(map(len, (*faces.members, *faces.blend_members)))
    return _badness(_wrong(simpler, ends)) > WORSE * bad + 0.1 * n * MARGIN**2


def _sorted_out(faces: Faces, x: Floats) -> Faces:
    """Every vertex at the face it belongs to: in the strip of a rounding, or beyond it."""
    if not faces.blends:
        return faces
    in_strip = np.zeros(len(x), dtype=bool)
    members = []
    for blend, own in zip(faces.blends, faces.blend_members):
        candidates = np.unique(np.concatenate([own, faces.members[blend.first], faces.members[blend.second]]))
        near = _beside(blend, x[own], x[candidates])
        ball = _ball(faces.surfaces, blend, x[candidates[near]])
        strip = ball.on_it & (np.abs(ball.distance) < STRIP)
        corner = _in_corner(faces, blend, ball)
        in_strip[candidates[near][strip]] = True
        members.append(candidates[near][strip & ~corner])
    return replace(
        faces,
        members=tuple(_kept(m, m[~in_strip[m]]) for m in faces.members),
        blend_members=tuple(_kept(own, found) for own, found in zip(faces.blend_members, members)),
    )


def _kept(before: Ints, after: Ints) -> Ints:
    """The vertices after sorting, where enough are left to say anything."""
    return after if len(after) >= LEAST else before


def _beside(blend: Blend, own: Floats, x: Floats) -> NDArray[np.bool_]:
    """Whether places lie in the box of a blend's vertices, widened by its radius."""
    low, high = own.min(axis=0) - blend.radius, own.max(axis=0) + blend.radius
    return np.asarray(((x >= low) & (x <= high)).all(axis=1))


def _ball(surfaces: Sequence[AnalyticSurface], blend: Blend, x: Floats) -> Rolled:
    return rolled(x, surfaces[blend.first], surfaces[blend.second], sides=blend.sides, radius=blend.radius)


def _in_corner(faces: Faces, blend: Blend, ball: Rolled) -> NDArray[np.bool_]:
    """Whether the ball would cut a third surface, along which a neighbour of the blend rolls."""
    corner = np.zeros(len(ball.centre), dtype=bool)
    own = {blend.first, blend.second}
    for other in faces.blends:
        for k, side in zip((other.first, other.second), other.sides):
            if k not in own and {other.first, other.second} & own:
                away = side * faces.surfaces[k].distance(ball.centre)
                corner |= (away < blend.radius) & (away > -blend.radius)
    return corner


def _without_strays(faces: Faces, ends: Ends, stray: float) -> Faces:
    """The faces without vertices that are far on the wrong side of them: those of a neighbour, at a sharp edge."""
    members = []
    for m, d in zip((*faces.members, *faces.blend_members), _depths(faces, ends)):
        kept = m[d < stray]
        members.append(kept if len(kept) > LEFT * len(m) else m)
    n = len(faces.surfaces)
    return replace(faces, members=tuple(members[:n]), blend_members=tuple(members[n:]))


def _alike(faces: Faces, share: float) -> Faces:
    """Radii of blends that differ by no more than a share made one, their mean."""
    radii = np.array([b.radius for b in faces.blends])
    weight = np.array([len(m) for m in faces.blend_members], dtype=np.float64)
    left = np.argsort(radii).tolist()
    while left:
        same = [k for k in left if radii[k] <= (1.0 + share) * radii[left[0]]]
        left = [k for k in left if k not in same]
        radii[same] = float((radii[same] * weight[same]).sum() / weight[same].sum())
    return replace(faces, blends=tuple(replace(b, radius=float(r)) for b, r in zip(faces.blends, radii)))


def _squared(faces: Faces, x: Floats) -> Faces:
    """Directions nearly along the grid, or at right angles to each other, made exactly so."""
    numbers = _numbered(faces, x)
    weight = np.bincount(
        numbers.group[numbers.group >= 0], [len(m) for m, g in zip(faces.members, numbers.group) if g >= 0]
    )
    along = np.abs(numbers.lead) > np.sqrt(1.0 - SQUARE**2)
    square = np.where(along.any(axis=1, keepdims=True), np.where(along, np.sign(numbers.lead), 0.0), numbers.lead)
    frame: list[Floats] = []
    for g in np.argsort(-weight).tolist():
        for axis in frame:
            if abs(square[g] @ axis) < SQUARE:
                square[g] = square[g] - (square[g] @ axis) * axis
        square[g] /= np.linalg.norm(square[g])
        if all(abs(square[g] @ axis) < 1e-9 for axis in frame):
            frame.append(square[g])
    surfaces = []
    for k, (base, group) in enumerate(zip(faces.surfaces, numbers.group)):
        surface = base
        if group >= 0:
            still, direction = np.zeros(_size(surface)), numbers.along[k] * square[group]
            surface = _moved(surface, still, direction, numbers.pivot[k])
        surfaces.append(surface)
    return replace(faces, surfaces=tuple(surfaces))


def _size(surface: AnalyticSurface) -> int:
    """How many numbers of its own a surface has."""
    return 1 if isinstance(surface, Plane) else 3 if isinstance(surface, Cylinder) else 4


def _numbered(faces: Faces, x: Floats, *, turning: bool = True) -> _Numbers:
    """Numbers of all faces, with those of the directions if they may turn; blends of exactly one radius share it."""
    sizes = [_size(surface) for surface in faces.surfaces]
    start = np.concatenate([[0], np.cumsum(sizes)])
    lead: list[Floats] = []
    group, along = np.full(len(sizes), -1), np.ones(len(sizes))
    for k, surface in enumerate(faces.surfaces):
        if turning and (direction := _direction(surface)) is not None:
            same = [g for g, d in enumerate(lead) if abs(d @ direction) > PARALLEL]
            group[k] = same[0] if same else len(lead)
            lead += [] if same else [direction]
            along[k] = np.sign(lead[group[k]] @ direction)
    turn = int(start[-1])
    _, radius = np.unique([b.radius for b in faces.blends], return_inverse=True)
    first = turn + 2 * len(lead)
    pivot = np.array([x[m].mean(axis=0) for m in faces.members])
    count = first + int(radius.max(initial=-1)) + 1
    own = [slice(a, b) for a, b in pairwise(start.tolist())]
    return _Numbers(
        own, np.array(lead).reshape(-1, 3), turn, group, along, first + radius.astype(np.int64), pivot, count
    )


def _direction(surface: AnalyticSurface) -> Floats | None:
    if isinstance(surface, Plane):
        return surface.normal_vector
    return surface.axis if isinstance(surface, Cylinder | Cone) else None


def _moved(surface: AnalyticSurface, q: Floats, direction: Floats, pivot: Floats) -> AnalyticSurface:
    """A surface with its own numbers moved by q, turned about the pivot to a direction."""
    if isinstance(surface, Plane):
        foot = pivot - surface.distance(pivot[None])[0] * surface.normal_vector
        return Plane(direction, float(direction @ foot + q[0]))
    if isinstance(surface, Cylinder):
        foot = surface.point + ((pivot - surface.point) @ surface.axis) * surface.axis
        return Cylinder(
            foot + q[1:] @ np.stack(across(surface.axis)), direction, max(surface.radius + float(q[0]), 0.1)
        )
    if isinstance(surface, Sphere):
        return Sphere(surface.centre + q[1:], max(surface.radius + float(q[0]), 0.1))
    assert isinstance(surface, Cone)
    foot = surface.apex + ((pivot - surface.apex) @ surface.axis) * surface.axis
    apex = foot - np.linalg.norm(foot - surface.apex) * direction
    return Cone(apex + q[:3], direction, surface.half_angle + float(q[3]) / LEVER)


def _moved_surface(faces: Faces, numbers: _Numbers, step: Floats, k: int) -> AnalyticSurface:
    surface, group = faces.surfaces[k], numbers.group[k]
    direction = _direction(surface)
    if direction is None or group < 0:
        still = np.zeros(3) if direction is None else direction
        return _moved(surface, step[numbers.own[k]], still, numbers.pivot[k])
    e = np.stack(across(numbers.lead[group]))
    at = numbers.turn + 2 * group
    direction = direction + numbers.along[k] * (step[at : at + 2] @ e) / LEVER
    return _moved(surface, step[numbers.own[k]], direction / np.linalg.norm(direction), numbers.pivot[k])


def _moved_faces(faces: Faces, numbers: _Numbers, step: Floats) -> Faces:
    surfaces = tuple(_moved_surface(faces, numbers, step, k) for k in range(len(faces.surfaces)))
    radii = [max(b.radius + float(step[n]), 0.1) for b, n in zip(faces.blends, numbers.radius)]
    return replace(faces, surfaces=surfaces, blends=tuple(replace(b, radius=r) for b, r in zip(faces.blends, radii)))


def _newton(faces: Faces, numbers: _Numbers, ends: Ends) -> Faces:
    """The faces after Newton's steps."""
    return damped_newton(_Guess(faces, numbers, ends), steps=STEPS).faces


class _Guess:
    """Faces, their free numbers, and the centres on the wrong side."""

    def __init__(self, faces: Faces, numbers: _Numbers, ends: Ends) -> None:
        self.faces, self._numbers, self._ends = faces, numbers, ends
        self._wrong = _wrong(faces, ends)
        self.badness = _badness(self._wrong)

    def step(self) -> Floats:
        return _step(self.faces, self._numbers, self._wrong)

    def moved(self, step: Floats) -> "_Guess":
        numbers = replace(self._numbers, lead=_turned(self._numbers, step))
        return _Guess(_moved_faces(self.faces, self._numbers, step), numbers, self._ends)


def _turned(numbers: _Numbers, step: Floats) -> Floats:
    """The groups' directions after a step."""
    found = numbers.lead.copy()
    for g, lead in enumerate(numbers.lead):
        at = numbers.turn + 2 * g
        turned = lead + step[at : at + 2] @ np.stack(across(lead)) / LEVER
        found[g] = turned / np.linalg.norm(turned)
    return found


_Wrong = list[tuple[Floats, Floats, float]]  # of every face: places on its wrong side, signed depths, and its outside


def _wrong(faces: Faces, ends: Ends) -> _Wrong:
    """For all surfaces, then all blends, the centres on the wrong side."""
    found = []
    for (solid, empty, outside), m in zip(_distances(faces, ends), (*faces.members, *faces.blend_members)):
        rows = [np.flatnonzero((d > 0) & (d < DEEPEST)) for d in (solid + MARGIN, MARGIN - empty)]
        places = np.concatenate([ends.solid[m[rows[0]]], ends.empty[m[rows[1]]]])
        found.append((places, np.concatenate([solid[rows[0]] + MARGIN, empty[rows[1]] - MARGIN]), outside))
    return found


def _depths(faces: Faces, ends: Ends) -> list[Floats]:
    """Of every face how far the solid or the empty centre beside each vertex is on its wrong side; else below 0."""
    return [np.maximum(solid, -empty) for solid, empty, _ in _distances(faces, ends)]


def _distances(faces: Faces, ends: Ends) -> Iterator[tuple[Floats, Floats, float]]:
    """Of every face the distances outward of its solid and its empty centres, and the sign that makes them so."""
    for surface, m in zip(faces.surfaces, faces.members):
        outside = float(np.sign(np.median((surface.normal(ends.solid[m]) * ends.normal[m]).sum(axis=1))))
        yield outside * surface.distance(ends.solid[m]), outside * surface.distance(ends.empty[m]), outside
    for blend, m in zip(faces.blends, faces.blend_members):
        solid, empty = (_ball(faces.surfaces, blend, x[m]) for x in (ends.solid, ends.empty))
        outside = float(np.sign(np.median(((ends.solid[m] - solid.centre) * ends.normal[m]).sum(axis=1))))
        yield outside * solid.distance, outside * empty.distance, outside


def _badness(wrong: _Wrong) -> float:
    """Sum of squared depths, of large ones less."""
    depth = np.abs(np.concatenate([w[1] for w in wrong]))
    return float((np.minimum(depth, PULL) * (2.0 * depth - np.minimum(depth, PULL))).sum())


def _step(faces: Faces, numbers: _Numbers, wrong: _Wrong) -> Floats:
    """All numbers' step to the least sum, as far as the depths are linear in them."""
    m, pull = np.zeros((numbers.count, numbers.count)), np.zeros(numbers.count)
    for k, (x, depth, outside) in enumerate(wrong):
        if not len(x):
            continue
        if k < len(faces.surfaces):
            columns, slope = _slopes(faces, numbers, k, x)
        else:
            columns, slope = _blend_slopes(faces, numbers, k - len(faces.surfaces), x)
        weight = np.minimum(1.0, PULL / np.maximum(np.abs(depth), 1e-9))
        weighted = (outside * slope) * weight[:, None]
        m[np.ix_(columns, columns)] += weighted.T @ (outside * slope)
        pull[columns] += weighted.T @ depth
    m[np.diag_indices(len(m))] += STEADY * max(float(m.diagonal().max(initial=0.0)), 1.0)
    return np.asarray(np.linalg.solve(m, -pull))


def _slopes(faces: Faces, numbers: _Numbers, k: int, x: Floats) -> tuple[Ints, Floats]:
    """Numbers of a surface, and the derivatives (n, numbers) of its distance from places by them."""
    group = numbers.group[k]
    turn = [] if group < 0 else [numbers.turn + 2 * group, numbers.turn + 2 * group + 1]
    columns = np.array([*range(numbers.own[k].start, numbers.own[k].stop), *turn])
    here = faces.surfaces[k].distance(x)
    slope = np.empty((len(x), len(columns)))
    for c, number in enumerate(columns.tolist()):
        step = np.zeros(numbers.count)
        step[number] = SMALL
        slope[:, c] = (_moved_surface(faces, numbers, step, k).distance(x) - here) / SMALL
    return columns, slope


def _blend_slopes(faces: Faces, numbers: _Numbers, number: int, x: Floats) -> tuple[Ints, Floats]:
    """The same of a rounding: through the two surfaces that it touches, at the ball's centre, and its radius."""
    blend = faces.blends[number]
    ball = _ball(faces.surfaces, blend, x)
    total = np.zeros((len(x), numbers.count))
    for side, k in enumerate((blend.first, blend.second)):
        columns, slope = _slopes(faces, numbers, k, ball.centre)
        total[:, columns] += ball.weight[:, side, None] * slope
    total[:, numbers.radius[number]] += -1.0 - ball.weight @ np.array(blend.sides)
    used = np.flatnonzero(np.abs(total).max(axis=0) > 0)
    return used, total[:, used]

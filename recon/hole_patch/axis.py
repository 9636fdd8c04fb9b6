"""The axis of the wheel: the line that the normals of a thrown vessel all meet.

A line with direction a through q has the moment b = q × a; the line through p along n meets it exactly when
(p × n)·a + n·b = 0, which is linear in (a, b). So the axis is the least eigenvector of a 6 × 6 matrix with |a| = 1;
fracture faces and handles, whose normals miss the axis, are weighed down round by round.

         a
      \\  |  /
     n \\ | / n       a, b   direction and moment of the axis
        \\|/          p, n   point of the surface and its normal
      ---+---

How well the line serves is said by the wall itself. Turned into one half plane it is a curve, if it was thrown; each
piece of wall, a sector wide and long enough for relief to cancel, stands off from that curve by some distance.

Paper  [pottmann1999] for the line complex, [holland1977] for the weights.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from recon.hole_patch.surroundings import Axis

__all__ = ["KEPT_TO", "coverage", "departure", "wheel_axis"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

ENOUGH_FACES = 50
SECTORS = 24
ROUNDS = 30
TALL = 0.1  # of the greatest radius, height of a ring: relief of a few millimetres cancels, slopes hardly bend
ACROSS = 0.55  # greatest |n_θ| of a wall; fractures and the sides of handles have more
FEW_SECTORS = 8  # of 24; a ring of fewer is an arc, about which a wrong axis says as much as the right one
LEVEL = 0.7  # cosine between the axis and the normals of a base
LEAST_BASE = 0.1  # of the disc around the axis, that tells where the base is
FLAT, AT_END, FLATTER = 0.9, 0.1, 3.0  # cosine of level wall, share of the height from an end, times the other's area
KEPT_TO = 0.02  # of the radius: what a hand that lifts the wet pot leaves; a squashed one is off by more


def wheel_axis(points: Floats, normals: Floats, weights: Floats) -> Axis | None:
    """The line that most normals meet, or None when the surface is not round about it.

    points, normals  (F, 3) of wall and perhaps other faces; weights (F,) areas
    Promises  direction from base to mouth: the level wall near the axis, the base, lies below the middle.
              Round means: at least 0.6 of the area recurs, at its radius, height and slope, in at least half of the
              sectors in which there is any surface (`coverage`). Broken cups reach 0.77 to 1, a bunny 0.25. How
              well the wall keeps to the wheel is said by quality and support of the axis (`departure`).
    Paper     [pottmann1999].
    """
    if len(points) < ENOUGH_FACES or not weights.sum() > 0.0:
        return None
    kept = _thinned(weights, 20_000)
    p, n, w = points[kept], normals[kept], weights[kept] * (weights.sum() / weights[kept].sum())
    found = _best_line(p, n, w)
    if found is None:
        return None
    axis = _base_down(*found, p, n, w)
    axis = replace(axis, **departure(axis, p, n, w)._asdict())
    grain = float(np.sqrt(weights.sum() / len(weights)))
    return axis if _is_round(axis, p, n, w, grain) else None


def _thinned(weights: Floats, count: int) -> Ints:
    """Up to `count` numbers, spread evenly over the total weight."""
    if len(weights) <= count:
        return np.arange(len(weights))
    total = np.cumsum(weights)
    return np.unique(np.searchsorted(total, (np.arange(count) + 0.5) / count * total[-1]))


def _best_line(p: Floats, n: Floats, w: Floats) -> tuple[Floats, Floats] | None:
    """Point and direction: the best of the robust fits from three crosswise starts."""
    centre = np.average(p, axis=0, weights=w)
    size = float(np.sqrt(np.average(((p - centre) ** 2).sum(axis=1), weights=w)))
    if not size > 0.0:
        return None
    rows = np.concatenate([np.cross((p - centre) / size, n), n], axis=1)
    fits = [_robust_complex(rows, w, start) for start in range(3)]
    cost = [np.average(np.minimum(np.abs(rows @ x) / 0.05, 1.0), weights=w) for x in fits]
    x = fits[int(np.argmin(cost))]
    a, b = x[:3], x[3:]
    return centre + size * np.cross(a, b), a


def _robust_complex(rows: Floats, w: Floats, start: int) -> Floats:
    """(6,) direction and moment; `start` picks one of the three crosswise directions of the plain least-squares fit."""
    x = _least_complex(rows, w, start)
    for scale in np.geomspace(0.5, 0.02, ROUNDS):
        x = _least_complex(rows, w / (1.0 + ((rows @ x) / scale) ** 2) ** 2, 0, near=x[:3])
    return x


def _least_complex(rows: Floats, w: Floats, which: int, near: Floats | None = None) -> Floats:
    """Eigenvector of the moments after the free part b is eliminated; `near` keeps to the direction already found."""
    m = rows.T @ (rows * w[:, None]) / w.sum()
    # the ridge stands in for the missing row of a pure cylinder, whose normals say nothing along the axis
    free = np.linalg.solve(m[3:, 3:] + 1e-9 * np.eye(3), m[3:, :3])
    values, vectors = np.linalg.eigh(m[:3, :3] - m[:3, 3:] @ free)
    if near is not None:
        which = int(np.argmax(np.abs(near @ vectors) / (values - values[0] + 0.1 * values[-1] + 1e-12)))
    a = vectors[:, which]
    b = -free @ a
    return np.concatenate([a, b - a * (a @ b)])


def _base_down(point: Floats, direction: Floats, p: Floats, n: Floats, w: Floats) -> Axis:
    """Turn the axis so that the base, level wall near it, is below the middle of the vessel."""
    axis = Axis(point, direction, 0.0)
    _, radius, height = axis.cylindrical(p).T
    near = 0.25 * float(np.quantile(radius, 0.98))
    inner = (radius < near) & (np.abs(n @ axis.direction) > LEVEL)  # not the neck of a bottle
    if w[inner].sum() < LEAST_BASE * np.pi * near**2:  # of the base what is near the axis is lost, or all
        inner = _flat_end(np.abs(n @ axis.direction), radius, height, w)
    middle = 0.5 * (np.quantile(height, 0.01) + np.quantile(height, 0.99))
    base_below = np.average(height[inner], weights=w[inner]) < middle
    direction = axis.direction if base_below else -axis.direction
    origin = axis.point + axis.direction * float(np.average(height, weights=w))
    return Axis(origin, direction, 0.0)


def _flat_end(level: Floats, radius: Floats, height: Floats, w: Floats) -> NDArray[np.bool_]:
    """(F,) faces of the end that level wall closes toward the axis, and not the other, else those of the narrow end.

    level   (F,) cosine between the axis and the faces' normals, without its sign
    """
    low, high = np.quantile(height, [0.01, 0.99])
    within = AT_END * (high - low)
    ends = height < low + within, height > high - within
    inward = [1.0 - radius / max(float(np.quantile(radius[end], 0.95)), 1e-300) for end in ends]  # a lip has none
    closed = [float((w * np.maximum(reach, 0.0))[end & (level > FLAT)].sum()) for end, reach in zip(ends, inward)]
    which = int(np.argmax(closed))
    if closed[which] > FLATTER * closed[1 - which]:
        return ends[which]
    return np.asarray(radius < np.quantile(radius, 0.1))


class Departure(NamedTuple):
    """Of a wall from a turned one: root mean square distance, and share of the turn in which the wall keeps to it."""

    quality: float
    support: float


def departure(axis: Axis, points: Floats, normals: Floats, weights: Floats) -> Departure:
    """How far a wall stands off from a wall that is turned about the axis.

    points, normals  (F, 3) of wall and perhaps other faces; weights (F,) areas
    Promises  relief counts little: distances are means over 15° of rings a tenth of the radius tall. What is far from
              the wheel (a handle, a spout) does not count in `quality`, but lessens `support`.
    """
    away, weight, sector = _stand_offs(axis, points, normals, weights)
    if not weight.sum() > 0.0:
        return Departure(float("inf"), 0.0)
    near = away <= 4.0 * _weighted_median(away, weight) + 1e-12
    quality = float(np.sqrt(np.average(away[near] ** 2, weights=weight[near])))
    allowed = KEPT_TO * float(np.quantile(axis.cylindrical(points)[:, 1], 0.95))
    kept = [_weighted_median(away[sector == k], weight[sector == k]) <= allowed for k in np.unique(sector)]
    return Departure(quality, sum(kept) / SECTORS)


def _stand_offs(axis: Axis, points: Floats, normals: Floats, weights: Floats) -> tuple[Floats, Floats, Ints]:
    """Of every piece of wall, a ring tall and a sector wide: distance from the turned wall, area and sector."""
    ring, sector, offset = _rings(axis, points, normals)
    used = ring >= 0
    piece, cell = np.unique(ring[used] * SECTORS + sector[used], return_inverse=True)
    weight: Floats = np.bincount(cell, weights[used]).astype(np.float64)
    mean = np.bincount(cell, weights[used] * offset[used]) / np.maximum(weight, 1e-300)
    row = np.unique(piece // SECTORS, return_inverse=True)[1]
    middle = np.array([_weighted_median(mean[row == k], weight[row == k]) for k in range(int(row.max(initial=-1)) + 1)])
    telling = np.bincount(row)[row] >= FEW_SECTORS
    return np.abs(mean - middle[row])[telling], weight[telling], np.asarray(piece % SECTORS, dtype=np.int64)[telling]


def _rings(axis: Axis, points: Floats, normals: Floats) -> tuple[Ints, Ints, Floats]:
    """(F,) number of the ring of each face, -1 where it is no wall, its sector, and its distance along the slope.

    A ring is a strip of height on steep wall, of radius on level wall, outside and inside apart; the distance is that
    of the face's plane from the middle of the strip.
    """
    angle, radius, height = axis.cylindrical(points).T
    out = points - axis.point - height[:, None] * axis.direction
    n_r, n_z = (normals * out).sum(axis=1) / np.maximum(radius, 1e-12), normals @ axis.direction
    tall = TALL * float(np.quantile(radius, 0.95))
    steep = np.abs(n_r) >= np.abs(n_z)
    along, off = np.where(steep, height, radius), np.where(steep, radius, height)
    n_along, n_off = np.where(steep, n_z, n_r), np.where(steep, n_r, n_z)
    strip = np.floor((along - along.min()) / tall)
    # the plane through the face, read off at the middle of its strip
    offset = off + n_along / np.where(n_off == 0.0, 1.0, n_off) * (along - along.min() - (strip + 0.5) * tall)
    side = 2 * steep + (n_off > 0.0)
    wall = n_r**2 + n_z**2 > 1.0 - ACROSS**2
    sector = np.floor((angle / (2.0 * np.pi) + 0.5) * SECTORS).astype(np.int64) % SECTORS
    return np.where(wall, strip.astype(np.int64) * 4 + side, -1), sector, offset


def _weighted_median(values: Floats, w: Floats) -> float:
    order = np.argsort(values)
    total = np.cumsum(w[order])
    return float(values[order[np.searchsorted(total, 0.5 * total[-1])]])


def coverage(axis: Axis, points: Floats, normals: Floats, *, step: float, among: NDArray[np.bool_]) -> Ints:
    """(F,) in how many of 24 sectors about the axis some face of like radius, height and slope is found.

    step    length: radii and heights are alike within about one step, normals within about 20°
    among   (F,) the faces that may be counted
    """
    key, sector = _signature(axis, points, normals, step)
    base = key.min(axis=0) - 1
    size = key.max(axis=0) - base + 2
    flat = np.ravel_multi_index(tuple((key - base).T), tuple(size))
    cells, cell_of_face = np.unique(flat, return_inverse=True)
    bits = np.zeros(len(cells), dtype=np.int64)
    np.bitwise_or.at(bits, cell_of_face[among], np.int64(1) << sector[among])
    around = np.zeros(len(cells), dtype=np.int64)
    for shift in np.ndindex(3, 3, 3, 3):
        there = cells + int(np.dot(np.array(shift) - 1, np.cumprod([1, *size[:0:-1]])[::-1]))
        at = np.minimum(np.searchsorted(cells, there), len(cells) - 1)
        around |= np.where(cells[at] == there, bits[at], 0)
    return np.bitwise_count(around).astype(np.int64)[cell_of_face]


def _signature(axis: Axis, points: Floats, normals: Floats, step: float) -> tuple[Ints, Ints]:
    """Cell (radius, height, n_r, n_z) of every face, and its sector."""
    angle, radius, height = axis.cylindrical(points).T
    out = points - axis.point - height[:, None] * axis.direction
    n_r = (normals * out).sum(axis=1) / np.maximum(radius, 1e-12)
    n_z = normals @ axis.direction
    slope = 0.25
    key = np.floor(np.stack([radius / step, height / step, n_r / slope, n_z / slope], axis=1)).astype(np.int64)
    return key, np.floor((angle / (2.0 * np.pi) + 0.5) * SECTORS).astype(np.int64) % SECTORS


def _is_round(axis: Axis, p: Floats, n: Floats, w: Floats, grain: float) -> bool:
    step = max(0.02 * float(np.quantile(axis.cylindrical(p)[:, 1], 0.95)), 0.5 * grain)
    everywhere = np.ones(len(p), dtype=bool)
    _, sector = _signature(axis, p, n, step)
    seen = coverage(axis, p, n, step=step, among=everywhere)
    recurs = seen >= max(3, 0.5 * len(np.unique(sector)))
    return float(w[recurs].sum()) >= 0.6 * float(w.sum())

"""Borders that run round the whole axis: the mouth, a base that was not scanned, and the holes that run into them.

----------.       .----------  level of the rim: the circle that most of the border keeps to
           \\     /
            \\   /             excursion: the hole; it is cut off along the virtual curve, which runs on from
             '-'              the rim on both sides of it

The virtual curve of the paper is one cubic through the rims of both sherds. Here it is a cubic in the angle about the
axis, so that it follows the wheel however wide the gap is.

A hole that runs from the mouth down to a base that was not scanned joins both borders to one line, which goes round the
axis once each way. It is cut off at both levels, on two virtual curves.

Paper  [kinoshita], section 3.3, the virtual curve.
"""

import numpy as np
from numpy.typing import NDArray

from recon.hole_patch.hole_edges import Cycle
from recon.hole_patch.section_samples import wrapped
from recon.hole_patch.surroundings import BRIDGE, Axis

__all__ = ["between_rims", "comes_near", "excursions", "sweep", "winding"]

RIM_SHARE, SHORTEST_RIM = 0.5, 6.0  # of the gap's width, and in edge lengths: rim that the virtual curve is fitted to
WORN = 4.0  # edge lengths of rim beside the gap that are not believed: the fracture begins before the level is left
NEAR = 0.5  # of a line's largest radius: the foot of a vessel whose base was not scanned is evener than that
ROUNDS = 4  # of fitting and weighting by nearness

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def _turns(cycle: Cycle, axis: Axis) -> Floats:
    """(n,) angle about the axis from each point to the next."""
    angle = axis.cylindrical(cycle.points)[:, 0]
    return np.asarray(np.angle(np.exp(1j * (np.roll(angle, -1) - angle))))


def winding(cycle: Cycle, axis: Axis) -> int:
    """How often a closed line runs round the axis: -1 above a wall (a mouth), +1 below it (a base), 0 for a hole."""
    return round(float(_turns(cycle, axis).sum()) / (2.0 * np.pi))


def sweep(cycle: Cycle, axis: Axis) -> float:
    """Angle about the axis that a closed line covers, in radians."""
    return float(np.ptp(np.cumsum(_turns(cycle, axis))))


def comes_near(cycle: Cycle, axis: Axis) -> bool:
    """Whether a line round the axis comes so near to it that it must run over the base: it bounds a hole there."""
    radius = axis.cylindrical(cycle.points)[:, 1]
    return bool(radius.min() < NEAR * radius.max())


def excursions(cycle: Cycle, axis: Axis, spacing: float) -> list[Cycle]:
    """Where a line round the axis leaves the level it keeps to otherwise: closed lines, cut off at that level.

    spacing   edge length; what stays within a few of it belongs to the rim
    A line that keeps to no level, as the edge of a vessel broken in half, has no excursions.
    """
    _, radius, height = axis.cylindrical(cycle.points).T
    share = np.abs(_turns(cycle, axis))
    level = np.array([_weighted_median(radius, share), _weighted_median(height, share)])
    off = np.hypot(radius - level[0], height - level[1])
    usual = _weighted_median(off, share)
    reach = max(2.0 * spacing, 4.0 * usual)
    away = off > reach
    if usual > 2.0 * spacing or away.all() or not away.any():
        return []
    deep = [rows for rows in _runs(away) if off[rows].max() > 2.0 * reach and len(rows) > 4]
    holes = [_down_to_rim(rows, cycle.points, off) for rows in deep]
    rim = (off <= reach) & (cycle.sherds != BRIDGE)
    for rows in holes:
        rim[rows] = False
    return [_cut_off(cycle, axis, rows, rim=rim, spacing=spacing) for rows in holes]


def _down_to_rim(rows: Ints, points: Floats, off: Floats) -> Ints:
    """The run with what leads to it and from it, as long as that goes rather towards the rim than along it."""
    n = len(off)

    def lead(start: int, step: int) -> int:
        ahead = (start + step * np.arange(min(n // 4, 200))) % n
        way = np.cumsum(np.linalg.norm(np.diff(points[ahead], axis=0), axis=1))
        return step * int(np.argmin(off[ahead] + 0.45 * np.concatenate([[0.0], way])))

    first, last = int(rows[0]), int(rows[0]) + len(rows) - 1
    return np.arange(first + lead(first, -1), last + lead(last, 1) + 1) % n


def _weighted_median(values: Floats, weights: Floats) -> float:
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order[np.searchsorted(total, 0.5 * total[-1])]])


def _runs(flags: NDArray[np.bool_]) -> list[Ints]:
    """Cyclic rows of numbers where the flags hold, each with the point before and the point after."""
    n = len(flags)
    starts = np.flatnonzero(flags & ~np.roll(flags, 1))
    ends = np.flatnonzero(flags & ~np.roll(flags, -1))
    ends = np.roll(ends, -int(np.searchsorted(ends, starts[0])))
    return [np.arange(s - 1, s + (e - s) % n + 2) % n for s, e in zip(starts, ends)]


def between_rims(cycle: Cycle, axis: Axis, spacing: float) -> Cycle | None:
    """The hole of a line that runs round the mouth, down to the base, round it and up again: cut off at both levels.

    spacing   edge length
    None where the line keeps to no level at the mouth or at the base, or leaves them more than once.
    """
    turns = _turns(cycle, axis)
    mouth, base = (_level(cycle, axis, np.clip(sign * turns, 0.0, None), spacing) for sign in (-1.0, 1.0))
    if mouth is None or base is None or (mouth[1] & base[1]).any():
        return None
    sides = _runs(~(mouth[1] | base[1]))
    down = [rows for rows in sides if mouth[1][rows[0]] and base[1][rows[-1]]]
    up = [rows for rows in sides if base[1][rows[0]] and mouth[1][rows[-1]]]
    if len(down) != 1 or len(up) != 1:
        return None
    off = np.minimum(mouth[0], base[0])
    first, second = (_down_to_rim(rows, cycle.points, off) for rows in (down[0], up[0]))
    # each rim is followed from the one side round the vessel to the other: the hole lies the short way
    bridges = []
    for before, after, at_rim, whole in ((first, second, base[1], 2 * np.pi), (second, first, mouth[1], -2 * np.pi)):
        passed = _cyclic(int(before[-1]), int(after[0]), len(turns))
        rows = _cyclic(int(after[0]), int(before[-1]), len(turns))
        turn = float(turns[passed[:-1]].sum()) - whole
        rim = at_rim & (cycle.sherds != BRIDGE)
        rim[np.concatenate([first, second])] = False
        bridges.append(_bridge(cycle, axis, rows, turn=turn, rim=rim, spacing=spacing))
    return _row_of(cycle, [first, second], bridges)


def _level(cycle: Cycle, axis: Axis, share: Floats, spacing: float) -> tuple[Floats, NDArray[np.bool_]] | None:
    """(n,) distance from the level that the share of the line keeps to, and whether it stays within reach of it."""
    _, radius, height = axis.cylindrical(cycle.points).T
    off = np.hypot(radius - _weighted_median(radius, share), height - _weighted_median(height, share))
    usual = _weighted_median(off, share)
    return None if usual > 2.0 * spacing else (off, off <= max(2.0 * spacing, 4.0 * usual))


def _cyclic(first: int, last: int, n: int) -> Ints:
    """Numbers from the first to the last, round the end of n."""
    return (first + np.arange((last - first) % n + 1)) % n


def _cut_off(cycle: Cycle, axis: Axis, rows: Ints, *, rim: NDArray[np.bool_], spacing: float) -> Cycle:
    """The part of a line that left the rim, closed along the virtual curve.

    rim   (n,) points of the line that were measured on the rim
    """
    turn = -float(_turns(cycle, axis)[rows[:-1]].sum())
    return _row_of(cycle, [rows], [_bridge(cycle, axis, rows, turn=turn, rim=rim, spacing=spacing)])


def _row_of(cycle: Cycle, parts: list[Ints], bridges: list[tuple[Floats, Floats]]) -> Cycle:
    """Parts of a line, each followed by its bridge, as a line of its own."""
    points, normals, sherds, walls = [], [], [], []
    for rows, (arc, ups) in zip(parts, bridges):
        points += [cycle.points[rows], arc]
        normals += [cycle.normals[rows], ups]
        sherds += [cycle.sherds[rows], np.full(len(arc), BRIDGE)]
        walls += [cycle.walls[rows], np.full(len(arc), cycle.walls[rows[0]])]
    return Cycle(
        np.concatenate(points), np.concatenate(normals), np.concatenate(sherds), np.concatenate(walls), cycle.gap
    )


def _bridge(
    cycle: Cycle, axis: Axis, rows: Ints, *, turn: float, rim: NDArray[np.bool_], spacing: float
) -> tuple[Floats, Floats]:
    """(k, 3) points and (k, 3) normals from the last of the rows to the first, `turn` radians about the axis."""
    ends = axis.cylindrical(cycle.points[rows[[-1, 0]]])
    count = int(abs(turn) * ends[:, 1].mean() / spacing)
    t = np.arange(1, count + 1) / (count + 1)
    arc = _virtual_curve(cycle, axis, rows, turn=turn, rim=rim, t=t, spacing=spacing)
    if arc is None:
        arc = ends[0] + t[:, None] * (np.array([ends[0, 0] + turn, *ends[1, 1:]]) - ends[0])
    t = t[:, None]
    return axis.cartesian(arc), (1 - t) * cycle.normals[rows[-1]] + t * cycle.normals[rows[0]]


def _virtual_curve(
    cycle: Cycle, axis: Axis, rows: Ints, *, turn: float, rim: NDArray[np.bool_], t: Floats, spacing: float
) -> Floats | None:
    """(k, 3) angle, radius and height at shares t of the gap from the last of the rows to the first, on one cubic
    through the rim on both sides; None where either side has too little of it.
    """
    n = len(cycle.points)
    angle, radius, height = axis.cylindrical(cycle.points).T
    first, last = int(rows[0]), int(rows[-1])
    width = abs(turn) * float(np.median(radius[rim])) if rim.any() else 0.0
    sides = []
    for start, step in ((last, 1), (first, -1)):
        beside = (start + step * np.arange(1, n - len(rows))) % n
        way = np.linalg.norm(np.diff(cycle.points[np.append(start, beside)], axis=0), axis=1).cumsum()
        way = way - WORN * spacing
        beside = beside[(way > 0.0) & (way < max(RIM_SHARE * width, SHORTEST_RIM * spacing)) & rim[beside]]
        sides.append(beside)
    if min(map(len, sides)) < SHORTEST_RIM / 2:
        return None
    share = [wrapped(angle[side] - angle[start]) / turn for side, start in zip(sides, (last, first))]
    at = np.concatenate([share[0], 1.0 + share[1]])
    place = np.column_stack([radius, height])[np.concatenate(sides)]
    powers, weight = np.vander(at, 4), np.ones(len(at))
    for _ in range(ROUNDS):
        root = np.sqrt(weight)[:, None]
        cubic = np.linalg.lstsq(root * powers, root * place, rcond=None)[0]
        off = np.linalg.norm(place - powers @ cubic, axis=1)
        weight = 1.0 / np.maximum(off, 1e-3 + np.median(off))
    return np.column_stack([angle[last] + t * turn, np.vander(t, 4) @ cubic])

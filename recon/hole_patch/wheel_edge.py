"""The edge of a hole laid flat on the wheel: what is no edge cut off, chips told from the rest, even steps along it.

Paper  [kinoshita], section 3.4, step 1, for the edge; chips and strays are ours.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from recon.hole_patch.edge_cleaning import clean_rows
from recon.hole_patch.surroundings import Axis, HoleEdge, Wall
from recon.hole_patch.unit_length import axis_in, unit_length, wall_in
from recon.hole_patch.wheel_chart import WheelChart, wheel_chart

__all__ = [
    "ASTRAY",
    "DOWN",
    "MARGIN",
    "clean_wall",
    "even_edge",
    "loop_length",
    "sound_points",
    "unchipped",
    "with_clean_edge",
]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

# lengths in units of the vessel (`recon.hole_patch.unit_length`) where nothing else is said
MARGIN = 5.0  # of face beyond the hole, so that no trim curve comes near the border
SMOOTHED = 0.8  # along the edge: shorter than any relief
SPACING = 0.2  # between points of the edge where e is known
REJECTED = 0.02  # largest share of edge points that may be taken for chips
SMALLEST_CHIP = 0.2  # mm; what stands off by less is relief or noise
BESIDE, MOST_BESIDE = 2.5, 4.0  # mm of edge to either side that a chip stands off from, and at most so many units
ASTRAY = 1.25  # no relief or pose stands so far off where most of the edge does not
DOWN = 0.3  # mm, most depth times slope of relief at the edge: cords are deep where they are level
JUMP = 10.0  # farther along the wall than in space: to the other side of it, and no cut corner
SHORT = 0.05  # of the edge's points: a stretch between two jumps that is no side of the hole


def clean_wall(wall: Wall, axis: Axis) -> Wall:
    """The wall with the edge of its hole as `wheel_sheet` draws the face to it: `Sheet.sound` counts its points."""
    if wall.edge.normals is None:
        return wall
    unit = unit_length(wall, axis)
    scaled = wall_in(wall, unit)
    edge = with_clean_edge(scaled, wheel_chart(scaled, axis_in(axis, unit)), DOWN / unit).edge
    return replace(wall, edge=HoleEdge(edge.points * unit, edge.sherds, edge.normals))


def with_clean_edge(wall: Wall, chart: WheelChart, down: float = DOWN) -> Wall:
    """The wall with what is no edge of it cut off from the hole's edge: spikes, hairs and crossings in the chart, and
    stretches that run down into the fracture, which is deep and steep at once.
    """
    edge = _without_strays(wall.edge, chart)
    steps = np.linalg.norm(np.diff(edge.points, axis=0, append=edge.points[:1]), axis=1)
    flat = chart.flat(edge.points, edge.normals)
    # in space the edge on one wall may be nearer to that on the other than a hair is wide
    rows = clean_rows(chart.unfolded(flat[:, :2]), flat[:, :2], float(np.median(steps)))
    if edge.normals is None:
        return replace(wall, edge=HoleEdge(edge.points[rows], edge.sherds[rows]))
    points, flat, normals = edge.points[rows], flat[rows], edge.normals[rows]
    outward = np.einsum("ij,ij->i", chart.space(flat + np.array([0.0, 0.0, 1.0])) - points, normals)
    steep = np.sqrt(1.0 / np.clip(outward, 1e-3, 1.0) ** 2 - 1.0)
    deep = _running_median(flat[:, 2], loop_length(points), 4.0 * MARGIN) - flat[:, 2]
    on_wall = deep * steep < down
    return replace(wall, edge=HoleEdge(points[on_wall], edge.sherds[rows][on_wall], normals[on_wall]))


def _without_strays(edge: HoleEdge, chart: WheelChart) -> HoleEdge:
    """The edge without points laid on the other wall, by their normal or for a short stretch of the line: to the chart
    it jumps there and back, and what lies between would be cut off as a hair.
    """
    if edge.normals is None:
        return edge
    off = chart.flat(edge.points, edge.normals)[:, 2]
    rows = np.flatnonzero(np.abs(off - _running_median(off, loop_length(edge.points), 4.0 * MARGIN)) < ASTRAY)
    points = edge.points[rows]
    place = chart.unfolded(chart.flat(points, edge.normals[rows])[:, :2])
    along, across = (np.linalg.norm(np.roll(x, -1, axis=0) - x, axis=1) for x in (place, points))
    # runs between jumps; the first goes on in the last
    run = np.roll(np.cumsum(along > across + JUMP), 1)
    run[0] = 0
    run[run == run.max()] = 0 if along[-1] <= across[-1] + JUMP else run.max()
    rows = rows[(np.bincount(run) > SHORT * len(rows))[run]]
    return HoleEdge(edge.points[rows], edge.sherds[rows], edge.normals[rows])


def sound_points(left: Floats, length: Floats, measured: Bools, unit: float) -> Bools:
    """(n,) points of the edge that were measured, on the wall, and are no chips.

    A chip stands off from the edge around it; a stretch that strayed into the fracture, from all the rest.
    """
    astray = np.abs(left - np.median(left[measured]))
    on_wall = astray <= max(6.0 * 1.4826 * float(np.median(astray[measured])), ASTRAY)
    return on_wall & unchipped(left, length, measured, unit)


def unchipped(left: Floats, length: Floats, measured: Bools, unit: float) -> Bools:
    """(n,) points of the edge that were measured and do not stand off from the edge around them.

    left    (n,) e along the edge, in units
    length  (n + 1,) along it
    """
    off = np.abs(left - _running_median(left, length, min(BESIDE / unit, MOST_BESIDE)))
    usual = 1.4826 * float(np.median(off[measured]))
    allowed = float(np.quantile(off[measured], 1.0 - REJECTED, method="higher"))  # never more than the share
    return measured & (off <= max(6.0 * usual, allowed, SMALLEST_CHIP / unit))


def loop_length(loop: Floats) -> Floats:
    """(n + 1,) length along a closed polyline at its points and, last, all around."""
    steps = np.linalg.norm(np.diff(loop, axis=0, append=loop[:1]), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _running_median(values: Floats, length: Floats, half_width: float) -> Floats:
    """(n,) median of the values within a half width on either side along a closed polyline."""
    n = max(32, round(10 * length[-1] / half_width))
    at = np.linspace(0.0, length[-1], n, endpoint=False)
    even = np.interp(at, length[:-1], values, period=length[-1])
    median = np.median([np.roll(even, k) for k in range(-10, 11)], axis=0)
    return np.interp(length[:-1], at, median, period=length[-1])


def even_edge(edge: Floats, left: Floats, sound: Bools) -> Floats:
    """(k, 3) u, s and e at even steps along the edge, e averaged over `SMOOTHED`, bridges and chips filled."""
    length = loop_length(edge[:, :2])
    at = np.linspace(0.0, length[-1], max(16, round(length[-1] / SPACING)), endpoint=False)
    place = [np.interp(at, length[:-1], column, period=length[-1]) for column in edge[:, :2].T]
    e = np.interp(at, length[:-1][sound], left[sound], period=length[-1])
    half = round(0.5 * SMOOTHED / SPACING)
    return np.stack([*place, np.mean([np.roll(e, k) for k in range(-half, half + 1)], axis=0)], axis=1)

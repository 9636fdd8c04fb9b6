"""A row of points in the half plane to lines, arcs and splines that meet in sharp corners.

    points  ----.         corner  where the directions over a few voxels before and after differ
                 \\        run     the points from corner to corner, without those that the voxels rounded off
                  \\       piece   a line where one is near enough, else an arc, else a spline with few knots

A run is carried on over its end to where it meets the next: that is the true edge.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_lsq_spline

from recon.geometry.bspline import BSplineCurve
from recon.geometry.turned import ProfileArc, ProfileLine, ProfilePiece, ProfileSpline

__all__ = ["profile_pieces"]

Floats = NDArray[np.float64]

STEP = 0.5  # voxels between the points of a row
ARM = 6  # points before and after that show a corner
SHARPEST = 50.0  # degrees of a turn that is a corner, whatever lies around
EXCESS = 15.0  # or so many more than the turns before and after it: a bend goes on, a corner does not
BESIDE = 9  # points from a corner to where neither arm reaches it
APART = 8  # points between corners
ROUNDED, SHALLOW = 5, 2  # points at either side of a corner that the voxels rounded off, and of a shallow one
BLUNT = 35.0  # degrees of a corner that is shallow
OFF, RMS = 0.35, 0.12  # voxels that a piece may be off its points
SPLINE_OFF = 0.2
STRAIGHT = np.sin(np.radians(0.5))  # a line this near to the axis or to its normal runs along it
EDGE = 12  # points at the end of a spline that show how it goes on


@dataclass(frozen=True, eq=False)
class _Line:
    point: Floats
    direction: Floats

    def at(self, s: float) -> Floats:
        return np.asarray(self.point + s * self.direction)

    def parameter(self, p: Floats) -> float:
        return float((p - self.point) @ self.direction)

    def off(self, p: Floats) -> Floats:
        arm = p - self.point
        return np.abs(arm[:, 0] * self.direction[1] - arm[:, 1] * self.direction[0])


@dataclass(frozen=True, eq=False)
class _Circle:
    centre: Floats
    radius: float

    def at(self, s: float) -> Floats:
        return np.asarray(self.centre + self.radius * np.array([np.cos(s / self.radius), np.sin(s / self.radius)]))

    def parameter(self, p: Floats) -> float:
        arm = p - self.centre
        return float(self.radius * np.arctan2(arm[1], arm[0]))

    def off(self, p: Floats) -> Floats:
        return np.abs(np.linalg.norm(p - self.centre, axis=1) - self.radius)


_Guide = _Line | _Circle


def profile_pieces(row: Floats) -> list[ProfilePiece]:
    """Pieces of a row of points (n, 2) as (r, z): closed where it ends in its first point, else from axis to axis."""
    closed = bool(np.linalg.norm(row[0] - row[-1]) < 1e-9)
    points = _even(row)
    corners, turns = _corners(points, closed)
    if closed:
        points = np.concatenate([np.roll(points[:-1], -corners[0] if corners else 0, axis=0)] * 2)[: len(points)]
        cuts = [*(c - corners[0] for c in corners), len(points) - 1] if corners else [0, len(points) - 1]
        turns = [*turns, *turns[:1]] if corners else [0.0, 0.0]
    else:
        cuts, turns = [0, *corners, len(points) - 1], [0.0, *turns, 0.0]
    if closed and len(cuts) == 2:
        cuts, turns = [0, len(points) // 2, cuts[1]], [turns[0], 0.0, turns[1]]
    runs = [_trimmed(points[a : b + 1], *turns[k : k + 2]) for k, (a, b) in enumerate(pairwise(cuts))]
    guides = [_guide(run) for run in runs]
    ends = [points[c] for c in cuts]
    if corners or not closed:
        ends = _true_corners(ends, runs, guides, closed)
    return [_piece(run, guide, a, b) for run, guide, a, b in zip(runs, guides, ends[:-1], ends[1:])]


def _even(row: Floats) -> Floats:
    """The row at even steps."""
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(row, axis=0), axis=1))])
    at = np.linspace(0.0, length[-1], max(12, round(length[-1] / STEP)) + 1)
    return np.column_stack([np.interp(at, length, row[:, k]) for k in range(2)])


def _corners(points: Floats, closed: bool) -> tuple[list[int], list[float]]:
    """Points where the row turns sharply, the sharpest of each neighbourhood, and by how many degrees."""
    n = len(points) - 1 if closed else len(points)
    turn = _turns(points[:n], closed)
    index = np.arange(n)
    before, after = index - BESIDE, index + BESIDE
    before, after = (before % n, after % n) if closed else (np.maximum(before, 0), np.minimum(after, n - 1))
    more = np.abs(turn) - 0.5 * np.abs(turn[before] + turn[after])
    size = np.maximum(more / EXCESS, np.abs(turn) / SHARPEST)
    found: list[int] = []
    for i in np.argsort(-size).tolist():
        if size[i] < 1.0:
            break
        if all((min(abs(i - j), n - abs(i - j)) if closed else abs(i - j)) >= APART for j in found):
            found.append(i)
    found.sort()
    return found, turn[found].tolist()


def _turns(points: Floats, closed: bool) -> Floats:
    """Degrees by which the row turns left between the chords before and after each point; none beside open ends."""
    n = len(points)
    index = np.arange(n)
    if closed:
        a, b = points - points[(index - ARM) % n], points[(index + ARM) % n] - points
    else:
        a, b = points - points[np.maximum(index - ARM, 0)], points[np.minimum(index + ARM, n - 1)] - points
    turn = np.degrees(np.arctan2(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], (a * b).sum(axis=1)))
    return turn if closed else np.where((index > ARM) & (index < n - ARM - 1), turn, 0.0)


def _trimmed(run: Floats, start: float, end: float) -> Floats:
    """The run without what the voxels rounded off at its corners, of so many degrees, where enough is left."""
    most = max(0, (len(run) - 5) // 2)
    drop = [0 if turn == 0 else min(most, SHALLOW if abs(turn) < BLUNT else ROUNDED) for turn in (start, end)]
    return run[drop[0] : len(run) - drop[1]]


def _guide(run: Floats) -> _Guide | None:
    """Line or circle that a run keeps to; None where it keeps to neither."""
    line = _fitted_line(run)
    if _near(line, run):
        return line
    circle = _fitted_circle(run)
    return circle if circle is not None and _near(circle, run) else None


def _near(guide: _Guide, run: Floats) -> bool:
    return bool(guide.off(run).max() <= OFF and _rms(guide, run) <= RMS)


def _rms(guide: _Guide, run: Floats) -> float:
    return float(np.sqrt((guide.off(run) ** 2).mean()))


def _fitted_line(run: Floats) -> _Line:
    centre = run.mean(axis=0)
    direction = np.linalg.eigh((run - centre).T @ (run - centre))[1][:, 1]
    direction = direction if (run[-1] - run[0]) @ direction >= 0 else -direction
    k = int(np.abs(direction).argmax())
    if abs(direction[1 - k]) < max(STRAIGHT, 0.1 / len(run)):
        direction = np.where(np.arange(2) == k, np.sign(direction[k]), 0.0)
    return _Line(centre, direction)


def _fitted_circle(run: Floats) -> _Circle | None:
    centre = run.mean(axis=0)
    p = run - centre
    c = np.linalg.lstsq(np.column_stack([2 * p, np.ones(len(p))]), (p**2).sum(axis=1), rcond=None)[0]
    square = c[2] + c[:2] @ c[:2]
    if not 0 < square < 1e8:
        return None
    c, radius = c[:2] + centre, float(np.sqrt(square))
    if abs(c[0]) < 0.4 and min(run[0, 0], run[-1, 0]) < 1.0:  # a ball's circle has its centre on the axis
        c = np.array([0.0, c[1]])
        radius = float(np.linalg.norm(run - c, axis=1).mean())
    return _Circle(c, radius)


def _true_corners(ends: list[Floats], runs: list[Floats], guides: list[_Guide | None], closed: bool) -> list[Floats]:
    """Where each run, carried on, meets the next; on the axis where the row ends there."""
    n = len(runs)
    moved = []
    for k, end in enumerate(ends):
        before, after = (k - 1) % n, k % n
        if not closed and k in (0, n):
            run = after if k == 0 else n - 1
            moved.append(_on_axis(end, guides[run] or _end_guide(runs[run], at_end=k == n)))
            continue
        one = guides[before] or _end_guide(runs[before], at_end=True)
        other = guides[after] or _end_guide(runs[after], at_end=False)
        moved.append(_meeting(one, other, end))
    return moved


def _end_guide(run: Floats, *, at_end: bool) -> _Guide:
    part = run[-EDGE:] if at_end else run[:EDGE]
    circle, line = _fitted_circle(part), _fitted_line(part)
    if circle is None or _rms(circle, part) > 0.5 * _rms(line, part):
        return line
    return circle


def _on_axis(near: Floats, guide: _Guide) -> Floats:
    if isinstance(guide, _Line) and abs(guide.direction[0]) > 0.5:
        return np.array([0.0, guide.at(-guide.point[0] / guide.direction[0])[1]])
    if isinstance(guide, _Circle) and abs(guide.centre[0]) < guide.radius:
        up = np.sqrt(guide.radius**2 - guide.centre[0] ** 2)
        return np.array([0.0, min((guide.centre[1] + up, guide.centre[1] - up), key=lambda z: abs(z - near[1]))])
    return np.array([0.0, near[1]])


def _meeting(one: _Guide, other: _Guide, near: Floats) -> Floats:
    """Where two guides meet, by Newton's steps from near there; the place itself where they run side by side."""
    s, t = one.parameter(near), other.parameter(near)
    for _ in range(12):
        gap = one.at(s) - other.at(t)
        slope = np.column_stack([one.at(s + 1e-4) - one.at(s - 1e-4), other.at(t - 1e-4) - other.at(t + 1e-4)]) / 2e-4
        if abs(np.linalg.det(slope)) < 0.1:
            return near
        step = np.linalg.solve(slope, -gap)
        s, t = s + float(step[0]), t + float(step[1])
    found = one.at(s)
    return found if np.linalg.norm(found - near) < 4.0 else near


def _piece(run: Floats, guide: _Guide | None, start: Floats, end: Floats) -> ProfilePiece:
    if isinstance(guide, _Line):
        return ProfileLine(start, end)
    if isinstance(guide, _Circle):
        between = guide.parameter(run[len(run) // 2])
        return ProfileArc(start, guide.at(between), end)
    return ProfileSpline(_spline(np.concatenate([start[None], run, end[None]])))


def _spline(points: Floats) -> BSplineCurve:
    """Cubic through both ends, with as few knots as bring it near enough to all points."""
    points = points[np.concatenate([[True], np.linalg.norm(np.diff(points, axis=0), axis=1) > 1e-6])]
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    t = length / length[-1]
    weight = np.ones(len(t))
    weight[[0, -1]] = 1e4
    for spans in range(1, max(2, len(t) // 8)):
        knots = np.concatenate([[0.0] * 4, np.linspace(0, 1, spans + 1)[1:-1], [1.0] * 4])
        fitted = make_lsq_spline(t, points, knots, k=3, w=weight)
        off = np.linalg.norm(fitted(t) - points, axis=1)[1:-1]
        if off.max() <= SPLINE_OFF and np.sqrt((off**2).mean()) <= 0.5 * RMS:
            break
    control = fitted.c.copy()
    control[0], control[-1] = points[0], points[-1]
    return BSplineCurve(3, knots, control)

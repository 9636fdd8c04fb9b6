"""Quadrilaterals of a mesh in rectangles.

Between tracks (`tracks`) the parts of a mesh are rectangles as they are. Where there are no tracks, as in a ring or a
torus without irregular vertices, rectangles are grown from seeds, and the largest is taken, again and again.
"""

from heapq import heapify, heappop, heappush
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

__all__ = ["Rectangle", "rectangles"]

Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

MAX_REACH = 100  # quads from its seed to a side of a rectangle
EFFORT = 3000  # steps spent on the search for large rectangles, a quad
WAYS = 3  # to grow a rectangle


class Rectangle(NamedTuple):
    """Quads in rows; faces (n, m) row by row, and (n, m) the side of each that lies at the bottom."""

    faces: Ints
    turns: Ints


class _Box(NamedTuple):
    """Columns and rows of the grid that a rectangle takes up, and by which way it grew."""

    left: int
    right: int
    bottom: int
    top: int
    way: int

    @property
    def area(self) -> int:
        return (self.right - self.left + 1) * (self.top - self.bottom + 1)


def rectangles(faces: Ints, across: Ints) -> list[Rectangle]:
    """All quads in few rectangles, none of which meets itself along a side or at a vertex.

    faces   (F, 4) vertices
    across  (F, 4) sides across; -1 where a rectangle must end
    """
    search = _Search(across)
    found = [*search.whole_parts(), *search.largest_first()]
    return [part for rectangle in found for part in _apart(faces, rectangle)]


def _apart(faces: Ints, rectangle: Rectangle) -> list[Rectangle]:
    """The rectangle, cut between two places of its border where it meets itself at a vertex."""
    n, m = rectangle.faces.shape
    vertices = np.empty((n + 1, m + 1), dtype=np.int64)
    for side, (j, i) in enumerate(((0, 0), (0, 1), (1, 1), (1, 0))):
        corners = faces[rectangle.faces, (rectangle.turns + side) % 4]
        vertices[j : j + n, i : i + m] = corners
    inner = np.zeros(vertices.shape, dtype=bool)
    inner[1:-1, 1:-1] = True
    places = np.argwhere(~inner)
    order = np.argsort(vertices[~inner], kind="stable")
    twice = np.flatnonzero(np.diff(vertices[~inner][order]) == 0)
    if not len(twice):
        return [rectangle]
    pair = places[order[twice[0] : twice[0] + 2]]
    axis = int(np.abs(pair[1] - pair[0]).argmax())
    halves = (np.split(part, [int(pair[:, axis].sum()) // 2], axis=axis) for part in rectangle)
    return [part for half in zip(*halves) for part in _apart(faces, Rectangle(*half))]


class _Search:
    """Rectangles grown over quads that are free."""

    def __init__(self, across: Ints) -> None:
        size = 2 * MAX_REACH + 1
        self._across, self._free = across.ravel(), np.ones(len(across), dtype=np.bool_)
        self._grid, self._turns = np.zeros((size, size), dtype=np.int64), np.zeros((size, size), dtype=np.int64)
        self._stamps, self._stamp = np.full(len(across), -1), 0

    def whole_parts(self) -> list[Rectangle]:
        """The parts that hang together and are rectangles as they are."""
        found = []
        for part in self._parts():
            box = self._largest(int(part[0]))
            if box.area == len(part):
                found.append(self._taken(int(part[0]), box))
        return found

    def largest_first(self) -> list[Rectangle]:
        """What is left, the largest rectangle again and again; areas only shrink, so old ones are bounds."""
        order = np.random.default_rng(0).permutation(np.flatnonzero(self._free))
        ranked = [(-area, seed) for area, seed in zip(self._areas(order).tolist(), order.tolist())]
        heapify(ranked)
        found = []
        while ranked:
            bound, seed = heappop(ranked)
            if not self._free[seed]:
                continue
            box = self._largest(seed)
            if ranked and box.area < -bound and box.area < -ranked[0][0]:
                heappush(ranked, (-box.area, seed))
                continue
            found.append(self._taken(seed, box))
        return found

    def _parts(self) -> list[Ints]:
        n = len(self._free)
        inner = np.flatnonzero(self._across >= 0)
        pairs = inner // 4, self._across[inner] // 4
        _, part = csgraph.connected_components(sparse.coo_array((np.ones(len(inner)), pairs), shape=(n, n)))
        order = np.argsort(part, kind="stable")
        return np.split(order, np.flatnonzero(np.diff(part[order])) + 1) if n else []

    def _areas(self, order: Ints) -> Ints:
        """The area that each seed grows to; 1 for those that were not looked at."""
        areas, self._stamp = _areas(
            self._across, self._free, order, EFFORT * len(order), self._grid, self._turns, self._stamps, self._stamp
        )
        return np.asarray(areas)

    def _largest(self, seed: int) -> _Box:
        return max((self._grown(seed, way) for way in range(WAYS)), key=lambda box: box.area)

    def _grown(self, seed: int, way: int) -> _Box:
        self._stamp += 1
        box = _grow(self._across, self._free, seed, way, self._grid, self._turns, self._stamps, self._stamp)
        return _Box(*box, way)

    def _taken(self, seed: int, box: _Box) -> Rectangle:
        self._grown(seed, box.way)
        rows, columns = slice(box.bottom, box.top + 1), slice(box.left, box.right + 1)
        rectangle = Rectangle(self._grid[rows, columns].copy(), self._turns[rows, columns].copy())
        self._free[rectangle.faces] = False
        return rectangle


@njit(cache=True)
def _areas(
    across: Ints, free: Bools, order: Ints, effort: int, grid: Ints, turns: Ints, stamps: Ints, stamp: int
) -> tuple[Ints, int]:
    """The area that each seed grows to, until the effort is spent, 1 for those that were not looked at; the last
    stamp."""
    areas = np.ones(len(order), dtype=np.int64)
    spent = 0
    for k, seed in enumerate(order):
        for way in range(WAYS):
            stamp += 1
            left, right, bottom, top = _grow(across, free, seed, way, grid, turns, stamps, stamp)
            area = (right - left + 1) * (top - bottom + 1)
            areas[k] = max(areas[k], area)
            spent += area
        if spent > effort:
            break
    return areas, stamp


@njit(cache=True)
def _reach(across: Ints, free: Bools, box: Ints, side: int, grid: Ints, turns: Ints, stamps: Ints, stamp: int) -> bool:
    """Add a row beyond a side of the box (left, right, bottom, top) if all its quads are free; whether it was done."""
    left, right, bottom, top = box
    if side == 0:
        count, row, column, step_row, step_column, new_row, new_column = right - left + 1, bottom, left, 0, 1, -1, 0
    elif side == 1:
        count, row, column, step_row, step_column, new_row, new_column = top - bottom + 1, bottom, right, 1, 0, 0, 1
    elif side == 2:
        count, row, column, step_row, step_column, new_row, new_column = right - left + 1, top, left, 0, 1, 1, 0
    else:
        count, row, column, step_row, step_column, new_row, new_column = top - bottom + 1, bottom, left, 1, 0, 0, -1
    size = len(grid)
    if not (0 <= row + new_row < size and 0 <= column + new_column < size):
        return False
    for k in range(count):
        r, c = row + k * step_row, column + k * step_column
        other = across[4 * grid[r, c] + (side + turns[r, c]) % 4]
        if other < 0 or not free[other // 4] or stamps[other // 4] == stamp:
            return False
        grid[r + new_row, c + new_column] = other // 4
        turns[r + new_row, c + new_column] = (other % 4 - side - 2) % 4
    beside = 1 if step_column == 1 else 2
    for k in range(count - 1):  # a row that is cut across has no surface of one piece
        r, c = row + new_row + k * step_row, column + new_column + k * step_column
        if across[4 * grid[r, c] + (beside + turns[r, c]) % 4] < 0:
            return False
    for k in range(count):
        r, c = row + new_row + k * step_row, column + new_column + k * step_column
        if stamps[grid[r, c]] == stamp:  # the row meets itself: take it back
            for back in range(k):
                stamps[grid[row + new_row + back * step_row, column + new_column + back * step_column]] = -1
            return False
        stamps[grid[r, c]] = stamp
    return True


@njit(cache=True)
def _meets_itself(across: Ints, box: Ints, grid: Ints, turns: Ints, stamps: Ints, stamp: int) -> int:
    """A side of the box along which the rectangle is its own neighbour; -1 where there is none."""
    left, right, bottom, top = box
    for side in range(4):
        flat = side % 2 == 0
        for k in range(right - left + 1 if flat else top - bottom + 1):
            r = (bottom if side == 0 else top) if flat else bottom + k
            c = left + k if flat else (right if side == 1 else left)
            other = across[4 * grid[r, c] + (side + turns[r, c]) % 4]
            if other >= 0 and stamps[other // 4] == stamp:
                return side
    return -1


@njit(cache=True)
def _grow(
    across: Ints, free: Bools, seed: int, way: int, grid: Ints, turns: Ints, stamps: Ints, stamp: int
) -> tuple[int, int, int, int]:
    """Grow a rectangle from a seed: all sides in turn (way 0), left and right first (1), up and down first (2)."""
    middle = len(grid) // 2
    box = np.array([middle, middle, middle, middle])
    grid[middle, middle], turns[middle, middle], stamps[seed] = seed, 0, stamp
    moves = np.array([2, 1, 3, 0])  # what side 0 .. 3 changes in the box, and by how much
    steps = np.array([-1, 1, 1, -1])
    for phase in range(2):
        going = np.ones(4, dtype=np.bool_)
        for side in range(4):
            if (way == 1 and side % 2 == phase) or (way == 2 and side % 2 != phase):
                going[side] = False
        while going.any():
            for side in range(4):
                if going[side]:
                    if _reach(across, free, box, side, grid, turns, stamps, stamp):
                        box[moves[side]] += steps[side]
                    else:
                        going[side] = False
        if way == 0:
            break
    while True:
        side = _meets_itself(across, box, grid, turns, stamps, stamp)
        if side < 0:
            return box[0], box[1], box[2], box[3]
        low, high = (2, 3) if side % 2 == 0 else (0, 1)
        if box[low] == box[high]:  # one row that closes: cut it the other way
            low, high = (0, 1) if side % 2 == 0 else (2, 3)
        kept = max((box[high] - box[low] + 1) // 2, 1)
        _stamp(box, grid, stamps, -1)
        # keep the half with the seed
        if middle < box[low] + kept:
            box[high] = box[low] + kept - 1
        else:
            box[low] = box[low] + kept
        _stamp(box, grid, stamps, stamp)


@njit(cache=True)
def _stamp(box: Ints, grid: Ints, stamps: Ints, stamp: int) -> None:
    for r in range(box[2], box[3] + 1):
        for c in range(box[0], box[1] + 1):
            stamps[grid[r, c]] = stamp

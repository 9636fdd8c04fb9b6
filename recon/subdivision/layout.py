"""Quadrilaterals ready to become faces of a solid: irregular vertices apart, regular quads in rectangles.

    o---o---o---o---o        R   regular: all four corners have the faces of a regular mesh, the limit is bicubic
    | R | R | R | R |        x   a vertex that has not; its quads become caps
    o---o---o---o---o
    | R | c | c | R |        where two such vertices share a quad the mesh is refined once: after it a quad has one at
    o---o---x---o---o        most, and it is put first
    | R | c | c | R |

Paper  [catmull1978]; [peters2000], patches over regular parts and caps between them.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import sparse

from recon.geometry.control_mesh import ControlMesh
from recon.numerics.halfedges import opposite_sides
from recon.subdivision.catmull_clark import REGULAR_FACES, refine, split_faces
from recon.subdivision.sheets import Sheets, cut_along_creases, fan_corners

__all__ = ["Layout", "Rectangle", "irregular_corners", "isolated", "rectangles", "turned_faces"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

MAX_REACH = 100  # quads from its seed to a side of a rectangle
EFFORT = 3000  # steps spent on the search for large rectangles, a quad


class Layout(NamedTuple):
    """A mesh of quads that have one irregular corner at most.

    sheets    cut along creases; an irregular corner is corner 0
    faces     (F, 4) the same quads over vertices that creases do not cut, and `across` (F, 4) their sides across
    points    (W, V) sparse, control points -> points of the sheets' vertices
    regular   (F,) whether no corner is irregular, so that the quad is polynomial
    """

    sheets: Sheets
    faces: Ints
    across: Ints
    points: sparse.csr_array
    regular: Bools


class Rectangle(NamedTuple):
    """Quads in rows; faces (n, m) row by row, and (n, m) the side of each that lies at the bottom."""

    faces: Ints
    turns: Ints


def isolated(mesh: ControlMesh, steps: int = 0) -> Layout:
    """The mesh, refined once where a quad would have two irregular corners, and then so often.

    Raises  BadGeometry when a face is no quadrilateral; NotManifold.
    """
    sheets, behind = cut_along_creases(mesh, 4)
    points = sparse.csr_array(
        (np.ones(len(behind)), behind, np.arange(len(behind) + 1)), shape=(len(behind), mesh.n_vertices)
    )
    beside = opposite_sides(mesh.faces_of(4))
    # two parts that touch in a vertex alone part there
    faces = fan_corners(beside).reshape(beside.shape)
    whole = Sheets(faces, beside, np.zeros(int(faces.max()) + 1, dtype=np.int64))
    irregular = irregular_corners(sheets, REGULAR_FACES)
    while (near := bool((irregular.sum(axis=1) > 1).any())) or steps > 0:
        step, whole = refine(sheets), split_faces(whole)
        sheets, points, steps = step.sheets, sparse.csr_array(step.matrix @ points), steps - (not near)
        irregular = irregular_corners(sheets, REGULAR_FACES)
    turns = irregular.argmax(axis=1)
    turned, across = turned_faces(sheets.faces, sheets.across, turns)
    whole_faces, whole_across = turned_faces(whole.faces, whole.across, turns)
    regular = np.logical_not(irregular.any(axis=1))
    return Layout(Sheets(turned, across, sheets.kinds), whole_faces, whole_across, points, np.asarray(regular))


def irregular_corners(sheets: Sheets, regular_faces: tuple[int, ...]) -> Bools:
    """(F, k) whether the corner has not the faces around it that its kind has in a regular mesh."""
    wanted = np.array(regular_faces)[sheets.kinds]
    irregular = np.bincount(sheets.faces.ravel(), minlength=len(sheets.kinds)) != wanted
    return np.asarray(irregular[sheets.faces])


def turned_faces(faces: Ints, across: Ints, turns: Ints) -> tuple[Ints, Ints]:
    """Faces begun at another corner; the sides across with them."""
    k = faces.shape[1]
    places = (np.arange(k) + turns[:, None]) % k
    other = np.take_along_axis(across, places, axis=1)
    moved = k * (other // k) + (other % k - turns[other // k]) % k
    return np.take_along_axis(faces, places, axis=1), np.where(other < 0, -1, moved)


def rectangles(across: Ints, wanted: Bools) -> list[Rectangle]:
    """The wanted quads in few rectangles, the largest first, none of which meets itself along a side.

    across  (F, 4) sides across; -1 where a rectangle must end
    """
    free = wanted.copy()
    chosen = np.flatnonzero(wanted)
    order = np.random.default_rng(0).permutation(chosen)
    areas = _first_areas(across.ravel(), free, order, EFFORT * max(len(order), 1))
    heap = [(-int(areas[f]), int(f)) for f in order]
    heap.sort()
    return _claimed(across.ravel(), free, heap)


def _claimed(across: Ints, free: Bools, ranked: list[tuple[int, int]]) -> list[Rectangle]:
    """Take the largest rectangle that is left, again and again; areas only shrink, so old ones are bounds."""
    from heapq import heapify, heappop, heappush

    heapify(ranked)
    grid, turns = _room()
    stamps = np.full(len(free), -1)
    found: list[Rectangle] = []
    stamp = 0
    while ranked:
        bound, seed = heappop(ranked)
        if not free[seed]:
            continue
        best, stamp = _largest(across, free, seed, (grid, turns, stamps), stamp)
        area = (best[1] - best[0] + 1) * (best[3] - best[2] + 1)
        if ranked and area < -bound and area < -ranked[0][0]:
            heappush(ranked, (-area, seed))
            continue
        stamp += 1
        box = _grow(across, free, seed, best[4], grid, turns, stamps, stamp)
        rows, columns = slice(box[2], box[3] + 1), slice(box[0], box[1] + 1)
        rectangle = Rectangle(grid[rows, columns].copy(), turns[rows, columns].copy())
        free[rectangle.faces] = False
        found.append(rectangle)
    return found


def _room() -> tuple[Ints, Ints]:
    size = 2 * MAX_REACH + 1
    return np.zeros((size, size), dtype=np.int64), np.zeros((size, size), dtype=np.int64)


def _largest(
    across: Ints, free: Bools, seed: int, room: tuple[Ints, Ints, Ints], stamp: int
) -> tuple[tuple[int, int, int, int, int], int]:
    """Box (left, right, bottom, top) of the largest of three ways to grow, and which; the last stamp used."""
    boxes = []
    for way in range(3):
        stamp += 1
        box = _grow(across, free, seed, way, *room, stamp)
        boxes.append(((box[1] - box[0] + 1) * (box[3] - box[2] + 1), (*box, way)))
    return max(boxes, key=lambda entry: entry[0])[1], stamp


def _first_areas(across: Ints, free: Bools, order: Ints, effort: int) -> Ints:
    grid, turns = _room()
    return _areas(across, free, order, effort, grid, turns, np.full(len(free), -1))


@njit(cache=True)
def _areas(across: Ints, free: Bools, order: Ints, effort: int, grid: Ints, turns: Ints, stamps: Ints) -> Ints:
    """The area that each seed grows to, until the effort is spent; 1 for those that were not looked at."""
    areas = np.ones(len(free), dtype=np.int64)
    stamp, spent = -1, 0
    for seed in order:
        for way in range(3):
            stamp -= 1
            left, right, bottom, top = _grow(across, free, seed, way, grid, turns, stamps, stamp)
            area = (right - left + 1) * (top - bottom + 1)
            areas[seed] = max(areas[seed], area)
            spent += area
        if spent > effort:
            break
    return areas


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

"""A scan of many millions of points, thinned cell by cell to one that fits the memory: quadrics, and the topology kept.

    +-----+-----+-----+      space is cut into cells; the triangles within a cell are collapsed with what reaches out of
    |     |     |     |      it locked, then again in cells shifted by a half and by a quarter, so that no seam is left.
    +--+--+--+--+--+--+      The scan stays in its file: memory holds what is left of it, a cell, and a number for each
       |     |     |         point and triangle.

Collapses keep the surface what it is, bodies, cavities and handles, as `recon.numerics.edge_collapse` does; what
was open stays open, its border as it was.  Planes are summed anew in every pass, from the triangles that are there.

Paper  [garland1997] for the quadrics; [dey1999] for the collapses that are allowed.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.errors import NotManifold, Refusal
from recon.geometry.mesh import TriangleMesh
from recon.geometry.mesh_source import MeshSource
from recon.numerics.cell_lookup import empty_lookup
from recon.numerics.distance import closest_points
from recon.numerics.edge_collapse import REGULARISER, collapse_edges, collapse_mesh
from recon.numerics.edge_heap import edge_heap
from recon.numerics.error_bound import no_bound
from recon.numerics.open_patch import ClosedOff, closed_off
from recon.numerics.quadrics import vertex_quadrics

__all__ = ["ThinnedScan", "thinned_scan"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
SmallInts = NDArray[np.int32]
Bools = NDArray[np.bool_]
Each = Callable[..., Iterable[Any]]

SHIFTS = (0.0, 0.5, 0.25)  # of a cell
SLACK = (1.6, 1.2, 1.0)  # times as many triangles as are wanted in the end may a pass leave
CELL = 300_000  # triangles of a cell, about
SIDES = 6.0  # a surface passes through about so many of the cells along one side, squared
PIECE = 1 << 20  # rows looked through at once
NEAR = 4.0  # sides of the triangles that are left: a point of the scan is compared with those so near its cell


@dataclass(frozen=True, eq=False)
class ThinnedScan:
    """What is left of a scan.

    mesh       with few triangles
    distances  (n,) from every point of the scan to it, in model units
    """

    mesh: TriangleMesh
    distances: Floats


class _Cells(NamedTuple):
    """Cells of one size, the first of which lacks a share."""

    low: Floats
    size: float
    shift: float

    def numbers(self, points: Floats) -> SmallInts:
        """(n,) the cell of every point (n, 3)."""
        i, j, k = np.floor((points - self.low) / self.size + self.shift).astype(np.int32).T
        return np.asarray((i << 20) + (j << 10) + k, dtype=np.int32)


def thinned_scan(
    scan: MeshSource,
    n_vertices: int,
    *,
    cell: int = CELL,
    each: Each = map,
    doing: Callable[[str], None] = lambda t: None,
) -> ThinnedScan:
    """A mesh of about `n_vertices` with the shape of the scan, which need not be in memory.

    cell      triangles that are collapsed at once, about
    each      as `map`, for the cells of a pass
    Promises  bodies, cavities and handles as before; the same bytes whatever `each` does.
    Raises    NotManifold for edges with more than two faces, or with two that disagree about what is outside.
    """
    low, size, unit = _measured(scan, cell)
    mesh = scan
    for number, (shift, slack) in enumerate(zip(SHIFTS, SLACK)):
        doing(f"thinning, pass {number + 1} of {len(SHIFTS)}")
        owners = _owners(mesh, _Cells(low, size, shift))
        # only in the last pass the triangles between cells have lost their share before
        kept = len(owners.others) if number == len(SHIFTS) - 1 else 0
        share = (2.0 * slack * n_vertices - kept) / max(mesh.n_faces - kept, 1)
        mesh = _pass(mesh, owners, (min(max(share, 0.0), 1.0), unit), each)
    if mesh.n_vertices - mesh.n_faces // 2 != _used_vertices(scan) - scan.n_faces // 2:
        raise Refusal(f"{scan.name}: the thinned mesh has another Euler number than the scan.")
    doing("measuring what was lost")
    found = TriangleMesh(mesh.points(slice(None)), mesh.triangles(slice(None)), scan.name)
    return ThinnedScan(found, _distances(scan, found, _Cells(low, size, 0.0)))


def _measured(scan: MeshSource, cell: int) -> tuple[Floats, float, float]:
    """Low corner of the scan, side of its cells, and the usual side of its triangles."""
    ends = [(p.min(axis=0), p.max(axis=0)) for p in map(scan.points, scan.pieces(scan.n_vertices, PIECE))]
    low, high = np.min([e[0] for e in ends], axis=0), np.max([e[1] for e in ends], axis=0)
    along = max(1, round(np.sqrt(scan.n_faces / (SIDES * cell))))
    corners = scan.triangles(slice(0, PIECE))
    numbers, rows = np.unique(corners[:, :2], return_inverse=True)
    ends_of_sides = scan.points(numbers)[rows.reshape(-1, 2)]
    unit = float(np.linalg.norm(ends_of_sides[:, 1] - ends_of_sides[:, 0], axis=1).mean())
    return low, float((high - low).max()) / along, unit


def _used_vertices(scan: MeshSource) -> int:
    used = np.zeros(scan.n_vertices, dtype=bool)
    for part in scan.pieces(scan.n_faces, PIECE):
        used[scan.triangles(part)] = True
    return int(np.count_nonzero(used))


class _Owners(NamedTuple):
    """Triangles (n,) in the order of the cells that may change them, where those of each begin, those that no cell has;
    and the vertices (V,) whose triangles all lie in one cell.
    """

    order: Ints
    starts: Ints
    others: Ints
    free: Bools


def _owners(mesh: MeshSource, cells: _Cells) -> _Owners:
    home = np.concatenate([cells.numbers(mesh.points(part)) for part in mesh.pieces(mesh.n_vertices, PIECE)])
    free, owner = np.ones(mesh.n_vertices, dtype=bool), np.empty(mesh.n_faces, dtype=np.int32)
    parts = mesh.pieces(mesh.n_faces, PIECE)
    for part in parts:
        faces = mesh.triangles(part)
        corners = home[faces]
        within = (corners == corners[:, :1]).all(axis=1)
        free[faces[~within]] = False
        owner[part] = np.where(within, corners[:, 0], -1)
    for part in parts:
        owner[part][~free[mesh.triangles(part)].any(axis=1)] = -1
    order = np.argsort(owner, kind="stable")
    n_others = int(np.searchsorted(owner[order], 0))
    starts = n_others + np.flatnonzero(np.diff(owner[order[n_others:]], prepend=-1))
    return _Owners(order, np.append(starts, len(order)), order[:n_others], free)


def _pass(mesh: MeshSource, owners: _Owners, goal: tuple[float, float], each: Each) -> MeshSource:
    """One pass over all cells; goal: the share of triangles that are left, and the length that counts as one."""
    numbers: list[Ints] = []
    faces, moved, places = [mesh.triangles(owners.others)], [np.empty(0, dtype=np.int64)], [np.empty((0, 3))]
    for patch, (points, rows, changed) in enumerate(each(_collapsed, _patches(mesh, owners, goal, numbers))):
        faces.append(numbers[patch][rows])
        moved.append(numbers[patch][changed])
        places.append(points)
    together = np.concatenate(faces)
    left = np.zeros(mesh.n_vertices, dtype=bool)
    left[together] = True
    used = np.flatnonzero(left)
    vertices = mesh.points(used)
    vertices[np.searchsorted(used, np.concatenate(moved))] = np.concatenate(places)
    number = np.cumsum(left, dtype=np.int64) - 1
    return MeshSource.of(vertices, number[together], mesh.name)


@dataclass(frozen=True, eq=False)
class _Patch:
    """Triangles of a cell: points (V, 3), faces (F, 3), which vertices stay, share that is left, length of one."""

    points: Floats
    faces: Ints
    locked: Bools
    goal: tuple[float, float]
    name: str


def _patches(mesh: MeshSource, owners: _Owners, goal: tuple[float, float], numbers: list[Ints]) -> Iterator[_Patch]:
    """The patch of every cell; the numbers of its vertices are put down in `numbers`."""
    for first, stop in zip(owners.starts[:-1], owners.starts[1:]):
        used, rows = np.unique(mesh.triangles(owners.order[first:stop]), return_inverse=True)
        numbers.append(used)
        yield _Patch(mesh.points(used), rows.reshape(-1, 3), ~owners.free[used], goal, mesh.name)


def _collapsed(patch: _Patch) -> tuple[Floats, Ints, Ints]:
    """Places (n, 3) of the vertices that may have moved, the faces (G, 3) that are left, and which vertices (n,)."""
    share, unit = patch.goal
    _refuse_tangles(patch)
    closed = closed_off(patch.faces, len(patch.points))
    n, n_imaginary = len(patch.faces), len(closed.faces) - len(patch.faces)
    middle = patch.points.mean(axis=0)
    vertices = (patch.points - middle) / unit
    locked = patch.locked | closed.border | _is_pinched(closed, len(vertices))
    mesh = collapse_mesh(
        np.append(vertices, np.full((1, 3), np.nan), axis=0),
        closed.faces,
        closed.twin,
        quadric=np.append(vertex_quadrics(vertices, patch.faces, regulariser=REGULARISER), np.zeros((1, 10)), axis=0),
        locked=np.append(locked, True),
        feature=np.zeros(len(locked) + 1, dtype=bool),
    )
    collapse_edges(
        mesh, edge_heap(len(mesh.half)), no_bound(), empty_lookup(), len(closed.faces), round(share * n) + n_imaginary
    )
    rows = mesh.corner.reshape(-1, 3)[:n].astype(np.int64)
    rows = rows[rows[:, 0] >= 0]
    left = np.zeros(len(vertices), dtype=bool)
    left[rows] = True
    changed = np.flatnonzero(left & ~locked)
    return mesh.place[changed] * unit + middle, rows, changed


def _refuse_tangles(patch: _Patch) -> None:
    start, end = patch.faces.ravel(), np.roll(patch.faces, -1, axis=1).ravel()
    way = np.sort(start * len(patch.points) + end)
    twice = np.flatnonzero(way[1:] == way[:-1])
    if len(twice):
        ends = np.divmod(way[twice[0]], len(patch.points))
        raise NotManifold(
            patch.name,
            f"at {len(twice)} edges two faces run in the same direction, so that there is no surface; the first is",
            patch.points[list(ends)].mean(axis=0),
        )


def _is_pinched(closed: ClosedOff, n_vertices: int) -> Bools:
    """(V,) whether the faces around a vertex are more than one fan."""
    corners = closed.faces.ravel()
    out = np.zeros(n_vertices + 1, dtype=np.int64)
    out[corners] = np.arange(len(corners))
    return np.asarray(_fan_sizes(closed.twin, out) != np.bincount(corners, minlength=n_vertices + 1))[:n_vertices]


@njit(cache=True)
def _fan_sizes(twin: Ints, out: Ints) -> Ints:  # pragma: no cover - compiled
    """(V,) faces met on the way around each vertex."""
    sizes = np.empty(len(out), dtype=np.int64)
    for vertex in range(len(out)):
        h, size = out[vertex], 0
        while True:
            size += 1
            h = twin[h + 2 if h % 3 == 0 else h - 1]
            if h == out[vertex]:
                break
        sizes[vertex] = size
    return sizes


def _distances(scan: MeshSource, mesh: TriangleMesh, cells: _Cells) -> Floats:
    """(n,) from every point of the scan to the nearest triangle around its cell; never less than the true distance."""
    corners = mesh.corners()
    low, high = corners.min(axis=1), corners.max(axis=1)
    reach = NEAR * float((high - low).max(axis=1).mean())
    home = np.concatenate([cells.numbers(scan.points(part)) for part in scan.pieces(scan.n_vertices, PIECE)])
    order = np.argsort(home, kind="stable")
    starts = np.flatnonzero(np.diff(home[order], prepend=-1))
    found = np.empty(scan.n_vertices)
    for members in np.split(order, starts[1:]):
        points = scan.points(members)
        near = ((high >= points.min(axis=0) - reach) & (low <= points.max(axis=0) + reach)).all(axis=1)
        faces = mesh.face_vertices[near] if near.any() else mesh.face_vertices
        found[members] = closest_points(points, mesh.vertices, faces).distances
    return found

"""The relief of a wall as a picture: heights above the smooth wall over cells of the wall laid flat.

The picture shows the whole turn; its left border meets its right one. Cells in cracks, and in the hole, are not known.

      s ^  / / / /|/ / / / / /|/ / /      u    around the axis, periodic
        |  \\ \\ \\ \\|\\ ,---. \\ \\|\\ \\ \\      s    along the profile
        |  / / / /|/(hole )/ /|/ / /      h    distance from the turned profile, less its mean over `LEVELLING`
        |  \\ \\ \\ \\|\\ '---' \\ \\|\\ \\ \\      |    cracks between sherds
        +---------------------------> u
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage

from recon.geometry.mesh import TriangleMesh
from recon.hole_patch.section_samples import vertex_areas_and_normals
from recon.hole_patch.surroundings import Wall
from recon.hole_patch.wheel_chart import RolledChart

__all__ = ["ReliefMap", "inside_polygon", "relief_map", "triangle_heights"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

CELL = (0.4, 0.8)  # mm: the finest cords are 2 mm wide, a scan's edges 0.5 to 1 mm long, on a large vessel longer
CELLS_A_TURN = 800  # beyond which cells grow
REACH = 30.0  # mm above and below the hole: the profile is known as far
LEVELLING = 5.0  # mm, standard deviation of the mean that is taken off: wider than cords, narrower than sherds
FARTHEST = 3.0  # mm from the profile; a handle or a foot is no relief
LARGEST_FACE = 40  # cells; larger ones bridge what was not scanned


@dataclass(frozen=True, eq=False)
class ReliefMap:
    """Heights over cells of the wall.

    height  (nu, ns) in millimetres, 0 where not known; row 0 follows the last row
    known   (nu, ns)
    corner  (2,) least u and s of cell (0, 0)
    cell    (2,) its size in millimetres
    """

    height: Floats
    known: Bools
    corner: Floats
    cell: Floats

    def place(self, cells: Ints) -> Floats:
        """(m, 2) u and s in the middle of cells (m, 2)."""
        return np.asarray(self.corner + (cells + 0.5) * self.cell)

    def index(self, chart: Floats) -> Floats:
        """(m, 2) fractional cells of u and s (m, 2): the inverse of `place`."""
        return np.asarray((chart - self.corner) / self.cell - 0.5)


def relief_map(wall: Wall, chart: RolledChart, edge: Floats) -> ReliefMap:
    """The relief of a wall as scanned, from its chart.

    edge      (n, 2) u and s of the hole's edge
    Promises  what is wider than some millimetres, the vessel's shape and the sherds' misplacement, is taken off.
    """
    normals = vertex_areas_and_normals(wall.measured)[1] if wall.over_lip else None
    flat = chart.flat(wall.measured.vertices, normals)
    turn = 2 * np.pi * chart.mean_radius
    low, high = chart.profile.curve.domain
    low, high = max(low, edge[:, 1].min() - REACH), min(high, edge[:, 1].max() + REACH)
    side = float(np.clip(turn / CELLS_A_TURN, *CELL))
    shape = (fft.next_fast_len(round(turn / side), real=True), int((high - low) / side))
    corner, cell = np.array([-0.5 * turn, low]), np.array([turn / shape[0], side])
    near = (np.abs(flat[:, 2]) < FARTHEST) & (flat[:, 1] > low - 2.0) & (flat[:, 1] < high + 2.0)
    faces = wall.measured.face_vertices
    mesh = TriangleMesh(
        np.column_stack([(flat[:, :2] - corner) / cell - 0.5, flat[:, 2]]), faces[near[faces].all(axis=1)]
    )
    height, known = triangle_heights(mesh, shape)
    return ReliefMap(np.where(known, height - _levelled(height, known, LEVELLING / side), 0.0), known, corner, cell)


def triangle_heights(mesh: TriangleMesh, shape: tuple[int, int]) -> tuple[Floats, Bools]:
    """(nu, ns) heights of a mesh above whole (x, y), by linear interpolation, and where there are any.

    mesh   vertices (x, y, height); x counts round with period nu; faces seen from behind, and large ones, do not count
    shape  nu, ns
    """
    corners = mesh.corners().copy()
    x = corners[:, :, 0]
    x -= np.round((x - x[:, :1]) / shape[0]) * shape[0]
    first = np.ceil(corners[:, :, :2].min(axis=1)).astype(np.int64)
    count = np.floor(corners[:, :, :2].max(axis=1)).astype(np.int64) - first + 1
    sides = corners[:, 1:, :2] - corners[:, :1, :2]
    twice = sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]
    used = (count > 0).all(axis=1) & (count <= LARGEST_FACE).all(axis=1) & (twice > 1e-9)
    face, at = _boxes(first[used], count[used])
    corners, sides, twice = corners[used][face], sides[used][face], twice[used][face]
    off = at - corners[:, 0, :2]
    second = (off[:, 0] * sides[:, 1, 1] - off[:, 1] * sides[:, 1, 0]) / twice
    third = (sides[:, 0, 0] * off[:, 1] - sides[:, 0, 1] * off[:, 0]) / twice
    share = np.stack([1.0 - second - third, second, third], axis=1)
    on = (share >= -1e-9).all(axis=1) & (at[:, 1] >= 0) & (at[:, 1] < shape[1])
    cell = at[on, 0] % shape[0] * shape[1] + at[on, 1]
    size = shape[0] * shape[1]
    total = np.bincount(cell, (share * corners[:, :, 2]).sum(axis=1)[on], size)
    hits = np.bincount(cell, minlength=size)
    return (total / np.maximum(hits, 1)).reshape(shape), (hits > 0).reshape(shape)


def _boxes(first: Ints, count: Ints) -> tuple[Ints, Ints]:
    """(m,) number of each box and (m, 2) its whole points, for boxes of count (k, 2) points from first (k, 2)."""
    many = count.prod(axis=1)
    box = np.repeat(np.arange(len(many)), many)
    k = np.arange(len(box)) - (np.cumsum(many) - many)[box]
    return box, first[box] + np.stack([k // count[box, 1], k % count[box, 1]], axis=1)


def _levelled(height: Floats, known: Bools, width: float) -> Floats:
    """Mean of the known heights around every cell, under a bell of the given width in cells."""
    total, share = (
        ndimage.gaussian_filter(x, width, mode=("wrap", "nearest"), truncate=3.0)
        for x in (np.where(known, height, 0.0), known.astype(np.float64))
    )
    return np.asarray(total / np.maximum(share, 1e-6))


def inside_polygon(polygon: Floats, shape: tuple[int, int]) -> Bools:
    """(nu, ns) whether whole points (x, y) lie within a closed polygon (n, 2) that does not run round the map.

    Every side of the polygon turns the points above it from outside to inside or back.
    """
    a, b = polygon, np.roll(polygon, -1, axis=0)
    left, right = np.where((a[:, :1] < b[:, :1])[..., None], np.stack([a, b], 1), np.stack([b, a], 1)).swapaxes(0, 1)
    first = np.ceil(left[:, 0]).astype(np.int64)
    count = np.maximum(np.ceil(right[:, 0]).astype(np.int64) - first, 0)
    side, at = _boxes(np.stack([first, 0 * first], axis=1), np.stack([count, np.ones_like(count)], axis=1))
    share = (at[:, 0] - left[side, 0]) / (right[side, 0] - left[side, 0])
    above = np.ceil(left[side, 1] + share * (right[side, 1] - left[side, 1])).astype(np.int64)
    turns = np.zeros((shape[0], shape[1] + 1), dtype=np.int64)
    on = (at[:, 0] >= 0) & (at[:, 0] < shape[0])
    np.add.at(turns, (at[on, 0], np.clip(above[on], 0, shape[1])), 1)
    return np.asarray(turns.cumsum(axis=1)[:, :-1] % 2 == 1)

"""Bodies, cavities and handles of a grid, counted block by block: the same as `topology.grid_topology` of the whole.

    Euler number   a sum over cells, each counted with the voxel, joins, squares and cube that begin at its first corner
    bodies         solid voxels are labelled block by block; labels that meet on a plane that two blocks share are one
    cavities       the same of the empty voxels

Two neighbours, over faces or over edges, are corners of one cell, and each cell is in one block: no join is missed.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from recon.geometry.volume_source import SolidSource
from recon.voxel_mesh.block_lattice import Lattice, Place
from recon.voxel_mesh.cell_table import cell_table
from recon.voxel_mesh.topology import Topology, adjacency

__all__ = ["BlockCount", "Each", "GridCount", "LabelJoins", "count_block", "grid_count"]

Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]
Labels = NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class BlockCount:
    """What is counted of one block.

    voxels  solid ones, each counted in the block whose cell begins there
    euler   share of the block in the Euler number of the solid
    faces   triangles of the surface
    n_labels  of the solid voxels and of the empty ones
    label_sizes  (n_labels[0],) voxels of each label, counted as `voxels` are
    sides   for both, the labels on the first and the last plane along each axis
    """

    voxels: int
    euler: int
    faces: int
    n_labels: tuple[int, int]
    label_sizes: Ints
    sides: tuple[tuple[tuple[Labels, Labels], ...], ...]


class GridCount(NamedTuple):
    """Of the whole grid: solid voxels, triangles of its surface, and its topology."""

    voxels: int
    faces: int
    topology: Topology


def count_block(solid: SolidSource, lattice: Lattice, block: Place) -> BlockCount:
    """Count one block."""
    low, stop = lattice.extent(block)
    inside = solid.window(low, stop + 1)
    euler, faces = _cell_sums(inside, _euler_table(), cell_table().counts)
    numbers, sizes, sides = [], [], []
    for values, joined in zip((inside, ~inside), adjacency()):
        labels, n = ndimage.label(values, joined)
        numbers.append(int(n))
        sizes.append(np.bincount(labels[:-1, :-1, :-1].ravel(), minlength=n + 1)[1:])
        sides.append(tuple((labels.take(0, a).copy(), labels.take(-1, a).copy()) for a in range(3)))
    return BlockCount(int(sizes[0].sum()), euler, faces, (numbers[0], numbers[1]), sizes[0], tuple(sides))


@cache
def _euler_table() -> Ints:
    """(256,) what a cell adds: the voxel, joins, squares and cube at its first corner, and holes that corners leave."""
    case = np.arange(256)
    corner = [(case >> c & 1).astype(np.int64) for c in range(8)]
    joins = corner[0] * (corner[1] + corner[2] + corner[4])
    squares = corner[0] * (corner[1] * corner[2] * corner[3] + corner[2] * corner[4] * corner[6]
                           + corner[1] * corner[4] * corner[5])  # fmt: skip
    holes = sum((sum(corner) == 6) & (corner[c] == 0) & (corner[7 - c] == 0) for c in range(4))
    return np.asarray(corner[0] - joins + squares - (case == 255) + holes, dtype=np.int64)


@njit(cache=True)
def _cell_sums(inside: Bools, euler: Ints, triangles: NDArray[np.int8]) -> tuple[int, int]:  # pragma: no cover
    nx, ny, nz = inside.shape
    total, faces = 0, 0
    for i in range(nx - 1):
        for j in range(ny - 1):
            for k in range(nz - 1):
                case, bit = 0, 1
                for z in range(2):
                    for y in range(2):
                        for x in range(2):
                            case += bit * inside[i + x, j + y, k + z]
                            bit *= 2
                total += euler[case]
                faces += triangles[case]
    return total, faces


Each = Callable[[Callable[[Place], BlockCount], Sequence[Place]], Iterable[BlockCount]]


def grid_count(solid: SolidSource, lattice: Lattice, each: Each = map) -> GridCount:
    """Count all blocks, `each` of which may be counted elsewhere, and join what they say."""
    joins = (LabelJoins(), LabelJoins())
    voxels, euler, faces = 0, 0, 0
    for block, count in zip(lattice.blocks(), each(partial(count_block, solid, lattice), lattice.blocks())):
        voxels, euler, faces = voxels + count.voxels, euler + count.euler, faces + count.faces
        for join, n, sides in zip(joins, count.n_labels, count.sides):
            join.add(block, n, sides)
    bodies, cavities = joins[0].pieces(), joins[1].pieces() - 1
    return GridCount(voxels, faces, Topology(bodies, cavities, bodies + cavities - euler))


class LabelJoins:
    """Labels of blocks, numbered on, and which of them are one."""

    def __init__(self) -> None:
        self._n = 0
        self._open: dict[tuple[Place, int], Ints] = {}
        self._pairs: list[Ints] = []

    def add(self, block: Place, n: int, sides: tuple[tuple[Labels, Labels], ...]) -> None:
        """A block, after those before it along each axis; only planes that wait for their neighbour are held."""
        for axis, (first, last) in enumerate(sides):
            before = (block[0] - (axis == 0), block[1] - (axis == 1), block[2] - (axis == 2))
            waiting = self._open.pop((before, axis), None)
            if waiting is not None:
                here = self._numbered(first)
                self._pairs.append(np.unique(np.stack([waiting, here], axis=-1)[here >= 0], axis=0))
            self._open[block, axis] = self._numbered(last)
        self._n += n

    def _numbered(self, labels: Labels) -> Ints:
        return np.where(labels > 0, labels.astype(np.int64) - 1 + self._n, -1)

    def pieces(self) -> int:
        """How many there are when all is joined."""
        return int(self.numbers().max(initial=-1)) + 1

    def numbers(self) -> Ints:
        """(labels,) the piece that each label is of."""
        pairs = np.concatenate([np.empty((0, 2), dtype=np.int64), *self._pairs])
        graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(self._n, self._n))
        return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)

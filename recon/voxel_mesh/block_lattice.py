"""Blocks of a grid: which cells each holds, on a lattice that may be shifted.

    o   o   o | o   o   o      o  voxel centres; a cell lies between eight of them
      c   c   |   c   c        |  a lattice plane runs through centres; the cells on either side belong to one block
    o   o   o | o   o   o         each, the centres on it, and the surface's vertices there, to both

Cell c lies between the centres c and c + 1.  The first cell is -1, which begins before the grid, the last n - 1.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

__all__ = ["Lattice", "block_lattice"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Place = tuple[int, int, int]


@dataclass(frozen=True, eq=False)
class Lattice:
    """cuts  for each axis the first cell of every block, and one past the last cell of all."""

    cuts: tuple[Ints, Ints, Ints]

    @property
    def shape(self) -> Place:
        """Blocks along each axis."""
        return len(self.cuts[0]) - 1, len(self.cuts[1]) - 1, len(self.cuts[2]) - 1

    def blocks(self) -> list[Place]:
        """All blocks, the last axis fastest."""
        x, y, z = (range(n) for n in self.shape)
        return list(product(x, y, z))

    def extent(self, block: Place) -> tuple[Ints, Ints]:
        """(3,) the first cell of a block, and (3,) one past its last."""
        low = np.array([cut[b] for cut, b in zip(self.cuts, block)])
        stop = np.array([cut[b + 1] for cut, b in zip(self.cuts, block)])
        return low, stop

    def block_numbers(self, points: Floats) -> Ints:
        """(n,) number, in the order of `blocks`, of the block around each of (n, 3) points, given as indices."""
        places = [
            np.clip(np.searchsorted(cut, np.floor(x), side="right") - 1, 0, len(cut) - 2)
            for cut, x in zip(self.cuts, points.T)
        ]
        return np.asarray(np.ravel_multi_index(tuple(places), self.shape), dtype=np.int64)


def block_lattice(shape: Place, size: int, *, shifts: Place = (0, 0, 0)) -> Lattice:
    """Blocks of `size` cells a side over a grid of so many voxels; the last is up to a quarter longer, and no sliver.

    shifts  by how many cells the planes lie farther along each axis
    """
    x, y, z = (_cuts(n, size, shift) for n, shift in zip(shape, shifts))
    return Lattice((x, y, z))


def _cuts(n: int, size: int, shift: int) -> Ints:
    planes = np.arange(-1 + shift, n, size, dtype=np.int64)
    return np.unique(np.concatenate([[-1], planes[n - planes >= size // 4], [n]]))

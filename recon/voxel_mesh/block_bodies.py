"""The bodies of a grid larger than memory: how large each is, and the grid without those that are not wanted.

Labels of a block are the same whenever it is labelled: so a table that says of which body each label is will do.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from recon.geometry.volume_source import SolidSource
from recon.voxel_mesh.block_lattice import Lattice
from recon.voxel_mesh.block_topology import Each, LabelJoins, count_block
from recon.voxel_mesh.topology import adjacency

__all__ = ["BodyTable", "body_table", "wanted_bodies", "write_bodies"]

Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


class BodyTable(NamedTuple):
    """starts (blocks + 1,) first label of each block, body (labels,) of each label, sizes (bodies,) in voxels."""

    starts: Ints
    body: Ints
    sizes: Ints


def body_table(solid: SolidSource, lattice: Lattice, each: Each = map) -> BodyTable:
    """Bodies of the solid voxels, which hang together over faces."""
    joins, sizes, starts = LabelJoins(), [np.empty(0, dtype=np.int64)], [0]
    for block, count in zip(lattice.blocks(), each(partial(count_block, solid, lattice), lattice.blocks())):
        joins.add(block, count.n_labels[0], count.sides[0])
        sizes.append(count.label_sizes)
        starts.append(starts[-1] + count.n_labels[0])
    body = joins.numbers()
    weights = np.concatenate(sizes).astype(np.float64)
    return BodyTable(np.array(starts), body, np.bincount(body, weights).astype(np.int64))


def wanted_bodies(table: BodyTable, *, largest: bool = False, min_voxels: int = 1) -> Bools:
    """(bodies,) which stay, as `topology.kept_bodies` chooses."""
    keep = table.sizes >= min_voxels
    if largest and len(keep):
        keep &= np.arange(len(keep)) == int(table.sizes.argmax())
    return np.asarray(keep)


def write_bodies(
    solid: SolidSource,
    lattice: Lattice,
    table: BodyTable,
    keep: Bools,
    path: Path,
    doing: Callable[[str], None] = lambda text: None,
) -> None:
    """Write the grid with the bodies that stay alone, a numpy array of zeros and ones, block by block."""
    np.lib.format.open_memmap(path, mode="w+", dtype=np.uint8, shape=solid.shape).flush()
    for number, block in enumerate(lattice.blocks()):
        doing(f"dropping bodies, block {number + 1} of {len(lattice.blocks())}")
        low, stop = lattice.extent(block)
        labels, _ = ndimage.label(solid.window(low, stop + 1), adjacency()[0])
        stays = np.append(False, keep[table.body[table.starts[number] : table.starts[number + 1]]])
        inner = [slice(max(a, 0), min(b + 1, n)) for a, b, n in zip(low, stop, solid.shape)]
        there = tuple(slice(part.start - a, part.stop - a) for part, a in zip(inner, low))
        # mapped anew for every block: what was written need not stay in memory
        values = np.lib.format.open_memmap(path, mode="r+")
        values[tuple(inner)] = stays[labels[there]]
        values.flush()
        del values

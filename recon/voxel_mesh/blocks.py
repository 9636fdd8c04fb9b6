"""From a grid larger than memory to the surface of a solid: block by block, in passes over shifted lattices.

    |       |       |        pass 1   every block of the grid is marched and collapsed alone; the vertices on the planes
    |       |       |                 between blocks stay, and by their grid edges the parts are joined
        :       :            pass 2   blocks shifted by a half: the joined surface within each is collapsed, the seams
        :       :                     of pass 1 among it; what reaches out of a block stays
      '   '   '   '          pass 3   shifted by a quarter: the lines where planes of passes 1 and 2 cross, and faces as
                                      long as they may get.  Before it none is longer than a quarter of a block.

A pass depends on the grid and on the pass before alone.  So blocks may be done in any order, by any number of workers,
and the result is the same to the last bit.  Memory holds a few blocks and what is left of the surface.

Paper  [nakamura] for the collapse; the passes over shifted lattices are ours.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.errors import BadGeometry, BadOption, NotManifold, Refusal
from recon.geometry.mesh import TriangleMesh
from recon.geometry.volume_source import SolidSource
from recon.numerics.self_intersection import crossing_triangles
from recon.voxel_mesh.block_collapse import (
    Collapsed,
    Patch,
    Terms,
    block_errors,
    collapse_block,
    collapse_patch,
)
from recon.voxel_mesh.block_lattice import Lattice, Place, block_lattice
from recon.voxel_mesh.block_topology import GridCount, grid_count
from recon.voxel_mesh.pipeline import VoxelOptions
from recon.voxel_mesh.simplify import REACH, ROUNDS
from recon.voxel_mesh.topology import mesh_topology

__all__ = ["LEAST_BLOCK", "BlockBoundary", "blocks_of", "boundary_by_blocks"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Each = Callable[..., Iterable[Any]]

LEAST_BLOCK = 16  # voxels a side
LONGEST = 0.25  # of a block: a face that long fits between the planes of two lattices
SHIFTS = (0.0, 0.5, 0.25)  # of a block
SLACK = (3.0, 1.5, 1.0)  # times as many faces as are wanted in the end may a pass leave, so that seams get their share


@dataclass(frozen=True, eq=False)
class BlockBoundary:
    """The boundary and how it compares with the grid's own; lengths named `voxels` are in smallest spacings.

    mesh     closed, in model units
    count    solid voxels, triangles of the grid's surface, bodies, cavities and genus
    errors   (n,) distances found between mesh and surface, both ways, in voxels
    blocks   along each axis, of the first pass
    """

    mesh: TriangleMesh
    count: GridCount
    errors: Floats
    blocks: Place

    def figures(self) -> dict[str, Any]:
        """Figures of the command line's JSON."""
        return {
            "voxels": self.count.voxels,
            "faces_marching_cubes": self.count.faces,
            "faces": self.mesh.n_faces,
            "reduction": 1.0 - self.mesh.n_faces / self.count.faces,
            "max_error_voxels": float(self.errors.max()),
            "rms_error_voxels": float(np.sqrt((self.errors**2).mean())),
            "feature_voxels": None,
            "features_kept": None,
            **self.count.topology._asdict(),
            "blocks": list(self.blocks),
        }


def boundary_by_blocks(
    solid: SolidSource,
    options: VoxelOptions = VoxelOptions(),  # noqa: B008  (frozen)
    *,
    size: int = 256,
    each: Each = map,
    doing: Callable[[str], None] = lambda text: None,
) -> BlockBoundary:
    """Boundary of the solid voxels as a closed triangle mesh with few faces, from blocks of `size` voxels a side.

    each      as `map`: calls a function for every entry of a sequence, here or elsewhere, and gives what it returns in
              their order
    Promises  as `recon.voxel_mesh.pipeline.voxel_boundary`; the same bytes whatever `each` does.
    Raises    BadGeometry when no voxel is solid, or every one; Refusal when the bound cannot be had; BadOption.
    """
    _check(options, size)
    lattices = [blocks_of(solid.shape, size, shift) for shift in SHIFTS]
    doing("counting")
    count = grid_count(solid, lattices[0], each)
    _refuse_plain(solid, count)
    passes = 1 if len(lattices[0].blocks()) == 1 else len(SHIFTS)
    surface = _Surface.none()
    for number, lattice in enumerate(lattices[:passes]):
        doing(f"pass {number + 1} of {passes}, {len(lattice.blocks())} blocks")
        last = number == passes - 1
        slack = 1.0 if last else SLACK[number]
        longest = np.inf if last else LONGEST * size
        terms = Terms(options.tolerance, slack * _remaining(options, count.faces), longest)
        work = _FirstPass(solid, lattice, terms) if number == 0 else _LaterPass(solid, lattice, terms, surface)
        surface = _settled(work, each)
    doing("measuring the error")
    errors = np.concatenate(list(each(*_LaterPass(solid, lattices[0], terms, surface).measuring())))
    after = mesh_topology(surface.vertices, surface.faces)
    if after != count.topology:
        raise NotManifold(solid.name, f"the mesh has {after}, the voxels {count.topology}")
    return BlockBoundary(solid.placed(surface.vertices, surface.faces), count, errors, lattices[0].shape)


def blocks_of(shape: Place, size: int, shift: float = 0.0) -> Lattice:
    """The blocks of a grid, shifted by a share of their size along the axes that are cut at all."""
    x, y, z = (round(shift * size) if n + 1 > size else 0 for n in shape)
    return block_lattice(shape, size, shifts=(x, y, z))


def _check(options: VoxelOptions, size: int) -> None:
    if size < LEAST_BLOCK:
        raise BadOption("--block", f"must be {LEAST_BLOCK} voxels or more, not {size}")
    if options.features:
        raise BadOption("--features", "paper looks at the whole grid: not with --block")


def _refuse_plain(solid: SolidSource, count: GridCount) -> None:
    if count.voxels == 0:
        raise BadGeometry(solid.name, "no voxel is solid; check the threshold or the label")
    if count.voxels == np.prod(solid.shape, dtype=np.int64):
        raise BadGeometry(solid.name, "every voxel is solid, so nothing bounds it; check the threshold or the label")


def _remaining(options: VoxelOptions, n_before: int) -> float:
    """Share of the grid's triangles that is wanted in the end; 0 as few as may be."""
    if options.n_faces is not None:
        return options.n_faces / n_before
    return 0.0 if options.reduction is None else 1.0 - options.reduction


@dataclass(frozen=True, eq=False)
class _Surface:
    """What is joined: vertices (V, 3) in voxels, their quadrics (V, 10), faces (F, 3)."""

    vertices: Floats
    quadrics: Floats
    faces: Ints

    @classmethod
    def none(cls) -> "_Surface":
        return cls(np.empty((0, 3)), np.empty((0, 10)), np.empty((0, 3), dtype=np.int64))

    def without_loose(self) -> "_Surface":
        """Vertices of faces alone, in their old order."""
        used, rows = np.unique(self.faces, return_inverse=True)
        return _Surface(self.vertices[used], self.quadrics[used], rows.reshape(-1, 3))


@dataclass(frozen=True, eq=False)
class _FirstPass:
    """Blocks of the grid, each alone."""

    solid: SolidSource
    lattice: Lattice
    terms: Terms

    def order(self, blocks: Sequence[Place], kept: Floats) -> tuple[Any, ...]:
        """What `each` is given for some blocks: the function, and its arguments block by block."""
        work = partial(collapse_block, self.solid, self.lattice, self.terms)
        return work, blocks, [kept] * len(blocks)

    def joined(self, parts: Sequence[Collapsed]) -> _Surface:
        """The parts as one surface: vertices on the same grid edge become one, with the planes of all its faces."""
        keys = np.concatenate([part.keys for part in parts])
        inside = keys < 0
        own = np.where(inside, -1 - np.arange(len(keys)), keys)
        _, first, number = np.unique(own, return_index=True, return_inverse=True)
        quadrics = np.zeros((len(first), 10))
        np.add.at(quadrics, number, np.concatenate([part.quadrics for part in parts]))
        starts = np.cumsum([0, *(len(part.keys) for part in parts)])
        faces = np.concatenate([number[part.faces + start] for part, start in zip(parts, starts)])
        return _Surface(np.concatenate([part.vertices for part in parts])[first], quadrics, faces)


class _LaterPass:
    """Parts of a joined surface, each within a block of another lattice."""

    def __init__(self, solid: SolidSource, lattice: Lattice, terms: Terms, surface: _Surface) -> None:
        self.solid, self.lattice, self.terms, self.surface = solid, lattice, terms, surface
        vertices, faces = surface.vertices, surface.faces
        self._home = lattice.block_numbers(vertices / solid.proportions)
        corners = self._home[faces]
        within = (corners == corners[:, :1]).all(axis=1)
        self._begins = corners[:, 0]
        self._free = np.ones(len(vertices), dtype=bool)
        self._free[faces[~within]] = False
        self._own = np.where(within & self._free[faces].any(axis=1), self._begins, -1)
        self._low, self._high = vertices[faces].min(axis=1), vertices[faces].max(axis=1)

    def order(self, blocks: Sequence[Place], kept: Floats) -> tuple[Any, ...]:
        work = partial(collapse_patch, self.solid, self.lattice, self.terms)
        return work, blocks, [self._patch(block, self._own)[0] for block in blocks], [kept] * len(blocks)

    def measuring(self) -> tuple[Any, ...]:
        """What `each` is given for the errors of all blocks."""
        blocks = self.lattice.blocks()
        work = partial(block_errors, self.solid, self.lattice, self.terms)
        return work, blocks, [self._patch(block, self._begins)[0] for block in blocks]

    def _patch(self, block: Place, owner: Ints) -> tuple[Patch, Ints]:
        """The faces that a block owns and those that come near it; and the numbers of their vertices."""
        number = int(np.ravel_multi_index(block, self.lattice.shape))
        low, stop = self.lattice.extent(block)
        # so far that of every point of the grid's surface within the margin the nearest face is among them
        reach = (self.terms.margin + 1) * self.solid.proportions + (self.terms.tolerance or 0.0)
        from_, to = low * self.solid.proportions - reach, stop * self.solid.proportions + reach
        near = ((self._high >= from_) & (self._low <= to)).all(axis=1)
        own = np.flatnonzero(owner == number)
        around = np.flatnonzero(near & (owner != number))
        used, rows = np.unique(self.surface.faces[np.append(own, around)], return_inverse=True)
        n_here = int(np.count_nonzero(self._begins == number))
        locked = ~self._free[used] | (self._home[used] != number)
        quadrics = self.surface.quadrics[used]
        patch = Patch(self.surface.vertices[used], quadrics, rows.reshape(-1, 3), len(own), locked, n_here)
        return patch, used

    def joined(self, parts: Sequence[Collapsed]) -> _Surface:
        """The surface with what became of the parts in the place of what they were."""
        vertices, quadrics = self.surface.vertices.copy(), self.surface.quadrics.copy()
        faces = [self.surface.faces[self._own < 0]]
        for block, part in zip(self.lattice.blocks(), parts):
            patch, used = self._patch(block, self._own)
            moved = np.flatnonzero(~patch.locked)
            vertices[used[moved]], quadrics[used[moved]] = part.vertices[moved], part.quadrics[moved]
            faces.append(used[part.faces])
        return _Surface(vertices, quadrics, np.concatenate(faces)).without_loose()


def _settled(work: _FirstPass | _LaterPass, each: Each) -> _Surface:
    """A pass over all blocks; where faces of two blocks cut each other, those blocks again, with that place kept."""
    blocks = work.lattice.blocks()
    parts = dict(zip(blocks, each(*work.order(blocks, np.empty((0, 3))))))
    kept = np.empty((0, 3))
    for _ in range(ROUNDS):
        surface = work.joined([parts[block] for block in blocks])
        cuts = crossing_triangles(surface.vertices, surface.faces)[1]
        if not len(cuts):
            return surface
        kept = np.concatenate([kept, *_around(cuts)])
        again = list(_blocks_near(work, cuts))
        parts.update(zip(again, each(*work.order(again, kept))))
    raise Refusal(f"after {ROUNDS} rounds faces of two blocks still cut each other; allow a smaller --tolerance.")


def _around(places: Floats) -> list[Floats]:
    """Places and their neighbourhood, since what is kept is what lies within REACH of each."""
    steps = np.stack(np.meshgrid(*[[-REACH, 0.0, REACH]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    return [places + step for step in steps]


def _blocks_near(work: _FirstPass | _LaterPass, places: Floats) -> Iterator[Place]:
    for block in work.lattice.blocks():
        low, stop = (end * work.solid.proportions for end in work.lattice.extent(block))
        near = (places >= low - 3.0 * REACH) & (places <= stop + 3.0 * REACH)
        if near.all(axis=1).any():
            yield block

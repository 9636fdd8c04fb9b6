"""Bodies, cavities and holes of a binary grid, counted from its voxels and from a mesh, which must agree.

    solid voxels are joined over faces (6 neighbours), empty ones over faces and edges (18 neighbours)

chi_6 of the solid voxels as points, their joins, squares and cubes of solid voxels: points - joins + squares - cubes.
The surface has  chi = 2 (chi_6 + n_6),  n_6 the cells whose only two empty corners lie opposite each other: there the
two empty voxels do not meet, though the cell's other corners make no cube.  genus = shells - chi / 2.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from recon.numerics.closed_mesh import shell_volumes
from recon.numerics.halfedges import connected_components, euler_number

__all__ = ["Topology", "adjacency", "body_labels", "kept_bodies", "grid_topology", "mesh_topology"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

_OVER_FACES = ndimage.generate_binary_structure(3, 1)
_OVER_EDGES = ndimage.generate_binary_structure(3, 2)


class Topology(NamedTuple):
    """bodies: pieces that hang together; cavities: closed hollows within them; genus: handles, summed over shells."""

    bodies: int
    cavities: int
    genus: int

    @property
    def euler(self) -> int:
        """Euler number of the surface."""
        return 2 * (self.bodies + self.cavities - self.genus)


def adjacency() -> tuple[Bools, Bools]:
    """(3, 3, 3) which neighbours of the middle voxel hang together with it: of solid ones, and of empty ones."""
    return _OVER_FACES, _OVER_EDGES


def grid_topology(solid: Bools) -> Topology:
    """Topology of the surface around the solid voxels (X, Y, Z)."""
    inside = np.pad(np.asarray(solid, dtype=bool), 1)
    bodies = int(ndimage.label(inside, _OVER_FACES)[1])
    cavities = int(ndimage.label(~inside, _OVER_EDGES)[1]) - 1
    return Topology(bodies, cavities, bodies + cavities - (_chi_6(inside) + _opposite_holes(inside)))


def _chi_6(inside: Bools) -> int:
    total = int(inside.sum())
    joins = [_pairs(inside, axis) for axis in range(3)]
    squares = [_pairs(joins[a], b) for a, b in ((0, 1), (1, 2), (2, 0))]
    cubes = _pairs(squares[0], 2)
    return total - sum(int(j.sum()) for j in joins) + sum(int(s.sum()) for s in squares) - int(cubes.sum())


def _pairs(inside: Bools, axis: int) -> Bools:
    """Whether a place and its neighbour along an axis are both solid."""
    n = inside.shape[axis]
    return np.asarray(inside.take(range(n - 1), axis) & inside.take(range(1, n), axis))


def _opposite_holes(inside: Bools) -> int:
    """Cells with six solid corners, the two empty ones opposite each other."""
    nx, ny, nz = inside.shape
    corner = [inside[x : nx - 1 + x, y : ny - 1 + y, z : nz - 1 + z] for z in (0, 1) for y in (0, 1) for x in (0, 1)]
    solid_corners = sum(c.astype(np.int8) for c in corner)
    return sum(int(((solid_corners == 6) & ~corner[c] & ~corner[7 - c]).sum()) for c in range(4))


def mesh_topology(vertices: Floats, face_vertices: Ints) -> Topology:
    """Topology of a closed mesh: shells with a positive volume are bodies, those with a negative one cavities."""
    shell = connected_components(face_vertices)
    volumes = shell_volumes(vertices[face_vertices], shell)
    bodies = int((volumes > 0).sum())
    return Topology(bodies, len(volumes) - bodies, len(volumes) - euler_number(face_vertices) // 2)


def body_labels(solid: Bools) -> tuple[NDArray[np.int32], Ints]:
    """Number of the body of each solid voxel, from 1, and the voxels of each body."""
    labels, n = ndimage.label(solid, _OVER_FACES)
    return labels, np.bincount(labels.ravel(), minlength=n + 1)[1:].astype(np.int64)


def kept_bodies(solid: Bools, *, largest: bool = False, min_voxels: int = 1) -> tuple[Bools, Ints]:
    """The solid voxels without their small bodies, and the sizes of those dropped, the largest first."""
    labels, sizes = body_labels(solid)
    keep = sizes >= min_voxels
    if largest:
        keep &= np.arange(len(sizes)) == int(sizes.argmax())
    return np.append(False, keep)[labels], np.sort(sizes[~keep])[::-1]

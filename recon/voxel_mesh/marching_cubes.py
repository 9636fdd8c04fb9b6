"""Marching cubes of a binary grid: a closed surface that separates every solid voxel centre from every empty one.

      o---x---.       o solid centre, . empty centre; the line between neighbours is a grid edge
      |  /    |       x surface vertex, halfway along the grid edge that it belongs to for ever: sliding along it
      x /     |         changes the shape and never what is inside
      |/      |
      .-------.       Lengths here are voxels: index times `proportions`, the spacing over the smallest spacing.

Paper  [nakamura], section 2; [lorensen1987].
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.geometry.voxel_grid import VoxelGrid
from recon.numerics.cell_lookup import CellLookup, cell_lookup
from recon.voxel_mesh.cell_table import cell_table

__all__ = ["GridSurface", "marching_cubes", "window_surface"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class GridSurface:
    """Surface of a binary grid.

    vertices       (V, 3) in voxels
    face_vertices  (F, 3) counter-clockwise seen from outside the solid
    edge_voxel     (V, 3) index of the voxel at the lower end of the vertex's grid edge; -1 before the grid's border
    edge_axis      (V,) axis along which that grid edge runs
    solid_below    (V,) whether its lower end is the solid one
    """

    vertices: Floats
    face_vertices: Ints
    edge_voxel: Ints
    edge_axis: Ints
    solid_below: Bools

    def solid_voxels(self) -> Ints:
        """(V, 3) index of the solid voxel at the end of each vertex's grid edge."""
        step = np.eye(3, dtype=np.int64)[self.edge_axis]
        return self.edge_voxel + np.where(self.solid_below[:, None], 0, step)

    def empty_voxels(self) -> Ints:
        """(V, 3) index of the empty voxel at its other end, which may lie before or behind the grid."""
        step = np.eye(3, dtype=np.int64)[self.edge_axis]
        return self.edge_voxel + np.where(self.solid_below[:, None], step, 0)

    def face_cells(self) -> Ints:
        """(F, 3) cell in which each face lies, by the least index of the cell's corners."""
        # what a face's grid edges share along each axis tells which cell it is
        middle = (self.edge_voxel + 0.5 * np.eye(3)[self.edge_axis])[self.face_vertices].mean(axis=1)
        return np.floor(middle).astype(np.int64)

    def side_centres(self, proportions: Floats) -> tuple[Floats, Floats]:
        """Solid (n, 3) and empty (m, 3) centres beside the surface, each once, in voxels."""
        solid, empty = (_distinct(index) for index in (self.solid_voxels(), self.empty_voxels()))
        return solid * proportions, empty * proportions

    def lookup(self, proportions: Floats) -> CellLookup:
        """Which of its triangles lie near a point; its vertices may have slid along their grid edges."""
        return cell_lookup(self.vertices[self.face_vertices], self.face_cells(), proportions)


def _distinct(index: Ints) -> Ints:
    """Each row of (n, 3) indices once."""
    low = index.min(axis=0)
    shape = tuple((index.max(axis=0) - low + 1).tolist())
    return (
        np.stack(np.unravel_index(np.unique(np.ravel_multi_index(tuple((index - low).T), shape)), shape), axis=1) + low
    )


def marching_cubes(grid: VoxelGrid) -> GridSurface:
    """Surface of the solid voxels; where they reach the border of the grid it closes half a voxel outside.

    Promises  closed and manifold, every edge with two faces, whatever the grid; one shell a 6-connected body and one a
              cavity (outside 18-connected), see `recon.voxel_mesh.topology`.
    """
    low, inside = cropped(grid.solid)
    table = cell_table()
    counts = _count(inside, table.counts)
    edges, axis, below, faces = _march(inside, table.counts, table.triangles, *counts)
    edge_voxel = edges.astype(np.int64) + low
    half = np.eye(3)[axis] * 0.5
    return GridSurface((edge_voxel + half) * grid.proportions, faces, edge_voxel, axis.astype(np.int64), below)


def window_surface(inside: Bools, first: Ints, proportions: Floats) -> GridSurface:
    """Surface within a window of a grid: open where it leaves the window, on the planes through its outermost centres.

    inside  (X, Y, Z) solid voxels of the window, two or more along each axis; first (3,) index of the first of them
    Promises  the same vertices and faces as the surface of the whole has within the window, to the last bit.
    """
    table = cell_table()
    n_vertices = sum(int(np.count_nonzero(np.diff(inside, axis=axis))) for axis in range(3))
    _, n_faces = _count(inside, table.counts)
    edges, axis, below, faces = _march(inside, table.counts, table.triangles, n_vertices, n_faces)
    edge_voxel = edges.astype(np.int64) + first
    half = np.eye(3)[axis] * 0.5
    return GridSurface((edge_voxel + half) * proportions, faces, edge_voxel, axis.astype(np.int64), below)


def cropped(solid: Bools) -> tuple[Ints, Bools]:
    """The box of the solid voxels with one layer of empty ones around it, and the index of its first voxel."""
    spans = []
    for axis in range(3):
        hit = np.flatnonzero(solid.any(axis=tuple(a for a in range(3) if a != axis)))
        spans.append((int(hit[0]), int(hit[-1]) + 1))
    inner = solid[tuple(slice(*span) for span in spans)]
    return np.array([span[0] - 1 for span in spans], dtype=np.int64), np.pad(inner, 1)


@njit(cache=True)
def _case(inside: Bools, i: int, j: int, k: int) -> int:  # pragma: no cover - compiled
    return (
        inside[i, j, k]
        + 2 * inside[i + 1, j, k]
        + 4 * inside[i, j + 1, k]
        + 8 * inside[i + 1, j + 1, k]
        + 16 * inside[i, j, k + 1]
        + 32 * inside[i + 1, j, k + 1]
        + 64 * inside[i, j + 1, k + 1]
        + 128 * inside[i + 1, j + 1, k + 1]
    )


@njit(cache=True)
def _count(inside: Bools, per_case: NDArray[np.int8]) -> tuple[int, int]:  # pragma: no cover - compiled
    """Vertices and triangles there will be."""
    nx, ny, nz = inside.shape
    n_vertices, n_faces = 0, 0
    for i in range(nx - 1):
        for j in range(ny - 1):
            for k in range(nz - 1):
                case = _case(inside, i, j, k)
                if case != 0 and case != 255:
                    n_faces += per_case[case]
                    here = case & 1
                    n_vertices += (here != case >> 1 & 1) + (here != case >> 2 & 1) + (here != case >> 4 & 1)
    return n_vertices, n_faces


@njit(cache=True)
def _march(
    inside: Bools, per_case: NDArray[np.int8], triangles: NDArray[np.int8], n_vertices: int, n_faces: int
) -> tuple[NDArray[np.int32], NDArray[np.int8], Bools, Ints]:  # pragma: no cover - compiled
    """Cells layer by layer; the vertices of two layers of grid edges are remembered, no more.

    Every crossed grid edge has its own cell, the one that begins at its lower end, since the outermost layer is empty.
    """
    nx, ny, nz = inside.shape
    edges = np.empty((n_vertices, 3), dtype=np.int32)
    axes = np.empty(n_vertices, dtype=np.int8)
    below = np.empty(n_vertices, dtype=np.bool_)
    faces = np.empty((n_faces, 3), dtype=np.int64)
    number = np.full((2, ny, nz, 3), -1, dtype=np.int32)  # by parity of the slice, of grid edges that begin in it
    made, filled, n = 0, 0, np.empty(3, dtype=np.int64)
    made = _number_slice(inside, 0, number, edges, axes, below, made)
    for i in range(nx - 1):
        made = _number_slice(inside, i + 1, number, edges, axes, below, made)
        for j in range(ny - 1):
            for k in range(nz - 1):
                case = _case(inside, i, j, k)
                for t in range(per_case[case]):
                    for c in range(3):
                        e = triangles[case, t, c]
                        axis, rest = e // 4, e % 4
                        low, high = rest & 1, rest >> 1
                        x = 0 if axis == 0 else low
                        y = low if axis == 0 else 0 if axis == 1 else high
                        z = 0 if axis == 2 else high
                        n[c] = number[(i + x) & 1, j + y, k + z, axis]
                    faces[filled, 0], faces[filled, 1], faces[filled, 2] = n[0], n[1], n[2]
                    filled += 1
    return edges, axes, below, faces


@njit(cache=True)
def _number_slice(
    inside: Bools,
    i: int,
    number: NDArray[np.int32],
    edges: NDArray[np.int32],
    axes: NDArray[np.int8],
    below: Bools,
    made: int,
) -> int:  # pragma: no cover - compiled
    """Number the crossed grid edges that begin in slice i."""
    nx, ny, nz = inside.shape
    for j in range(ny):
        for k in range(nz):
            here = inside[i, j, k]
            for axis in range(3):
                x, y, z = i + (axis == 0), j + (axis == 1), k + (axis == 2)
                if x < nx and y < ny and z < nz and inside[x, y, z] != here:
                    edges[made, 0], edges[made, 1], edges[made, 2] = i, j, k
                    axes[made], below[made] = axis, here
                    number[i & 1, j, k, axis] = made
                    made += 1
    return made

"""Feature voxels: the tips of what sticks out of a shape, and the bottoms of its hollows.

    solid          opened by a ball      residue and its distances       features
    #######          #####                #.....#                         maxima of the distance over the six neighbours
    #######         #######                                               1 2        2 is one: no neighbour is farther
    #######         #######                                               . 1        from the opened shape

Concave features are found the same way on the closed shape; they lie outside, so the solid voxels that touch them are
taken in their place.  A ball is digital: every voxel whose centre lies within the radius, in units of the smallest
spacing, so that it is a ball in space on grids whose voxels are no cubes.

Paper  [nakamura], section 2.1: radius 3 for opening, 2 for closing.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from recon.geometry.voxel_grid import VoxelGrid
from recon.voxel_mesh.marching_cubes import cropped

__all__ = ["FeatureVoxels", "feature_voxels", "opened", "closed"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

_OVER_FACES = ndimage.generate_binary_structure(3, 1)


class FeatureVoxels(NamedTuple):
    """Masks over the grid (X, Y, Z): convex features, and solid voxels that touch a concave one."""

    convex: Bools
    concave: Bools


def feature_voxels(grid: VoxelGrid, *, opening: float = 3.0, closing: float = 2.0) -> FeatureVoxels:
    """Feature voxels of a grid; opening and closing are the radii of the two balls, in voxels.

    Where nothing of a body is left by the opening, all of it sticks out, and every voxel of it is a feature.
    """
    low, inside = cropped(grid.solid)
    margin = int(np.ceil(max(opening, closing))) + 1
    inside = np.pad(inside, margin)
    convex = _maxima(inside & ~opened(inside, opening, grid.proportions), inside, grid.proportions)
    residue = closed(inside, closing, grid.proportions) & ~inside
    outer = _maxima(residue, ~inside, grid.proportions)
    concave = inside & ndimage.binary_dilation(outer, _OVER_FACES)
    return FeatureVoxels(*(_restored(mask, low - margin, grid.solid.shape) for mask in (convex, concave)))


def opened(inside: Bools, radius: float, proportions: Floats) -> Bools:
    """Opening of a mask with empty borders by a ball."""
    ball = _ball(radius, proportions)
    eroded = inside.copy()
    _stamp(eroded, _surface(~inside), ball, False)
    grown = eroded.copy()
    _stamp(grown, _surface(eroded), ball, True)
    return grown


def closed(inside: Bools, radius: float, proportions: Floats) -> Bools:
    """Closing of a mask by a ball; its borders must be empty as deep as the radius."""
    return ~opened(~inside, radius, proportions)


def _ball(radius: float, proportions: Floats) -> Ints:
    reach = np.floor(radius / proportions).astype(int)
    offsets = np.stack(np.meshgrid(*(np.arange(-r, r + 1) for r in reach), indexing="ij"), axis=-1).reshape(-1, 3)
    return offsets[((offsets * proportions) ** 2).sum(axis=1) <= radius**2].astype(np.int64)


def _surface(mask: Bools) -> Ints:
    """Voxels of a mask with a neighbour over a face outside it; balls around the others reach no farther."""
    return np.argwhere(mask & ~ndimage.binary_erosion(mask, _OVER_FACES, border_value=1))


@njit(cache=True)
def _stamp(mask: Bools, centres: Ints, ball: Ints, value: bool) -> None:  # pragma: no cover - compiled
    nx, ny, nz = mask.shape
    for c in range(len(centres)):
        for b in range(len(ball)):
            i, j, k = centres[c, 0] + ball[b, 0], centres[c, 1] + ball[b, 1], centres[c, 2] + ball[b, 2]
            if 0 <= i < nx and 0 <= j < ny and 0 <= k < nz:
                mask[i, j, k] = value


def _maxima(residue: Bools, whole: Bools, proportions: Floats) -> Bools:
    """Voxels of the residue that no neighbour over a face exceeds in distance to what was left of the whole."""
    features = np.zeros_like(residue)
    places = np.argwhere(residue)
    left = np.argwhere(whole & ~residue & ndimage.binary_dilation(residue, _OVER_FACES))
    if not len(places):
        return features
    if not len(left):
        return residue.copy()
    away = cKDTree(left * proportions).query(places * proportions)[0]
    distance = np.zeros(residue.shape, dtype=np.float32)
    distance[residue] = away
    shifted = np.pad(distance, 1)
    for axis in range(3):
        for step in (-1, 1):
            neighbour = np.roll(shifted, step, axis=axis)[1:-1, 1:-1, 1:-1][residue]
            away = np.where(neighbour > distance[residue], -1.0, away)
    features[residue] = away >= 0
    return features


def _restored(mask: Bools, low: Ints, shape: tuple[int, ...]) -> Bools:
    """A mask over the cropped box as one over the whole grid."""
    whole = np.zeros(shape, dtype=bool)
    here = np.argwhere(mask) + low
    whole[tuple(here.T)] = True
    return whole

"""From a binary grid to the surfaces of a CAD part: terraces off, regions, surfaces, intervals; all in model units."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.errors import NoSolid
from recon.geometry.analytic import AnalyticSurface, Blend
from recon.geometry.voxel_grid import VoxelGrid
from recon.voxel_mesh.marching_cubes import GridSurface, marching_cubes
from recon.voxel_mesh.open_intervals import open_interval, snapped_blend, snapped_surface
from recon.voxel_mesh.recognition import Recognised, recognised
from recon.voxel_mesh.regions import analytic_regions, smooth_surface
from recon.voxel_mesh.terraces import without_terraces
from recon.voxel_mesh.voting import Vote

__all__ = ["AnalyticPart", "analytic_part"]

Floats = NDArray[np.float64]
ROOM = 3  # voxels around the part


@dataclass(frozen=True, eq=False)
class AnalyticPart:
    """Surfaces and blends of a part.

    intervals  for each surface, how far it may move along its normal without a voxel centre changing sides
    box        lowest and highest corner of the part, with room around
    """

    grid: VoxelGrid
    surfaces: tuple[AnalyticSurface, ...]
    blends: tuple[Blend, ...]
    intervals: tuple[tuple[float, float], ...]
    box: tuple[Floats, Floats]

    def vote(self) -> Vote:
        """Who says which cells between the surfaces are solid."""
        index = np.argwhere(self.grid.solid.any(axis=(1, 2))), np.argwhere(self.grid.solid.any(axis=(0, 2)))
        spans = [*index, np.argwhere(self.grid.solid.any(axis=(0, 1)))]
        low = np.array([span.min() - ROOM for span in spans])
        return Vote(self.grid, self.surfaces, low, np.array([span.max() + ROOM + 1 for span in spans]))

    def snapped(self, step: float) -> "AnalyticPart":
        """The part at the roundest multiples of a step that the intervals hold."""
        voxel = self.grid.voxel
        surfaces = tuple(
            snapped_surface(s, interval, step=step, voxel=voxel) for s, interval in zip(self.surfaces, self.intervals)
        )
        blends = tuple(snapped_blend(b, step=step, voxel=voxel) for b in self.blends)
        return AnalyticPart(self.grid, surfaces, blends, self.intervals, self.box)


def analytic_part(grid: VoxelGrid, *, doing: Callable[[str], None] = lambda text: None) -> AnalyticPart:
    """Surfaces of the part that a grid shows.

    Raises  NoSolid when nothing on the grid's surface is plane, cylinder, sphere or cone.
    """
    surface = marching_cubes(grid)
    doing("taking the terraces off")
    smooth = smooth_surface(surface, without_terraces(surface, grid.proportions))
    doing("recognising surfaces")
    regions, _ = analytic_regions(smooth)
    if not regions:
        raise NoSolid(f"nothing on {grid.name} is a plane, a cylinder, a sphere or a cone")
    found = recognised(smooth, regions)
    place = (grid.direction, grid.voxel, grid.origin)
    return AnalyticPart(
        grid,
        tuple(s.placed(*place) for s in found.surfaces),
        tuple(b.placed(*place) for b in found.blends),
        _intervals(surface, grid, found),
        _box(surface, grid),
    )


def _intervals(surface: GridSurface, grid: VoxelGrid, found: Recognised) -> tuple[tuple[float, float], ...]:
    solid = surface.solid_voxels()
    step = np.eye(3, dtype=np.int64)[surface.edge_axis]
    empty = surface.edge_voxel + np.where(surface.solid_below[:, None], step, 0)
    intervals = []
    for one, members in zip(found.surfaces, found.members):
        low, high = open_interval(one, solid[members] * grid.proportions, empty[members] * grid.proportions)
        intervals.append((low * grid.voxel, high * grid.voxel))
    return tuple(intervals)


def _box(surface: GridSurface, grid: VoxelGrid) -> tuple[Floats, Floats]:
    low = surface.vertices.min(axis=0) - ROOM
    high = surface.vertices.max(axis=0) + ROOM
    corners = np.stack(np.meshgrid(*np.stack([low, high], axis=1), indexing="ij"), axis=-1).reshape(-1, 3)
    placed = grid.place(corners)
    return placed.min(axis=0), placed.max(axis=0)

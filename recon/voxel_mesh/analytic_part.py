"""From a binary grid to the surfaces of a CAD part: terraces off, regions, surfaces, intervals; all in model units."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from recon.errors import NoSolid
from recon.geometry.analytic import AnalyticSurface, Blend
from recon.geometry.voxel_grid import VoxelGrid
from recon.voxel_mesh.marching_cubes import GridSurface, marching_cubes
from recon.voxel_mesh.mixed_part import MixedPart
from recon.voxel_mesh.open_intervals import NEAR, open_interval, open_radius, roundest, snapped_surface
from recon.voxel_mesh.recognition import recognised
from recon.voxel_mesh.regions import analytic_regions, smooth_surface
from recon.voxel_mesh.settled_surfaces import Ends, settled_faces
from recon.voxel_mesh.sheets import borne_out_sheets
from recon.voxel_mesh.terraces import without_terraces
from recon.voxel_mesh.voting import Vote

__all__ = ["AnalyticPart", "analytic_part", "free_part"]

Floats = NDArray[np.float64]
ROOM = 3  # voxels around the part
MOST = 60  # surfaces: settled together, and cut with each other, they take the square of that


@dataclass(frozen=True, eq=False)
class AnalyticPart:
    """Surfaces and blends of a part.

    intervals  for each surface, how far it may move along its normal without a voxel centre changing sides
    ends       for each blend, the solid and the empty ends (n, 3) of the grid edges of its vertices
    box        lowest and highest corner of the part, with room around
    mixed      the same surface for a solid of true faces and triangles
    """

    grid: VoxelGrid
    surfaces: tuple[AnalyticSurface, ...]
    blends: tuple[Blend, ...]
    intervals: tuple[tuple[float, float], ...]
    ends: tuple[tuple[Floats, Floats], ...]
    box: tuple[Floats, Floats]
    mixed: MixedPart

    def vote(self) -> Vote:
        """Who says which cells between the surfaces are solid."""
        index = np.argwhere(self.grid.solid.any(axis=(1, 2))), np.argwhere(self.grid.solid.any(axis=(0, 2)))
        spans = [*index, np.argwhere(self.grid.solid.any(axis=(0, 1)))]
        low = np.array([span.min() - ROOM for span in spans])
        return Vote(self.grid, self.surfaces, low, np.array([span.max() + ROOM + 1 for span in spans]))

    def snapped(self, step: float, *, places: bool = True) -> "AnalyticPart":
        """The part at the roundest multiples of a step that the intervals hold, its axes too unless `places` is off."""
        voxel = self.grid.voxel
        surfaces = tuple(
            snapped_surface(s, interval, step=step, voxel=voxel, places=places)
            for s, interval in zip(self.surfaces, self.intervals)
        )
        blends = []
        for blend, ends in zip(self.blends, self.ends):
            low, high = open_radius(blend, surfaces, *ends)
            radius = roundest(low - NEAR * voxel, high + NEAR * voxel, step)
            blends.append(replace(blend, radius=0.5 * (low + high) if radius is None else radius))
        return replace(self, surfaces=surfaces, blends=tuple(blends))


def analytic_part(grid: VoxelGrid, *, doing: Callable[[str], None] = lambda text: None) -> AnalyticPart:
    """Surfaces of the part that a grid shows.

    Raises  NoSolid when nothing on the grid's surface is plane, cylinder, sphere or cone, or too much of it.
    """
    surface = marching_cubes(grid)
    doing("taking the terraces off")
    slid = without_terraces(surface, grid.proportions)
    smooth = smooth_surface(surface, slid)
    doing("recognising surfaces")
    regions, _ = analytic_regions(smooth)
    if not regions:
        raise NoSolid(f"nothing on {grid.name} is a plane, a cylinder, a sphere or a cone")
    ends, faces = Ends(*_ends(surface, grid), smooth.normal), recognised(smooth, regions)
    if len(faces.surfaces) > MOST:
        raise NoSolid(f"{len(faces.surfaces)} surfaces were found on {grid.name}, more than the {MOST} a part may have")
    doing("settling the surfaces between the voxels")
    found = settled_faces(faces, ends, smooth.middle)
    place = (grid.direction, grid.voxel, grid.origin)
    intervals = [open_interval(one, ends.solid[m], ends.empty[m]) for one, m in zip(found.surfaces, found.members)]
    return AnalyticPart(
        grid,
        tuple(s.placed(*place) for s in found.surfaces),
        tuple(b.placed(*place) for b in found.blends),
        tuple((low * grid.voxel, high * grid.voxel) for low, high in intervals),
        tuple((grid.place(ends.solid[m]), grid.place(ends.empty[m])) for m in found.blend_members),
        _box(surface, grid),
        MixedPart(grid, surface, slid, tuple(borne_out_sheets(found, ends)), ends),
    )


def free_part(grid: VoxelGrid) -> MixedPart:
    """The smoothed surface of a grid without a single sheet."""
    surface = marching_cubes(grid)
    slid = without_terraces(surface, grid.proportions)
    normal = smooth_surface(surface, slid).normal
    return MixedPart(grid, surface, slid, (), Ends(*_ends(surface, grid), normal))


def _ends(surface: GridSurface, grid: VoxelGrid) -> tuple[Floats, Floats]:
    """Solid and empty end of every vertex's grid edge, in voxels."""
    return surface.solid_voxels() * grid.proportions, surface.empty_voxels() * grid.proportions


def _box(surface: GridSurface, grid: VoxelGrid) -> tuple[Floats, Floats]:
    low = surface.vertices.min(axis=0) - ROOM
    high = surface.vertices.max(axis=0) + ROOM
    corners = np.stack(np.meshgrid(*np.stack([low, high], axis=1), indexing="ij"), axis=-1).reshape(-1, 3)
    placed = grid.place(corners)
    return placed.min(axis=0), placed.max(axis=0)

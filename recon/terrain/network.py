"""The patches of a terrain as a network: corners, edges and sides numbered for the kernel door."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from recon.geometry.bspline import BSplineSurface
from recon.geometry.patches import COLLAPSED, PatchNetwork
from recon.terrain.pipeline import Terrain

__all__ = ["stretched", "terrain_network"]


def terrain_network(terrain: Terrain) -> PatchNetwork:
    """Patches of a terrain, in local coordinates, with every shared side one edge.

    Promises  all normals upward; an edge has two patches, or one on the border of the map.
    """
    patches: list[BSplineSurface | None] = [None] * terrain.n_patches
    for part in terrain.nets:
        for row, surface in zip(part.rows.tolist(), part.surfaces()):
            patches[row] = surface
    layout = terrain.layout
    sides = layout.side_edges
    used = np.unique(sides[sides != COLLAPSED])
    number = np.full(len(terrain.tiling.edges), COLLAPSED)
    number[used] = np.arange(len(used))
    vertices, corners = np.unique(layout.corners, return_inverse=True)  # those of a part of the ground, where it is one
    local = np.full(len(terrain.tiling.points), -1)
    local[vertices] = np.arange(len(vertices))
    return PatchNetwork(
        tuple(patch for patch in patches if patch is not None),
        np.column_stack([terrain.tiling.points, terrain.jets.height])[vertices],
        local[terrain.tiling.edges[used]],
        np.where(sides == COLLAPSED, COLLAPSED, number[sides]),
        layout.side_forward.astype(np.int64),
        corners.reshape(-1, 4),
    )


def stretched(network: PatchNetwork, factors: NDArray[np.float64]) -> PatchNetwork:
    """The network with its coordinates times the (3,) factors."""
    if (factors == 1.0).all():
        return network
    patches = tuple(replace(patch, control_net=patch.control_net * factors) for patch in network.patches)
    return replace(
        network,
        patches=patches,
        vertices=network.vertices * factors,
        side_forward=network.side_forward.astype(np.int64),
    )

"""The patches of a terrain as a network: corners, edges and sides numbered for the kernel door."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from recon.geometry.bspline import BSplineSurface
from recon.geometry.patches import COLLAPSED, PatchNetwork
from recon.terrain.ground import Terrain

__all__ = ["border_angles", "joined_network", "stretched", "terrain_network"]


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


def joined_network(parts: Sequence[PatchNetwork]) -> PatchNetwork:
    """The networks of neighbouring map tiles as one: vertices at one place, to the last bit, become one, and so edges.

    Promises  no two edges join the same two vertices, as in every part.
    """
    vertices, number = np.unique(np.vstack([part.vertices for part in parts]), axis=0, return_inverse=True)
    first = np.cumsum([0, *(len(part.vertices) for part in parts)])
    ends = np.vstack([number[part.edge_vertices + at] for part, at in zip(parts, first)])
    key = ends.min(axis=1) * len(vertices) + ends.max(axis=1)
    _, kept, edge = np.unique(key, return_index=True, return_inverse=True)
    turned = ends[:, 0] != ends[kept][edge, 0]
    first_edge = np.cumsum([0, *(len(part.edge_vertices) for part in parts)])
    sides, forward = [], []
    for part, at in zip(parts, first_edge):
        used = part.side_edges != COLLAPSED
        own = np.where(used, part.side_edges + at, 0)
        sides.append(np.where(used, edge[own], COLLAPSED))
        forward.append(part.side_forward ^ (used & turned[own]))
    corners = np.vstack([number[part.corner_vertices + at] for part, at in zip(parts, first)])
    patches = tuple(patch for part in parts for patch in part.patches)
    return PatchNetwork(patches, vertices, ends[kept], np.vstack(sides), np.vstack(forward).astype(np.int64), corners)


def border_angles(parts: Sequence[PatchNetwork], samples: int = 5) -> NDArray[np.float64]:
    """(n,) angles in radians between the tangent planes of two parts at points of the edges that they share."""
    whole = joined_network(parts)
    part = np.repeat(np.arange(len(parts)), [len(p.patches) for p in parts])
    patch, side = np.nonzero(whole.side_edges != COLLAPSED)
    edge = whole.side_edges[patch, side]
    order = np.argsort(edge, kind="stable")
    first = order[:-1][(edge[order][1:] == edge[order][:-1])]
    second = order[1:][(edge[order][1:] == edge[order][:-1])]
    across = part[patch[first]] != part[patch[second]]
    t = (np.arange(samples) + 0.5) / samples
    found = []
    for a, b in zip(first[across].tolist(), second[across].tolist()):
        one, other = (_side_normals(whole, int(patch[k]), int(side[k]), t) for k in (a, b))
        found.append(np.arcsin(np.clip(np.linalg.norm(np.cross(one, other), axis=1), 0.0, 1.0)))
    return np.concatenate([np.empty(0), *found])


def _side_normals(network: PatchNetwork, patch: int, side: int, t: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 3) unit normals along a side at parameters of its edge."""
    t = t if network.side_forward[patch, side] else 1.0 - t
    fixed = np.full(len(t), 1.0 if side in (1, 2) else 0.0)
    return network.patches[patch].normal(np.column_stack([t, fixed] if side in (0, 2) else [fixed, t]))


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

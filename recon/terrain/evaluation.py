"""Elevation and slope at any place of the map: which patch holds it, and where in the patch.

The plan map of every patch whose box holds the place is inverted by Newton steps.
"""

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from recon.geometry.contour_map import ContourMap
from recon.numerics.bernstein import bernstein
from recon.terrain.ground import Terrain
from recon.terrain.patch_group import PatchGroup

__all__ = ["contour_distances", "distances_between", "edge_angles", "elevations", "sampled_triangles"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SAMPLES = (np.arange(5) + 0.5) / 5
CHUNK, STEPS = 50_000, 12
BESIDE_POINT = 1.0 - 1e-6  # v at which the slope is taken in a corner that is a side: there X_u vanishes
INSIDE = 1e-7  # how far outside [0, 1] a parameter may lie


def elevations(terrain: Terrain, places: ArrayLike) -> tuple[Floats, Floats]:
    """(m,) heights and (m, 2) gradients of the ground at map places (m, 2); NaN outside the map."""
    local = np.asarray(places, dtype=np.float64).reshape(-1, 2) - terrain.origin
    patch, uv = _located(terrain, local)
    height, gradient = np.full(len(local), np.nan), np.full((len(local), 2), np.nan)
    for part in terrain.nets:
        place_in = np.full(terrain.n_patches, -1)
        place_in[part.rows] = np.arange(len(part.rows))
        rows = np.flatnonzero((patch >= 0) & (place_in[patch] >= 0))
        index = place_in[patch[rows]]
        height[rows] = part.points(index, uv[rows])[0][:, 2]
        beside = np.where(terrain.layout.is_triangle[patch[rows]], BESIDE_POINT, 1.0)
        _, x_u, x_v = part.points(index, np.column_stack([uv[rows, 0], np.minimum(uv[rows, 1], beside)]))
        z_u, z_v = x_u[:, 2], x_v[:, 2]
        area = _cross(x_u, x_v)
        with np.errstate(divide="ignore", invalid="ignore"):
            gradient[rows, 0] = (z_u * x_v[:, 1] - z_v * x_u[:, 1]) / area
            gradient[rows, 1] = (z_v * x_u[:, 0] - z_u * x_v[:, 0]) / area
    return height, gradient


def _cross(a: Floats, b: Floats) -> Floats:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def _located(terrain: Terrain, places: Floats) -> tuple[Ints, Floats]:
    """(m,) patch of every place, -1 for none, and the (m, 2) parameters in it."""
    patch, uv = np.full(len(places), -1), np.zeros((len(places), 2))
    for part in terrain.nets:
        if not len(part.rows):
            continue
        low, high = part.boxes()
        tree = shapely.STRtree(shapely.box(low[:, 0], low[:, 1], high[:, 0], high[:, 1]))
        samples = part.grid(SAMPLES)[..., :2].reshape(len(part.rows), -1, 2)
        for first in range(0, len(places), CHUNK):
            pair_place, owner = tree.query(shapely.points(places[first : first + CHUNK]))
            pair_place = pair_place + first
            found, inside = _inverted(part, owner, places[pair_place], samples)
            patch[pair_place[inside]], uv[pair_place[inside]] = part.rows[owner[inside]], found[inside]
    return patch, uv


def _inverted(part: PatchGroup, owner: Ints, places: Floats, samples: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """(n, 2) parameters of the places (n, 2) in the patches `owner`, and whether they lie there; Newton steps from the
    nearest of the patch's samples.
    """
    off = samples[owner] - places[:, None]
    nearest = np.argmin(np.einsum("nkd,nkd->nk", off, off), axis=1)
    uv = np.stack(np.divmod(nearest, len(SAMPLES)), axis=1)
    uv = SAMPLES[uv]
    scale = np.ptp(samples, axis=1).max(axis=1)[owner]
    for _ in range(STEPS):
        point, x_u, x_v = part.plan(owner, uv)
        miss, area = places - point, _cross(x_u, x_v)
        area = np.where(np.abs(area) > 1e-12 * scale**2, area, 1e-12 * scale**2)
        step = np.column_stack([_cross(miss, x_v), _cross(x_u, miss)]) / area[:, None]
        uv = np.clip(uv + np.clip(step, -0.5, 0.5), -0.2, 1.2)
    point, _, _ = part.plan(owner, uv)
    close = np.linalg.norm(places - point, axis=1) < 1e-8 * scale + 1e-9
    inside = close & (uv > -INSIDE).all(axis=1) & (uv < 1 + INSIDE).all(axis=1)
    return np.clip(uv, 0.0, 1.0), inside


def sampled_triangles(terrain: Terrain, steps: int = 4) -> tuple[Floats, Ints]:
    """(n, 3) points of the ground in map coordinates and (m, 3) triangles: every patch cut into steps x steps cells."""
    t = np.linspace(0.0, 1.0, steps + 1)
    points = np.empty((terrain.n_patches, (steps + 1) ** 2, 3))
    for part in terrain.nets:
        points[part.rows] = part.grid(t).reshape(len(part.rows), -1, 3)
    i, j = np.divmod(np.arange(steps * steps), steps)
    corner = i * (steps + 1) + j
    cell = np.vstack([
        np.column_stack([corner, corner + steps + 1, corner + steps + 2]),
        np.column_stack([corner, corner + steps + 2, corner + 1]),
    ])  # fmt: skip
    faces = (np.arange(terrain.n_patches)[:, None, None] * (steps + 1) ** 2 + cell).reshape(-1, 3)
    flat = points.reshape(-1, 3) + np.r_[terrain.origin, 0.0]
    return flat, faces


def contour_distances(terrain: Terrain, contours: ContourMap) -> Floats:
    """(m,) distances in plan from the given contour points to the ground's own curve of their height.

    The ground holds every contour's curve exactly, as the border of patches; ground between contours is not looked at.
    """
    curves = terrain.tiling.curves
    points = np.einsum("tk,mkd->mtd", bernstein(3, np.linspace(0, 1, 9)), curves.bezier) + terrain.origin
    level = curves.heights[curves.contour]
    out = []
    for height in np.unique(contours.heights):
        given = np.concatenate([line for line, z in zip(contours.lines, contours.heights) if z == height])
        out.append(_to_polylines(given, points[level == height]))
    return np.concatenate(out)


def _to_polylines(places: Floats, rows: Floats) -> Floats:
    """(m,) distances to the nearest of many short polylines (n, k, 2), by their nearest legs."""
    start, end = rows[:, :-1].reshape(-1, 2), rows[:, 1:].reshape(-1, 2)
    _, near = cKDTree((start + end) / 2).query(places, k=min(8, len(start)))
    near = near.reshape(len(places), -1)
    way = end[near] - start[near]
    square = np.maximum(np.einsum("nkd,nkd->nk", way, way), 1e-300)
    off = places[:, None] - start[near]
    share = np.clip(np.einsum("nkd,nkd->nk", off, way) / square, 0.0, 1.0)
    return np.linalg.norm(off - share[..., None] * way, axis=2).min(axis=1)


def distances_between(ours: ContourMap | None, theirs: ContourMap | None) -> Floats | None:
    """(m,) distances in plan from the points of our contours to their contours of the same height."""
    out: list[Floats] = []
    for height in np.unique([] if ours is None or theirs is None else ours.heights).tolist():
        given = [line for line, z in zip(theirs.lines, theirs.heights) if z == height]  # type: ignore[union-attr]
        found = [line for line, z in zip(ours.lines, ours.heights) if z == height]  # type: ignore[union-attr]
        if given:
            legs = np.concatenate([np.stack([line[:-1], line[1:]], axis=1) for line in given])
            tree = shapely.STRtree(shapely.linestrings(legs))
            points = shapely.points(np.concatenate(found))
            out.append(np.asarray(tree.query_nearest(points, return_distance=True, all_matches=False)[1]))
    return np.concatenate(out) if out else None


def edge_angles(terrain: Terrain, samples: int = 5) -> Floats:
    """(n,) angles in radians between the tangent planes of two patches at points of their common edges."""
    t = (np.arange(samples) + 0.5) / samples
    n_edges = len(terrain.tiling.edges)
    normals = np.full((n_edges, 2, samples, 3), np.nan)
    count = np.zeros(n_edges, dtype=np.int64)
    layout = terrain.layout
    for part in terrain.nets:
        for side, (u, v) in enumerate(((t, 0 * t), (0 * t + 1, t), (t, 0 * t + 1), (0 * t, t))):
            edge = layout.side_edges[part.rows, side]
            used = np.flatnonzero(edge >= 0)
            normal = part.normals(u, v)[used]
            normal = np.where(layout.side_forward[part.rows[used], side][:, None, None], normal, normal[:, ::-1])
            order = np.argsort(edge[used], kind="stable")
            sorted_edges = edge[used][order]
            again = np.r_[False, sorted_edges[1:] == sorted_edges[:-1]].astype(np.int64)
            slot = count[sorted_edges] + again
            normals[sorted_edges, slot] = normal[order]
            np.add.at(count, edge[used], 1)
    both = normals[count == 2]
    return np.asarray(np.arcsin(np.clip(np.linalg.norm(np.cross(both[:, 0], both[:, 1]), axis=2), 0, 1))).ravel()

"""Elevation and slope at any place of the map: which patch holds it, and where in the patch.

The plan map X(u, v) = (1 - v) a(u) + v b(u) of every patch whose box holds the place is inverted by Newton steps.
"""

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from recon.geometry.contour_map import ContourMap
from recon.numerics.bernstein import bernstein, bernstein_derivative
from recon.terrain.merging import plan_sides
from recon.terrain.pipeline import Terrain

__all__ = ["contour_distances", "elevations", "sampled_triangles"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SAMPLES = (np.arange(5) + 0.5) / 5
CHUNK, STEPS = 50_000, 12
INSIDE = 1e-7  # how far outside [0, 1] a parameter may lie


def elevations(terrain: Terrain, places: ArrayLike) -> tuple[Floats, Floats]:
    """(m,) heights and (m, 2) gradients of the ground at map places (m, 2); NaN outside the map."""
    local = np.asarray(places, dtype=np.float64).reshape(-1, 2) - terrain.origin
    patch, uv = _located(terrain, local)
    height, gradient = np.full(len(local), np.nan), np.full((len(local), 2), np.nan)
    bottom, top = plan_sides(terrain.tiling, terrain.layout)
    for part in terrain.nets:
        place_in = np.full(terrain.n_patches, -1)
        place_in[part.rows] = np.arange(len(part.rows))
        rows = np.flatnonzero((patch >= 0) & (place_in[patch] >= 0))
        net = part.nets[place_in[patch[rows]], :, :, 2]
        u, v = uv[rows].T
        bu, bv = bernstein(part.degree, u), bernstein(5, v)
        height[rows] = np.einsum("ni,nij,nj->n", bu, net, bv)
        z_u = np.einsum("ni,nij,nj->n", bernstein_derivative(part.degree, u), net, bv)
        z_v = np.einsum("ni,nij,nj->n", bu, net, bernstein_derivative(5, v))
        _, x_u, x_v = _plan(bottom[patch[rows]], top[patch[rows]], uv[rows])
        area = _cross(x_u, x_v)
        with np.errstate(divide="ignore", invalid="ignore"):
            gradient[rows, 0] = (z_u * x_v[:, 1] - z_v * x_u[:, 1]) / area
            gradient[rows, 1] = (z_v * x_u[:, 0] - z_u * x_v[:, 0]) / area
    return height, gradient


def _cross(a: Floats, b: Floats) -> Floats:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def _plan(bottom: Floats, top: Floats, uv: Floats) -> tuple[Floats, Floats, Floats]:
    """(n, 2) point of the plan map and its two derivatives."""
    u, v = uv[:, 0], uv[:, 1:]
    value, slope = bernstein(3, u), bernstein_derivative(3, u)
    low, high = (np.einsum("nk,nkd->nd", value, net) for net in (bottom, top))
    low_u, high_u = (np.einsum("nk,nkd->nd", slope, net) for net in (bottom, top))
    return (1 - v) * low + v * high, (1 - v) * low_u + v * high_u, high - low


def _located(terrain: Terrain, places: Floats) -> tuple[Ints, Floats]:
    """(m,) patch of every place, -1 for none, and the (m, 2) parameters in it."""
    bottom, top = plan_sides(terrain.tiling, terrain.layout)
    hull = np.concatenate([bottom, top], axis=1)
    low, high = hull.min(axis=1), hull.max(axis=1)
    tree = shapely.STRtree(shapely.box(low[:, 0], low[:, 1], high[:, 0], high[:, 1]))
    patch, uv = np.full(len(places), -1), np.zeros((len(places), 2))
    for first in range(0, len(places), CHUNK):
        pair_place, owner = tree.query(shapely.points(places[first : first + CHUNK]))
        pair_place = pair_place + first
        start = _nearest_sample(bottom[owner], top[owner], places[pair_place])
        found, inside = _inverted(bottom[owner], top[owner], places[pair_place], start)
        patch[pair_place[inside]], uv[pair_place[inside]] = owner[inside], found[inside]
    return patch, uv


def _nearest_sample(bottom: Floats, top: Floats, places: Floats) -> Floats:
    """(n, 2) parameters of that of a grid of samples of each patch which is nearest to the patch's own place."""
    low, high = bernstein(3, SAMPLES) @ bottom, bernstein(3, SAMPLES) @ top
    best, nearest = np.zeros((len(places), 2)), np.full(len(places), np.inf)
    for v in SAMPLES.tolist():
        off = (1 - v) * low + v * high - places[:, None]
        square = (off * off).sum(axis=2)
        at = np.argmin(square, axis=1)
        closer = square[np.arange(len(at)), at] < nearest
        nearest[closer] = square[np.arange(len(at)), at][closer]
        best[closer] = np.column_stack([SAMPLES[at], np.full(len(at), v)])[closer]
    return best


def _inverted(bottom: Floats, top: Floats, places: Floats, uv: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    scale = np.abs(top - bottom).max(axis=(1, 2)) + np.abs(np.diff(bottom, axis=1)).max(axis=(1, 2))
    for _ in range(STEPS):
        point, x_u, x_v = _plan(bottom, top, uv)
        miss, area = places - point, _cross(x_u, x_v)
        area = np.where(np.abs(area) > 1e-12 * scale**2, area, 1e-12 * scale**2)
        step = np.column_stack([_cross(miss, x_v), _cross(x_u, miss)]) / area[:, None]
        uv = np.clip(uv + np.clip(step, -0.5, 0.5), -0.2, 1.2)
    point, _, _ = _plan(bottom, top, uv)
    close = np.linalg.norm(places - point, axis=1) < 1e-8 * scale + 1e-9
    inside = close & (uv > -INSIDE).all(axis=1) & (uv < 1 + INSIDE).all(axis=1)
    return np.clip(uv, 0.0, 1.0), inside


def sampled_triangles(terrain: Terrain, steps: int = 4) -> tuple[Floats, Ints]:
    """(n, 3) points of the ground in map coordinates and (m, 3) triangles: every patch cut into steps x steps cells."""
    t = np.linspace(0.0, 1.0, steps + 1)
    points = np.empty((terrain.n_patches, (steps + 1) ** 2, 3))
    for part in terrain.nets:
        grid = np.einsum("iu,nuvd,jv->nijd", bernstein(part.degree, t), part.nets, bernstein(5, t), optimize=True)
        points[part.rows] = grid.reshape(len(part.rows), -1, 3)
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

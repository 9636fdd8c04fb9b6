"""Which parts of the surface lie on one plane, cylinder, sphere or cone: greedy growth, the largest region first.

    seed -> patch around it -> fits -> region: all that hangs together and keeps within
        0.62 voxel of the fit in its place on the grid edge's middle (half a voxel, and what the fit itself is off),
        0.33 voxel smoothed, and 12 degrees of its normal;   -> fits to the region -> region ...
    then the same once more for what is left, with 25 degrees.

A simpler kind wins unless a richer one's region is larger by a fifth: a plane is also a very large cylinder.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import sparse

from recon.errors import NoSolid
from recon.geometry.analytic import AnalyticSurface, Cone, Cylinder, Plane, Sphere
from recon.numerics.halfedges import vertex_adjacency, vertex_normals
from recon.voxel_mesh.fits import FITS
from recon.voxel_mesh.marching_cubes import GridSurface

__all__ = ["Region", "SmoothSurface", "analytic_regions", "smooth_surface"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

RAW, SMOOTHED = 0.62, 0.33
TURNS = 12.0, 25.0  # degrees; the second for what the first leaves: small holes along the grid, all steps
DEEP = 3  # rings between a seed and the regions found before
PATCH = 400  # vertices of the patch around a seed
MOST = 100  # regions
LEAST = 60  # vertices of a region worth a face
SEEDS = 6  # tried before the best is taken
GAIN = 1.2
NORMAL_ROUNDS = 2  # the steps of an axis-parallel hole turn single normals by more than any bound could allow
BENT = 8.0  # degrees by which the normals of a round region spread at least


@dataclass(frozen=True, eq=False)
class SmoothSurface:
    """The grid's surface in both its forms.

    middle, smooth, normal  (V, 3) places on the middles of grid edges, smoothed, and the smoothed normals
    start, neighbour        vertices around vertex v are neighbour[start[v]:start[v + 1]]
    """

    middle: Floats
    smooth: Floats
    normal: Floats
    start: Ints
    neighbour: Ints


@dataclass(frozen=True, eq=False)
class Region:
    """Vertices (n,) on one surface."""

    surface: AnalyticSurface
    vertices: Ints


def smooth_surface(surface: GridSurface, smooth: Floats) -> SmoothSurface:
    """Both forms together, with the neighbourhoods."""
    adjacency = sparse.csr_array(vertex_adjacency(surface.face_vertices, len(smooth)))
    links = adjacency.indptr.astype(np.int64), adjacency.indices.astype(np.int64)
    normal = vertex_normals(smooth, surface.face_vertices)
    for _ in range(NORMAL_ROUNDS):
        normal = normal + adjacency @ normal
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return SmoothSurface(surface.vertices, smooth, normal, *links)


def analytic_regions(s: SmoothSurface, *, seed: int = 0) -> tuple[list[Region], Ints]:
    """Regions, the largest first, and the region of every vertex, -1 where nothing fits.

    Raises  NoSolid when there are more than a part has: a free shape falls into ever smaller ones.
    """
    rng = np.random.default_rng(seed)
    label = np.full(len(s.middle), -1, dtype=np.int64)
    found: list[Region] = []
    for turn in TURNS:
        tried = np.zeros(len(label), dtype=bool)
        while (region := _largest(s, label, tried, turn, rng)) is not None:
            label[region.vertices] = len(found)
            found.append(region)
            if len(found) > MOST:
                raise NoSolid(f"more than {MOST} surfaces were found, too many for a part")
    found.sort(key=lambda region: -len(region.vertices))
    for number, region in enumerate(found):
        label[region.vertices] = number
    return found, label


def _largest(
    s: SmoothSurface, label: Ints, tried: NDArray[np.bool_], turn: float, rng: np.random.Generator
) -> Region | None:
    """The largest region around a few seeds far from all regions; None when every seed has been tried."""
    while True:
        seeds = np.flatnonzero(_depth(label >= 0, tried, s.start, s.neighbour, DEEP) > DEEP)
        if not len(seeds):
            return None
        best: Region | None = None
        for v in rng.choice(seeds, min(SEEDS, len(seeds)), replace=False).tolist():
            region = _grown(s, v, label, turn)
            if region is None or len(region.vertices) < LEAST:
                tried[v] = True
            elif best is None or len(region.vertices) > len(best.vertices):
                best = region
        if best is not None:
            return best


def _grown(s: SmoothSurface, seed: int, label: Ints, turn: float) -> Region | None:
    """The largest region around a seed over all kinds."""
    patch = _patch(seed, label, s.start, s.neighbour, PATCH)
    if len(patch) < LEAST:
        return None
    best: Region | None = None
    for fit in FITS:
        region = Region(Plane(np.zeros(3), 0.0), patch)
        for number in range(3):
            points = s.middle if number else s.smooth
            surface = fit(points[region.vertices], s.normal[region.vertices])
            if surface is None:
                break
            grown = _flood(seed, label, s, surface, turn)
            if len(grown) < LEAST:
                break
            done = number and len(grown) <= 1.02 * len(region.vertices)
            region = Region(surface, grown)
            if done:
                break
        if surface is None or len(region.vertices) < LEAST or region.vertices is patch:
            continue
        if not isinstance(surface, Plane) and _spread(s.normal[region.vertices]) < BENT:
            continue
        if best is None or len(region.vertices) > GAIN * len(best.vertices):
            best = region
    return best


def _spread(normals: Floats) -> float:
    """Degrees between the mean normal and the one that nineteen in twenty are nearer to."""
    mean = normals.mean(axis=0)
    cosine = normals @ (mean / max(float(np.linalg.norm(mean)), 1e-12))
    return float(np.degrees(np.arccos(np.clip(np.quantile(cosine, 0.05), -1.0, 1.0))))


def packed(surface: AnalyticSurface) -> tuple[int, Floats]:
    """Kind and numbers of a surface, for compiled code."""
    if isinstance(surface, Plane):
        return 0, np.append(surface.normal_vector, surface.offset)
    if isinstance(surface, Cylinder):
        return 1, np.concatenate([surface.point, surface.axis, [surface.radius]])
    if isinstance(surface, Sphere):
        return 2, np.append(surface.centre, surface.radius)
    assert isinstance(surface, Cone)
    return 3, np.concatenate([surface.apex, surface.axis, [surface.half_angle]])


def _flood(seed: int, label: Ints, s: SmoothSurface, surface: AnalyticSurface, turn: float) -> Ints:
    kind, numbers = packed(surface)
    return np.asarray(
        _flooded(
            seed, label, s.middle, s.smooth, s.normal, s.start, s.neighbour, kind, numbers, np.cos(np.radians(turn))
        )
    )


@njit(cache=True)
def _fits(kind: int, q: Floats, x: Floats, y: Floats, n: Floats, cosine: float) -> bool:  # pragma: no cover - compiled
    """Whether a vertex, x raw, y smoothed, with normal n, keeps within the bounds of a surface; n may be inward."""
    if kind == 0:
        turn = q[0] * n[0] + q[1] * n[1] + q[2] * n[2]
        raw = q[0] * x[0] + q[1] * x[1] + q[2] * x[2] - q[3]
        smooth = q[0] * y[0] + q[1] * y[1] + q[2] * y[2] - q[3]
        return turn >= cosine and abs(raw) <= RAW and abs(smooth) <= SMOOTHED
    turn, raw, smooth = 0.0, 0.0, 0.0
    for which in range(2):
        p = x if which == 0 else y
        ax, ay, az = p[0] - q[0], p[1] - q[1], p[2] - q[2]
        if kind == 2:
            size = np.sqrt(ax * ax + ay * ay + az * az) + 1e-12
            d = size - q[3]
            gx, gy, gz = ax / size, ay / size, az / size
        else:
            t = ax * q[3] + ay * q[4] + az * q[5]
            wx, wy, wz = ax - t * q[3], ay - t * q[4], az - t * q[5]
            size = np.sqrt(wx * wx + wy * wy + wz * wz) + 1e-12
            if kind == 1:
                d = size - q[6]
                gx, gy, gz = wx / size, wy / size, wz / size
            else:
                cos, sin = np.cos(q[6]), np.sin(q[6])
                d = size * cos - t * sin
                gx, gy, gz = cos * wx / size - sin * q[3], cos * wy / size - sin * q[4], cos * wz / size - sin * q[5]
        turn = gx * n[0] + gy * n[1] + gz * n[2]
        if which == 0:
            raw = d
        else:
            smooth = d
    return abs(turn) >= cosine and abs(raw) <= RAW and abs(smooth) <= SMOOTHED


@njit(cache=True)
def _flooded(
    seed: int,
    label: Ints,
    middle: Floats,
    smooth: Floats,
    normal: Floats,
    start: Ints,
    neighbour: Ints,
    kind: int,
    numbers: Floats,
    cosine: float,
) -> Ints:  # pragma: no cover - compiled
    seen = np.zeros(len(label), dtype=np.bool_)
    queue = np.empty(len(label), dtype=np.int64)
    queue[0], n, at = seed, 1, 0
    seen[seed] = True
    while at < n:
        v = queue[at]
        at += 1
        for e in range(start[v], start[v + 1]):
            w = neighbour[e]
            if not seen[w] and label[w] < 0:
                seen[w] = True
                if _fits(kind, numbers, middle[w], smooth[w], normal[w], cosine):
                    queue[n] = w
                    n += 1
    return queue[:n].copy()


@njit(cache=True)
def _patch(seed: int, label: Ints, start: Ints, neighbour: Ints, most: int) -> Ints:  # pragma: no cover - compiled
    """Up to so many vertices around a seed, ring by ring, that belong to no region."""
    seen = np.zeros(len(label), dtype=np.bool_)
    queue = np.empty(most, dtype=np.int64)
    queue[0], n, at = seed, 1, 0
    seen[seed] = True
    while at < n and n < most:
        v = queue[at]
        at += 1
        for e in range(start[v], start[v + 1]):
            w = neighbour[e]
            if not seen[w] and label[w] < 0 and n < most:
                seen[w] = True
                queue[n] = w
                n += 1
    return queue[:n].copy()


@njit(cache=True)
def _depth(
    taken: NDArray[np.bool_], tried: NDArray[np.bool_], start: Ints, neighbour: Ints, most: int
) -> Ints:  # pragma: no cover - compiled
    """Rings from the vertices that are taken or tried, most + 1 for all farther ones."""
    n = len(taken)
    depth = np.full(n, most + 1, dtype=np.int64)
    queue = np.empty(n, dtype=np.int64)
    size, at = 0, 0
    for v in range(n):
        if taken[v] or tried[v]:
            depth[v] = 0
            queue[size] = v
            size += 1
    while at < size:
        v = queue[at]
        at += 1
        if depth[v] >= most:
            continue
        for e in range(start[v], start[v + 1]):
            w = neighbour[e]
            if depth[w] > depth[v] + 1:
                depth[w] = depth[v] + 1
                queue[size] = w
                size += 1
    return depth

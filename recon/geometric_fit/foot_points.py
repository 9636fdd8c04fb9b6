"""Nearest points of the limit surface, by Gauss-Newton steps that walk from patch to patch.

At a place (v, w) with residual r = p - S the step solves

    | S_v . S_v   S_v . S_w |   | dv |     | S_v . r |
    | S_v . S_w   S_w . S_w |   | dw |  =  | S_w . r |

A step over a side goes on in the patch across, as if the two were one plane: what was outside by h is inside by h
there, and what was along the side by t is along it by 1 - t, as the side runs the other way. That is so in triangles
and in quadrilaterals. A step that would lead away from p is cut in half. On a border the step is taken along it.

      o---------o              o-------o-------o
       \\       / \\             |       |       |      _to_side    (v, w) -> (t, h)
        \\  h<0/h>0\\            |  h<0  |  h>0  |      _from_side  (t, h) -> (v, w)
         \\   /     \\           |       |       |
           o--------o          o-------o-------o

Paper  [marinov2005], Newton on a subdivision surface.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from recon.subdivision.evaluation import N_BASIS, NetCache, PatchArrays, net_cache, patch_frame, points_at
from recon.subdivision.limit_surface import LimitPatches

__all__ = [
    "EXACT",
    "ROUGH",
    "Feet",
    "Places",
    "Samples",
    "joined",
    "nearest_feet",
    "patch_order",
    "sample_places",
    "seed_feet",
    "surface_samples",
    "walk_feet",
    "walk_on",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
SmallInts = NDArray[np.int32]
Singles = NDArray[np.float32]

ROUGH, EXACT = 1e-5, 1e-9  # how far a foot may still have to go, as a share of the size of the data
ON_SIDE = 1e-12  # how far inside a place on a side may seem
SEEDS = {3: ((1 / 3, 1 / 3), (1 / 6, 1 / 6), (2 / 3, 1 / 6), (1 / 6, 2 / 3))}  # samples (v, w) in each patch
SEEDS[4] = ((1 / 4, 1 / 4), (3 / 4, 1 / 4), (1 / 4, 3 / 4), (3 / 4, 3 / 4))


class Places(NamedTuple):
    """Places on the surface, (N,) patch, v and w, in whatever precision they are kept."""

    patch: Ints | SmallInts
    v: Floats | Singles
    w: Floats | Singles

    def chosen(self, which: Ints | SmallInts) -> "Places":
        """Those of the numbers `which`."""
        return Places(self.patch[which], self.v[which], self.w[which])


class Feet(NamedTuple):
    """A place on the surface for every data point.

    patch, v, w  (N,) where; `positions` (N, 3) the point of the surface, `normals` (N, 3) its unit normal
    """

    patch: Ints
    v: Floats
    w: Floats
    positions: Floats
    normals: Floats

    def chosen(self, which: Ints) -> "Feet":
        """Those of the numbers `which`."""
        return Feet(self.patch[which], self.v[which], self.w[which], self.positions[which], self.normals[which])

    def places(self) -> Places:
        """Where they are now: what may be walked on from later."""
        return Places(self.patch.astype(np.int32), self.v.astype(np.float32), self.w.astype(np.float32))

    def replaced(self, which: Ints, others: "Feet") -> "Feet":
        """These feet with others in the places `which`."""
        patch, v, w = self.patch.copy(), self.v.copy(), self.w.copy()
        positions, normals = self.positions.copy(), self.normals.copy()
        patch[which], v[which], w[which] = others.patch, others.v, others.w
        positions[which], normals[which] = others.positions, others.normals
        return Feet(patch, v, w, positions, normals)


def joined(parts: Sequence[Feet]) -> Feet:
    """Feet one after the other."""
    return Feet(
        np.concatenate([part.patch for part in parts]),
        np.concatenate([part.v for part in parts]),
        np.concatenate([part.w for part in parts]),
        np.concatenate([part.positions for part in parts]),
        np.concatenate([part.normals for part in parts]),
    )


def nearest_feet(patches: LimitPatches, points: Floats, data: Floats, *, step: float = EXACT) -> Feet:
    """Foot points from scratch: seeds by a tree over samples of the surface, then steps to the foot.

    points  (R, 3) the points the patches depend on, data (N, 3)
    step    the length of the last step, as a share of the size of the data
    """
    feet = seed_feet(surface_samples(patches, points), data)
    walk_on(patches, points, data, feet, step=step)
    return feet


class Samples(NamedTuple):
    """Places on the surface, (n,) each, and a search tree over their points."""

    patch: Ints
    v: Floats
    w: Floats
    tree: cKDTree


def surface_samples(patches: LimitPatches, points: Floats) -> Samples:
    """Four samples in every patch."""
    patch, v, w = sample_places(patches)
    at = points_at(patches.arrays, points, patch, v, w, 1)[:, 0]
    return Samples(patch, v, w, cKDTree(at, balanced_tree=False, compact_nodes=False))


def seed_feet(samples: Samples, data: Floats, *, n_nearest: int = 1) -> Feet:
    """The sample of the surface that is nearest to each data point, then the second nearest of each, and so on.

    Positions and normals are not set.
    """
    nearest = samples.tree.query(data, k=np.arange(1, n_nearest + 1))[1].T.ravel()
    nearest = np.minimum(nearest, samples.tree.n - 1)  # where there are fewer samples, the tree names none
    unset = (np.empty((len(nearest), 3)), np.empty((len(nearest), 3)))
    return Feet(samples.patch[nearest], samples.v[nearest], samples.w[nearest], *unset)


def sample_places(patches: LimitPatches) -> tuple[Ints, Floats, Floats]:
    """Four places (patch, v, w) in every patch, evenly spread."""
    n_patches, k = patches.sheets.faces.shape
    patch = np.repeat(np.arange(n_patches), len(SEEDS[k]))
    v, w = np.tile(np.array(SEEDS[k]), (n_patches, 1)).T.copy()
    return patch, v, w


def walk_feet(
    patches: LimitPatches,
    points: Floats,
    data: Floats,
    start: Feet | Places,
    *,
    step: float = ROUGH,
    max_steps: int = 30,
) -> Feet:
    """Walk from the places of `start` to the foot points of the data."""
    unset = (np.empty(data.shape), np.empty(data.shape))
    patch, v, w = start.patch.astype(np.int64), start.v.astype(np.float64), start.w.astype(np.float64)
    feet = Feet(patch, v, w, *unset)
    walk_on(patches, points, data, feet, step=step, max_steps=max_steps)
    return feet


def walk_on(
    patches: LimitPatches, points: Floats, data: Floats, feet: Feet, *, step: float = ROUGH, max_steps: int = 30
) -> None:
    """As walk_feet, in place: of a scan of millions of points, feet are kept once."""
    allowed = step * diagonal_of(data)
    order, _ = patch_order(feet.patch, len(patches.arrays.tables))
    locked = data.view()
    locked.flags.writeable = False  # compiled once, for what may be written to and what may not
    _walk(patches.arrays, points, locked, *feet, order, net_cache(), allowed**2, max_steps)


@njit(cache=True)
def diagonal_of(data: Floats) -> float:  # pragma: no cover - compiled
    """Length of the diagonal of the box around (N, 3) points; zero around none."""
    square = 0.0
    for axis in range(3):
        if len(data):
            square += (data[:, axis].max() - data[:, axis].min()) ** 2
    return np.sqrt(square)


@njit(cache=True)
def _to_side(k: int, side: int, v: float, w: float) -> tuple[float, float]:
    """How far along a side a place is, from its start to its end, and how far inside of it."""
    if k == 3:
        u = 1.0 - v - w
        if side == 0:
            return v, w
        return (w, u) if side == 1 else (u, v)
    if side == 0:
        return v, w
    if side == 1:
        return w, 1.0 - v
    return (1.0 - v, 1.0 - w) if side == 2 else (1.0 - w, v)


@njit(cache=True)
def _from_side(k: int, side: int, along: float, inside: float) -> tuple[float, float]:
    """The place (v, w) so far along a side and so far inside of it."""
    if k == 3:
        rest = 1.0 - along - inside
        if side == 0:
            return along, inside
        return (rest, along) if side == 1 else (inside, rest)
    if side == 0:
        return along, inside
    if side == 1:
        return 1.0 - inside, along
    return (1.0 - along, 1.0 - inside) if side == 2 else (inside, 1.0 - along)


@njit(cache=True)
def _squared_distance(data: Floats, i: int, s: Floats) -> float:
    x, y, z = data[i, 0] - s[0, 0], data[i, 1] - s[0, 1], data[i, 2] - s[0, 2]
    return x * x + y * y + z * z


@njit(cache=True)
def _step(data: Floats, i: int, s: Floats, across: Ints, patch: int, v: float, w: float) -> tuple[float, float, float]:
    """The Gauss-Newton step (dv, dw), and the square of its length in space."""
    rx, ry, rz = data[i, 0] - s[0, 0], data[i, 1] - s[0, 1], data[i, 2] - s[0, 2]
    g = s[1, 0] * rx + s[1, 1] * ry + s[1, 2] * rz
    h = s[2, 0] * rx + s[2, 1] * ry + s[2, 2] * rz
    vv = s[1, 0] * s[1, 0] + s[1, 1] * s[1, 1] + s[1, 2] * s[1, 2]
    vw = s[1, 0] * s[2, 0] + s[1, 1] * s[2, 1] + s[1, 2] * s[2, 2]
    ww = s[2, 0] * s[2, 0] + s[2, 1] * s[2, 1] + s[2, 2] * s[2, 2]
    damping = 1e-6 * (vv + ww)
    det = (vv + damping) * (ww + damping) - vw * vw
    if not det > 0.0:
        return 0.0, 0.0, 0.0
    dv, dw = ((ww + damping) * g - vw * h) / det, ((vv + damping) * h - vw * g) / det
    k = across.shape[1]
    for side in range(k):
        if across[patch, side] >= 0:
            continue
        along, inside = _to_side(k, side, v, w)
        if inside <= ON_SIDE and _to_side(k, side, v + dv, w + dw)[1] < inside:
            # along the border: (to_v, to_w) is the direction of the side in the derivatives by v and w
            from_v, from_w = _from_side(k, side, 0.0, 0.0)
            to_v, to_w = _from_side(k, side, 1.0, 0.0)
            to_v, to_w = to_v - from_v, to_w - from_w
            slope = to_v * g + to_w * h
            square = to_v * to_v * vv + 2 * to_v * to_w * vw + to_w * to_w * ww
            t = slope / square if square > 0.0 else 0.0
            t = min(max(t, -along), 1.0 - along)
            return t * to_v, t * to_w, t * t * square
    return dv, dw, dv * g + dw * h


@njit(cache=True)
def _is_inside(k: int, v: float, w: float) -> bool:
    return v >= 0.0 and w >= 0.0 and (v + w <= 1.0 if k == 3 else max(v, w) <= 1.0)


@njit(cache=True)
def _go(across: Ints, patch: int, v: float, w: float, dv: float, dw: float) -> tuple[int, float, float]:
    """The patch and the place that a move leads to."""
    k = across.shape[1]
    if _is_inside(k, v + dv, w + dw):
        return patch, v + dv, w + dw
    reach = 1.0
    for side in range(k):
        if across[patch, side] < 0:
            inside, after = _to_side(k, side, v, w)[1], _to_side(k, side, v + dv, w + dw)[1]
            if after < 0.0:
                reach = min(reach, max(inside, 0.0) / (inside - after))
    v, w = v + reach * dv, w + reach * dw
    for _ in range(12):
        out, depth = 0, 0.0
        for side in range(k):
            inside = _to_side(k, side, v, w)[1]
            if inside < depth:
                out, depth = side, inside
        if depth >= 0.0:
            break
        other = across[patch, out]
        if other < 0:
            break
        # the side runs the other way there, and what was outside is inside
        along, inside = _to_side(k, out, v, w)
        patch = other // k
        v, w = _from_side(k, other % k, 1.0 - along, -inside)
    v, w = min(max(v, 0.0), 1.0), min(max(w, 0.0), 1.0)
    if k == 3 and v + w > 1.0:
        v = v / (v + w)
        w = 1.0 - v
    return patch, v, w


@njit(cache=True)
def patch_order(patch: Ints, n_patches: int) -> tuple[SmallInts, Ints]:  # pragma: no cover - compiled
    """(N,) the places patch after patch, so that what is known of a patch is at hand for all of them; (P + 1,) where
    those in each patch begin."""
    starts = np.zeros(n_patches + 1, dtype=np.int64)
    for p in patch:
        starts[p + 1] += 1
    starts = np.cumsum(starts)
    order, filled = np.empty(len(patch), dtype=np.int32), starts.copy()
    for i in range(len(patch)):
        order[filled[patch[i]]] = i
        filled[patch[i]] += 1
    return order, starts


@njit(cache=True, nogil=True)
def _walk(
    patches: PatchArrays,
    points: Floats,
    data: Floats,
    patch: Ints,
    v: Floats,
    w: Floats,
    positions: Floats,
    normals: Floats,
    order: SmallInts,
    cache: NetCache,
    allowed: float,
    max_steps: int,
) -> None:
    """Walk all data points; the feet, given by their places, are changed in place."""
    b = np.empty((6, N_BASIS))
    across = patches.across
    here, there = np.empty((3, 3)), np.empty((3, 3))
    for i in order:
        at, at_v, at_w = patch[i], v[i], w[i]
        patch_frame(patches, points, at, at_v, at_w, cache, b, here)
        best = _squared_distance(data, i, here)
        for _ in range(max_steps):
            dv, dw, length = _step(data, i, here, across, at, at_v, at_w)
            if length <= allowed:
                break
            share, moved = min(1.0, 1.5 / max(abs(dv), abs(dw), abs(dv + dw))), False
            for _ in range(6):
                to, to_v, to_w = _go(across, at, at_v, at_w, share * dv, share * dw)
                patch_frame(patches, points, to, to_v, to_w, cache, b, there)
                distance = _squared_distance(data, i, there)
                if distance < best:
                    at, at_v, at_w, best, moved = to, to_v, to_w, distance, True
                    here, there = there, here
                    break
                share *= 0.35
            if not moved:
                break
        patch[i], v[i], w[i] = at, at_v, at_w
        for axis in range(3):
            positions[i, axis] = here[0, axis]
        nx = here[1, 1] * here[2, 2] - here[1, 2] * here[2, 1]
        ny = here[1, 2] * here[2, 0] - here[1, 0] * here[2, 2]
        nz = here[1, 0] * here[2, 1] - here[1, 1] * here[2, 0]
        norm = np.sqrt(nx * nx + ny * ny + nz * nz)
        scale = 1.0 / norm if norm > 0.0 else 0.0
        normals[i, 0], normals[i, 1], normals[i, 2] = scale * nx, scale * ny, scale * nz

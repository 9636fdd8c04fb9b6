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

from recon.subdivision.evaluation import MAX_SUPPORT, N_BASIS, PatchArrays, patch_weights, points_at
from recon.subdivision.limit_surface import LimitPatches

__all__ = ["EXACT", "ROUGH", "Feet", "joined", "nearest_feet", "sample_places", "seed_feet", "walk_feet"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

ROUGH, EXACT = 1e-5, 1e-9  # how far a foot may still have to go, as a share of the size of the data
SEEDS = {3: ((1 / 3, 1 / 3), (1 / 6, 1 / 6), (2 / 3, 1 / 6), (1 / 6, 2 / 3))}  # samples (v, w) in each patch
SEEDS[4] = ((1 / 4, 1 / 4), (3 / 4, 1 / 4), (1 / 4, 3 / 4), (3 / 4, 3 / 4))


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
    return walk_feet(patches, points, data, seed_feet(patches, points, data), step=step)


def seed_feet(patches: LimitPatches, points: Floats, data: Floats, *, n_nearest: int = 1) -> Feet:
    """The sample of the surface that is nearest to each data point, then the second nearest of each, and so on.

    The normals are zero.
    """
    patch, v, w = sample_places(patches)
    samples = points_at(patches.arrays, points, patch, v, w, 1)[:, 0]
    tree = cKDTree(samples, balanced_tree=False, compact_nodes=False)
    nearest = tree.query(data, k=np.arange(1, n_nearest + 1))[1].T.ravel()
    nearest = np.minimum(nearest, len(samples) - 1)  # where there are fewer samples, the tree names none
    return Feet(patch[nearest], v[nearest], w[nearest], samples[nearest], np.zeros_like(samples[nearest]))


def sample_places(patches: LimitPatches) -> tuple[Ints, Floats, Floats]:
    """Four places (patch, v, w) in every patch, evenly spread."""
    n_patches, k = patches.sheets.faces.shape
    patch = np.repeat(np.arange(n_patches), len(SEEDS[k]))
    v, w = np.tile(np.array(SEEDS[k]), (n_patches, 1)).T.copy()
    return patch, v, w


def walk_feet(
    patches: LimitPatches, points: Floats, data: Floats, start: Feet, *, step: float = ROUGH, max_steps: int = 30
) -> Feet:
    """Walk from the places of `start` to the foot points of the data."""
    allowed = step * float(np.linalg.norm(np.ptp(data, axis=0))) if len(data) else 0.0
    patch, v, w = start.patch.copy(), start.v.copy(), start.w.copy()
    positions, normals = _walk(patches.arrays, points, data, patch, v, w, allowed * allowed, max_steps)
    return Feet(patch, v, w, positions, normals)


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
def _place(patches: PatchArrays, points: Floats, patch: int, at: Floats, b: Floats, c: Floats, s: Floats) -> None:
    """Point and first derivatives into s (3, 3)."""
    size = patch_weights(patches, patch, at[0], at[1], 3, b, c)
    first = patches.support_starts[patch]
    for r in range(3):
        x, y, z = 0.0, 0.0, 0.0
        for j in range(size):
            p = patches.support[first + j]
            weight = c[r, j]
            x += weight * points[p, 0]
            y += weight * points[p, 1]
            z += weight * points[p, 2]
        s[r, 0], s[r, 1], s[r, 2] = x, y, z


@njit(cache=True)
def _squared_distance(p: Floats, s: Floats) -> float:
    x, y, z = p[0] - s[0, 0], p[1] - s[0, 1], p[2] - s[0, 2]
    return x * x + y * y + z * z


@njit(cache=True)
def _step(p: Floats, s: Floats, across: Ints, at: Floats, move: Floats) -> float:
    """The Gauss-Newton step (dv, dw) into `move`; the square of its length in space."""
    rx, ry, rz = p[0] - s[0, 0], p[1] - s[0, 1], p[2] - s[0, 2]
    g = s[1, 0] * rx + s[1, 1] * ry + s[1, 2] * rz
    h = s[2, 0] * rx + s[2, 1] * ry + s[2, 2] * rz
    vv = s[1, 0] * s[1, 0] + s[1, 1] * s[1, 1] + s[1, 2] * s[1, 2]
    vw = s[1, 0] * s[2, 0] + s[1, 1] * s[2, 1] + s[1, 2] * s[2, 2]
    ww = s[2, 0] * s[2, 0] + s[2, 1] * s[2, 1] + s[2, 2] * s[2, 2]
    damping = 1e-6 * (vv + ww)
    det = (vv + damping) * (ww + damping) - vw * vw
    if not det > 0.0:
        return 0.0
    move[0] = ((ww + damping) * g - vw * h) / det
    move[1] = ((vv + damping) * h - vw * g) / det
    k = len(across)
    for side in range(k):
        along, inside = _to_side(k, side, at[0], at[1])
        if across[side] < 0 and inside <= 0.0 and _to_side(k, side, at[0] + move[0], at[1] + move[1])[1] < inside:
            # along the border: d is the direction of the side in the derivatives by v and w
            v, w = _from_side(k, side, 0.0, 0.0)
            to_v, to_w = _from_side(k, side, 1.0, 0.0)
            dv, dw = to_v - v, to_w - w
            slope = dv * g + dw * h
            square = dv * dv * vv + 2 * dv * dw * vw + dw * dw * ww
            t = slope / square if square > 0.0 else 0.0
            t = min(max(t, -along), 1.0 - along)
            move[0], move[1] = t * dv, t * dw
            return t * t * square
    return move[0] * g + move[1] * h


@njit(cache=True)
def _go(patches: PatchArrays, patch: int, at: Floats, move: Floats, share: float, to: Floats) -> int:
    """The place a share of the move away into `to`; its patch."""
    k = patches.across.shape[1]
    reach = 1.0
    for side in range(k):
        if patches.across[patch, side] < 0:
            inside = _to_side(k, side, at[0], at[1])[1]
            after = _to_side(k, side, at[0] + share * move[0], at[1] + share * move[1])[1]
            if after < 0.0:
                reach = min(reach, max(inside, 0.0) / (inside - after))
    v, w = at[0] + reach * share * move[0], at[1] + reach * share * move[1]
    for _ in range(12):
        out, depth = 0, 0.0
        for side in range(k):
            inside = _to_side(k, side, v, w)[1]
            if inside < depth:
                out, depth = side, inside
        if depth >= 0.0:
            break
        other = patches.across[patch, out]
        if other < 0:
            break
        # the side runs the other way there, and what was outside is inside
        along, inside = _to_side(k, out, v, w)
        patch = other // k
        v, w = _from_side(k, other % k, 1.0 - along, -inside)
    to[0], to[1] = min(max(v, 0.0), 1.0), min(max(w, 0.0), 1.0)
    if k == 3 and to[0] + to[1] > 1.0:
        total = to[0] + to[1]
        to[0], to[1] = to[0] / total, 1.0 - to[0] / total
    return patch


@njit(cache=True, nogil=True)
def _walk(
    patches: PatchArrays,
    points: Floats,
    data: Floats,
    patch: Ints,
    v: Floats,
    w: Floats,
    allowed: float,
    max_steps: int,
) -> tuple[Floats, Floats]:
    """Walk all data points; patch, v and w are changed in place; positions and unit normals."""
    positions, normals = np.empty_like(data), np.zeros_like(data)
    b, c = np.empty((6, N_BASIS)), np.empty((6, MAX_SUPPORT))
    here, there, place, to, move = np.empty((3, 3)), np.empty((3, 3)), np.empty(2), np.empty(2), np.empty(2)
    for i in range(len(data)):
        at = patch[i]
        place[0], place[1] = v[i], w[i]
        _place(patches, points, at, place, b, c, here)
        best = _squared_distance(data[i], here)
        for _ in range(max_steps):
            length = _step(data[i], here, patches.across[at], place, move)
            if length <= allowed:
                break
            longest = max(abs(move[0]), abs(move[1]), abs(move[0] + move[1]))
            share, moved = min(1.0, 1.5 / longest), False
            for _ in range(6):
                new = _go(patches, at, place, move, share, to)
                _place(patches, points, new, to, b, c, there)
                distance = _squared_distance(data[i], there)
                if distance < best:
                    moved = True
                    break
                share *= 0.35
            if not moved:
                break
            at, best = new, distance
            # slices would do, but take seconds to compile
            place[0], place[1] = to[0], to[1]
            here, there = there, here
        patch[i], v[i], w[i] = at, place[0], place[1]
        for axis in range(3):
            positions[i, axis] = here[0, axis]
        nx = here[1, 1] * here[2, 2] - here[1, 2] * here[2, 1]
        ny = here[1, 2] * here[2, 0] - here[1, 0] * here[2, 2]
        nz = here[1, 0] * here[2, 1] - here[1, 1] * here[2, 0]
        norm = np.sqrt(nx * nx + ny * ny + nz * nz)
        if norm > 0.0:
            normals[i, 0], normals[i, 1], normals[i, 2] = nx / norm, ny / norm, nz / norm
    return positions, normals

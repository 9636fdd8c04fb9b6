"""Nearest points of the limit surface, by Gauss-Newton steps that walk from patch to patch.

At a place (v, w) with residual r = p - S the step solves

    | S_v . S_v   S_v . S_w |   | dv |     | S_v . r |
    | S_v . S_w   S_w . S_w |   | dw |  =  | S_w . r |

A step over a side goes on in the patch across: there the barycentric coordinates are b'_e = b_e + b_o, the other end
likewise, and b'_o = -b_o, as if the two patches were one parallelogram. A step that would lead away from p is cut
in half. On a border the step is taken along the border.

b_o
 o---------e+1
  \\       / \\          o    corner opposite the side e, e + 1 that is crossed
   \\     /   \\
    \\   /  x  \\
      e-------o'

Paper  [marinov2005], Newton on a subdivision surface.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from recon.subdivision.evaluation import MAX_SUPPORT, PatchArrays, patch_weights, points_at
from recon.subdivision.limit_surface import LimitPatches

__all__ = ["Feet", "joined", "nearest_feet", "seed_feet", "walk_feet"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

ROUGH, EXACT = 1e-5, 1e-9  # how far a foot may still have to go, as a share of the size of the data
SEEDS = ((1 / 3, 1 / 3), (1 / 6, 1 / 6), (2 / 3, 1 / 6), (1 / 6, 2 / 3))  # of the samples (v, w) in each patch


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


def seed_feet(patches: LimitPatches, points: Floats, data: Floats) -> Feet:
    """The sample of the surface that is nearest to each data point; normals are zero."""
    n_patches = len(patches.sheets.faces)
    patch = np.repeat(np.arange(n_patches), len(SEEDS))
    v, w = np.tile(np.array(SEEDS), (n_patches, 1)).T.copy()
    samples = points_at(patches.arrays, points, patch, v, w, 1)[:, 0]
    nearest = cKDTree(samples, balanced_tree=False, compact_nodes=False).query(data)[1]
    return Feet(patch[nearest], v[nearest], w[nearest], samples[nearest], np.zeros_like(data))


def walk_feet(
    patches: LimitPatches, points: Floats, data: Floats, start: Feet, *, step: float = ROUGH, max_steps: int = 30
) -> Feet:
    """Walk from the places of `start` to the foot points of the data."""
    allowed = step * float(np.linalg.norm(np.ptp(data, axis=0))) if len(data) else 0.0
    patch, v, w = start.patch.copy(), start.v.copy(), start.w.copy()
    positions, normals = _walk(patches.arrays, points, data, patch, v, w, allowed * allowed, max_steps)
    return Feet(patch, v, w, positions, normals)


@njit(cache=True)
def _place(patches: PatchArrays, points: Floats, patch: int, bary: Floats, b: Floats, c: Floats, s: Floats) -> None:
    """Point and first derivatives into s (3, 3)."""
    size = patch_weights(patches, patch, bary[1], bary[2], 3, b, c)
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
def _step(p: Floats, s: Floats, across: Ints, bary: Floats, move: Floats) -> float:
    """The Gauss-Newton step in barycentric coordinates into `move`; the square of its length in space."""
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
    move[1] = ((ww + damping) * g - vw * h) / det
    move[2] = ((vv + damping) * h - vw * g) / det
    move[0] = -move[1] - move[2]
    for o in range(3):
        e = (o + 1) % 3
        if bary[o] <= 0.0 and move[o] < 0.0 and across[e] < 0:
            # along the border from e to e + 1: d = S_(e+1) - S_e in the derivatives by v and w
            f = (e + 1) % 3
            dv = (1.0 if f == 1 else 0.0) - (1.0 if e == 1 else 0.0)
            dw = (1.0 if f == 2 else 0.0) - (1.0 if e == 2 else 0.0)
            slope = dv * g + dw * h
            square = dv * dv * vv + 2 * dv * dw * vw + dw * dw * ww
            t = slope / square if square > 0.0 else 0.0
            t = min(max(t, -bary[f]), bary[e])
            move[o], move[f], move[e] = 0.0, t, -t
            return t * t * square
    return move[1] * g + move[2] * h


@njit(cache=True)
def _go(patches: PatchArrays, patch: int, bary: Floats, move: Floats, share: float, to: Floats) -> int:
    """The place a share of the move away into `to`; its patch."""
    reach = 1.0
    for o in range(3):
        if patches.across[patch, (o + 1) % 3] < 0 and bary[o] + share * move[o] < 0.0:
            reach = min(reach, bary[o] / (-share * move[o]))
    for i in range(3):
        to[i] = bary[i] + reach * share * move[i]
    for _ in range(12):
        o = 0
        if to[1] < to[o]:
            o = 1
        if to[2] < to[o]:
            o = 2
        if to[o] >= 0.0:
            return patch
        e, f = (o + 1) % 3, (o + 2) % 3
        other = patches.across[patch, e]
        be, bf, bo = to[e], to[f], to[o]
        if other < 0:
            break
        patch, side = other // 3, other % 3
        # the side runs the other way there: its start is our end
        to[side], to[(side + 1) % 3], to[(side + 2) % 3] = bf + bo, be + bo, -bo
    total = 0.0
    for i in range(3):
        to[i] = max(to[i], 0.0)
        total += to[i]
    for i in range(3):
        to[i] /= total
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
    b, c = np.empty((6, 15)), np.empty((6, MAX_SUPPORT))
    here, there, bary, to, move = np.empty((3, 3)), np.empty((3, 3)), np.empty(3), np.empty(3), np.empty(3)
    for i in range(len(data)):
        at = patch[i]
        bary[0], bary[1], bary[2] = 1.0 - v[i] - w[i], v[i], w[i]
        _place(patches, points, at, bary, b, c, here)
        best = _squared_distance(data[i], here)
        for _ in range(max_steps):
            length = _step(data[i], here, patches.across[at], bary, move)
            if length <= allowed:
                break
            share, moved = min(1.0, 1.5 / max(abs(move[0]), abs(move[1]), abs(move[2]))), False
            for _ in range(6):
                new = _go(patches, at, bary, move, share, to)
                _place(patches, points, new, to, b, c, there)
                distance = _squared_distance(data[i], there)
                if distance < best:
                    moved = True
                    break
                share *= 0.35
            if not moved:
                break
            at, best = new, distance
            bary[:], here[:] = to, there
        patch[i], v[i], w[i] = at, bary[1], bary[2]
        positions[i] = here[0]
        nx = here[1, 1] * here[2, 2] - here[1, 2] * here[2, 1]
        ny = here[1, 2] * here[2, 0] - here[1, 0] * here[2, 2]
        nz = here[1, 0] * here[2, 1] - here[1, 1] * here[2, 0]
        norm = np.sqrt(nx * nx + ny * ny + nz * nz)
        if norm > 0.0:
            normals[i, 0], normals[i, 1], normals[i, 2] = nx / norm, ny / norm, nz / norm
    return positions, normals

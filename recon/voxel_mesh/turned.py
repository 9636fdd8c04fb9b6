"""Parts turned about an axis: the axis from the normals, the profile from the voxels of a whole turn.

The normals of a surface of revolution meet its axis: with d along it, through c, every point x and normal n has

    (x × n)·d - n·(d × c) = 0

which is linear in d and d × c.  A whole turn of voxels has one answer to which (r, z) are solid: averaged over the
turn the terraces go, and where the average passes a half the profile runs.

Paper  [pottmann2001], chapter 3, for lines that meet an axis.
"""

from collections.abc import Callable

import numpy as np
from contourpy import contour_generator
from numba import njit
from numpy.typing import NDArray
from scipy import ndimage

from recon.errors import NoSolid
from recon.geometry.turned import ProfileArc, ProfileLine, ProfilePiece, ProfileSpline, TurnedPart
from recon.geometry.voxel_grid import VoxelGrid
from recon.numerics.halfedges import vertex_normals
from recon.voxel_mesh.fits import across
from recon.voxel_mesh.marching_cubes import GridSurface, marching_cubes
from recon.voxel_mesh.profile import profile_pieces
from recon.voxel_mesh.settled_profile import settled
from recon.voxel_mesh.terraces import without_terraces

__all__ = ["fitted_axis", "turned_part"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

STEP = 0.5  # voxels between the points of the section
ANGLES = 240  # directions that a turn is averaged over
MISSING = np.sin(np.radians(12.0))  # by how much a normal may miss the axis, seen from its point
STRAY = 0.06  # share of the normals that may miss it by more: those at sharp edges
MIXED = 2.5  # area of the section, over the length of its profile in voxels, that is solid at some angles alone
ROUNDS = 4
AWAY = 2.0  # voxels from the axis from which on a normal says where it lies


def turned_part(grid: VoxelGrid, *, doing: Callable[[str], None] = lambda text: None) -> TurnedPart:
    """The part as a profile and an axis, in model units.

    Raises  NoSolid when it is no solid of revolution, or more than one body.
    """
    surface = marching_cubes(grid)
    doing("looking for an axis")
    smooth = without_terraces(surface, grid.proportions)
    origin, axis = fitted_axis(smooth, vertex_normals(smooth, surface.face_vertices))
    doing("averaging over a turn")
    r, z, share = _section(grid, surface, origin, axis)
    lines = [np.asarray(line, dtype=np.float64) for line in contour_generator(r, z, share).lines(0.5)]
    length = sum(float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum()) for line in lines)
    if ((share > 0.05) & (share < 0.95)).sum() * STEP**2 > MIXED * length:
        raise NoSolid(f"{grid.name} has an axis, but not all of it is turned")
    loops = _loops([profile_pieces(line) for line in lines if len(line) > 8])
    doing("settling the profile between the voxels")
    part = settled(TurnedPart(origin, axis, loops), *surface.side_centres(grid.proportions))
    return part.placed(grid.direction, grid.voxel, grid.origin)


def fitted_axis(points: Floats, normals: Floats) -> tuple[Floats, Floats]:
    """Point on and direction (3,) of the axis that the normals at points (n, 3) meet.

    Raises  NoSolid when they meet none, or any one of several.
    """
    centre = points.mean(axis=0)
    x = points - centre
    rows = np.concatenate([np.cross(x, normals), -normals], axis=1)
    weight = np.ones(len(x))
    for _ in range(ROUNDS):
        m = (rows * weight[:, None]).T @ rows
        inverse = np.linalg.pinv(m[3:, 3:], rcond=1e-9)
        values, vectors = np.linalg.eigh(m[:3, :3] - m[:3, 3:] @ inverse @ m[3:, :3])
        axis = vectors[:, 0]
        moment = -inverse @ m[3:, :3] @ axis
        foot = np.cross(moment, axis)
        arm = x - foot
        away = np.linalg.norm(arm - (arm @ axis)[:, None] * axis, axis=1)
        miss = np.abs(rows @ np.concatenate([axis, moment - (moment @ axis) * axis])) / np.maximum(away, AWAY)
        weight = (miss < MISSING) / np.maximum(away, AWAY)
    if (miss > MISSING).mean() > STRAY or values[1] < 20.0 * max(values[0], 1e-12):
        raise NoSolid("the surface turns about no axis")
    axis = axis if axis[int(np.abs(axis).argmax())] > 0 else -axis
    return centre + foot, axis


def _section(grid: VoxelGrid, surface: GridSurface, origin: Floats, axis: Floats) -> tuple[Floats, Floats, Floats]:
    """Distances from the axis, heights along it, and the share of a turn (z, r) that is solid there."""
    arm = surface.vertices - origin
    height = arm @ axis
    away = np.linalg.norm(arm - height[:, None] * axis, axis=1)
    r = np.arange(0.0, away.max() + 3.0, STEP)
    z = np.arange(height.min() - 3.0, height.max() + 3.0, STEP)
    frame = np.stack([*across(axis), axis])
    share = _share(grid.solid, np.asarray(grid.proportions), origin, frame, r, z)
    # where the axis runs along the grid a whole layer steps at once, and the turn averages nothing
    for along in (0, 1, 0):
        share = ndimage.convolve1d(share, [0.25, 0.5, 0.25], axis=along, mode="nearest" if along == 0 else "mirror")
    return r, z, share


@njit(cache=True)
def _share(
    solid: NDArray[np.bool_], size: Floats, origin: Floats, frame: Floats, r: Floats, z: Floats
) -> Floats:  # pragma: no cover - compiled
    share = np.zeros((len(z), len(r)))
    nx, ny, nz = solid.shape
    for a in range(ANGLES):
        cos, sin = np.cos(2.0 * np.pi * (a + 0.37) / ANGLES), np.sin(2.0 * np.pi * (a + 0.37) / ANGLES)
        ux, uy, uz = (cos * frame[0] + sin * frame[1]) / size
        for i in range(len(z)):
            bx, by, bz = (origin + z[i] * frame[2]) / size
            for j in range(len(r)):
                x = int(np.floor(bx + r[j] * ux + 0.5))
                y = int(np.floor(by + r[j] * uy + 0.5))
                k = int(np.floor(bz + r[j] * uz + 0.5))
                if 0 <= x < nx and 0 <= y < ny and 0 <= k < nz and solid[x, y, k]:
                    share[i, j] += 1.0 / ANGLES
    return share


def _loops(chains: list[list[ProfilePiece]]) -> tuple[tuple[ProfilePiece, ...], ...]:
    """Closed rows of pieces: chains that end on the axis are joined along it, where it runs through solid."""
    closed = [chain for chain in chains if chain[0].start[0] > 0.0]
    open_ones = [chain for chain in chains if chain[0].start[0] == 0.0]
    ends = sorted([(chain[0].start[1], n, 0) for n, chain in enumerate(open_ones)]
                  + [(chain[-1].end[1], n, 1) for n, chain in enumerate(open_ones)])  # fmt: skip
    partner = {ends[k][1:]: ends[k ^ 1][1:] for k in range(len(ends))}
    left = set(range(len(open_ones)))
    while left:
        n, loop, end = left.pop(), [], 1
        loop += open_ones[n]
        while True:
            m, side = partner[n, end]
            here = loop[-1].end
            there = open_ones[m][0].start if side == 0 else open_ones[m][-1].end
            loop.append(ProfileLine(here, there))
            if m not in left:
                break
            left.remove(m)
            loop += open_ones[m] if side == 0 else [_turned_round(p) for p in reversed(open_ones[m])]
            n, end = m, 1 - side
        closed.append(loop)
    if not closed:
        raise NoSolid("no profile was found")
    closed.sort(key=lambda loop: -abs(_area(loop)))
    if any(not _inside(loop, closed[0]) for loop in closed[1:]):
        raise NoSolid("more than one body turns about the axis")
    return tuple(
        tuple(loop) if (_area(loop) > 0) == (k == 0) else tuple(_turned_round(p) for p in reversed(loop))
        for k, loop in enumerate(closed)
    )


def _turned_round(piece: ProfilePiece) -> ProfilePiece:
    if isinstance(piece, ProfileLine):
        return ProfileLine(piece.end, piece.start)
    if isinstance(piece, ProfileArc):
        return ProfileArc(piece.end, piece.middle, piece.start)
    return ProfileSpline(piece.curve.reversed())


def _outline(loop: list[ProfilePiece]) -> Floats:
    return np.concatenate([p.points(2 if isinstance(p, ProfileLine) else 40)[:-1] for p in loop])


def _area(loop: list[ProfilePiece]) -> float:
    p = _outline(loop)
    q = np.roll(p, -1, axis=0)
    return 0.5 * float((p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]).sum())


def _inside(loop: list[ProfilePiece], around: list[ProfilePiece]) -> bool:
    """Whether a loop lies in another: a ray from its first point crosses that an odd number of times."""
    x, y = _outline(loop)[0]
    p = _outline(around)
    q = np.roll(p, -1, axis=0)
    crossed = (p[:, 1] > y) != (q[:, 1] > y)
    rise = np.where(crossed, q[:, 1] - p[:, 1], 1.0)
    return bool((crossed & (x < p[:, 0] + (y - p[:, 1]) / rise * (q[:, 0] - p[:, 0]))).sum() % 2)

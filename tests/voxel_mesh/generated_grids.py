"""Grids with known shapes, for tests."""

import numpy as np

from recon.geometry.voxel_grid import VoxelGrid

OFF = np.array([0.137, 0.241, 0.359])


def centres(n: int, spacing=(1.0, 1.0, 1.0)) -> np.ndarray:
    """(X, Y, Z, 3) places of the centres of a cube of side n, its middle near the origin."""
    counts = [round(n / s) for s in spacing]
    axes = [(np.arange(c) - 0.5 * c) * s + o for c, s, o in zip(counts, spacing, OFF)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)


def random_grid(seed: int, shape=(9, 10, 11)) -> VoxelGrid:
    rng = np.random.default_rng(seed)
    return VoxelGrid(solid=rng.random(shape) < rng.uniform(0.15, 0.85), name="noise")


def ball(n: int, radius: float, spacing=(1.0, 1.0, 1.0)) -> VoxelGrid:
    x = centres(n, spacing)
    return VoxelGrid(np.array(spacing), np.zeros(3), np.eye(3), "ball", (x**2).sum(axis=-1) < radius**2)


def block_with_hole(n: int, turn: np.ndarray | None = None) -> VoxelGrid:
    """A block of 0.7 x 0.5 x 0.4 n with a hole of radius 0.12 n along its second axis."""
    x = centres(n) @ (np.eye(3) if turn is None else turn)
    block = (np.abs(x) < np.array([0.35, 0.25, 0.2]) * n).all(axis=-1)
    hole = (x[..., 0] - 0.1 * n) ** 2 + x[..., 2] ** 2 < (0.12 * n) ** 2
    return VoxelGrid(solid=block & ~hole, name="block with a hole")


def flange(n: int) -> VoxelGrid:
    """A disk of radius 0.46 n and height 0.16 n along the grid, a boss of 0.23 n on it, six holes of 0.042 n around."""
    x, y, z = np.moveaxis(centres(n), -1, 0)
    solid = (np.hypot(x, y) < 0.46 * n) & (np.abs(z) < 0.08 * n)
    solid |= (np.hypot(x, y) < 0.23 * n) & (z > 0.0) & (z < 0.3 * n)
    for angle in np.radians(60.0 * np.arange(6)):
        solid &= np.hypot(x - 0.35 * n * np.cos(angle), y - 0.35 * n * np.sin(angle)) > 0.042 * n
    return VoxelGrid(solid=solid, name="flange")


def rounded_pocket(n: int, turn: np.ndarray) -> VoxelGrid:
    """A block of 0.8 x 0.6 x 0.24 n with a pocket of 0.56 x 0.36 n, upright edges rounded by 0.07 n."""
    x, y, z = np.moveaxis(centres(n) @ turn, -1, 0)

    def rounded(a: float, b: float) -> np.ndarray:
        over = np.maximum(np.abs(np.stack([x, y], axis=-1)) - np.array([a, b]) + 0.07 * n, 0.0)
        return np.hypot(*np.moveaxis(over, -1, 0)) < 0.07 * n

    block = rounded(0.4 * n, 0.3 * n) & (np.abs(z) < 0.12 * n)
    return VoxelGrid(solid=block & ~(rounded(0.28 * n, 0.18 * n) & (z > 0.0)), name="pocket")


def rounded_block(n: int, turn: np.ndarray) -> VoxelGrid:
    """A block of 0.8 x 0.6 x 0.5 n with all edges rounded by 0.1 n, a stub of radius 0.12 n on its top."""
    p = centres(n) @ turn
    over = np.maximum(np.abs(p) - np.array([0.3, 0.2, 0.15]) * n, 0.0)
    stub = (np.hypot(p[..., 0], p[..., 1]) < 0.12 * n) & (p[..., 2] > 0.0) & (p[..., 2] < 0.35 * n)
    return VoxelGrid(solid=((over**2).sum(axis=-1) < (0.1 * n) ** 2) | stub, name="rounded block")


def rounded_disk(n: int, turn: np.ndarray) -> VoxelGrid:
    """A disk of radius 0.4 n and height 0.3 n with both rims rounded by 0.1 n, a square hole of 0.3 n through it."""
    x, y, z = np.moveaxis(centres(n) @ turn, -1, 0)
    out, up = np.maximum(np.hypot(x, y) - 0.3 * n, 0.0), np.maximum(np.abs(z) - 0.05 * n, 0.0)
    disk = np.hypot(out, up) < 0.1 * n
    return VoxelGrid(solid=disk & ~((np.abs(x) < 0.15 * n) & (np.abs(y) < 0.15 * n)), name="rounded disk")


def rotation(axis, degrees: float) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    axis = np.asarray(axis, dtype=float)
    return Rotation.from_rotvec(np.radians(degrees) * axis / np.linalg.norm(axis)).as_matrix()

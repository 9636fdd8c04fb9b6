"""Mountains with known heights: Gaussian summits with a ridge, a valley, a saddle and a pit between them."""

import numpy as np

from recon.geometry.contour_map import ContourMap, HeightGrid
from recon.terrain.contouring import contour_grid

SIZE, CELL = (600.0, 440.0), 10.0


def mountain_grid(seed: int) -> HeightGrid:
    """Grid of 61 x 45 heights between about 0 and 120 m; every seed another mountain."""
    random = np.random.default_rng(seed)
    x, y = np.arange(0.0, SIZE[0] + 1, CELL), np.arange(0.0, SIZE[1] + 1, CELL)
    px, py = np.meshgrid(x, y)
    z = 20 + 0.03 * px
    for _ in range(4):
        cx, cy = random.uniform(0.2, 0.8, 2) * SIZE
        wide, narrow, turn = random.uniform(90, 160), random.uniform(50, 90), random.uniform(0, np.pi)
        a = (px - cx) * np.cos(turn) + (py - cy) * np.sin(turn)
        b = (py - cy) * np.cos(turn) - (px - cx) * np.sin(turn)
        z = z + random.uniform(-25, 70) * np.exp(-((a / wide) ** 2) - (b / narrow) ** 2)
    return HeightGrid(x, y, z)


def mountain_contours(seed: int, interval: float = 10.0) -> ContourMap:
    """Contours of `mountain_grid`."""
    return contour_grid(mountain_grid(seed), interval)

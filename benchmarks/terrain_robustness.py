"""Unlike grounds, none of them measured: each to a surface and to a block, through the gate.

python benchmarks/terrain_robustness.py             every ground, one row of a table each
python benchmarks/terrain_robustness.py volcano     those whose name has the word in it

A row: points and patches, largest angle between faces, root mean square height error beside that of the triangulation
of the contour points, what the gate says of the block, seconds of the processor for all of it.
"""

import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parent))

from brep_export.app.terrain_job import TOLERANCE, lowest_place
from brep_export.blocks import block_solid
from brep_export.check import check
from recon.errors import ReconError
from recon.geometry.contour_map import ContourMap, HeightGrid
from recon.terrain.contouring import contour_grid
from recon.terrain.evaluation import edge_angles, elevations
from recon.terrain.network import terrain_network
from recon.terrain.pipeline import terrain_surface
from terrain import fractal_mountain, triangulation

Floats = NDArray[np.float64]

DEPTH = 50.0  # of the base below the ground
N, CELL = 90, 10.0


class Ground(NamedTuple):
    """A map, and the (n, 2) places at which its true heights (n,) are known."""

    name: str
    contours: ContourMap
    places: Floats
    heights: Floats


def gridded(
    name: str, z: Floats, interval: float, *, cell: tuple[float, float] = (CELL, CELL), at: float = 0.0
) -> Ground:
    """Contours of a grid (ny, nx); `at` is how far from the origin of coordinates it lies."""
    x, y = (at + step * np.arange(n) for step, n in zip(cell, z.shape[::-1]))
    grid = HeightGrid(x, y, z)
    return Ground(name, contour_grid(grid, interval), *grid.places())


def plan(n: int = N) -> tuple[Floats, Floats]:
    """x and y of a square of n x n places, from -1 to 1."""
    x, y = np.meshgrid(np.linspace(-1, 1, n), np.linspace(-1, 1, n))
    return x, y


def ridged(seed: int) -> Floats:
    """Sharp crests: octaves of noise, folded at zero."""
    z = np.zeros((N, N))
    for octave in range(4):
        noise = fractal_mountain(N, CELL, seed + octave, 3.0).heights
        z += (1.0 - np.abs(noise / np.ptp(noise) * 2 - 1)) * 60 / 2**octave
    return z


def hills(seed: int, count: int, narrow: float, rise: tuple[float, float]) -> Floats:
    """Round hills, and pits where they are negative, on level ground."""
    random = np.random.default_rng(seed)
    x, y = plan()
    centres, heights = random.uniform(-0.8, 0.8, (count, 2)), random.uniform(*rise, count)
    return np.asarray(
        sum(h * np.exp(-((x - a) ** 2 + (y - b) ** 2) / narrow**2) for (a, b), h in zip(centres, heights))
    )


def smooth_step(s: Floats, width: float) -> Floats:
    return np.asarray(0.5 * (1 + np.tanh(s / width)))


def grids() -> Iterator[Ground]:
    x, y = plan()
    r, turn = np.hypot(x, y), np.arctan2(y, x)
    for word, roughness, seed in (("smooth", 3.2, 5), ("middling", 2.5, 6), ("rough", 2.0, 7)):
        yield gridded(f"fractal, {word}", fractal_mountain(N, CELL, seed, roughness).heights, 10.0)
    yield gridded("ridges, sharp", ridged(11), 10.0)
    yield gridded("volcano with a crater", 160 * np.exp(-2.5 * r) - 90 * np.exp(-((r / 0.16) ** 2)), 10.0)
    yield gridded("cone, pointed", 120 * np.maximum(0.0, 0.9 - r) + 3 * x, 10.0)
    yield gridded("plain, three contours", 14 + 12 * x + 4 * np.sin(3 * y) + 2 * x * y, 10.0)
    yield gridded("islands in a level sea", np.maximum(hills(3, 9, 0.22, (20, 70)) - 12, 0.0) - 1.0, 10.0)
    yield gridded("cliff, contours near each other", 100 * smooth_step(x + 0.2 * np.sin(4 * y), 0.03) + 6 * y, 10.0)
    yield gridded("canyon", 80 - 75 * np.exp(-(((y - 0.3 * np.sin(3 * x)) / 0.09) ** 2)) + 8 * x, 10.0)
    yield gridded("slope, every contour leaves the map", 60 * x + 20 * y + 5 * np.sin(9 * y), 10.0)
    yield gridded("saddles, an egg crate", 40 * np.sin(6 * x) * np.sin(6 * y) + 0.7 * x, 8.0)
    yield gridded("monkey saddle", 60 * (x**3 - 3 * x * y**2) + 0.3, 10.0)
    stretched = fractal_mountain(4 * N, CELL, 9, 2.6).heights[: N // 2 * 8 : 8]
    yield gridded("ridges eight times as long as wide", stretched[:, : 2 * N], 20.0)
    dunes = (5 * x + 0.6 * np.sin(4 * y)) % 1.0
    yield gridded("dunes, steep on one side", 30 * np.where(dunes < 0.8, dunes / 0.8, (1 - dunes) / 0.2), 6.0)
    yield gridded("pits", 50 + hills(8, 25, 0.1, (-40, -15)) + 5 * x, 8.0)
    yield gridded("whole metres", np.round(fractal_mountain(N, CELL, 12, 2.4).heights), 10.0)
    yield gridded(
        "noise of a metre",
        fractal_mountain(N, CELL, 13, 3.0).heights + np.random.default_rng(1).normal(size=(N, N)),
        10.0,
    )
    yield gridded("spiral ridge", 50 * np.cos(3 * turn + 14 * r) * np.exp(-r) + 20 * r, 10.0)
    z = fractal_mountain(N, CELL, 14, 2.6).heights.copy()
    z[20:34, 30:52] = z[60:63, 10:40] = np.nan
    yield gridded("voids", z, 10.0)
    far = fractal_mountain(N, CELL, 15, 2.6).heights
    yield gridded("far away, cells 30 m by 7 m", far, 10.0, cell=(30.0, 7.0), at=5.4e6)


def drawn() -> Iterator[Ground]:
    """Contours that were drawn, and never a grid."""
    x, y = (axis.ravel() for axis in plan(60))
    places = 400.0 * np.column_stack([x, y])
    extent = np.array([[-400.0, -400.0], [400.0, 400.0]])
    t = np.linspace(0.0, 2 * np.pi, 41)
    t[-1] = 0.0

    def oval(size: float) -> Floats:
        return size * np.column_stack([1.6 * np.cos(t), np.sin(t)])

    steps = np.arange(1, 9)
    rings = [oval(230 - 25.0 * k) for k in steps]
    height = 10.0 * (230 - np.hypot(places[:, 0] / 1.6, places[:, 1])) / 25.0
    inside = (height > 10.0) & (height < 80.0)
    yield Ground("drawn, ovals of 40 points", ContourMap(rings, 10.0 * steps, extent), places[inside], height[inside])
    near = np.r_[40, 80, 120, 120.4, 120.8, 121.2, 160, 200.0][::-1]
    cliff = 10.0 * np.interp(np.hypot(places[:, 0] / 1.6, places[:, 1]), near[::-1], steps[::-1])
    inside = (cliff > 10.0) & (cliff < 80.0)
    rings = [oval(size) for size in near]
    yield Ground(
        "drawn, 0.4 m between contours", ContourMap(rings, 10.0 * steps, extent), places[inside], cliff[inside]
    )
    along = np.linspace(-400.0, 400.0, 30)
    lines = [np.column_stack([along, 80.0 * k + 25 * np.sin(along / 90)]) for k in range(-4, 5)]
    slope = (places[:, 1] - 25 * np.sin(places[:, 0] / 90)) / 8.0
    inside = np.abs(slope) < 40.0
    yield Ground(
        "drawn, from border to border",
        ContourMap(lines, 10.0 * np.arange(-4, 5), extent),
        places[inside],
        slope[inside],
    )


def row(ground: Ground) -> str:
    """What comes out, as a row of the table; a sentence where nothing does."""
    begin = time.process_time()
    try:
        surface = terrain_surface(ground.contours)
        network = terrain_network(surface)
        report = check(block_solid(network, lowest_place(network) - DEPTH, TOLERANCE), TOLERANCE)
    except ReconError as refused:
        return f"| {ground.name} | {ground.contours.n_points:,} | | | | | {type(refused).__name__}: {refused} | |"
    seconds = time.process_time() - begin
    flat, _ = triangulation(ground.contours)
    rough = flat(ground.places) - ground.heights
    miss = (elevations(surface, ground.places)[0] - ground.heights)[np.isfinite(rough)]
    ours, theirs = (float(np.sqrt(np.nanmean(m**2))) for m in (miss, rough))
    verdict = "pass" if report.passed else "; ".join(map(str, report.defects))
    angle = np.degrees(edge_angles(surface).max(initial=0.0))
    return (
        f"| {ground.name} | {ground.contours.n_points:,} | {surface.n_patches:,} | {angle:.0e}° | {ours:.2f} "
        f"| {theirs:.2f} | {verdict} | {seconds:.1f} |"
    )


def main() -> None:
    word = " ".join(sys.argv[1:])
    print("| ground | points | patches | angle | ours, m | triangles, m | block | seconds |\n" + "|---" * 8 + "|")
    for ground in (*grids(), *drawn()):
        if word in ground.name:
            print(row(ground), flush=True)


if __name__ == "__main__":
    main()

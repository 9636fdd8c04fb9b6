"""Contour lines to a mountain: how near, how many faces, how fast, beside other interpolations of the same contours.

python benchmarks/terrain.py            heights and contours halfway, all methods, one run
python benchmarks/terrain.py --growth   seconds and memory against the number of contour points, and a plot of them

Mountains: generated ones, and the real ones where they lie beside the checkout. Errors are root mean squares in metres
against the grid that was contoured, at those of its places that the triangulation of the contour points covers.
"""

import argparse
import resource
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy import sparse
from scipy.interpolate import (
    CloughTocher2DInterpolator,
    LinearNDInterpolator,
    RBFInterpolator,
    RegularGridInterpolator,
)
from scipy.sparse.linalg import splu

from recon.geometry.contour_map import ContourMap, HeightGrid
from recon.readers.height_grids import read_height_grid
from recon.terrain.contouring import contour_grid, contour_levels
from recon.terrain.evaluation import distances_between, edge_angles, elevations
from recon.terrain.levels import levels
from recon.terrain.limiter import excess
from recon.terrain.pipeline import Terrain, TerrainOptions, terrain_surface
from recon.terrain.sections import contours_at
from tables import Table, machine

Floats = NDArray[np.float64]
Heights = Callable[[Floats], Floats]

DATA = Path(__file__).parents[2] / "shared" / "data" / "terrain"
PLOT = Path(__file__).parents[1] / "docs" / "measured" / "terrain_growth.png"
CELL = 10.0  # metres
NEIGHBOURS = 50  # of the radial basis functions
FINER = 0.25  # times the default tolerance


def fractal_mountain(n: int, cell: float, seed: int, roughness: float = 2.2) -> HeightGrid:
    """(n, n) heights of a random surface with a power spectrum, between 0 and a tenth of its width."""
    random = np.random.default_rng(seed)
    k = np.hypot(*np.meshgrid(np.fft.fftfreq(n), np.fft.fftfreq(n)))
    k[0, 0] = np.inf
    z = np.fft.ifft2(np.fft.fft2(random.normal(size=(n, n))) * k**-roughness).real
    axis = cell * np.arange(n)
    return HeightGrid(axis, axis, 0.1 * n * cell * (z - z.min()) / np.ptp(z))


def mountains() -> Iterator[tuple[str, HeightGrid, float]]:
    """Name, grid and contour interval of each."""
    yield "fractal, smooth", fractal_mountain(120, 10.0, 1, 3.0), 10.0
    yield "fractal, rough", fractal_mountain(120, 10.0, 2), 10.0
    if (DATA / "maunga_whau_10m.json").exists():
        yield "maunga_whau", read_height_grid(DATA / "maunga_whau_10m.json"), 20.0
    if (DATA / "st_helens_10m.tif").exists():
        grid = read_height_grid(DATA / "st_helens_10m.tif")
        yield "St Helens", grid, 20.0
        yield "St Helens", grid, 50.0


def triangulation(contours: ContourMap) -> tuple[Heights, int]:
    points, heights = _points(contours)
    flat = LinearNDInterpolator(points, heights)
    return flat, len(flat.tri.simplices)


def radial(contours: ContourMap) -> Heights:
    points, heights = _points(contours)
    chosen = np.random.default_rng(0).permutation(len(points))[:15_000]
    return RBFInterpolator(points[chosen], heights[chosen], neighbors=NEIGHBOURS)  # type: ignore[no-any-return]


def minimum_curvature(contours: ContourMap, cell: float) -> Heights:
    """The grid that bends least, through the contour points by bilinear interpolation."""
    points, heights = _points(contours)
    (x0, y0), (x1, y1) = contours.extent
    x, y = np.arange(x0, x1 + cell, cell), np.arange(y0, y1 + cell, cell)
    nx, ny = len(x), len(y)
    second = [sparse.diags_array([1.0, -2.0, 1.0], offsets=[0, 1, 2], shape=(n - 2, n)) for n in (nx, ny)]
    first = [sparse.diags_array([-1.0, 1.0], offsets=[0, 1], shape=(n - 1, n)) for n in (nx, ny)]
    rows = sparse.vstack([
        sparse.kron(sparse.eye_array(ny), second[0]),
        sparse.kron(second[1], sparse.eye_array(nx)),
        np.sqrt(2.0) * sparse.kron(first[1], first[0]),
    ])  # fmt: skip
    u, v = (points - (x0, y0)).T / cell
    i, j = np.minimum(u.astype(int), nx - 2), np.minimum(v.astype(int), ny - 2)
    s, t = u - i, v - j
    at = np.arange(len(points))
    parts = [((1 - s) * (1 - t), j * nx + i), (s * (1 - t), j * nx + i + 1),
             ((1 - s) * t, (j + 1) * nx + i), (s * t, (j + 1) * nx + i + 1)]  # fmt: skip
    place = sum(sparse.csr_array((w, (at, k)), shape=(len(points), nx * ny)) for w, k in parts)
    matrix = sparse.csc_array(rows.T @ rows + 10.0 * place.T @ place)
    z = splu(matrix, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}).solve(10.0 * place.T @ heights)
    return RegularGridInterpolator((x, y), z.reshape(ny, nx).T, bounds_error=False)  # type: ignore[no-any-return]


def _points(contours: ContourMap) -> tuple[Floats, Floats]:
    points = np.vstack(contours.lines)
    heights = np.repeat(contours.heights, [len(line) for line in contours.lines])
    points, first = np.unique(points, axis=0, return_index=True)
    return points, heights[first]


def compared(name: str, grid: HeightGrid, interval: float) -> None:
    contours = contour_grid(grid, interval)
    places, heights = grid.places()
    flat, n_triangles = triangulation(contours)
    covered = np.isfinite(flat(places))
    places, heights = places[covered], heights[covered]
    levels = np.unique(contours.heights)
    middles = ((levels[1:] + levels[:-1]) / 2).tolist()
    truth = contour_levels(grid, middles)
    begin = time.process_time()
    ground = terrain_surface(contours)
    seconds = time.process_time() - begin
    print(
        f"\n{name} at {interval:g} m: {contours.n_points:,} points, {n_triangles:,} triangles; "
        f"{ground.n_patches:,} patches in {seconds:.1f} s, "
        f"{np.degrees(edge_angles(ground).max(initial=0.0)):.0e} degrees between them at most; "
        f"{100 * overshoot(ground):.1f} % of the interval beyond contours at most\n"
    )
    cut_again(ground, contours)
    cut_again(terrain_surface(contours, TerrainOptions(tolerance=FINER * ground.tolerance)), contours)
    print()
    halfway = dict.fromkeys(("halfway mean", "halfway median", "halfway 90 %"), "7.2f")
    table = Table({"method": "22", "rms, m": "6.2f", "of the TIN's": "5.3f"} | halfway)
    methods: dict[str, Heights] = {
        "TIN": flat,
        "Clough-Tocher": CloughTocher2DInterpolator(*_points(contours)),
        "radial basis, 50 near": radial(contours),
        "minimum curvature": minimum_curvature(contours, 2.0 * float(grid.x[1] - grid.x[0])),
        "recon terrain": lambda at: elevations(ground, at)[0],
    }
    base = None
    for label, method in methods.items():
        miss = method(places) - heights
        rms = float(np.sqrt(np.nanmean(miss**2)))
        base = base or rms
        everywhere = method(grid.places()[0]).reshape(grid.heights.shape)
        found = distances_between(contour_levels(HeightGrid(grid.x, grid.y, everywhere), middles), truth)
        away = [] if found is None else [found.mean(), np.median(found), np.quantile(found, 0.9)]
        table.row(label, rms, rms / base, *away)


def overshoot(ground: Terrain) -> float:
    """Farthest that a patch between contours of two heights goes beyond these, in intervals, on a grid of samples."""
    limits = levels(ground.tiling, ground.interval)
    strip = limits.strip[ground.layout.face]
    beyond = excess(limits.low[strip], limits.high[strip], ground.nets)
    return float(np.max(beyond, where=~limits.ended[strip], initial=0.0)) / ground.interval


def cut_again(ground: Terrain, contours: ContourMap) -> None:
    """Print how far the given contours lie from those of the ground at the same heights, and the other way about."""
    found = contours_at(ground, np.unique(contours.heights).tolist(), steps=16)
    there, back = distances_between(contours, found), distances_between(found, contours)
    if there is not None and back is not None:
        print(
            f"cut again at the given heights, tolerance {ground.tolerance:.2f} m: given contours {there.mean():.2f} m "
            f"off on average, {there.max():.1f} at most; cuts {back.mean():.2f} m off given ones, median "
            f"{np.median(back):.2f}, {back.max():.1f} at most"
        )


def growth() -> None:
    """Contours of smooth ground far apart, and of rough ground near each other, in larger and larger maps."""
    kinds = {
        "sparse": (2.6, 16.67, (100, 200, 400, 800, 1600, 3000)),
        "dense": (2.2, 10.0, (150, 300, 600, 1200, 2050)),
    }
    seen: dict[str, list[tuple[int, float]]] = {}
    for kind, (roughness, interval, sizes) in kinds.items():
        table = Table(
            {kind: "9,", "patches": "9,", "seconds": "8.1f", "seconds per 100,000": "8.1f", "MiB so far": "8,.0f"}
        )
        for n in sizes:
            contours = contour_grid(fractal_mountain(n, CELL, 3, roughness), interval)
            begin = time.process_time()
            ground = terrain_surface(contours)
            seconds = time.process_time() - begin
            seen.setdefault(kind, []).append((contours.n_points, seconds))
            peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
            table.row(contours.n_points, ground.n_patches, seconds, seconds / contours.n_points * 1e5, peak)
        print(f"\n{kind}: seconds grow with the power {exponent(seen[kind]):.2f} of the points\n")
    draw_growth(seen)


def exponent(rows: list[tuple[int, float]]) -> float:
    """Slope of the line that fits best in logarithms, over maps of more than 20,000 points."""
    points, seconds = np.log([row for row in rows if row[0] > 20_000]).T
    return float(np.polyfit(points, seconds, 1)[0])


def draw_growth(seen: dict[str, list[tuple[int, float]]]) -> None:
    """Points against seconds of every kind of map, into the folder of measured figures."""
    figure = Figure(figsize=(5.0, 3.6), layout="constrained")
    panel = figure.subplots()
    for kind, rows in seen.items():
        panel.loglog(*np.transpose(rows), "o-", label=f"{kind} contours, power {exponent(rows):.2f}")
    ends = np.array([1e4, 1.2e6])
    panel.loglog(ends, 5e-5 * ends, "k--", linewidth=0.7, label="linear")
    panel.set_xlabel("contour points")
    panel.set_ylabel("seconds of one processor")
    panel.legend()
    figure.savefig(PLOT, dpi=110)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--growth", action="store_true")
    print(f"{machine()}; processor time\n")
    if parser.parse_args().growth:
        growth()
    else:
        for mountain in mountains():
            compared(*mountain)


if __name__ == "__main__":
    main()

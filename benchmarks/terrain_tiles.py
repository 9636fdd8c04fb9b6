"""A map by tiles: patches, angles within tiles and across their borders, the gate, memory and time, row by row.

python benchmarks/terrain_tiles.py [SIDE] [--interval M] [--tile KM]

Fractal ground (`fractal_mountain` of terrain.py, seed 3, roughness 2.6) of SIDE by SIDE heights (1200), 10 m apart, as
text with one decimal; contours at M metres (100), tolerance 10 m, tiles of about KM kilometres (SIDE / 1000). Each is a
block whose base lies 100 m below the lowest height, and goes through the gate into a STEP file that is read back. All
tiles in one process; angles in degrees, the largest between faces within tiles, and between those of a tile and of its
neighbours in the north and west; memory is the largest that was held so far, seconds are processor time, those of
looking through the text among the last ones.
"""

import argparse
import resource
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from brep_export.app.terrain_job import g1_max_deg
from brep_export.app.tile_names import KILOMETRE, tile_label
from brep_export.app.tile_work import TileOrder, network_shape, proven
from brep_export.app.workshop import Bench
from recon.errors import ReconError
from recon.geometry.patches import PatchNetwork
from recon.readers.height_grids import open_height_grid
from recon.terrain.map_tiles import MapTiles, Place, plan_tiles
from recon.terrain.network import border_angles, terrain_network
from recon.terrain.pipeline import TerrainOptions
from tables import Table, machine
from terrain import fractal_mountain

CELL, SEED, ROUGHNESS = 10.0, 3, 2.6
TOLERANCE, BELOW = 10.0, 100.0  # metres
Figures = tuple[int, bool, float, float, int]
REQUEST = {"scale": None, "exaggerate": None, "name": None, "header_unit": "M", "join": False}


def write_map(path: Path, side: int) -> None:
    grid = fractal_mountain(side, CELL, SEED, ROUGHNESS)
    with path.open("w", encoding="ascii") as file:
        file.write(f"ncols {side}\nnrows {side}\nxllcenter 0\nyllcenter 0\ncellsize {CELL:g}\nnodata_value -9999\n")
        for row in grid.heights[::-1]:
            file.write(" ".join(map("{:.1f}".format, row.tolist())) + "\n")


def measured(path: Path, interval: float, size: float) -> None:
    begun = time.process_time()
    plan = plan_tiles(open_height_grid(path), interval, size, TerrainOptions(tolerance=TOLERANCE))
    tiles = MapTiles(plan)
    order = TileOrder(REQUEST, tiles, plan.lowest - BELOW)
    print(f"\nlooked through in {time.process_time() - begun:.0f} s: {plan.shape[0]} by {plan.shape[1]} tiles\n")
    table = Table(
        {"row": "4", "tiles": "5,", "patches": "8,", "pass": "5,", "angle within": "12.1e", "across borders": "14.1e"}
        | {"MB of STEP": "10,.0f", "MiB held": "8,.0f", "seconds": "8.0f"}
    )
    known: dict[Place, PatchNetwork] = {}
    made: list[Figures] = []
    for r in range(plan.shape[0]):
        begin = time.process_time()
        row = [tile_figures(order, (r, c), known, path.parent) for c in range(plan.shape[1])]
        table.row(str(r), *together(row), held(), time.process_time() - begin)
        made.extend(row)
        for place in [place for place in known if place[0] < r]:
            del known[place]
    table.row("all", *together(made), held(), time.process_time() - begun)


def together(tiles: Sequence[Figures]) -> tuple[float, ...]:
    """Of some tiles: how many, their patches, how many pass, the largest angles, megabytes of their files."""
    patches, passed, within, across, size = zip(*tiles)
    return len(tiles), sum(patches), sum(passed), max(within), max(across), sum(size) / 1e6


def held() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def tile_figures(order: TileOrder, tile: Place, known: dict[Place, PatchNetwork], folder: Path) -> Figures:
    """Patches, whether it passes, angle within, and to its neighbours in the north and west, bytes of its file."""
    try:
        ground = order.tiles.tile(tile)
    except ReconError as problem:
        print(f"\n{tile_label(tile)}: {problem}\n")
        return 0, False, 0.0, 0.0, 0
    network = known[tile] = terrain_network(ground)
    beside = [known[place] for place in ((tile[0] - 1, tile[1]), (tile[0], tile[1] - 1)) if place in known]
    across = max((float(border_angles([network, other]).max(initial=0.0)) for other in beside), default=0.0)
    step = folder / f"{tile_label(tile)}.step"
    shape, kind = network_shape(order, network)
    report, _ = proven(order, shape, kind, ([str(step)], f"-{tile_label(tile)}", Bench(lambda message: None)))
    size = step.stat().st_size if report.passed else 0
    step.unlink(missing_ok=True)
    return ground.n_patches, report.passed, g1_max_deg(ground), float(np.degrees(across)), size


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("side", nargs="?", type=int, default=1200)
    parser.add_argument("--interval", type=float, default=100.0)
    parser.add_argument("--tile", type=float)
    parser.add_argument("--map", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.map is not None:
        write_map(given.map, given.side)
        return
    print(f"{machine()}; processor time")
    with TemporaryDirectory() as folder:
        path = Path(folder) / "map.asc"
        # in a process of its own: what it holds is no matter of the tiles
        subprocess.run([sys.executable, __file__, str(given.side), "--map", str(path)], check=True)
        measured(path, given.interval, KILOMETRE * (given.tile or given.side / 1000))


if __name__ == "__main__":
    main()

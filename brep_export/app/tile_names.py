"""Which tiles of which grid are asked for, and their files. Without the kernel, for a plan that only says so."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from recon.errors import BadOption

if TYPE_CHECKING:
    from recon.geometry.height_source import HeightSource

__all__ = ["KILOMETRE", "chosen_tiles", "planned_files", "tile_files", "tile_label", "tiled_grid"]

Place = tuple[int, int]

KILOMETRE = 1000.0


def chosen_tiles(only: str | None, shape: Place) -> list[Place]:
    """The tiles asked for, row by row, from text such as 0-2,4-6: rows from the north, columns from the west.

    Raises  BadOption.
    """
    if only is None:
        only = f"0-{shape[0] - 1},0-{shape[1] - 1}"
    try:
        rows, columns = (
            range(int(first), int(last or first) + 1)
            for first, _, last in (part.partition("-") for part in only.split(","))
        )
    except ValueError as problem:
        raise BadOption("--only", f"give rows and columns of tiles, as 0-2,4-6, not {only!r}") from problem
    tiles = [(r, c) for r in rows for c in columns]
    if not tiles or rows[-1] >= shape[0] or columns[-1] >= shape[1]:
        raise BadOption("--only", f"the map has {shape[0]} rows and {shape[1]} columns of tiles, from 0")
    return tiles


def tile_label(tile: Place) -> str:
    return f"r{tile[0]}-c{tile[1]}"


def tile_files(outputs: Sequence[str], tile: Place) -> list[str]:
    """The files of a tile: name-r0-c0.step for name.step."""
    paths = [Path(path) for path in outputs]
    return [str(path.with_name(f"{path.stem}-{tile_label(tile)}{path.suffix}")) for path in paths]


def tiled_grid(request: Mapping[str, Any]) -> "HeightSource":
    """The grid that is cut into tiles, or what `--clip` keeps of it: cells that lie wholly in a box.

    Raises  BadOption; UnreadableFile and its like where the grid cannot be read.
    """
    from brep_export.app.clip_box import clip_box
    from recon.readers.height_grids import open_height_grid
    from recon.readers.map_polygons import POLYGON_ENDINGS
    from recon.terrain.map_tiles import cells_within

    clip = request["clip"]
    if clip is not None and Path(clip).suffix.lower() in POLYGON_ENDINGS:
        raise BadOption(
            "--clip", "only a box, west,south,east,north, goes with --tile: a polygon would cut tiles apart"
        )
    box = None if clip is None else clip_box(clip)
    source = open_height_grid(request["inputs"][0], project=request["project"])
    return source if box is None else cells_within(source, box)


def planned_files(request: Mapping[str, Any]) -> list[str]:
    """Every file that `recon terrain --tile` would write, told from the axes of the grid alone.

    Raises  as `tiled_grid`.
    """
    from recon.terrain.map_tiles import lattice

    outputs: list[str] = request["outputs"]
    if request["join"]:
        return outputs
    rows, columns = lattice(tiled_grid(request), KILOMETRE * request["tile"])
    tiles = chosen_tiles(request["only"], (len(rows) - 1, len(columns) - 1))
    return [file for tile in tiles for file in tile_files(outputs, tile)]

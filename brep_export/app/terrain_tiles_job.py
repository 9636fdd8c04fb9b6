"""The job behind `recon terrain --tile`: a grid too large for memory, tile by tile, to a file each, or some as one."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from OCP.TopoDS import TopoDS_Shape

from brep_export.app.deliver import copied_ahead, gate, write_files
from brep_export.app.outputs import check_destinations
from brep_export.app.result import kernel_of_all, result
from brep_export.app.terrain_job import (
    TOLERANCE,
    g1_max_deg,
    ground_options,
    lowest_place,
    paint,
    scale_of,
    sidecar,
    stretch_of,
    write_sidecar,
)
from brep_export.app.tile_names import KILOMETRE, chosen_tiles, tile_files, tile_label
from brep_export.app.workshop import Bench, Exit
from brep_export.blocks import block_solid
from brep_export.check import CheckReport, ShapeKind
from brep_export.shells import network_shell
from recon.errors import BadGeometry, BadOption, Refusal
from recon.geometry.patches import PatchNetwork
from recon.readers.height_grids import GRID_ENDINGS, open_height_grid
from recon.terrain.map_tiles import MapTiles, Place, TiledMap, plan_tiles
from recon.terrain.network import border_angles, joined_network, stretched, terrain_network

__all__ = ["terrain_tiles"]

Answer = tuple[Exit, dict[str, Any], tuple[str, ...]]

WHOLE = "looks at the whole map, or mends it: not with --tile"
NOT_BY_TILES = {  # options of `recon terrain`, with what they have to be left at and why
    "clip": (None, "cuts through tiles, whose neighbours know nothing of the cut: cut the grid itself first, or choose"
                   " tiles with --only"),
    "against": (None, WHOLE), "contours": (None, WHOLE), "attribute": (None, WHOLE), "unit": (None, WHOLE),
    "mend": (False, WHOLE), "break_lines": (False, WHOLE),
}  # fmt: skip


def terrain_tiles(request: Mapping[str, Any], bench: Bench) -> Answer:
    """Lay the lattice, make the chosen tiles, prove and write each, or all of them joined."""
    _check_request(request)
    with bench.phase("read", "looking through the grid"):
        source = open_height_grid(request["inputs"][0], project=request["project"])
        plan = plan_tiles(source, request["interval"], KILOMETRE * request["tile"], ground_options(request))
    chosen = chosen_tiles(request["only"], plan.shape)
    base = _base(request, plan)
    tiles = MapTiles(plan)
    work = _joined if request["join"] else _one_by_one
    made = work(_Order(request, plan, base, chosen), tiles, bench)
    room = {
        "lattice": list(plan.shape),
        "tiles": made.rows,
        "patches": sum(row["patches"] for row in made.rows),
        "g1_max_deg": max((row["g1_max_deg"] for row in made.rows), default=None),
        "border_max_deg": made.border_max_deg,
        "tolerance": plan.options.tolerance,
        "origin": plan.origin.tolist(),
        "crs": source.crs or None,
    }
    kernel = kernel_of_all(made.kernels) if made.kernels else {}
    answer = result(
        "terrain",
        inputs=request["inputs"],
        outputs=made.written,
        reasons=made.reasons,
        kernel=kernel,
        seconds=bench.seconds | {"total": bench.elapsed()},
        room=room,
        notes=bench.notes,
    )
    return (Exit.REFUSED if made.reasons else Exit.WRITTEN), answer, tuple(made.reasons)


@dataclass(frozen=True, eq=False)
class _Order:
    """What was asked for: the request, the map, the height of the base or None, the tiles."""

    request: Mapping[str, Any]
    plan: TiledMap
    base: float | None
    tiles: list[Place]


@dataclass(frozen=True, eq=False)
class _Made:
    """What came out: figures of every tile, what the gate said, files, why something is missing.

    Of the gate's reports only their figures: a report holds its shape, and a map has many.
    """

    rows: list[dict[str, Any]]
    kernels: list[dict[str, Any]]
    written: list[str]
    reasons: list[str]
    border_max_deg: float | None = None


def _check_request(request: Mapping[str, Any]) -> None:
    path = request["inputs"][0]
    if Path(path).suffix.lower() not in GRID_ENDINGS:
        raise BadOption("--tile", f"{path} is no grid ({' '.join(GRID_ENDINGS)}); only a grid is made by tiles")
    if request["interval"] is None:
        raise BadOption("--interval", f"{path} is a grid; say at which interval in metres to contour it")
    lines = next((path for path in request["outputs"] if Path(path).suffix.lower() == ".geojson"), None)
    if lines is not None:
        raise BadOption("--output", f"{lines} would hold contours, which are not made by tiles")
    for name, (usual, why) in NOT_BY_TILES.items():
        if request[name] != usual:
            raise BadOption(f"--{name.replace('_', '-')}", why)
    if request["base_depth"] is not None and request["base_level"] is not None:
        raise BadOption("--base-level", "say how deep the base lies or at which height, not both")
    if not request["join"] and (request["picture"] or request["report"]):
        raise BadOption("--tile", "a picture or a page shows one shape: ask for it with --join")


def _base(request: Mapping[str, Any], plan: TiledMap) -> float | None:
    """Height of the base, one for all tiles, so that they stand on one plane."""
    if request["base_level"] is not None:
        return float(request["base_level"])
    return None if request["base_depth"] is None else plan.lowest - float(request["base_depth"])


def _one_by_one(order: _Order, tiles: MapTiles, bench: Bench) -> _Made:
    made = _Made([], [], [], [])
    check_destinations(
        {**order.request, "outputs": [f for tile in order.tiles for f in tile_files(order.request["outputs"], tile)]}
    )
    for number, tile in enumerate(order.tiles, 1):
        try:
            _one(order, tile, tiles, (made, bench, f"tile {number} of {len(order.tiles)}"))
        except (BadGeometry, Refusal) as problem:
            made.reasons.append(f"{tile_label(tile)}: {problem}")
    return made


def _one(order: _Order, tile: Place, tiles: MapTiles, into: tuple[_Made, Bench, str]) -> None:
    made, bench, where = into
    with bench.phase("reconstruct", where):
        ground = tiles.tile(tile)
        network = terrain_network(ground)
        row = {"tile": tile_label(tile), "patches": ground.n_patches, "g1_max_deg": g1_max_deg(ground)}
    shape, kind = _shape(order, network)
    report, written = _proven(
        order, shape, kind, (tile_files(order.request["outputs"], tile), f"-{tile_label(tile)}", bench)
    )
    made.rows.append(row)
    made.kernels.append(report.as_json())
    made.written.extend(written)
    made.reasons.extend(f"{tile_label(tile)}: {defect}" for defect in report.defects)


def _joined(order: _Order, tiles: MapTiles, bench: Bench) -> _Made:
    made = _Made([], [], [], [])
    networks = []
    for number, tile in enumerate(order.tiles, 1):
        with bench.phase("reconstruct", f"tile {number} of {len(order.tiles)}"):
            ground = tiles.tile(tile)
            networks.append(terrain_network(ground))
            made.rows.append({"tile": tile_label(tile), "patches": ground.n_patches, "g1_max_deg": g1_max_deg(ground)})
    border = float(np.degrees(border_angles(networks).max(initial=0.0)))
    with bench.phase("brep", "joining the tiles"):
        shape, kind = _shape(order, joined_network(networks))
    report, written = _proven(order, shape, kind, (order.request["outputs"], "", bench))
    return _Made(made.rows, [report.as_json()], written, [str(defect) for defect in report.defects], border)


def _shape(order: _Order, network: PatchNetwork) -> tuple[TopoDS_Shape, ShapeKind]:
    stretch = stretch_of(order.request)
    if order.base is None:
        return network_shell(stretched(network, stretch), TOLERANCE), ShapeKind.SHELL
    lowest = lowest_place(network)
    if lowest <= order.base:
        raise BadOption(
            "--base-depth", f"the ground of a tile reaches down to {lowest:.2f} m, the base lies at {order.base:.2f} m"
        )
    return block_solid(stretched(network, stretch), order.base * stretch[2], TOLERANCE), ShapeKind.SOLID


def _proven(
    order: _Order, shape: TopoDS_Shape, kind: ShapeKind, to: tuple[list[str], str, Bench]
) -> tuple[CheckReport, list[str]]:
    """What the gate says of a shape, and the files that were written of it."""
    outputs, ending, bench = to
    request, plan = order.request, order.plan
    scale = scale_of(request["scale"])
    beside = {sidecar(path): partial(write_sidecar, plan.origin, plan.source.crs, scale) for path in outputs}
    name = (request["name"] or "terrain") + ending
    asked = dict(request) | {"name": name, "outputs": outputs}
    with copied_ahead(shape, asked, bench) as copy:
        report = gate(shape, TOLERANCE, kind, bench, copy)
        return write_files(shape, report, asked, bench, paint=partial(paint, shape, report), beside=beside)

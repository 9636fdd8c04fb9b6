"""One tile of a map, here or on a worker of a cluster: made, proved, written; and what goes wrong in it, said.

A shape stays in the process that makes it. What comes back is figures, and the patches where tiles are to be joined.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from threading import Lock
from typing import Any

from OCP.TopoDS import TopoDS_Shape

from brep_export.app.deliver import copied_ahead, gate, write_files
from brep_export.app.terrain_job import (
    TOLERANCE,
    g1_max_deg,
    lowest_place,
    paint,
    scale_of,
    sidecar,
    stretch_of,
    write_sidecar,
)
from brep_export.app.tile_names import tile_files, tile_label
from brep_export.app.workshop import Bench, ended_by
from brep_export.blocks import block_solid
from brep_export.check import CheckReport, ShapeKind
from brep_export.shells import network_shell
from recon.errors import BadOption
from recon.geometry.patches import PatchNetwork
from recon.terrain.map_tiles import MapTiles, Place
from recon.terrain.network import stretched, terrain_network

__all__ = ["TileMade", "TileOrder", "made_alone", "made_tile", "nearby", "network_shape", "proven"]

ALONE = Lock()  # a worker may have several threads: the kernel's settings are the process's, and so is its memory


@dataclass(frozen=True, eq=False)
class TileOrder:
    """What was asked for: the request, the map's tiles, the height of the base or None."""

    request: Mapping[str, Any]
    tiles: MapTiles
    base: float | None


@dataclass(frozen=True, eq=False)
class TileMade:
    """What came of a tile.

    row      figures of its ground, or None where it has none
    kernel   what the gate said, or None where it was not asked: a report holds its shape, and a map has many
    network  its patches, where they are to be joined
    written  files
    reasons  why something is missing, one sentence each
    trace, cause  of a fault, as in an Outcome
    """

    row: dict[str, Any] | None = None
    kernel: dict[str, Any] | None = None
    network: PatchNetwork | None = None
    written: Sequence[str] = ()
    reasons: Sequence[str] = ()
    trace: str = ""
    cause: str = ""


def made_tile(order: TileOrder, tile: Place, bench: Bench, where: str = "") -> TileMade:
    """A tile, proved and in its files, or its patches where tiles are joined; what it raises is said: others go on."""
    try:
        return _made(order, tile, bench, where)
    except Exception as problem:  # noqa: BLE001 - the last door of a tile, as the workshop's is of a job
        return _broken_off(problem)


def nearby(order: TileOrder, tile: Place) -> TileOrder | TileMade:
    """The order that a worker is given: with the heights around the tile; or what is said where they cannot be read."""
    try:
        return replace(order, tiles=MapTiles(order.tiles.plan.near(tile)))
    except Exception as problem:  # noqa: BLE001 - as where a tile is made, which reads the same heights
        return _broken_off(problem)


def made_alone(order: TileOrder | TileMade, tile: Place) -> TileMade:
    """The tile of such an order on a worker, one at a time in a process."""
    if isinstance(order, TileMade):
        return order
    with ALONE:
        return made_tile(order, tile, Bench(lambda message: None))


def _broken_off(problem: Exception) -> TileMade:
    ending = ended_by(problem)
    return TileMade(reasons=ending.reasons, trace=ending.trace, cause=ending.cause)


def _made(order: TileOrder, tile: Place, bench: Bench, where: str) -> TileMade:
    with bench.phase("reconstruct", where):
        ground = order.tiles.tile(tile)
        network = terrain_network(ground)
        row = {"tile": tile_label(tile), "patches": ground.n_patches, "g1_max_deg": g1_max_deg(ground)}
    if order.request["join"]:
        return TileMade(row, network=network)
    shape, kind = network_shape(order, network)
    files = tile_files(order.request["outputs"], tile)
    report, written = proven(order, shape, kind, (files, f"-{tile_label(tile)}", bench))
    return TileMade(row, report.as_json(), None, written, [str(defect) for defect in report.defects])


def network_shape(order: TileOrder, network: PatchNetwork) -> tuple[TopoDS_Shape, ShapeKind]:
    """The open shell of some ground, or the block above the base."""
    stretch = stretch_of(order.request)
    if order.base is None:
        return network_shell(stretched(network, stretch), TOLERANCE), ShapeKind.SHELL
    lowest = lowest_place(network)
    if lowest <= order.base:
        raise BadOption(
            "--base-depth", f"the ground of a tile reaches down to {lowest:.2f} m, the base lies at {order.base:.2f} m"
        )
    return block_solid(stretched(network, stretch), order.base * stretch[2], TOLERANCE), ShapeKind.SOLID


def proven(
    order: TileOrder, shape: TopoDS_Shape, kind: ShapeKind, to: tuple[list[str], str, Bench]
) -> tuple[CheckReport, list[str]]:
    """What the gate says of a shape, and the files that were written of it."""
    outputs, ending, bench = to
    request, plan = order.request, order.tiles.plan
    scale = scale_of(request["scale"])
    beside = {sidecar(path): partial(write_sidecar, plan.origin, plan.source.crs, scale) for path in outputs}
    name = (request["name"] or "terrain") + ending
    asked = dict(request) | {"name": name, "outputs": outputs}
    with copied_ahead(shape, asked, bench) as copy:
        report = gate(shape, TOLERANCE, kind, bench, copy)
        return write_files(shape, report, asked, bench, paint=partial(paint, shape, report), beside=beside)

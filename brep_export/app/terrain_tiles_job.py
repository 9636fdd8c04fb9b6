"""The job behind `recon terrain --tile`: a grid too large for memory, tile by tile, to a file each, or some as one."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from brep_export.app.clip_box import clip_box
from brep_export.app.cluster_calls import calls
from brep_export.app.outputs import check_destinations
from brep_export.app.result import kernel_of_all, result
from brep_export.app.terrain_job import ground_options, stretch_of
from brep_export.app.tile_names import KILOMETRE, chosen_tiles, tile_files, tile_label, tiled_grid
from brep_export.app.tile_work import TileMade, TileOrder, made_alone, made_tile, nearby, network_shape, proven
from brep_export.app.workshop import Bench, Exit
from recon.errors import BadOption
from recon.geometry.height_source import HeightSource
from recon.geometry.patches import PatchNetwork
from recon.readers.height_grids import GRID_ENDINGS
from recon.terrain.map_tiles import MapTiles, Place, TiledMap, plan_tiles
from recon.terrain.network import border_angles, joined_network

__all__ = ["terrain_tiles"]

Answer = tuple[Exit, dict[str, Any], tuple[str, ...], str, str]

WHOLE = "looks at the whole map, or mends it: not with --tile"
NOT_BY_TILES = {  # options of `recon terrain`, with what they have to be left at and why
    "against": (None, WHOLE), "contours": (None, WHOLE), "attribute": (None, WHOLE), "unit": (None, WHOLE),
    "mend": (False, WHOLE), "break_lines": (False, WHOLE),
}  # fmt: skip


def terrain_tiles(request: Mapping[str, Any], bench: Bench) -> Answer:
    """Lay the lattice, make the chosen tiles, prove and write each, or all of them joined.

    A tile that cannot be made, for whatever reason, is named with it, and the others are made.
    """
    _check_request(request)
    with bench.phase("read", "looking through the grid"):
        source = tiled_grid(request)
        _tell_box(source, request["clip"], bench)
        plan = plan_tiles(source, request["interval"], KILOMETRE * request["tile"], ground_options(request))
    places = chosen_tiles(request["only"], plan.shape)
    order = TileOrder(request, MapTiles(plan), _base(request, plan))
    made = (_joined if request["join"] else _one_by_one)(order, places, bench)
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
    answer = result(
        "terrain",
        inputs=request["inputs"],
        outputs=made.written,
        reasons=made.reasons,
        kernel=kernel_of_all(made.kernels) if made.kernels else {},
        seconds=bench.seconds | {"total": bench.elapsed()},
        room=room,
        notes=bench.notes,
    )
    status = Exit.REFUSED if made.reasons else Exit.WRITTEN
    return status, answer, tuple(made.reasons), "\n".join(made.traces), next(iter(made.causes), "")


@dataclass(frozen=True, eq=False)
class _Made:
    """What came out of the tiles: figures of each, what the gate said, files, and why something is missing."""

    rows: list[dict[str, Any]] = field(default_factory=list)
    kernels: list[dict[str, Any]] = field(default_factory=list)
    written: list[str] = field(default_factory=list)
    reasons: list[str] = field(default_factory=list)
    traces: list[str] = field(default_factory=list)
    causes: list[str] = field(default_factory=list)
    border_max_deg: float | None = None

    def take(self, tile: Place, made: TileMade) -> None:
        """Add what came of a tile."""
        self.rows.extend([] if made.row is None else [made.row])
        self.kernels.extend([] if made.kernel is None else [made.kernel])
        self.written.extend(made.written)
        self.reasons.extend(f"{tile_label(tile)}: {reason}" for reason in made.reasons)
        self.traces.extend([f"{tile_label(tile)}: {made.trace}"] if made.trace else [])
        self.causes.extend([made.cause] if made.cause else [])


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
    stretch_of(request)  # what is wrong with a scale is wrong for every tile


def _tell_box(source: HeightSource, clip: str | None, bench: Bench) -> None:
    """Say which box was kept, where that is not the one asked for."""
    if clip is None:
        return
    kept = np.array([[source.x[0], source.y[0]], [source.x[-1], source.y[-1]]])
    if not np.allclose(kept, clip_box(clip), rtol=0.0, atol=1e-3):
        box = ",".join(f"{place:.10g}" for place in kept.ravel())
        bench.note(f"--clip keeps whole cells of the grid, here those in {box}", name="clipped")


def _base(request: Mapping[str, Any], plan: TiledMap) -> float | None:
    """Height of the base, one for all tiles, so that they stand on one plane."""
    if request["base_level"] is not None:
        return float(request["base_level"])
    return None if request["base_depth"] is None else plan.lowest - float(request["base_depth"])


def _one_by_one(order: TileOrder, places: Sequence[Place], bench: Bench) -> _Made:
    outputs = [path for tile in places for path in tile_files(order.request["outputs"], tile)]
    check_destinations({**order.request, "outputs": outputs})
    made = _Made()
    for tile, one in _tiles(order, places, bench):
        made.take(tile, one)
        bench.kept(one.written)
    return made


def _joined(order: TileOrder, places: Sequence[Place], bench: Bench) -> _Made:
    """All tiles as one shape, or none of them where one is missing."""
    made = _Made()
    networks: list[PatchNetwork] = []
    for tile, one in _tiles(order, places, bench):
        made.take(tile, one)
        networks.extend([] if one.network is None else [one.network])
    if made.reasons:
        return made
    border = float(np.degrees(border_angles(networks).max(initial=0.0)))
    with bench.phase("brep", "joining the tiles"):
        shape, kind = network_shape(order, joined_network(networks))
    report, written = proven(order, shape, kind, (order.request["outputs"], "", bench))
    reasons = [str(defect) for defect in report.defects]
    return _Made(made.rows, [report.as_json()], written, reasons, border_max_deg=border)


def _tiles(order: TileOrder, places: Sequence[Place], bench: Bench) -> Iterator[tuple[Place, TileMade]]:
    """Every tile with what came of it, in their order: made here, or by the workers of a scheduler."""
    names = [f"tile {number} of {len(places)}" for number in range(1, len(places) + 1)]
    if order.request["scheduler"] is None:
        for tile, name in zip(places, names):
            yield tile, made_tile(order, tile, bench, name)
        return
    outputs = order.request["outputs"]
    away = replace(order, request={**order.request, "outputs": [str(Path(path).absolute()) for path in outputs]})
    with calls(order.request["scheduler"], lost=_lost) as each:
        made = each(made_alone, (nearby(away, tile) for tile in places), places)
        for tile, name in zip(places, names):
            with bench.phase("reconstruct", name):
                one = next(made)
            yield tile, replace(one, written=_as_given(one.written, outputs))


def _lost(problem: Exception) -> TileMade:
    return TileMade(reasons=["every worker that was given it broke off; nothing was written."], cause="crash")


def _as_given(written: Sequence[str], outputs: Sequence[str]) -> list[str]:
    """Files that workers know by their whole paths, as the user names them."""
    folders = {Path(path).absolute().parent: Path(path).parent for path in outputs}
    return [str(folders[Path(path).parent] / Path(path).name) for path in written]

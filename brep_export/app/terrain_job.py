"""The job behind `recon terrain`: contours, or a grid to contour first, to a mountain, through the gate, to files."""

import json
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from OCP.TopoDS import TopoDS_Shape

from brep_export.app.clip_box import clip_box
from brep_export.app.deliver import copied_ahead, gate, write_files
from brep_export.app.outputs import check_destinations
from brep_export.app.result import result
from brep_export.app.scene import Measured, line_part, point_part
from brep_export.app.workshop import Bench, Exit
from brep_export.blocks import block_solid
from brep_export.check import CheckReport, ShapeKind
from brep_export.compounds import one_or_compound
from brep_export.shells import network_shell
from recon.errors import BadOption
from recon.geometry.contour_map import ContourMap, HeightGrid
from recon.geometry.patches import PatchNetwork
from recon.readers.contours import CONTOUR_ENDINGS, read_contours
from recon.readers.height_grids import GRID_ENDINGS, read_height_grid
from recon.readers.map_polygons import POLYGON_ENDINGS, read_polygon
from recon.terrain.base_contours import contours_with
from recon.terrain.clipping import clip_to_box, clip_to_polygon
from recon.terrain.contouring import contour_grid, contour_levels, largest_piece
from recon.terrain.evaluation import contour_distances, distances_between, edge_angles, elevations
from recon.terrain.network import stretched, terrain_network
from recon.terrain.pipeline import PatchKind, Terrain, TerrainOptions, terrain_surface
from recon.terrain.sections import contours_at, islands_above
from recon.tolerance import Tolerance

__all__ = [
    "TOLERANCE", "g1_max_deg", "ground_options", "lowest_place", "paint", "scale_of", "sidecar", "stretch_of",
    "terrain", "write_sidecar",
]  # fmt: skip

Answer = tuple[Exit, dict[str, Any], tuple[str, ...]]

# a hundredth of a metre: far below what a map resolves, far above what the shared edges need
LINES_ENDING = ".geojson"
TOLERANCE = Tolerance(merge=1e-5, fit=0.01)

MOST_COARSE, PICTURE_SAG = 100_000, 1e-4  # triangles, and their distance from the faces in diagonals of the shape
MOST_PLACES, GRID_COLOUR = 30_000, "#b98d66"  # of a grid in the page's view


def terrain(request: Mapping[str, Any], bench: Bench) -> Answer:
    """Read the map, make the ground, close it if asked, prove it, write it."""
    _check_request(request)
    with bench.phase("read", "reading the map"):
        contours = _clipped(_read(request, bench), request["clip"])
        against = _against(request)
    with bench.phase("reconstruct", "following the contours"):
        options = ground_options(request)
        ground = terrain_surface(contours, options, doing=bench.doing)
        room = _figures(contours, ground, against)
        lines = _new_contours(ground, request["contours"])
        whole = _to_be_cut(contours, ground, options, request["base_level"], bench)
    for note in ground.notes:
        bench.note(note, name="ground")
    with bench.phase("brep", "building the shape"):
        shape, kind, scale = _shape(whole, request)
    room["g1_max_deg"] = g1_max_deg(whole)
    beside = {path: partial(_write_lines, lines, ground) for path in _line_files(request)}
    beside |= {
        sidecar(path): partial(write_sidecar, ground.origin, ground.crs, scale) for path in _shape_files(request)
    }
    asked = dict(request) | {"name": request["name"] or "terrain", "outputs": _shape_files(request)}
    with copied_ahead(shape, asked, bench) as copy:
        report = gate(shape, TOLERANCE, kind, bench, copy)
        report, written = write_files(
            shape,
            report,
            asked,
            bench,
            paint=partial(paint, shape, report),
            beside=beside,
            measured=partial(_measured, contours, ground, against, stretch_of(request)),
            sheets=[partial(_draw_map, contours, ground, against)],
        )
    reasons = tuple(str(defect) for defect in report.defects)
    answer = result(
        "terrain",
        inputs=request["inputs"],
        outputs=written,
        reasons=reasons,
        kernel=report.as_json(),
        seconds=bench.seconds | {"total": bench.elapsed()},
        room=room,
        notes=bench.notes,
    )
    return (Exit.REFUSED if reasons else Exit.WRITTEN), answer, reasons


def _check_request(request: Mapping[str, Any]) -> None:
    if request["base_depth"] is not None and request["base_level"] is not None:
        raise BadOption("--base-level", "say how deep the base lies or at which height, not both")
    if _line_files(request) and request["contours"] is None:
        raise BadOption("--contours", f"say at which interval the contours in {_line_files(request)[0]} lie")
    if request["contours"] is not None and not _line_files(request):
        raise BadOption("--contours", "name a .geojson file with -o for the contours")
    sidecars = [sidecar(path) for path in _shape_files(request)]
    check_destinations({**request, "outputs": sidecars, "endings": (".json",), "picture": None, "report": None})


def ground_options(request: Mapping[str, Any]) -> TerrainOptions:
    """What was asked for of the ground; BadOption where it does not go together."""
    kind, angle = PatchKind(request["patches"]), request["angle"]
    if angle is not None and kind is not PatchKind.GREGORY:
        raise BadOption("--angle", "is kept by the B-splines of Gregory patches; the default ones meet exactly")
    options = TerrainOptions(tolerance=request["tolerance"], mend=request["mend"], patches=kind)
    return options if angle is None else replace(options, angle=angle)


def _line_files(request: Mapping[str, Any]) -> list[str]:
    return [path for path in request["outputs"] if Path(path).suffix.lower() == LINES_ENDING]


def _shape_files(request: Mapping[str, Any]) -> list[str]:
    return [path for path in request["outputs"] if Path(path).suffix.lower() != LINES_ENDING]


def sidecar(path: str) -> str:
    """Beside an output, under its whole name: the map's own file may well be called hill.json."""
    return f"{path}.json"


def _read(request: Mapping[str, Any], bench: Bench) -> ContourMap:
    path = request["inputs"][0]
    if Path(path).suffix.lower() in GRID_ENDINGS:
        if request["interval"] is None:
            raise BadOption("--interval", f"{path} is a grid; say at which interval in metres to contour it")
        if request["unit"] not in (None, "m"):
            raise BadOption("--unit", f"{path} is a grid, which is read in metres; convert it first")
        grid, lost = largest_piece(read_height_grid(path, project=request["project"]))
        if lost:
            bench.note(
                f"{lost} heights that voids cut off from the largest piece of the grid are left out.", name="ground"
            )
        return contour_grid(grid, request["interval"])
    if request["interval"] is not None:
        raise BadOption(
            "--interval", f"{path} holds contours already; only a grid ({' '.join(GRID_ENDINGS)}) is contoured"
        )
    if Path(path).suffix.lower() not in CONTOUR_ENDINGS:
        raise BadOption("contours", f"{path}: give {' '.join(CONTOUR_ENDINGS)}, or a grid {' '.join(GRID_ENDINGS)}")
    told = {name: request[name] for name in ("attribute", "unit", "break_lines", "project")}
    return read_contours(path, **told)


def _against(request: Mapping[str, Any]) -> HeightGrid | None:
    return None if request["against"] is None else read_height_grid(request["against"], project=request["project"])


def _clipped(contours: ContourMap, clip: str | None) -> ContourMap:
    if clip is None:
        return contours
    if Path(clip).suffix.lower() in POLYGON_ENDINGS:
        return clip_to_polygon(contours, read_polygon(clip))
    return clip_to_box(contours, clip_box(clip))


def _new_contours(ground: Terrain, interval: float | None) -> ContourMap | None:
    if interval is None:
        return None
    heights = ground.jets.height
    first, last = np.ceil(heights.min() / interval), np.floor(heights.max() / interval)
    return contours_at(ground, (interval * np.arange(first, last + 1)).tolist())


def _to_be_cut(
    contours: ContourMap, ground: Terrain, options: TerrainOptions, level: float | None, bench: Bench
) -> Terrain:
    """The ground, made again with a contour at the base where that cuts it."""
    if level is None or level < lowest_place(terrain_network(ground)):
        return ground
    if level >= ground.jets.height.max():
        raise BadOption("--base-level", f"must lie below the highest ground, {ground.jets.height.max():.2f} m")
    contours, told = contours_with(contours, ground, level)
    for note in told:
        bench.note(note, name="ground")
    bench.doing("cutting at the base")
    return terrain_surface(contours, replace(options, tolerance=ground.tolerance), floor=level, doing=bench.doing)


def _shape(ground: Terrain, request: Mapping[str, Any]) -> tuple[TopoDS_Shape, ShapeKind, float]:
    """The open shell of the ground, or the solids above the base that was asked for; and how long a metre is in it."""
    depth, level = request["base_depth"], request["base_level"]
    scale, stretch = scale_of(request["scale"]), stretch_of(request)
    network = terrain_network(ground)
    lowest = lowest_place(network)
    if depth is None and level is None:
        return network_shell(stretched(network, stretch), TOLERANCE), ShapeKind.SHELL, scale
    base = lowest - depth if level is None else level
    grounds = [ground] if base < lowest else islands_above(ground, base)
    solids = [block_solid(stretched(terrain_network(part), stretch), base * stretch[2], TOLERANCE) for part in grounds]
    return one_or_compound(solids), ShapeKind.SOLID if len(solids) == 1 else ShapeKind.COMPOUND, scale


def stretch_of(request: Mapping[str, Any]) -> NDArray[np.float64]:
    """Factors from metres of the ground to the file, of x, y and z."""
    scale = scale_of(request["scale"])
    return scale * np.array([1.0, 1.0, float(request["exaggerate"] or 1.0)])


def scale_of(text: str | None) -> float:
    """Length in the file for one metre of the ground: 1, or 1/25000 for 1:25000."""
    if text is None:
        return 1.0
    parts = text.split(":")
    try:
        over, under = (float(part) for part in parts)
    except ValueError as problem:
        raise BadOption("--scale", f"give it as 1:25000, not {text!r}") from problem
    if not (over > 0 and under > 0 and np.isfinite(over / under)):
        raise BadOption("--scale", f"give it as 1:25000, not {text!r}")
    return over / under


def lowest_place(network: PatchNetwork) -> float:
    """Height of the lowest place, on a grid of samples of every patch and at every vertex."""
    from recon.numerics.bspline_basis import basis_matrix

    lowest = float(network.vertices[:, 2].min())
    t = np.linspace(0.0, 1.0, 5)
    for patch in network.patches:
        z = patch.control_net[..., 2]
        if z.min() < lowest:
            along = [
                basis_matrix(k, d, t) for k, d in ((patch.knots_u, patch.degree_u), (patch.knots_v, patch.degree_v))
            ]
            lowest = min(lowest, float((along[1] @ (along[0] @ z).T).min()))
    return lowest


def g1_max_deg(ground: Terrain) -> float:
    """Largest angle in degrees between the faces along their common edges."""
    stray = max((patches.stray() for patches in ground.nets), default=0.0)
    return float(np.degrees(edge_angles(ground).max(initial=0.0) + 2.0 * stray))


def _write_lines(lines: ContourMap | None, ground: Terrain, path: Path) -> None:
    rows = [] if lines is None else list(zip(lines.lines, lines.heights.tolist()))
    features = [
        {
            "type": "Feature",
            "properties": {"elevation": height},
            "geometry": {"type": "LineString", "coordinates": line.round(3).tolist()},
        }
        for line, height in rows
    ]
    content: dict[str, Any] = {"type": "FeatureCollection", "features": features}
    if ground.crs:
        content["crs"] = {"type": "name", "properties": {"name": ground.crs}}
    path.write_text(json.dumps(content), encoding="utf-8")


def write_sidecar(origin: NDArray[np.float64], crs: str, scale: float, path: Path) -> None:
    """Where the file's zero lies on the map, and how long a metre is in it."""
    content = {"origin": [float(x) for x in origin], "crs": crs or None, "scale": scale, "unit": "m"}
    path.write_text(json.dumps(content), encoding="utf-8")


def _figures(contours: ContourMap, ground: Terrain, against: HeightGrid | None) -> dict[str, Any]:
    sides = ground.tiling.contour_sides()
    distance = contour_distances(ground, contours)
    free = len(ground.tiling.points) - ground.tiling.curves.n_vertices
    figures: dict[str, Any] = {
        "contours": len(contours.lines),
        "voids": len(contours.voids),
        "vertices": ground.tiling.curves.n_vertices,
        "free_vertices": free - len(ground.tiling.spots),
        "spot_heights": len(ground.tiling.spots),
        "quads": int((~ground.layout.is_triangle).sum()),
        "sleeves": int((sides == 1).sum()),
        "terminals": int((sides == 2).sum()),
        "junctions": int((sides == 0).sum()),
        "patches": ground.n_patches,
        "tolerance": ground.tolerance,
        "contour_error": {"mean": float(distance.mean()), "max": float(distance.max())},
        "origin": [float(x) for x in ground.origin],
        "crs": contours.crs or None,
    }
    if against is not None:
        places, heights = against.places()
        miss = elevations(ground, places)[0] - heights
        inside = np.isfinite(miss)
        if not inside.any():
            raise BadOption("--against", "the grid and the contours have no place in common")
        figures["rmse"] = float(np.sqrt((miss[inside] ** 2).mean()))
        figures["mid_contour"] = _mid_contours(contours, ground, against)
    return figures


def _mid_contours(contours: ContourMap, ground: Terrain, against: HeightGrid) -> dict[str, float] | None:
    """Distances in plan from the ground's contours halfway between the given heights to those of the grid itself."""
    levels = np.unique(contours.heights)
    middles = ((levels[:-1] + levels[1:]) / 2).tolist()
    found = distances_between(contours_at(ground, middles), contour_levels(against, middles))
    if found is None:
        return None
    mean, median, p90 = found.mean(), np.median(found), np.quantile(found, 0.9)
    return {"mean": float(mean), "median": float(median), "p90": float(p90)}


def _measured(
    contours: ContourMap, ground: Terrain, against: HeightGrid | None, stretch: NDArray[np.float64]
) -> Measured:
    """The contours, coloured by how far the ground's own lie from them, and the grid it was held to, if any."""
    order = np.argsort(contours.heights, kind="stable")  # that of contour_distances
    lines = [_placed(contours.lines[k], contours.heights[k], ground, stretch) for k in order]
    off = contour_distances(ground, contours)
    parts = [line_part("contours", lines, "#7a4b22", values=off, scale="contours of the ground off these, in plan, m")]
    if against is not None:
        places, heights = against.places()
        some = np.arange(len(places))[:: max(1, len(places) // MOST_PLACES)]
        miss = np.abs(elevations(ground, places[some])[0] - heights[some])
        shown = _placed(places[some], heights[some], ground, stretch)
        parts.append(point_part("grid", shown, GRID_COLOUR, values=miss, scale="height off the grid, m", shown=False))
    return Measured(parts)


def _placed(places: NDArray[np.float64], height: Any, ground: Terrain, stretch: NDArray[np.float64]) -> Any:
    """Map places (n, 2) with their height in the file's own coordinates."""
    return np.column_stack([places - ground.origin, np.broadcast_to(height, len(places))]) * stretch


def _draw_map(contours: ContourMap, ground: Terrain, against: HeightGrid | None, path: Path) -> None:
    from brep_export.app.terrain_map import draw_map

    draw_map(path, contours, ground, against)


def paint(shape: TopoDS_Shape, report: CheckReport, path: Path) -> None:
    """In raking light chords a metre off a face look like creases: small grounds are cut finer than for the gate."""
    from brep_export.app.pictures import CLAY, Part, View, draw
    from brep_export.triangulation import triangulate

    mesh = report.triangles()
    if mesh.n_faces < MOST_COARSE:
        mesh = triangulate(shape, PICTURE_SAG * float(np.linalg.norm(np.ptp(mesh.vertices, axis=0))), angle=0.2).mesh
    ground = Part(mesh, CLAY[0])
    draw(
        path, [View("from the south", (ground,), (0.3, -1.4, 0.9)), View("raking light", (ground,), (-1.6, -0.4, 0.35))]
    )

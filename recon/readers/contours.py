"""Contour lines from files: GeoJSON, DXF, CSV with one point a row, and what pyogrio reads (Shapefile, GeoPackage).

GeoJSON  LineString and MultiLineString, the height in a property (ELEV, elevation, height, z ...) or in the coordinates
DXF      polylines with an elevation, and 3D polylines of one height; the unit of its header is checked
SHP, GPKG  as GeoJSON, with the extra `gis`
CSV      columns x, y, z and, where contours of one height follow each other, a column `line` that numbers them
"""

import csv
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.errors import BadGeometry, BadOption, UnreadableFile
from recon.geometry.contour_map import ContourMap
from recon.readers.content import file_text, require_plain_file
from recon.readers.dxf_documents import damaged_dxf_refused, dxf_document

__all__ = ["CONTOUR_ENDINGS", "read_contours"]

Floats = NDArray[np.float64]

CONTOUR_ENDINGS = (".geojson", ".csv", ".dxf", ".shp", ".gpkg")
METRES = {"m": 1.0, "ft": 0.3048, "us-ft": 1200 / 3937}
DXF_UNITS = {1: "inches", 2: "ft", 4: "millimetres", 5: "centimetres", 6: "m", 7: "kilometres", 21: "us-ft"}
HEIGHT_NAMES = ("elev", "elevation", "height", "z", "ele", "level", "contour", "hoehe", "alt", "altitude")


def read_contours(path: str | Path, *, attribute: str | None = None, unit: str | None = None) -> ContourMap:
    """Contour map of a file, in the file's own plane coordinates, which have to be metres.

    attribute  name of the property that holds the height; None: a usual name, else the third coordinate
    unit       m, ft or us-ft: what coordinates and heights are in, if not metres; the map comes in metres
    Raises     UnreadableFile, UnsupportedFormat, BadGeometry naming the first contour that cannot be used, BadOption.
    """
    if unit is not None and unit not in METRES:
        raise BadOption("--unit", f"must be one of {', '.join(METRES)}, not {unit!r}")
    file = require_plain_file(path, CONTOUR_ENDINGS)
    name, ending = str(path), file.suffix.lower()
    told = unit
    if ending == ".dxf":
        lines, heights, crs, told = _dxf(file, unit)
    elif ending in (".shp", ".gpkg"):
        lines, heights, crs = _by_pyogrio(file, attribute)
    elif ending == ".csv":
        lines, heights, crs = _csv(file_text(path, CONTOUR_ENDINGS), name)
    else:
        lines, heights, crs = _geojson(file_text(path, CONTOUR_ENDINGS), name, attribute)
    if not lines:
        raise UnreadableFile(name, "holds no contour lines")
    _refuse_degrees(lines, crs, name)
    metres = METRES[told or "m"]
    return ContourMap([metres * line for line in lines], metres * np.array(heights), crs=crs)


def _dxf(path: Path, unit: str | None) -> tuple[list[Floats], list[float], str, str]:
    """Polylines of a drawing and the unit they are in: the one given, or the header's where that is a map's."""
    with damaged_dxf_refused(str(path)):
        return _dxf_lines(dxf_document(str(path)), path, unit)


def _dxf_lines(drawing: Any, path: Path, unit: str | None) -> tuple[list[Floats], list[float], str, str]:
    header = DXF_UNITS.get(int(drawing.header.get("$INSUNITS", 0)), "m")
    if unit is None and header not in METRES:
        raise UnreadableFile(
            str(path), f"says that it is drawn in {header}", "Say --unit m if its numbers are metres, as maps often are"
        )
    lines, heights = [], []
    for number, entity in enumerate(drawing.modelspace().query("LWPOLYLINE POLYLINE LINE")):
        points = _dxf_points(entity)
        if len(points) < 2:
            raise BadGeometry(f"contour {number}", "has one vertex only")
        if np.ptp(points[:, 2]) > 1e-6:
            raise BadGeometry(f"contour {number}", f"changes its height along the line, near {_at(points[0])}")
        lines.append(points[:, :2])
        heights.append(float(points[0, 2]))
    return lines, heights, "", unit or header


def _dxf_points(entity: Any) -> Floats:
    if entity.dxftype() == "LINE":
        points = [entity.dxf.start, entity.dxf.end]
    elif entity.dxftype() == "LWPOLYLINE":
        points = list(entity.vertices_in_wcs())
    else:
        points = list(entity.points_in_wcs())
    rows = np.array([(p.x, p.y, p.z) for p in points]).reshape(-1, 3)
    is_ring = entity.dxftype() != "LINE" and bool(entity.is_closed)
    if is_ring and len(rows) and (rows[0] != rows[-1]).any():
        rows = np.vstack([rows, rows[:1]])
    return rows


def _at(point: Floats) -> str:
    return f"({point[0]:.1f}, {point[1]:.1f})"


def _by_pyogrio(path: Path, attribute: str | None) -> tuple[list[Floats], list[float], str]:
    """Lines of a Shapefile or GeoPackage, read as the features of a GeoJSON file are."""
    try:
        import pyogrio
        import shapely
    except ImportError as problem:
        raise UnreadableFile(str(path), "needs pyogrio", "Install recon-brep[gis]") from problem
    try:
        facts, _, geometries, columns = pyogrio.raw.read(path)
    except (pyogrio.errors.DataSourceError, pyogrio.errors.DataLayerError, ValueError) as problem:
        raise UnreadableFile(str(path), f"cannot be read ({problem})") from problem
    features = []
    for row, geometry in enumerate(shapely.from_wkb(geometries)):
        properties = {name: _plain(column[row]) for name, column in zip(facts["fields"], columns)}
        features.append(
            {
                "properties": properties,
                "geometry": None if geometry is None else json.loads(shapely.to_geojson(geometry)),
            }
        )
    lines, heights, _ = _geojson(json.dumps({"features": features}), str(path), attribute)
    return lines, heights, str(facts.get("crs") or "")


def _plain(value: Any) -> Any:
    value = value.item() if hasattr(value, "item") else value
    return value if isinstance(value, (int, float, str)) and value == value else None


def _refuse_degrees(lines: list[Floats], crs: str, name: str) -> None:
    points = np.concatenate(lines)
    degrees = re.search(r"CRS84|EPSG:+4326$", crs) is not None
    if degrees or (not crs and (np.abs(points) <= (180.0, 90.0)).all() and np.ptp(points, axis=0).max() < 10.0):
        raise UnreadableFile(name, "has coordinates in degrees", "Project the map to metres first, for example to UTM")


def _geojson(text: str, name: str, attribute: str | None) -> tuple[list[Floats], list[float], str]:
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as problem:
        raise UnreadableFile(name, "is no JSON") from problem
    features = content.get("features") if isinstance(content, dict) else None
    if not isinstance(features, list):
        raise UnreadableFile(name, "is no GeoJSON feature collection")
    lines, heights = [], []
    for number, feature in enumerate(features):
        for row in _parts(feature, number, name):
            line = _points(row, number, name)
            heights.append(_height(feature, line, number, attribute))
            lines.append(line[:, :2])
    crs = content.get("crs") or {}
    label = crs.get("properties", {}).get("name", "") if isinstance(crs, dict) else ""
    return lines, heights, str(label)


def _parts(feature: Any, number: int, name: str) -> Iterator[Any]:
    geometry = feature.get("geometry") if isinstance(feature, dict) else None
    geometry = geometry if isinstance(geometry, dict) else {}
    kind = geometry.get("type")
    if kind not in ("LineString", "MultiLineString"):
        raise UnreadableFile(name, f"feature {number} is a {kind or 'thing without geometry'}, not a line")
    coordinates = geometry.get("coordinates")
    yield from [coordinates] if kind == "LineString" else (coordinates or [])


def _points(row: Any, number: int, name: str) -> Floats:
    try:
        line = np.array(row, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as problem:
        raise UnreadableFile(name, f"feature {number} holds coordinates that are no numbers") from problem
    if line.ndim != 2 or line.shape[1] < 2 or not np.isfinite(line).all():
        raise UnreadableFile(name, f"feature {number} holds no row of points")
    if len(line) < 2:
        raise BadGeometry(f"contour {number}", f"has one vertex only, near ({line[0, 0]:.1f}, {line[0, 1]:.1f})")
    return line


def _height(feature: Any, line: Floats, number: int, attribute: str | None) -> float:
    properties = feature.get("properties") or {}
    value: Any
    if attribute is not None:
        value = properties.get(attribute)
        if value is None:
            raise BadOption(
                "--attribute", f"contour {number} has no property {attribute!r}; it has {sorted(properties)}"
            )
    else:
        value = next((v for k, v in properties.items() if k.lower() in HEIGHT_NAMES and v is not None), None)
    if value is None and line.shape[1] > 2:
        if np.ptp(line[:, 2]) > 1e-6:
            raise BadGeometry(f"contour {number}", "changes its height along the line")
        return float(line[0, 2])
    try:
        height = float(value)
    except (TypeError, ValueError, OverflowError):
        height = np.nan
    if not np.isfinite(height):
        raise BadGeometry(f"contour {number}", f"has no height, near ({line[0, 0]:.1f}, {line[0, 1]:.1f})")
    return height


def _csv(text: str, name: str) -> tuple[list[Floats], list[float], str]:
    rows = list(csv.DictReader(text.splitlines()))
    names = {key.strip().lower(): key for key in (rows[0] if rows else {}) if key is not None}
    missing = {"x", "y", "z"} - set(names)
    if missing:
        raise UnreadableFile(name, f"has no column {min(missing)}", "The first row names the columns x, y, z and line")
    try:
        points = np.array([[float(row[names[c]]) for c in "xyz"] for row in rows])
    except (TypeError, ValueError, OverflowError) as problem:
        raise UnreadableFile(name, f"holds a word where a number belongs ({problem})") from problem
    if not np.isfinite(points).all():
        raise UnreadableFile(name, "holds a value that is not a finite number")
    keys = [row[names["line"]] for row in rows] if "line" in names else points[:, 2].tolist()
    breaks = [i for i in range(1, len(keys)) if keys[i] != keys[i - 1]]
    pieces = np.split(points, breaks)
    for number, piece in enumerate(pieces):
        if len(piece) < 2 or np.ptp(piece[:, 2]) > 0:
            fault = "has one vertex only" if len(piece) < 2 else "changes its height along the line"
            raise BadGeometry(f"contour {number}", f"{fault}, near ({piece[0, 0]:.1f}, {piece[0, 1]:.1f})")
    return [piece[:, :2] for piece in pieces], [float(piece[0, 2]) for piece in pieces], ""

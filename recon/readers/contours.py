"""Contour lines from files: GeoJSON, and CSV with one point a row.

GeoJSON  LineString and MultiLineString, the height in a property (ELEV, elevation, height, z ...) or in the coordinates
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
from recon.readers.content import file_text

__all__ = ["CONTOUR_ENDINGS", "read_contours"]

Floats = NDArray[np.float64]

CONTOUR_ENDINGS = (".geojson", ".csv")
HEIGHT_NAMES = ("elev", "elevation", "height", "z", "ele", "level", "contour", "hoehe", "alt", "altitude")


def read_contours(path: str | Path, *, attribute: str | None = None) -> ContourMap:
    """Contour map of a file, in the file's own plane coordinates, which have to be metres.

    attribute  name of the property that holds the height; None: a usual name, else the third coordinate
    Raises     UnreadableFile, UnsupportedFormat, BadGeometry naming the first contour that cannot be used, BadOption.
    """
    text = file_text(path, CONTOUR_ENDINGS)
    is_csv = Path(path).suffix.lower() == ".csv"
    lines, heights, crs = _csv(text, str(path)) if is_csv else _geojson(text, str(path), attribute)
    if not lines:
        raise UnreadableFile(str(path), "holds no contour lines")
    _refuse_degrees(lines, crs, str(path))
    return ContourMap(lines, heights, crs=crs)


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
    except (TypeError, ValueError) as problem:
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
    except (TypeError, ValueError):
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
    except (TypeError, ValueError) as problem:
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

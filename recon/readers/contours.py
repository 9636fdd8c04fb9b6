"""Contour lines from files: GeoJSON, DXF, CSV with one point a row, and what pyogrio reads (Shapefile, GeoPackage).

GeoJSON  LineString and MultiLineString, the height in a property (ELEV, elevation, height, z ...) or in the coordinates
DXF      polylines with an elevation, 3D polylines of one height, arcs and splines as chords; the unit of its header is
         checked
SHP, GPKG  as GeoJSON, with the extra `gis`
CSV      columns x, y, z and, where contours of one height follow each other, a column `line` that numbers them

Points are spot heights: Point and MultiPoint, POINT entities, in CSV rows whose `line` is empty. Lines whose height
changes along them are break lines, where those are asked for: the heights at their vertices count as spot heights.
"""

import csv
import json
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.errors import BadGeometry, BadOption, UnreadableFile
from recon.geometry.contour_map import ContourMap
from recon.readers.content import file_text, require_plain_file
from recon.readers.dxf_documents import damaged_dxf_refused, dxf_document
from recon.readers.projection import IN_DEGREES, in_utm, is_in_degrees, metres_of

__all__ = ["CONTOUR_ENDINGS", "read_contours"]

Floats = NDArray[np.float64]

PARTLY_READ = "parsed incompletely"  # said of a field's value, which then counts as 0 or as its first digits
CONTOUR_ENDINGS = (".geojson", ".csv", ".dxf", ".shp", ".gpkg")
METRES = {"m": 1.0, "ft": 0.3048, "us-ft": 1200 / 3937}
DXF_UNITS = {1: "inches", 2: "ft", 4: "millimetres", 5: "centimetres", 6: "m", 7: "kilometres", 21: "us-ft"}
LINE, POINT = "LineString", "Point"
DXF_LINES, DXF_CURVES = ("LWPOLYLINE", "POLYLINE", "LINE"), ("SPLINE", "ARC", "CIRCLE", "ELLIPSE")
SAGITTA = 0.01, 1e-6  # by which chords may lie off a curve, in the drawing's unit and of the curve's size
LEVEL = 1e-6  # by which the heights of one contour may differ, as decimals are rounded
HEIGHT_NAMES = ("elev", "elevation", "height", "z", "ele", "level", "contour", "hoehe", "alt", "altitude")


@dataclass(frozen=True)
class _MapRows:
    """What a file holds, in its own unit: contours with a height each, and rows x, y, z of spot heights."""

    break_lines: bool
    lines: list[Floats] = field(default_factory=list)
    heights: list[float] = field(default_factory=list)
    spots: list[Floats] = field(default_factory=list)

    def add_line(self, line: Floats, height: float) -> None:
        self.lines.append(line)
        self.heights.append(height)

    def add_sloping(self, line: Floats, number: int) -> None:
        """A line (n, 3) whose height changes along it."""
        if not self.break_lines:
            fault = f"changes its height along the line, near {_at(line[0])}; --break-lines takes it for a break line"
            raise BadGeometry(f"contour {number}", fault)
        self.spots.append(line)

    def all_spots(self) -> Floats:
        """(s, 3), each place once."""
        spots = np.concatenate([np.empty((0, 3)), *self.spots])
        return spots[np.sort(np.unique(spots[:, :2], axis=0, return_index=True)[1])]


def read_contours(
    path: str | Path,
    *,
    attribute: str | None = None,
    unit: str | None = None,
    break_lines: bool = False,
    project: bool = False,
) -> ContourMap:
    """Contour map of a file, in the file's own plane coordinates, which have to be metres.

    attribute    name of the property that holds the height; None: a usual name, else the third coordinate
    unit         m, ft or us-ft: what coordinates and heights are in, if not metres; the map comes in metres
    break_lines  take lines whose height changes along them for rows of spot heights, where they are refused else
    project      bring maps in degrees to the metres of their UTM zone, where they are refused else
    Raises     UnreadableFile, UnsupportedFormat, BadGeometry naming the first contour that cannot be used, BadOption.
    """
    if unit is not None and unit not in METRES:
        raise BadOption("--unit", f"must be one of {', '.join(METRES)}, not {unit!r}")
    file = require_plain_file(path, CONTOUR_ENDINGS)
    name, ending, rows = str(path), file.suffix.lower(), _MapRows(break_lines)
    crs, told = "", unit
    if ending == ".dxf":
        told = _dxf(rows, file, unit)
    elif ending in (".shp", ".gpkg"):
        crs = _by_pyogrio(rows, file, attribute)
    elif ending == ".csv":
        _csv(rows, file_text(path, CONTOUR_ENDINGS), name)
    else:
        crs = _geojson(rows, file_text(path, CONTOUR_ENDINGS), name, attribute)
    if not rows.lines:
        raise UnreadableFile(name, "holds no contour lines")
    if unit is None and abs(metres_of(crs) - 1.0) > 1e-9:
        instead = "Say --unit ft or us-ft where its heights are in feet too, or project it to metres first"
        raise UnreadableFile(name, f"has coordinates in units of {metres_of(crs):.6g} m", instead)
    metres = METRES[told or "m"]
    lines, heights, spots = rows.lines, metres * np.array(rows.heights), rows.all_spots()
    if not _in_degrees(lines, crs):
        return ContourMap([metres * line for line in lines], heights, crs=crs, spots=metres * spots)
    if not project:
        raise UnreadableFile(name, "has coordinates in degrees", IN_DEGREES)
    places, zone = in_utm(np.concatenate([*lines, spots[:, :2]]), name, crs)
    *lines, places = np.split(places, np.cumsum([len(line) for line in lines]))
    return ContourMap(lines, heights, crs=zone, spots=np.column_stack([places, metres * spots[:, 2]]))


def _dxf(rows: _MapRows, path: Path, unit: str | None) -> str:
    """Fill in what a drawing holds; the unit it is in: the one given, or the header's where that is a map's."""
    with damaged_dxf_refused(str(path)):
        return _dxf_lines(rows, dxf_document(str(path)), path, unit)


def _dxf_lines(rows: _MapRows, drawing: Any, path: Path, unit: str | None) -> str:
    header = DXF_UNITS.get(int(drawing.header.get("$INSUNITS", 0)), "m")
    if unit is None and header not in METRES:
        raise UnreadableFile(
            str(path), f"says that it is drawn in {header}", "Say --unit m if its numbers are metres, as maps often are"
        )
    space = drawing.modelspace()
    for number, entity in enumerate(space.query(" ".join(DXF_LINES + DXF_CURVES))):
        points = _dxf_points(entity)
        if len(points) < 2:
            raise BadGeometry(f"contour {number}", "has one vertex only")
        if np.ptp(points[:, 2]) > LEVEL:
            rows.add_sloping(points, number)
        else:
            rows.add_line(points[:, :2], float(points[0, 2]))
    rows.spots.extend(np.array([[*entity.dxf.location]], dtype=np.float64) for entity in space.query("POINT"))
    return unit or header


def _dxf_points(entity: Any) -> Floats:
    """(n, 3) vertices of a line, or ends of a curve's chords; of a closed one the first comes again as the last."""
    kind = entity.dxftype()
    if kind in DXF_CURVES or getattr(entity, "has_arc", False):
        return _dxf_chords(entity)
    if kind == "LINE":
        points = [entity.dxf.start, entity.dxf.end]
    elif kind == "LWPOLYLINE":
        points = list(entity.vertices_in_wcs())
    else:  # the frame that a smoothed polyline was drawn by stands among its vertices
        frame = [bool(vertex.dxf.flags & vertex.SPLINE_FRAME_CONTROL_POINT) for vertex in entity.vertices]
        points = [point for point, is_frame in zip(entity.points_in_wcs(), frame) if not is_frame]
    rows = np.array([(p.x, p.y, p.z) for p in points]).reshape(-1, 3)
    is_ring = kind != "LINE" and bool(entity.is_closed)
    if is_ring and len(rows) and (rows[0] != rows[-1]).any():
        rows = np.vstack([rows, rows[:1]])
    return rows


def _dxf_chords(entity: Any) -> Floats:
    from ezdxf.path import make_path

    path = make_path(entity, segments=16)  # parts of an arc, each a cubic that lies off it by little
    corners = np.array([(p.x, p.y, p.z) for p in path.control_vertices()]).reshape(-1, 3)
    length, share = SAGITTA
    size = float(np.ptp(corners, axis=0).max()) if len(corners) else 0.0
    rows = np.array([(p.x, p.y, p.z) for p in path.flattening(max(length, share * size))]).reshape(-1, 3)
    if path.is_closed and len(rows):
        rows[-1] = rows[0]
    return rows


def _at(point: Floats) -> str:
    return f"({point[0]:.1f}, {point[1]:.1f})"


def _by_pyogrio(rows: _MapRows, path: Path, attribute: str | None) -> str:
    """Fill in what a Shapefile or GeoPackage holds, read as the features of a GeoJSON file are; its CRS."""
    try:
        import pyogrio
        import shapely
    except ImportError as problem:
        raise UnreadableFile(str(path), "needs pyogrio", "Install recon-brep[gis]") from problem
    try:
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            facts, _, geometries, columns = pyogrio.raw.read(path)
    except (pyogrio.errors.DataSourceError, pyogrio.errors.DataLayerError, ValueError, UnboundLocalError) as problem:
        # the last where a Shapefile's .prj holds no coordinate system
        raise UnreadableFile(str(path), f"cannot be read ({problem})") from problem
    _require_numbers(told, path)
    features = []
    for row, geometry in enumerate(shapely.from_wkb(geometries)):
        properties = {name: _plain(column[row]) for name, column in zip(facts["fields"], columns)}
        features.append(
            {
                "properties": properties,
                "geometry": None if geometry is None else json.loads(shapely.to_geojson(geometry)),
            }
        )
    _geojson(rows, json.dumps({"features": features}), str(path), attribute)
    return str(facts.get("crs") or "")


def _require_numbers(told: Sequence[warnings.WarningMessage], path: Path) -> None:
    """Refuse a file of which a value was read in part only; what else the library warns of goes on to the user."""
    for warning in told:
        said = str(warning.message).splitlines()[0]
        if PARTLY_READ in said:
            raise UnreadableFile(str(path), f"holds a value that is no number ({said})", "Copy the file again")
        warnings.warn(warning.message, stacklevel=2)


def _plain(value: Any) -> Any:
    value = value.item() if hasattr(value, "item") else value
    return value if isinstance(value, (int, float, str)) and value == value else None


def _in_degrees(lines: list[Floats], crs: str) -> bool:
    if crs:
        return is_in_degrees(crs)
    points = np.concatenate(lines)
    return bool((np.abs(points) <= (180.0, 90.0)).all() and np.ptp(points, axis=0).max() < 10.0)


def _geojson(rows: _MapRows, text: str, name: str, attribute: str | None) -> str:
    """Fill in what a feature collection holds; its CRS."""
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as problem:
        raise UnreadableFile(name, "is no JSON") from problem
    features = content.get("features") if isinstance(content, dict) else None
    if not isinstance(features, list):
        raise UnreadableFile(name, "is no GeoJSON feature collection")
    for number, feature in enumerate(features):
        kind, parts = _parts(feature, number, name)
        for row in parts:
            points = _points(row, number, name)
            if kind == POINT:
                rows.spots.append(
                    np.column_stack([points[:, :2], _height(feature, points, f"spot {number}", attribute)])
                )
            elif len(points) < 2:
                raise BadGeometry(f"contour {number}", f"has one vertex only, near {_at(points[0])}")
            elif _slopes(feature, points, attribute):
                rows.add_sloping(points[:, :3], number)
            else:
                rows.add_line(points[:, :2], _height(feature, points, f"contour {number}", attribute))
    crs = content.get("crs") or {}
    return str(crs.get("properties", {}).get("name", "") if isinstance(crs, dict) else "")


def _parts(feature: Any, number: int, name: str) -> tuple[str, list[Any]]:
    """Whether a feature is of lines or of points, and the coordinates of its parts."""
    geometry = feature.get("geometry") if isinstance(feature, dict) else None
    geometry = geometry if isinstance(geometry, dict) else {}
    kind, coordinates = geometry.get("type"), geometry.get("coordinates")
    if kind not in (LINE, POINT, "Multi" + LINE, "Multi" + POINT):
        raise UnreadableFile(name, f"feature {number} is a {kind or 'thing without geometry'}, not a line or a point")
    if kind == POINT:
        return POINT, [[coordinates]]
    if kind == "Multi" + POINT:
        return POINT, [[place] for place in coordinates or []]
    return LINE, [coordinates] if kind == LINE else list(coordinates or [])


def _points(row: Any, number: int, name: str) -> Floats:
    try:
        line = np.array(row, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as problem:
        raise UnreadableFile(name, f"feature {number} holds coordinates that are no numbers") from problem
    if line.ndim != 2 or line.shape[1] < 2 or not np.isfinite(line).all():
        raise UnreadableFile(name, f"feature {number} holds no row of points")
    return line


def _told_height(feature: Any, attribute: str | None) -> Any:
    """The property that holds the height, of whatever type; None where there is none."""
    properties = feature.get("properties") or {}
    if attribute is not None:
        return properties.get(attribute)
    return next((v for k, v in properties.items() if k.lower() in HEIGHT_NAMES and v is not None), None)


def _slopes(feature: Any, points: Floats, attribute: str | None) -> bool:
    """Whether the height of a line is told by its vertices alone, and changes along it."""
    if points.shape[1] < 3 or attribute is not None or _told_height(feature, attribute) is not None:
        return False
    return bool(np.ptp(points[:, 2]) > LEVEL)


def _height(feature: Any, points: Floats, what: str, attribute: str | None) -> float:
    value = _told_height(feature, attribute)
    if value is None and attribute is not None:
        properties = sorted(feature.get("properties") or {})
        raise BadOption("--attribute", f"{what} has no property {attribute!r}; it has {properties}")
    if value is None and points.shape[1] > 2:
        return float(points[0, 2])
    try:
        height = float(value)
    except (TypeError, ValueError, OverflowError):
        height = np.nan
    if not np.isfinite(height):
        raise BadGeometry(what, f"has no height, near {_at(points[0])}")
    return height


def _csv(rows: _MapRows, text: str, name: str) -> None:
    table = list(csv.DictReader(text.splitlines()))
    names = {key.strip().lower(): key for key in (table[0] if table else {}) if key is not None}
    missing = {"x", "y", "z"} - set(names)
    if missing:
        raise UnreadableFile(name, f"has no column {min(missing)}", "The first row names the columns x, y, z and line")
    try:
        points = np.array([[float(row[names[c]]) for c in "xyz"] for row in table])
    except (TypeError, ValueError, OverflowError) as problem:
        raise UnreadableFile(name, f"holds a word where a number belongs ({problem})") from problem
    if not np.isfinite(points).all():
        raise UnreadableFile(name, "holds a value that is not a finite number")
    keys = [row[names["line"]] for row in table] if "line" in names else points[:, 2].tolist()
    breaks = [i for i in range(1, len(keys)) if keys[i] != keys[i - 1]]
    for number, (key, piece) in enumerate(zip([keys[i] for i in [0, *breaks]], np.split(points, breaks))):
        if "line" in names and not (key or "").strip():
            rows.spots.append(piece)
        elif len(piece) < 2:
            raise BadGeometry(f"contour {number}", f"has one vertex only, near {_at(piece[0])}")
        elif np.ptp(piece[:, 2]) > 0:
            rows.add_sloping(piece, number)
        else:
            rows.add_line(piece[:, :2], float(piece[0, 2]))

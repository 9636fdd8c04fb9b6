"""Height grids from files: ESRI ASCII (.asc), JSON rows (.json); GeoTIFF (.tif) and SRTM tiles (.hgt), extra `gis`.

JSON  {"width": nx, "height": ny, "values": [...]} row by row, north to south; "cell" metres between neighbours, else 10
"""

import json
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.errors import ReconError, UnreadableFile
from recon.geometry.contour_map import HeightGrid
from recon.geometry.height_source import HeightSource
from recon.readers.ascii_rows import AsciiRows
from recon.readers.content import file_bytes, file_text, require_plain_file
from recon.readers.projection import IN_DEGREES, in_utm_grid, metres_of, require_rasterio

__all__ = ["GRID_ENDINGS", "open_height_grid", "read_height_grid"]

Floats = NDArray[np.float64]

GRID_ENDINGS = (".asc", ".json", ".tif", ".tiff", ".hgt")
CELL = 10.0
FEET = re.compile(r"\b(foot|feet|ft)\b", re.IGNORECASE)
LONG = 2**26  # bytes of a text file that is read by windows: a map of some ten million heights


def read_height_grid(path: str | Path, *, project: bool = False) -> HeightGrid:
    """Height grid of a file; heights count at the middle of cells.

    project  bring grids in degrees to the metres of their UTM zone, where they are refused else
    Raises   UnreadableFile, UnsupportedFormat, BadGeometry.
    """
    file = require_plain_file(path, GRID_ENDINGS)
    with _told_of(file):
        if file.suffix.lower() in (".asc", ".json"):
            return _ascii(file) if file.suffix.lower() == ".asc" else _json(file)
        return _raster(file, project=project)


def open_height_grid(path: str | Path, *, project: bool = False) -> HeightSource:
    """The same grid, read window by window; a short text file, JSON, and one that is brought from degrees, as a whole
    all the same.

    Raises   as `read_height_grid`, for a faulty part once that is read; UnreadableFile for a long text file whose rows
             are not one a line.
    """
    file = require_plain_file(path, GRID_ENDINGS)
    if file.suffix.lower() == ".asc" and file.stat().st_size > LONG:
        with _told_of(file):
            rows = AsciiRows(file)
            return HeightSource(*_ascii_axes(rows.header), "", _TextWindows(file, rows))
    if file.suffix.lower() in (".asc", ".json"):
        return HeightSource.of(read_height_grid(file))
    rasterio = require_rasterio(str(path))
    with _told_of(file), rasterio.open(file) as source:
        if source.crs is None or not source.crs.is_geographic:
            _require_metres(file, source)
            x, y = _axes(file, source.transform, source.shape)
            return HeightSource(x, y, "" if source.crs is None else source.crs.to_string(), _Windows(file, len(y)))
    return HeightSource.of(read_height_grid(file, project=project))


@dataclass(frozen=True, eq=False)
class _TextWindows:
    """Reads windows of a long text file, which lies with the north up."""

    path: Path
    text: AsciiRows

    def __call__(self, rows: slice, columns: slice) -> Floats:
        n_rows = int(self.text.header["nrows"])
        first, stop, _ = rows.indices(n_rows)
        with _told_of(self.path):
            values = self.text.rows(n_rows - stop, n_rows - first)[::-1, columns]
        return _known(values, self.text.header)


@dataclass(frozen=True)
class _Windows:
    """Reads windows of a raster, which lies with the north up."""

    path: Path
    n_rows: int

    def __call__(self, rows: slice, columns: slice) -> Floats:
        rasterio = require_rasterio(str(self.path))
        first, stop, _ = rows.indices(self.n_rows)
        with _told_of(self.path), rasterio.open(self.path) as source:
            left, right, _ = columns.indices(source.width)
            window = rasterio.windows.Window(left, self.n_rows - stop, right - left, stop - first)
            return np.asarray(_band(source, window)[::-1])


@contextmanager
def _told_of(path: Path) -> Iterator[None]:
    """What goes wrong in reading, said of the file."""
    try:
        yield
    except ReconError:
        raise
    except (OSError, ValueError, KeyError, TypeError, IndexError, OverflowError, RecursionError) as problem:
        raise UnreadableFile(str(path), f"is no height grid ({problem})") from problem


def _json(path: Path) -> HeightGrid:
    content = json.loads(file_bytes(path))
    values = np.array(content["values"], dtype=np.float64).reshape(content["height"], content["width"])
    cell = float(content.get("cell", CELL))
    x, y = (cell * np.arange(n, dtype=np.float64) for n in values.shape[::-1])
    return HeightGrid(x, y, values[::-1])


def _ascii(path: Path) -> HeightGrid:
    words = file_text(path).split()
    header: dict[str, float] = {}
    start = 0
    while words[start][0].isalpha():
        header[words[start].lower()] = float(words[start + 1])
        start += 2
    nx, ny = int(header["ncols"]), int(header["nrows"])
    values = np.array(words[start:], dtype=np.float64).reshape(ny, nx)[::-1]
    return HeightGrid(*_ascii_axes(header), _known(values, header))


def _known(values: Floats, header: Mapping[str, float]) -> Floats:
    """Heights with NaN where none was measured."""
    return np.where(values == header.get("nodata_value", np.nan), np.nan, values)


def _ascii_axes(header: Mapping[str, float]) -> tuple[Floats, Floats]:
    """Coordinates of columns and rows."""
    nx, ny, cell = int(header["ncols"]), int(header["nrows"]), header["cellsize"]
    x0 = header["xllcenter"] if "xllcenter" in header else header["xllcorner"] + cell / 2
    y0 = header["yllcenter"] if "yllcenter" in header else header["yllcorner"] + cell / 2
    x, y = (np.array([first + cell * k for k in range(n)]) for first, n in ((x0, nx), (y0, ny)))
    return x, y


def _raster(path: Path, *, project: bool) -> HeightGrid:
    rasterio = require_rasterio(str(path))
    try:
        with rasterio.open(path) as source:
            _require_metres(path, source)
            band, way, crs = _band(source), source.transform, source.crs
    except rasterio.errors.RasterioError as problem:
        raise UnreadableFile(str(path), f"is no grid that rasterio reads ({problem})") from problem
    _axes(path, way, band.shape)
    label = "" if crs is None else crs.to_string()
    if crs is not None and crs.is_geographic:
        if not project:
            raise UnreadableFile(str(path), "has coordinates in degrees", IN_DEGREES)
        band, way, label = in_utm_grid(band, way, crs, str(path))
    return HeightGrid(*_axes(path, way, band.shape), band[::-1], label)


def _band(source: Any, window: Any = None) -> Floats:
    """Heights of a raster or a window of it, from the north, as its scale tells them; NaN where none was measured."""
    stored = source.read(1, window=window, masked=True).astype(np.float64).filled(np.nan)
    return np.asarray(source.scales[0] * stored + source.offsets[0])


def _require_metres(path: Path, source: Any) -> None:
    """Raises UnreadableFile for a raster that says it is in feet, or in kilometres; degrees are others' concern."""
    metres = 1.0 if source.crs is None else metres_of(source.crs)
    if abs(metres - 1.0) > 1e-9:
        unit = f"has coordinates in units of {metres:.6g} m"
        raise UnreadableFile(str(path), unit, "Project it to metres first, its heights too")
    of_heights = source.units[0] or ""
    if FEET.search(of_heights):
        raise UnreadableFile(str(path), f"has heights in {of_heights}", "Bring them to metres first")


def _axes(path: Path, way: Any, shape: tuple[int, int]) -> tuple[Floats, Floats]:
    """Coordinates of the columns and rows of a raster from its transform."""
    if way.b or way.d or way.e >= 0:
        raise UnreadableFile(str(path), "is turned or stands on its head", "Resample it to a grid with north up")
    ny, nx = shape
    return way.c + way.a * (np.arange(nx) + 0.5), way.f + way.e * (np.arange(ny)[::-1] + 0.5)

"""From degrees to metres: the UTM zone of a map's middle, by rasterio; and which of the two a coordinate system has."""

import re
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from recon.errors import UnreadableFile

if TYPE_CHECKING:
    from rasterio.crs import CRS

__all__ = ["IN_DEGREES", "in_utm", "in_utm_grid", "is_in_degrees", "metres_of", "require_rasterio"]

Floats = NDArray[np.float64]

IN_DEGREES = "Let --project bring it to the metres of its UTM zone, or project it first"
WGS84 = "EPSG:4326"
DEGREES = re.compile(r"CRS84|EPSG:+4326$|^\s*GEOG(CS|CRS)\[")  # what is known without rasterio
SYSTEM = re.compile(
    r"(EPSG|ESRI|OGC|urn:ogc:def:crs):|\s*[A-Z_]+\["
)  # anything else may be a file or an address to GDAL
NORTHERN, SOUTHERN, ZONE = 32600, 32700, 6.0  # EPSG numbers before the first zone, and degrees of a zone
MOST_DEGREES = 8.0  # of longitude: beyond, one zone bends lengths by more than a thousandth


def require_rasterio(name: str) -> Any:
    """The package; raises UnreadableFile where it is not installed."""
    try:
        import rasterio
    except ImportError as problem:
        raise UnreadableFile(name, "needs rasterio", "Install recon-brep[gis]") from problem
    return rasterio


def is_in_degrees(crs: str) -> bool:
    """Whether a coordinate system, by its name or as text, is one of longitudes and latitudes."""
    known = _known(crs)
    return bool(DEGREES.search(crs)) if known is None else bool(known.is_geographic)


def metres_of(crs: "str | CRS") -> float:
    """Metres of one unit of a coordinate system; 1 where it has no such unit, or nothing is known of it."""
    known = _known(crs) if isinstance(crs, str) else crs
    return float(known.linear_units_factor[1]) if known is not None and known.is_projected else 1.0


def _known(crs: str) -> "CRS | None":
    """What rasterio knows of a coordinate system, if it is there."""
    try:
        from rasterio.crs import CRS
        from rasterio.errors import CRSError
    except ImportError:
        return None
    try:
        return CRS.from_user_input(crs) if SYSTEM.match(crs) else None
    except (CRSError, ValueError):
        return None


def in_utm(points: Floats, name: str, crs: str = "") -> tuple[Floats, str]:
    """(n, 2) longitudes and latitudes, of WGS 84 where no system is named, in metres, and the name of their system.

    Raises  UnreadableFile when they span more than a zone can hold, or are none.
    """
    require_rasterio(name)
    from rasterio.warp import transform

    zone = _zone(points.min(axis=0), points.max(axis=0), name)
    x, y = transform(crs or WGS84, zone, points[:, 0], points[:, 1])
    return np.column_stack([x, y]), zone


def in_utm_grid(heights: Floats, way: Any, crs: "CRS", name: str) -> tuple[Floats, Any, str]:
    """A grid north up in degrees (ny, nx), NaN where nothing is known, as one in metres; its transform and system."""
    require_rasterio(name)
    from rasterio.warp import Resampling, calculate_default_transform, reproject

    ny, nx = heights.shape
    west, north = way.c, way.f
    corners = np.array([[west, north + ny * way.e], [west + nx * way.a, north]])
    zone = _zone(corners[0], corners[1], name)
    to, width, height = calculate_default_transform(crs, zone, nx, ny, *corners.ravel())
    made = np.full((height, width), np.nan)
    reproject(
        heights, made, src_transform=way, src_crs=crs, src_nodata=np.nan, dst_transform=to, dst_crs=zone,
        dst_nodata=np.nan, resampling=Resampling.cubic,
    )  # fmt: skip
    return made, to, zone


def _zone(low: Floats, high: Floats, name: str) -> str:
    (west, south), (east, north) = low, high
    if not (-180.0 <= west <= east <= 180.0 and -80.0 <= south <= north <= 84.0):
        raise UnreadableFile(name, "lies outside the UTM zones", "Project it to metres first")
    if east - west > MOST_DEGREES:
        raise UnreadableFile(name, f"spans {east - west:.1f} degrees, too much for one UTM zone", "Give a part of it")
    number = 1 + int((0.5 * (west + east) + 180.0) // ZONE) % 60
    return f"EPSG:{(NORTHERN if south + north >= 0.0 else SOUTHERN) + number}"

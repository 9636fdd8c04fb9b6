"""A polygon on a map from GeoJSON: of the first feature, or alone."""

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.errors import UnreadableFile
from recon.readers.content import file_text

__all__ = ["POLYGON_ENDINGS", "read_polygon"]

POLYGON_ENDINGS = (".geojson", ".json")


def read_polygon(path: str | Path) -> NDArray[np.float64]:
    """(n, 2) the outer ring of the polygon in a file, its first point repeated at the end.

    Raises  UnreadableFile when there is none, or it has holes; UnsupportedFormat.
    """
    name = str(path)
    try:
        rings = _rings(json.loads(file_text(path, POLYGON_ENDINGS)), name)
        ring = np.array([place[:2] for place in rings[0]], dtype=np.float64)
    except (ValueError, TypeError, IndexError, KeyError, AttributeError, RecursionError) as problem:
        raise UnreadableFile(name, "holds no polygon") from problem
    if len(rings) > 1:
        raise UnreadableFile(name, "its polygon has holes", "Give the outer ring alone")
    if ring.ndim != 2 or len(ring) < 4 or not np.isfinite(ring).all() or (ring[0] != ring[-1]).any():
        raise UnreadableFile(name, "its polygon has no closed ring of three points or more")
    return ring


def _rings(content: Any, name: str) -> list[Any]:
    """The coordinates of a polygon, whether it stands alone, in a feature, or in a collection of one."""
    if content.get("type") == "FeatureCollection":
        if len(content["features"]) != 1:
            raise UnreadableFile(name, f"holds {len(content['features'])} features", "Give one polygon")
        content = content["features"][0]
    geometry = content.get("geometry", content)
    if geometry.get("type") != "Polygon":
        raise UnreadableFile(name, f"holds a {geometry.get('type')}, not a polygon")
    return list(geometry["coordinates"])

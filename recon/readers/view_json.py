"""Three-view drawings as JSON.

{"views": {"front": {"visible": [[u0, v0, u1, v1], ...], "hidden": [...]}, "top": {...}, "side": {...}}}

front (x, z) seen from -y, top (x, y) seen from +z, side (y, z) seen from +x; the views share one origin.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np

from recon.errors import BadGeometry, UnreadableFile
from recon.geometry.views import PROJECTIONS, DrawnView, ThreeViews
from recon.readers.content import file_bytes

__all__ = ["read_json_views"]

SHAPE = '{"views": {"front": {"visible": [[u0, v0, u1, v1], ...], "hidden": [...]}, "top": {...}, "side": {...}}}'
LARGEST = 1e9


def read_json_views(path: str | Path) -> ThreeViews:
    """A drawing from a JSON file.

    Raises  UnreadableFile when the file cannot be read, is no JSON, or lacks a view; BadGeometry when a view is empty.
    """
    name = str(path)
    try:
        content = json.loads(file_bytes(path))
    except (ValueError, RecursionError) as problem:
        raise UnreadableFile(name, "is no JSON", f"Write {SHAPE}") from problem
    views = content.get("views") if isinstance(content, dict) else None
    if not isinstance(views, dict):
        raise UnreadableFile(name, "holds no views", f"Write {SHAPE}")
    return ThreeViews(*(_view(views.get(p.name), f"{name}: {p.name} view") for p in PROJECTIONS))


def _view(value: Any, what: str) -> DrawnView:
    if not isinstance(value, dict):
        raise UnreadableFile(what, "is missing", f"Write {SHAPE}")
    rows: list[list[float]] = []
    hidden: list[bool] = []
    for key in ("visible", "hidden"):
        segments = value.get(key, [])
        if not isinstance(segments, list):
            raise UnreadableFile(what, f"has no list of {key} segments", f"Write {SHAPE}")
        for segment in segments:
            rows.append(_numbers(segment, what))
            hidden.append(key == "hidden")
    return DrawnView(np.array(rows, dtype=np.float64).reshape(-1, 2, 2), np.array(hidden, dtype=bool))


def _numbers(segment: Any, what: str) -> list[float]:
    row = segment if isinstance(segment, list) else []
    numbers = [x for x in row if isinstance(x, int | float) and not isinstance(x, bool)]
    # Compared one by one: JSON knows NaN, infinity, and whole numbers that no float holds.
    if len(row) != 4 or len(numbers) != 4 or not all(-LARGEST < x < LARGEST for x in numbers):
        raise BadGeometry(what, f"a segment is no row of four numbers: {str(segment)[:60]}")
    return [float(x) for x in numbers]

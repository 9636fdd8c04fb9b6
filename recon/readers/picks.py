"""Three points picked by hand, from which the box around a hole is set up.

{"picks": [[x, y, z], [x, y, z], [x, y, z]]}        millimetres, in the pose of the sherds
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.errors import UnreadableFile
from recon.readers.content import file_bytes

__all__ = ["read_picks"]

Floats = NDArray[np.float64]
LARGEST = 1e12
SHAPE = '{"picks": [[x, y, z], [x, y, z], [x, y, z]]}'


def read_picks(path: str | Path) -> Floats:
    """(3, 3) picked points, in millimetres, from a JSON file.

    Raises  UnreadableFile when the file cannot be read, is no JSON or holds anything but three finite points.
    """
    try:
        content = json.loads(file_bytes(path))
    except (ValueError, RecursionError) as problem:
        raise UnreadableFile(str(path), "is no JSON", f"Write {SHAPE}") from problem
    points = _three_points(content.get("picks") if isinstance(content, dict) else None)
    if points is None:
        raise UnreadableFile(str(path), "holds no three points", f"Write {SHAPE}")
    return points


def _three_points(value: Any) -> Floats | None:
    if not isinstance(value, list) or len(value) != 3:
        return None
    rows = [row for row in value if isinstance(row, list) and len(row) == 3]
    numbers = [x for row in rows for x in row if isinstance(x, int | float) and not isinstance(x, bool)]
    # Compared one by one: JSON knows NaN, infinity, and whole numbers that no float holds.
    if len(numbers) != 9 or not all(-LARGEST < x < LARGEST for x in numbers):
        return None
    return np.array(numbers, dtype=np.float64).reshape(3, 3)

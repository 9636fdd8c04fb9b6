"""What the answer lists of a part's surfaces: kind and size, the interval that the grid leaves open, and the rest."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from recon.geometry.analytic import AnalyticSurface, Blend, Cylinder, Plane, Sphere
from recon.geometry.mixed import MixedBoundary

__all__ = ["free_regions", "listed_blends", "listed_surfaces"]

Rows = list[dict[str, Any]]


def listed_surfaces(surfaces: Iterable[AnalyticSurface], intervals: Iterable[tuple[float, float]]) -> Rows:
    """Every surface with its size, and the interval that the grid leaves open."""
    rows: Rows = []
    for surface, (low, high) in zip(surfaces, intervals):
        if isinstance(surface, Plane):
            row = {"kind": "plane", "normal": surface.normal_vector.tolist(), "offset": surface.offset}
            value = surface.offset
        elif isinstance(surface, Cylinder):
            row = {"kind": "cylinder", "axis": surface.axis.tolist(), "point": surface.point.tolist()}
            row["radius"] = value = surface.radius
        elif isinstance(surface, Sphere):
            row = {"kind": "sphere", "centre": surface.centre.tolist(), "radius": surface.radius}
            value = surface.radius
        else:
            row, value = {"kind": "cone"} | {k: np.asarray(v).tolist() for k, v in vars(surface).items()}, 0.0
        rows.append(row | {"interval": [value + low, value + high]})
    return rows


def listed_blends(blends: Iterable[Blend]) -> Rows:
    """Every rounded edge with its radius, and the numbers of its two surfaces."""
    return [{"kind": "blend", "radius": b.radius, "between": [b.first, b.second]} for b in blends]


def free_regions(boundary: MixedBoundary) -> Rows:
    """Every region of triangles: how many, and the box around them."""
    rows, patch = boundary.triangles()
    found: Rows = []
    for number in np.unique(patch).tolist():
        places = boundary.vertices[np.unique(rows[patch == number])]
        box = [places.min(axis=0).tolist(), places.max(axis=0).tolist()]
        found.append({"kind": "triangles", "faces": int((patch == number).sum()), "box": box})
    return found

"""How thick the wall is where the scans show both its sides, though they were meant to show the outer one only.

outer  |      | inner        a point of the outer wall and the nearest point of the inner wall count when each
       |<---->|              lies square behind the other; the median holds against lips and bases
"""

import numpy as np
from numpy.typing import NDArray

from recon.geometry.mesh import TriangleMesh
from recon.hole_patch.assembly import Assembly
from recon.hole_patch.surroundings import ShownThickness
from recon.hole_patch.walls import INNER, OUTER
from recon.numerics.distance import TriangleTree

__all__ = ["shown_thickness"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

MOST_PROBES = 4000
FEWEST = 50  # places, or the answer hangs on a scar
SQUARE = 0.9  # cosine between the outer normal and the way to the inner wall


def shown_thickness(table: Assembly, normals: Floats, labels: Ints, *, limit: float) -> ShownThickness | None:
    """Thickness where outer and inner wall were both scanned; None where too little of the inner one was.

    normals  (F, 3) of the faces; labels (F,) OUTER, INNER or FRACTURE
    limit    in millimetres: what lies farther behind is the other side of the vessel
    """
    outer, inner = np.flatnonzero(labels == OUTER), np.flatnonzero(labels == INNER)
    if not len(outer) or not len(inner):
        return None
    far_side = TriangleMesh(table.vertices, table.faces, "inner wall").part(inner)
    probes = outer[:: max(1, len(outer) // MOST_PROBES)]
    found = TriangleTree(far_side.vertices, far_side.face_vertices).closest(table.centres[probes])
    behind = np.einsum("ij,ij->i", table.centres[probes] - found.points, normals[probes])
    against = np.einsum("ij,ij->i", normals[inner[found.faces]], normals[probes])
    square = (behind > SQUARE * found.distances) & (against < -SQUARE) & (found.distances > 0.0)
    square &= found.distances < limit
    if np.count_nonzero(square) < FEWEST:
        return None
    low, median, high = np.quantile(found.distances[square], [0.25, 0.5, 0.75])
    return ShownThickness(float(median), float(low), float(high), int(np.count_nonzero(square)))

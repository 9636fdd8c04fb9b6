"""A scan seen from one side, as the scanner saw it: the best start for a disc that has such a side.

All triangles show their front there, and neither the border nor a hole overlaps itself.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import OptimizeResult, minimize, nnls
from shapely import Polygon, make_valid

from recon.geometric_fit.rim_places import cross, least_box
from recon.geometric_fit.scan_kind import SheetScan
from recon.numerics.rows import unit_vectors

__all__ = ["OVERLAP", "measured_areas", "overlap", "seen_from_one_side"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

OVERLAP = 1e-6  # share of the rectangle that a border may cover twice, for rounding
LOOKS, FLATTEST = 30, 1e-3  # attempts to find a side from which all is seen, and the least cosine there
MOST_NORMALS = 200  # that are looked at anew in each attempt
WHOLE = 1e3  # weight of the shares of a convex combination adding up to one


def seen_from_one_side(sheet: SheetScan) -> Floats | None:
    """(V, 2) the scan seen from where all its triangles show their front and no border overlaps itself.

    None where no such side is found: from one that shows the front of all triangles the search goes on to where less
    is hidden, as the side from which a scanner saw it is one.
    """
    mesh, area = sheet.mesh, measured_areas(sheet)
    normals = mesh.area_vectors()[area > 0.0] / area[area > 0.0, None]
    toward_all = _side_in_front(normals, area[area > 0.0])
    if toward_all is None:
        return None
    aside, loops = _axes_across(toward_all), (*sheet.rims, *sheet.holes)

    def hidden(turn: Floats) -> float:
        toward = toward_all + turn @ aside
        return overlap(mesh.vertices @ _axes_across(toward).T, loops) if (normals @ toward).min() > 0.0 else 1.0

    def stop(intermediate_result: OptimizeResult) -> None:
        if intermediate_result.fun < OVERLAP:
            raise StopIteration

    turn = np.zeros(2)
    if hidden(turn) >= OVERLAP:
        search = {"initial_simplex": [[0.0, 0.0], [0.1, 0.0], [0.0, 0.1]], "maxfev": 4 * LOOKS}
        found = minimize(hidden, turn, method="Nelder-Mead", callback=stop, options=search)
        if found.fun >= OVERLAP:
            return None
        turn = found.x
    flat = mesh.vertices @ _axes_across(toward_all + turn @ aside).T
    return np.asarray(flat @ least_box(flat[sheet.rims[0]])[1])


def _axes_across(toward: Floats) -> Floats:
    """(2, 3) unit vectors across a direction that make a right-handed frame with it."""
    axes = np.linalg.svd(toward[None])[2][1:]
    return axes if np.linalg.det([*axes, toward]) > 0.0 else axes[::-1]


def _side_in_front(normals: Floats, areas: Floats) -> Floats | None:
    """(3,) unit direction from which all triangles with normals (n, 3) show their front; None without any.

    Their mean is one from which the scan looks largest. Where it does not see all of them, the direction whose least
    cosine is largest is that of the point nearest to the origin in the convex hull of the normals.
    """
    toward = unit_vectors((areas @ normals)[None])[0]
    chosen = np.empty(0, dtype=np.int64)
    for _ in range(LOOKS):
        cosines = normals @ toward
        if cosines.min() >= FLATTEST:
            return toward
        chosen = np.union1d(chosen, np.argsort(cosines)[:MOST_NORMALS])
        rows = np.vstack([normals[chosen].T, np.full(len(chosen), WHOLE)])
        share, _ = nnls(rows, np.array([0.0, 0.0, 0.0, WHOLE]), maxiter=100 * len(chosen))
        nearest = share @ normals[chosen]
        if np.linalg.norm(nearest) < FLATTEST:
            return None
        toward = nearest / np.linalg.norm(nearest)
    return None


def overlap(places: Floats, loops: tuple[Ints, ...]) -> float:
    """Area that closed rows of places cover not once, as a share of what the first covers; they may touch."""
    rows = [places[loop] for loop in loops]
    covered = [0.5 * abs(float(cross(row, np.roll(row, -1, axis=0)).sum())) for row in rows]
    off = sum(abs(make_valid(Polygon(row)).area - area) for row, area in zip(rows, covered))
    return off / max(covered[0], 1e-300)


def measured_areas(sheet: SheetScan) -> Floats:
    """(F,) the area of every face of the scan, zero of those laid over holes."""
    area = np.linalg.norm(sheet.mesh.area_vectors(), axis=1)
    area[sheet.n_faces :] = 0.0
    return area

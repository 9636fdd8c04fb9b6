"""A scan seen from one side, as the scanner saw it: the best start for a disc that has such a side.

All triangles show their front there, and neither the border nor a hole overlaps itself.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import OptimizeResult, linprog, minimize
from shapely import Polygon, make_valid

from recon.geometric_fit.rim_places import cross, least_box
from recon.geometric_fit.scan_kind import SheetScan

__all__ = ["OVERLAP", "measured_areas", "overlap", "seen_from_one_side"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

OVERLAP = 1e-6  # share of the rectangle that a border may cover twice, for rounding
LOOKS, FLATTEST = 30, 1e-3  # attempts to find a side from which all is seen, and the least cosine there


def seen_from_one_side(sheet: SheetScan) -> Floats | None:
    """(V, 2) the scan seen from where all its triangles show their front and no border overlaps itself.

    None where no such side is found: from the one that is steepest on all triangles the search goes on to where less
    is hidden, as the side from which a scanner saw it is one.
    """
    mesh, length = sheet.mesh, measured_areas(sheet)
    normals = 2.0 * mesh.area_vectors()[length > 0.0] / length[length > 0.0, None]
    steepest = _steepest_side(normals)
    if steepest is None:
        return None
    aside, loops = _axes_across(steepest), (*sheet.rims, *sheet.holes)

    def hidden(turn: Floats) -> float:
        toward = steepest + turn @ aside
        return overlap(mesh.vertices @ _axes_across(toward).T, loops) if (normals @ toward).min() > 0.0 else 1.0

    def stop(intermediate_result: OptimizeResult) -> None:
        if intermediate_result.fun < OVERLAP:
            raise StopIteration

    first = np.array([[0.0, 0.0], [0.1, 0.0], [0.0, 0.1]])
    search = {"initial_simplex": first, "maxfev": 4 * LOOKS}
    found = minimize(hidden, first[0], method="Nelder-Mead", callback=stop, options=search)
    if found.fun >= OVERLAP:
        return None
    flat = mesh.vertices @ _axes_across(steepest + found.x @ aside).T
    return np.asarray(flat @ least_box(flat[sheet.rims[0]])[1])


def _axes_across(toward: Floats) -> Floats:
    """(2, 3) unit vectors across a direction that make a right-handed frame with it."""
    axes = np.linalg.svd(toward[None])[2][1:]
    return axes if np.linalg.det([*axes, toward]) > 0.0 else axes[::-1]


def _steepest_side(normals: Floats) -> Floats | None:
    """(3,) unit direction whose least cosine with normals (n, 3) is largest, by a linear program; None without any."""
    toward = normals.mean(axis=0)
    chosen = np.empty(0, dtype=np.int64)
    for _ in range(LOOKS):
        chosen = np.union1d(chosen, np.argsort(normals @ toward)[:200])
        rows = np.column_stack([-normals[chosen], np.ones(len(chosen))])
        best = linprog([0.0, 0.0, 0.0, -1.0], A_ub=rows, b_ub=np.zeros(len(rows)), bounds=[(-1.0, 1.0)] * 3 + [(0, 1)])
        if best.x is None or best.x[3] < FLATTEST:
            return None
        toward = best.x[:3]
        if (normals @ toward).min() > 0.5 * best.x[3]:
            return np.asarray(toward / np.linalg.norm(toward))
    return None


def overlap(places: Floats, loops: tuple[Ints, ...]) -> float:
    """Area that closed rows of places cover not once, as a share of what the first covers; they may touch."""
    rows = [places[loop] for loop in loops]
    covered = [0.5 * abs(float(cross(row, np.roll(row, -1, axis=0)).sum())) for row in rows]
    off = sum(abs(make_valid(Polygon(row)).area - area) for row, area in zip(rows, covered))
    return off / max(covered[0], 1e-300)


def measured_areas(sheet: SheetScan) -> Floats:
    """(F,) twice the area of every face of the scan, zero of those laid over holes."""
    area = np.linalg.norm(sheet.mesh.area_vectors(), axis=1)
    area[sheet.n_faces :] = 0.0
    return area

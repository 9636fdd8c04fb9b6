"""Fracture that was taken for wall, known by the sheet that was laid over the hole.

Before anything is known of the hole, wall is told from fracture by what recurs round the axis. A crack that slants runs
on from the wall almost as if it were wall, and a line between wall and void drawn down there leads the face, and the
fracture after it, through the piece. Once the sheet over the hole is known such faces are plain to see:

      wall ------.  - - - - - - - - -     sheet
      d               \\     d · slope > what the wall itself shows anywhere: fracture, and all that lies with it in
                        `-.          one face of the break, up to the crease

    d      depth of a face under the sheet, into the material
    slope  tangent of the angle between the face and the sheet; relief is deep where it is level, and steep where it
           is not deep

Paper  [grady2005], the random walker that carries it to the crease.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from recon.errors import NoHole, NoSurface
from recon.hole_patch.assembly import Assembly
from recon.hole_patch.sherds import Reading, surroundings_in, with_fracture
from recon.hole_patch.surroundings import Surroundings
from recon.hole_patch.walls import INNER, OUTER, spread
from recon.hole_patch.wheel_sheet import WallFit, fit_wall

__all__ = ["look_again", "misread_faces"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

BESIDE = 2.0  # thicknesses from the hole's edge within which faces are looked at again
ALIKE = 0.9  # of the wall farther off shows less depth times slope; cracks misread there make up a few hundredths
ABOVE = 3.0  # times that is fracture
LEAST = 0.05  # of the thickness, depth times slope of a sheet that is off a little
STEEPEST = 10.0  # slope of what is square to the sheet, or overhangs
DEEPEST = 1.5  # thicknesses: what lies deeper is another wall
MOST = 0.3  # of the wall looked at: where more seems fracture, the sheet is wrong
BELIEF, READ = 1.0, 0.02  # in what the sheet says of a face, and in what was read of it


def look_again(reading: Reading, around: Surroundings, *, pass_band: float) -> tuple[Surroundings, int]:
    """The surroundings of a hole between closed sherds, fracture that was taken for wall put right; and the number of
    such faces.

    reading    of the sherds, and around, the hole as it was found in it
    pass_band  as of `surroundings_in`
    Promises   the surroundings as they were where nothing was misread, or where no sheet can be laid over the hole.
    """
    misread = _misread(reading, around)
    if not misread.any():
        return around, 0
    middle = around.outer.edge.points.mean(axis=0)
    try:
        return surroundings_in(with_fracture(reading, misread), near=middle, pass_band=pass_band), int(misread.sum())
    except NoHole:
        return around, 0


def _misread(reading: Reading, around: Surroundings) -> Flags:
    found = np.zeros(reading.table.n_faces, dtype=bool)
    if around.axis is None or not reading.closed.all():
        return found
    for wall, side, inward in ((around.outer, OUTER, -1.0), (around.inner, INNER, 1.0)):
        if wall is None:
            continue
        labels = (OUTER, INNER) if wall.over_lip else (side,)
        try:
            fit = fit_wall(wall, around.axis)
        except NoSurface:
            continue
        on_wall = np.isin(reading.labels, labels)
        found |= misread_faces(
            fit, reading.table, reading.normals, on_wall, thickness=reading.thickness, inward=inward
        )
    return found


def misread_faces(
    fit: WallFit, table: Assembly, normals: Floats, on_wall: Flags, *, thickness: float, inward: float
) -> Flags:
    """(F,) faces read as wall beside the hole that are fracture.

    fit        of the wall
    normals    (F, 3) of all faces, freed from noise
    on_wall    (F,) faces that were read as this wall
    thickness  of the wall, in millimetres
    inward     -1 where the material lies below the sheet, as on outer walls and over the lip, 1 where above, as on the
               inner one
    """
    none = np.zeros(table.n_faces, dtype=bool)
    edge = cKDTree(fit.wall.edge.points * fit.unit)
    walls = np.flatnonzero(on_wall)
    away, _ = edge.query(table.centres[walls], distance_upper_bound=2.0 * BESIDE * thickness)
    walls, away = walls[np.isfinite(away)], away[np.isfinite(away)]
    beside = away < BESIDE * thickness
    if not beside.any():
        return none
    depth, slope = _under_sheet(fit, table.centres[walls], -inward * normals[walls], inward)
    down = np.where((depth > 0.0) & (depth < DEEPEST * thickness), depth * slope, 0.0)
    usual = float(np.quantile(down[~beside], ALIKE)) if (~beside).any() else 0.0
    deep = beside & (down > max(ABOVE * usual, LEAST * thickness))
    if not deep.any():
        return none
    level = (np.abs(depth) < 0.5 * LEAST * thickness) & (slope < 0.3)
    share = _spread(table, normals, on_wall, walls[deep], walls[level & ~deep])
    found = none.copy()
    found[walls[beside]] = share[walls[beside]] < 0.5
    area = table.areas * found
    return none if area.sum() > MOST * table.areas[walls[beside]].sum() else found


def _under_sheet(fit: WallFit, points: Floats, normals: Floats, inward: float) -> tuple[Floats, Floats]:
    """(m,) depth of points under the sheet, into the material, in mm; and (m,) their slope beside it."""
    points = points / fit.unit
    flat = fit.chart.flat(points, normals)
    outward = fit.chart.space(flat + np.array([0.0, 0.0, 1.0])) - points
    cosine = np.clip(np.einsum("ij,ij->i", outward, normals), 1e-3, 1.0)
    slope = np.minimum(np.sqrt(1.0 / cosine**2 - 1.0), STEEPEST)
    return inward * (flat[:, 2] - fit.residual.at(flat[:, :2])) * fit.unit, slope


def _spread(table: Assembly, normals: Floats, on_wall: Flags, deep: Ints, level: Ints) -> Floats:
    """(F,) share of wall after a random walk from what is known."""
    guess, belief = on_wall.astype(np.float64), np.full(table.n_faces, READ)
    guess[deep], belief[deep] = 0.0, BELIEF
    belief[level] = BELIEF
    return spread(table, normals, guess=guess, belief=belief)

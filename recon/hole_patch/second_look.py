"""Fracture that was taken for wall, and wall taken for fracture, known by the sheet that was laid over the hole.

Before anything is known of the hole, wall is told from fracture by what recurs round the axis. A crack that slants runs
on from the wall almost as if it were wall, and a line between wall and void drawn down there leads the face, and the
fracture after it, through the piece. Once the sheet over the hole is known such faces are plain to see:

      wall ------.  - - - - - - - - -     sheet
      d               \\     d · slope > what the wall itself shows anywhere: fracture, and all that lies with it in
                        `-.          one face of the break, up to the crease

What was taken for fracture, but lies on the sheet and along it, is wall.

    d      depth of a face under the sheet, into the material
    slope  tangent of the angle between the face and the sheet; relief is deep where it is level, and steep where it
           is not deep

Paper  [grady2005], the random walker that carries it to the crease.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from recon.errors import NoHole, NoSurface
from recon.hole_patch.assembly import Assembly, label_groups
from recon.hole_patch.sherd_reading import Reading, with_labels
from recon.hole_patch.sherds import surroundings_in
from recon.hole_patch.surroundings import Axis, Surroundings
from recon.hole_patch.walls import FRACTURE, INNER, OUTER, depths_in_wall, spread
from recon.hole_patch.wheel_sheet import WallFit, fit_wall

__all__ = ["LEASTS", "look_again", "misread_faces", "wall_again"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

BESIDE = 2.0  # thicknesses from the hole's edge within which faces are looked at again
ALIKE = 0.9  # of the wall farther off is less deep, and less deep and steep; cracks misread there are a few hundredths
ABOVE, DEEPER = 3.0, 1.5  # times that is fracture: depth times slope of a face, depth of one face in every group
LEASTS = (
    0.05,
    0.03,
    np.inf,
)  # the same in thicknesses, where the wall is smooth: tried in turn, inf for no second look
STEEP = 0.6  # slope, at least, of a face that is fracture by itself: walls that were set askew are level
DEEP = 0.1  # thicknesses, at least, that a face of a break reaches down
NEAR, FLAT = 0.25, 0.5  # thicknesses from the sheet, and slope beside it, of wall that was taken for fracture
LEVEL = 0.3  # slope of what lies beside the sheet
UNDER = 0.75  # of a group's area lie under the sheet
STEEPEST = 10.0  # slope of what is square to the sheet, or overhangs
DEEPEST = 1.5  # thicknesses: what lies deeper is another wall
MOST = 0.3  # of the wall looked at: where more seems fracture, the sheet is wrong
BELIEF, READ = 1.0, 0.02  # in what the sheet says of a face, and in what was read of it


def look_again(
    reading: Reading, around: Surroundings, *, pass_band: float, least: float = LEASTS[0]
) -> tuple[Surroundings, Ints]:
    """The surroundings of a hole between closed sherds as a second look shows them; and (F,) labels, as it reads them.

    reading    of the sherds, and around, the hole as it was found in it
    pass_band  as of `surroundings_in`
    least      thicknesses times slope from which on a face may be fracture; one of LEASTS, no one of which is right for
               all breaks
    Promises   the surroundings as they were where nothing was misread, or where no sheet can be laid over the hole.
    """
    labels = _labels(reading, around, least)
    if np.array_equal(labels, reading.labels):
        return around, labels
    middle = around.outer.edge.points.mean(axis=0)
    try:
        return surroundings_in(with_labels(reading, labels), near=middle, pass_band=pass_band), labels
    except NoHole:
        return around, reading.labels


def _labels(reading: Reading, around: Surroundings, least: float) -> Ints:
    labels = reading.labels.copy()
    if around.axis is None or not reading.closed.all() or np.isinf(least):
        return labels
    for wall, side, inward in ((around.outer, OUTER, -1.0), (around.inner, INNER, 1.0)):
        if wall is None:
            continue
        sides = (OUTER, INNER) if wall.over_lip else (side,)
        try:
            fit = fit_wall(wall, around.axis)
        except NoSurface:
            continue
        again = wall_again(fit, reading, inward=inward)
        labels[again] = _nearest_label(reading, np.isin(reading.labels, sides), again)
        on_wall = np.isin(reading.labels, sides)
        labels[misread_faces(fit, around.axis, reading, on_wall, inward=inward, least=least)] = FRACTURE
    return labels


def _nearest_label(reading: Reading, among: Flags, faces: Ints) -> Ints:
    """(k,) labels of those among the faces that are nearest to faces (k,)."""
    centres = reading.table.centres
    nearest = cKDTree(centres[among]).query(centres[faces])[1]
    return np.asarray(reading.labels[among][nearest])


def wall_again(fit: WallFit, reading: Reading, *, inward: float) -> Ints:
    """(k,) numbers of the faces beside the hole that were read as fracture, but lie on the sheet and along it.

    A crack leaves a wall at once, at 45° and more; nothing of it lies along the sheet, however near to it.
    """
    edge = cKDTree(fit.wall.edge.points * fit.unit)
    faces = np.flatnonzero(reading.labels == FRACTURE)
    away = edge.query(reading.table.centres[faces], distance_upper_bound=BESIDE * reading.thickness)[0]
    faces = faces[np.isfinite(away)]
    if not len(faces):
        return faces
    depth, slope = _under_sheet(fit, reading.table.centres[faces], -inward * reading.normals[faces], inward)
    return faces[(np.abs(depth) < NEAR * reading.thickness) & (slope < FLAT)]


def misread_faces(
    fit: WallFit, axis: Axis, reading: Reading, on_wall: Flags, *, inward: float, least: float = LEASTS[0]
) -> Flags:
    """(F,) faces read as wall beside the hole that are fracture.

    fit        of the wall
    axis       that it was turned about
    on_wall    (F,) faces that were read as this wall
    inward     -1 where the material lies below the sheet, as on outer walls and over the lip, 1 where above, as on the
               inner one
    least      as of `look_again`
    """
    table, normals, thickness = reading.table, reading.normals, reading.thickness
    none = np.zeros(table.n_faces, dtype=bool)
    edge = cKDTree(fit.wall.edge.points * fit.unit)
    walls = np.flatnonzero(on_wall)
    away, _ = edge.query(table.centres[walls], distance_upper_bound=2.0 * BESIDE * thickness)
    walls, away = walls[np.isfinite(away)], away[np.isfinite(away)]
    beside = away < BESIDE * thickness
    if not beside.any():
        return none
    depth, slope = _under_sheet(fit, table.centres[walls], -inward * normals[walls], inward)
    depth = np.where(depth < DEEPEST * thickness, depth, 0.0)
    down = np.maximum(depth, 0.0) * slope
    usual, deepest = (_usual(x[~beside]) for x in (down, depth))
    steep = beside & (slope > STEEP) & (down > max(ABOVE * usual, least * thickness))
    if not steep.any():
        return none
    level = (np.abs(depth) < least * thickness) & (slope < LEVEL)
    share = _spread(table, normals, on_wall, walls[steep], walls[level & ~steep])
    found, deeps = none.copy(), np.full(table.n_faces, -np.inf)
    found[walls[beside]] = share[walls[beside]] < 0.5
    deeps[walls] = depth
    found = _fracture_groups(table, found, deeps, max(DEEPER * deepest, DEEP * thickness))
    found = _off_wheel(table, normals, axis, found, on_wall & ~found, DEEP * thickness)
    return none if table.areas[found].sum() > MOST * table.areas[walls[beside]].sum() else found


def _usual(values: Floats) -> float:
    return float(np.quantile(values, ALIKE)) if len(values) else 0.0


def _fracture_groups(table: Assembly, faces: Flags, depth: Floats, deep: float) -> Flags:
    """(F,) those connected groups of the faces that lie under the sheet, but for a quarter, and somewhere deep.

    A flank of relief lies half above it.
    """
    group, area = label_groups(table, faces.astype(np.int64))
    deepest = np.full(len(area), -np.inf)
    np.maximum.at(deepest, group[faces], depth[faces])
    under = np.bincount(group, table.areas * (depth > 0.0), len(area))
    return faces & ((deepest > deep) & (under > UNDER * area))[group]


def _off_wheel(table: Assembly, normals: Floats, axis: Axis, faces: Flags, wall: Flags, deep: float) -> Flags:
    """(F,) those connected groups of the faces that lie deep in the wall all round the turn, too: a foot or a shoulder
    too sharp for the sheet comes back there.
    """
    if not faces.any():
        return faces
    group, area = label_groups(table, faces.astype(np.int64))
    below = np.full(len(area), -np.inf)
    of = np.flatnonzero(faces)
    np.maximum.at(below, group[of], depths_in_wall(table, normals, axis, wall, of=of))
    return faces & (below > deep)[group]


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

"""The surroundings of one of the holes between sherds: its walls, without relief, its edge on each, the fracture.

Paper  [kinoshita], sections 3.1 and 3.4 step 1; [taubin1995], the filter that removes the relief.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from recon.errors import BadOption, NoHole
from recon.geometry.mesh import TriangleMesh
from recon.hole_patch.hole import Hole
from recon.hole_patch.sherd_reading import THICKEST, Reading, read_sherds, what_was_found
from recon.hole_patch.shown_thickness import shown_thickness
from recon.hole_patch.smoothing import taubin_smooth
from recon.hole_patch.surroundings import HoleEdge, ShownThickness, Surroundings, Wall
from recon.hole_patch.walls import INNER, OUTER, wall_mesh, wall_trust

__all__ = ["surroundings", "surroundings_in"]

Floats = NDArray[np.float64]

RELIEF_REACH = 2.5  # millimetres: how far from a border smoothing is held back by the vertices that do not move


def surroundings(
    sherds: Sequence[TriangleMesh], *, hole: int | None = None, near: Floats | None = None, pass_band: float = 0.01
) -> Surroundings:
    """The walls around a hole between sherds, the hole's edge on each, and the axis.

    sherds  in pose, in millimetres: closed with fracture faces, or open outer walls, or one mesh with a hole; the parts
            of a single mesh count as sherds
    hole    its number among `find_holes`; the largest that can be patched when None
    near    (3,) a point in the hole that is meant, in place of its number
    pass_band  of the filter that removes the relief, see `taubin_smooth`
    Raises  NoHole, NotManifold, BadGeometry; BadOption when there is no hole of that number.
    Paper   [kinoshita], [taubin1995].
    """
    return surroundings_in(read_sherds(sherds), hole=hole, near=near, pass_band=pass_band)


def surroundings_in(
    reading: Reading, *, hole: int | None = None, near: Floats | None = None, pass_band: float = 0.01
) -> Surroundings:
    """The same of sherds that were read already; parameters and errors as of `surroundings`."""
    holes = reading.holes
    if near is not None and holes:
        hole = min(range(len(holes)), key=lambda k: float(np.linalg.norm(holes[k].place - near)))
    chosen = _chosen(holes, hole, reading)
    sides = (OUTER, INNER) if chosen.over_lip else (OUTER,)
    outer = _wall(reading, sides, chosen.outer, pass_band)
    inner = None if chosen.inner is None else _wall(reading, (INNER,), chosen.inner, pass_band)
    return Surroundings(
        outer,
        inner,
        reading.axis,
        n_holes=len(holes),
        kind=chosen.kind,
        shown=_shown(reading) if inner is None else None,
        fracture=_fracture(reading, chosen),
    )


def _chosen(holes: tuple[Hole, ...], number: int | None, reading: Reading) -> Hole:
    if not holes:
        raise NoHole(what_was_found(reading))
    if number is None and reading.axis is None:
        raise NoHole(
            "the sherds fit no wheel, so a hole cannot be told from the mouth: "
            f"choose one of the {len(holes)} open lines by its number (--hole), 0 being the longest."
        )
    if number is None:
        number = next((k for k, hole in enumerate(holes) if not hole.problem), 0)
    if not 0 <= number < len(holes):
        raise BadOption("hole", f"must be from 0 to {len(holes) - 1}, not {number}; the longest hole is number 0")
    if holes[number].problem:
        x, y, z = holes[number].place
        raise NoHole(f"the hole near ({x:.3g}, {y:.3g}, {z:.3g}) cannot be patched: {holes[number].problem}.")
    return holes[number]


def _shown(reading: Reading) -> ShownThickness | None:
    """Thickness where the scans show it; without an axis nobody knows which wall is which."""
    if reading.axis is None:
        return None
    limit = THICKEST * float(np.quantile(reading.axis.cylindrical(reading.table.centres)[:, 1], 0.95))
    return shown_thickness(reading.table, reading.normals, reading.labels, limit=limit)


def _fracture(reading: Reading, hole: Hole) -> TriangleMesh | None:
    """The fracture faces that look into a hole, within a few thicknesses of its edge."""
    table = reading.table
    faces = np.flatnonzero(reading.fracture)
    if (hole.inner is None and not hole.over_lip) or not len(faces):
        return None
    edge = cKDTree(np.concatenate([wall.points for wall in (hole.outer, hole.inner) if wall is not None]))
    near = edge.query(table.centres[faces], distance_upper_bound=2.0 * reading.thickness)[0]
    faces = faces[np.isfinite(near)]
    return TriangleMesh(table.vertices, table.faces, "fracture").part(faces) if len(faces) else None


def _wall(reading: Reading, sides: tuple[int, ...], edge: HoleEdge, pass_band: float) -> Wall:
    on_wall = np.isin(reading.labels, sides)
    measured, sherds = wall_mesh(reading.table, on_wall, turned=sides == (INNER,))
    trust = wall_trust(measured, reach=max(RELIEF_REACH, 3.0 * reading.table.spacing))
    over_lip = len(sides) > 1
    return Wall(measured, taubin_smooth(measured, pass_band=pass_band), sherds, trust, edge, over_lip)

"""The sections of the wall by the four sides of the box, in the sides' own frames.

             side 2                 each side is a rectangle; of the wall that crosses it the section is
           +--->---+                kept as points (t, height):
    side 3 ^       ^ side 1
           +--->---+                 height |    .-.-.              t runs from 0 to 1 in the side's direction,
             side 0                         | .-'     '-.-.         height along the box's normal
                                            +-----------------> t

Paper  [kinoshita], section 3.2 step 2.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.hole_patch.box import FACING, Box
from recon.hole_patch.surroundings import Wall
from recon.numerics.halfedges import vertex_normals
from recon.numerics.planes import section_segments

__all__ = ["NearWall", "Section", "near_wall", "cut_sides"]

Floats = NDArray[np.float64]
COVERAGE_BINS = 20


@dataclass(frozen=True, eq=False)
class NearWall:
    """The part of a wall that a box can meet however it is turned.

    vertices       (V, 3) without relief, in space
    face_vertices  (F, 3)
    trust          (V,) how far a vertex may be believed, positive
    """

    vertices: Floats
    face_vertices: NDArray[np.int64]
    trust: Floats


@dataclass(frozen=True, eq=False)
class Section:
    """What one side of the box cuts from the wall; t (k,) in [0, 1], height (k,) in millimetres, trust (k,)."""

    t: Floats
    height: Floats
    trust: Floats

    def coverage(self) -> float:
        """Share of the side's length over which the wall was met."""
        bins = np.unique(np.minimum((self.t * COVERAGE_BINS).astype(int), COVERAGE_BINS - 1))
        return len(bins) / COVERAGE_BINS


def near_wall(wall: Wall, box: Box) -> NearWall:
    """The faces of the plain wall that face along the box's normal, within reach of the box however it is turned.

    The opposite wall of the vessel, which a deep box reaches too, faces the other way and is left out.
    """
    local = box.local(wall.plain.vertices)
    around = np.linalg.norm(np.maximum(-box.low, box.high))
    near = (np.hypot(local[:, 0], local[:, 1]) <= around) & (np.abs(local[:, 2]) <= box.reach)
    normals = vertex_normals(wall.plain.vertices, wall.plain.face_vertices)
    kept = near & (normals @ box.axes[2] > FACING)
    faces = wall.plain.face_vertices[kept[wall.plain.face_vertices].all(axis=1)]
    used, renumbered = np.unique(faces, return_inverse=True)
    return NearWall(wall.plain.vertices[used], renumbered.reshape(-1, 3), np.maximum(wall.trust[used], 1e-3))


def cut_sides(near: NearWall, box: Box) -> tuple[Section, Section, Section, Section]:
    """Sections of the near wall by the four sides of a box, each bounded to its rectangle; sides 0 to 3 as drawn."""
    local = np.column_stack([box.local(near.vertices), near.trust])
    return (
        _cut(near, local, box, across=1, at=box.low[1]),
        _cut(near, local, box, across=0, at=box.high[0]),
        _cut(near, local, box, across=1, at=box.high[1]),
        _cut(near, local, box, across=0, at=box.low[0]),
    )


def _cut(near: NearWall, local: Floats, box: Box, *, across: int, at: float) -> Section:
    along = 1 - across
    ends = section_segments(local, near.face_vertices, local[:, across] - at).reshape(-1, 4)
    t = (ends[:, along] - box.low[along]) / (box.high[along] - box.low[along])
    inside = (t >= 0.0) & (t <= 1.0) & (np.abs(ends[:, 2]) <= box.reach)
    return Section(t[inside], ends[inside, 2], ends[inside, 3])

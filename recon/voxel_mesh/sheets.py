"""Surfaces that the voxels bear out, and which of the surface's vertices lie on them.

    o----|----.     a surface stabs a grid edge when it runs between its solid centre o and its empty one: then a vertex
         S          may slide to the surface S without a centre changing sides

A surface that the part has stabs nearly all grid edges of its vertices.  One that only comes near to a free shape, as
the cones and cylinders that the growth finds on it, misses one in ten: it is no true face.  A rounding along two planes
is a strip of a cylinder between the two planes through its axis at right angles to them, where it touches.

All lengths in voxels.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from recon.geometry.analytic import AnalyticSurface, Blend, Cylinder, Plane
from recon.voxel_mesh.fits import fit_plane_through
from recon.voxel_mesh.settled_surfaces import Ends, Faces

__all__ = ["DEEP", "Sheet", "Touch", "borne_out_sheets", "stabbed_places"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

MISSED = 0.04  # share of its vertices whose grid edges a true surface may miss
DEEP = 0.03  # voxels by which it may miss them
FACING = 0.5  # cosine of the angle between its normal and a vertex's, at least
LEAST_FLAT, LEAST_ROUND = 40, 150  # vertices: fewer are fitted by anything
INSIDE = 0.002  # of a grid edge between a vertex and either centre: beyond them triangles might cut each other
ROUNDS = 8  # of Newton's for the place on a grid edge


@dataclass(frozen=True, eq=False)
class Touch:
    """Where a rounding touches the sheet `other`: on `plane`, the rounding on the side that its normal looks to."""

    other: int
    plane: Plane


@dataclass(frozen=True, eq=False)
class Sheet:
    """A surface with its outside: 1 where its own normal looks out of the solid, else -1.

    members  vertices (n,) of the surface that it was found from
    touches  of a rounding: where it ends
    """

    surface: AnalyticSurface
    outside: float
    members: Ints
    touches: tuple[Touch, ...] = ()

    def renumbered(self, number: dict[int, int]) -> "Sheet":
        """The sheet among others with new numbers."""
        return replace(self, touches=tuple(Touch(number[t.other], t.plane) for t in self.touches))

    def bears(self, ends: Ends, rows: Ints) -> Bools:
        """Whether the sheet stabs the grid edges of some vertices, faces as they do, and does not end before them."""
        x = 0.5 * (ends.solid[rows] + ends.empty[rows])
        facing = self.outside * (self.surface.normal(x) * ends.normal[rows]).sum(axis=1)
        within = np.ones(len(rows), dtype=bool)
        for touch in self.touches:
            within &= touch.plane.distance(x) > 0.0
        return np.asarray(within & (facing > FACING) & (self.depth(ends, rows) < DEEP))

    def depth(self, ends: Ends, rows: Ints) -> Floats:
        """How far the nearer of both centres is on the wrong side, below 0 where both are right."""
        solid, empty = (self.outside * self.surface.distance(x[rows]) for x in (ends.solid, ends.empty))
        return np.maximum(solid, -empty)


def borne_out_sheets(faces: Faces, ends: Ends) -> list[Sheet]:
    """Surfaces of the part that the voxels bear out, then its roundings along two planes among them."""
    found = {k: sheet for k, sheet in enumerate(_sheets(faces, ends)) if _is_borne_out(sheet, ends)}
    number = {k: n for n, k in enumerate(found)}
    sheets = list(found.values())
    for blend, members in zip(faces.blends, faces.blend_members):
        strip = _strip(blend, faces, number)
        if strip is not None:
            surface, touches = strip
            sheet = Sheet(surface, _outside(surface, ends, members), members, touches)
            if _is_borne_out(sheet, ends):
                sheets.append(sheet)
    return sheets


def _sheets(faces: Faces, ends: Ends) -> Iterator[Sheet]:
    """The surfaces, a plane in place of a round one where the voxels bear it out as well."""
    for surface, members in zip(faces.surfaces, faces.members):
        flat = fit_plane_through(0.5 * (ends.solid + ends.empty)[members], ends.normal[members])
        plane = Sheet(flat, 1.0, members)
        round_one = not isinstance(surface, Plane)
        yield (
            plane
            if round_one and _is_borne_out(plane, ends)
            else Sheet(surface, _outside(surface, ends, members), members)
        )


def _outside(surface: AnalyticSurface, ends: Ends, members: Ints) -> float:
    facing = (surface.normal(ends.solid[members]) * ends.normal[members]).sum(axis=1)
    return 1.0 if np.median(facing) >= 0.0 else -1.0


def _is_borne_out(sheet: Sheet, ends: Ends) -> bool:
    least = LEAST_FLAT if isinstance(sheet.surface, Plane) else LEAST_ROUND
    return len(sheet.members) >= least and bool((sheet.depth(ends, sheet.members) > 0.0).mean() <= MISSED)


def _strip(blend: Blend, faces: Faces, number: dict[int, int]) -> tuple[Cylinder, tuple[Touch, ...]] | None:
    """The cylinder of a rounding along two planes, and where it touches them; None along anything else."""
    pair = [faces.surfaces[k] for k in (blend.first, blend.second)]
    if not all(isinstance(plane, Plane) for plane in pair) or not {blend.first, blend.second} <= number.keys():
        return None
    normals = np.array([plane.normal(blend.middle[None])[0] for plane in pair])
    axis = np.cross(*normals)
    axis /= np.linalg.norm(axis)
    offsets = [side * blend.radius - plane.distance(np.zeros((1, 3)))[0] for plane, side in zip(pair, blend.sides)]
    centre = np.linalg.solve(np.vstack([normals, axis]), np.array([*offsets, float(axis @ blend.middle)]))
    touches = []
    for k, plane, normal in zip((blend.first, blend.second), pair, normals):
        across = np.cross(axis, normal)
        other = pair[1] if plane is pair[0] else pair[0]
        toward = blend.sides[0 if other is pair[0] else 1] * float(across @ other.normal(centre[None])[0])
        across = -np.sign(toward) * across
        touches.append(Touch(number[k], Plane(across, float(across @ centre))))
    return Cylinder(centre, axis, blend.radius), tuple(touches)


def stabbed_places(sheet: Sheet, ends: Ends, rows: Ints) -> Floats:
    """(n, 3) places where the sheet runs through the grid edges of vertices that it bears, or within DEEP of that."""
    start, way = ends.solid[rows], ends.empty[rows] - ends.solid[rows]
    t = np.full(len(rows), 0.5)
    for _ in range(ROUNDS):
        x = start + t[:, None] * way
        slope = (sheet.surface.normal(x) * way).sum(axis=1)
        slope = np.where(np.abs(slope) > 0.05, slope, np.where(slope < 0.0, -0.05, 0.05))
        t = np.clip(t - sheet.surface.distance(x) / slope, INSIDE, 1.0 - INSIDE)
    return np.asarray(start + t[:, None] * way)

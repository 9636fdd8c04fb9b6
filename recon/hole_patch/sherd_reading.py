"""What is understood of sherds in pose: the wheel's axis, wall told from fracture, lines between wall and void, holes.

    closed sherds   wall | fracture, outer | inner wall; fracture with nobody against it looks into the hole
    open walls      border with no other sherd near it; round the axis it is mouth or base, else a hole
    either way      directed edges between wall and void, joined to closed lines, cleaned

Paper  [kinoshita], section 3.1, where the edge is picked by hand.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from recon.errors import NoHole
from recon.geometry.mesh import TriangleMesh
from recon.hole_patch.assembly import Assembly, assemble, label_groups, steady_normals
from recon.hole_patch.axis import wheel_axis
from recon.hole_patch.edge_cleaning import chart_points, clean_rows, crossings, signed_area
from recon.hole_patch.fracture import looks_into_hole, mated_faces, wall_thickness
from recon.hole_patch.hole import Hole
from recon.hole_patch.hole_edges import Cycle, free_border, hole_cycles, void_edges
from recon.hole_patch.open_rims import between_rims, comes_near, excursions, sweep, winding
from recon.hole_patch.surroundings import Axis, HoleEdge, HoleKind
from recon.hole_patch.walls import FRACTURE, INNER, OUTER, fracture_faces, label_walls, lip_height

__all__ = ["THICKEST", "Reading", "find_holes", "read_sherds", "separate", "what_was_found", "with_labels"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

LEAST_LENGTH, LEAST_AREA = 8.0, 4.0  # of a hole, in thicknesses and their square; smaller ones are chips
LEAST_DEPTH = 2.0  # thicknesses that a hole reaches down from the lip; less is the lip's own unevenness, or a chip
LEAST_KNOWN = 30.0  # thicknesses: of a line that is mostly unknown, to be worth a word
SIZEABLE = 0.002  # of all area, to be a sherd of its own
NOT_ROUND = 0.1  # thicknesses off the wheel, from which on walls recur badly round it
THICKEST = 0.4  # of a wall, in radii of the vessel
FOOT = 0.1  # of the vessel's height, from below
LEAST_CUT = 4.0  # thicknesses of a line that runs down a foot and up again; hairs at its cracks are shorter
AGAINST, FEW_AGAINST = -0.3, 3  # cosine between normals of both sides of a foot ring, and points of one that show it
NEARLY_ROUND = 1.75 * np.pi
OPEN_THICKNESS = 2.0  # edge lengths that stand for the thickness where only one wall was scanned


@dataclass(frozen=True, eq=False)
class Reading:
    """What was understood of the sherds: read once, it tells of every hole between them.

    table, normals  their faces, and normals (F, 3) freed from noise
    axis            the wheel's, or None
    labels          (F,) OUTER, INNER or FRACTURE
    thickness       of the wall, or what stands for it where only one wall was scanned
    closed          (S,) sherds with both walls and their fracture
    mated           (F,) faces that a face of another sherd lies against
    fracture        (F,) fracture faces that look into a hole
    cycles          closed lines between wall and void, longest first
    """

    table: Assembly
    normals: Floats
    axis: Axis | None
    labels: Ints
    thickness: float
    closed: Flags
    mated: Flags
    fracture: Flags
    cycles: list[Cycle]

    @cached_property
    def holes(self) -> tuple[Hole, ...]:
        """All holes, the longest edge first; mouth and base are none."""
        return tuple(_holes(self))


def find_holes(sherds: Sequence[TriangleMesh]) -> tuple[Hole, ...]:
    """All holes between the sherds, the longest edge first; mouth and base are none.

    Raises  NoHole when the sherds fit no wheel's axis and so cannot be understood; NotManifold, BadGeometry.
    """
    return read_sherds(sherds).holes


def what_was_found(reading: Reading) -> str:
    """The sentence for sherds that surround no hole: what there is in its place."""
    if not reading.cycles:
        least = LEAST_LENGTH * reading.thickness
        found = f"no line between wall and void is longer than {least:.3g}, eight times the wall's thickness"
    else:
        longest, count = reading.cycles[0].length, len(reading.cycles)
        found = f"of {count} open lines, the longest {longest:.3g} long, none runs round a hole in the wall"
    doubt = ""
    if reading.closed.any() and reading.axis is not None and reading.axis.quality > NOT_ROUND * reading.thickness:
        doubt = (
            f" The walls stand off from the wheel by {reading.axis.quality:.2f} mm, so that fracture may pass for wall:"
            " give the outer walls alone, as open meshes."
        )
    return f"the sherds surround no hole: {found}.{doubt}"


def separate(sherds: Sequence[TriangleMesh]) -> list[TriangleMesh]:
    """The sherds one by one: when they came as a single mesh, its connected parts of some size."""
    if len(sherds) != 1:
        return list(sherds)
    table = assemble(sherds)
    group, area = label_groups(table, np.zeros(table.n_faces, dtype=np.int64))
    large = np.flatnonzero(area > SIZEABLE * area.sum())
    return [TriangleMesh(table.vertices, table.faces, sherds[0].name).part(group == k) for k in large]


def read_sherds(sherds: Sequence[TriangleMesh]) -> Reading:
    """Axis, walls and lines between wall and void of sherds in pose; see `surroundings` for what they may be.

    Raises  NoHole when closed sherds fit no wheel's axis and so cannot be understood; NotManifold, BadGeometry.
    """
    table = assemble(separate(sherds))
    normals = steady_normals(table)
    closed = _closed_sherds(table)
    axis = wheel_axis(table.centres, normals, table.areas)
    if closed.any():
        return _read_closed(table, normals, axis, closed)
    void = np.zeros(table.n_faces, dtype=bool)
    thickness = OPEN_THICKNESS * table.spacing
    labels = np.full(table.n_faces, OUTER)
    if axis is not None:
        labels = label_walls(table, normals, axis, fracture=void, doubtful=void, thickness=thickness)
    cycles = _cycles(table, normals, axis, labels, hole=void, closed=closed, thickness=thickness)
    return Reading(table, normals, axis, labels, thickness, closed, void, void, cycles)


def _read_closed(table: Assembly, normals: Floats, axis: Axis | None, closed: Flags) -> Reading:
    if axis is None:
        raise NoHole(
            "the sherds fit no wheel: their walls do not recur round any axis, so wall cannot be told from fracture; "
            "give the outer walls alone, as open meshes."
        )
    thickness = wall_thickness(table)
    if thickness > THICKEST * float(np.quantile(axis.cylindrical(table.centres)[:, 1], 0.95)):
        raise NoHole("the sherds are no vessel: their walls would be as thick as the whole is wide.")
    mated = mated_faces(table, normals, 0.4 * thickness)
    fracture, doubtful = fracture_faces(table, normals, axis, mated=mated, thickness=thickness)
    fracture &= closed[table.face_sherd]
    thickness = wall_thickness(table, fracture)
    labels = label_walls(table, normals, axis, fracture=fracture, doubtful=doubtful, thickness=thickness)
    wall = labels != FRACTURE
    axis = wheel_axis(table.centres[wall], normals[wall], table.areas[wall]) or axis
    return with_labels(Reading(table, normals, axis, labels, thickness, closed, mated, ~wall, []), labels)


def with_labels(reading: Reading, labels: Ints) -> Reading:
    """The reading of closed sherds with other labels (F,), its holes found anew."""
    table, thickness = reading.table, reading.thickness
    hole = looks_into_hole(table, labels == FRACTURE, reading.mated, radius=0.7 * thickness)
    cycles = _cycles(
        table, reading.normals, reading.axis, labels, hole=hole, closed=reading.closed, thickness=thickness
    )
    return replace(reading, labels=labels, fracture=hole, cycles=cycles)


def _closed_sherds(table: Assembly) -> Flags:
    """(S,) sherds whose border is at most a few small scanning holes."""
    ends = table.vertices[table.border_edges]
    border = np.bincount(
        table.vertex_sherd[table.border_edges[:, 0]], np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1), table.n_sherds
    )
    area = np.bincount(table.face_sherd, table.areas, table.n_sherds)
    return np.asarray((border < 0.5 * np.sqrt(area)) & (area > 0.0))


def _cycles(
    table: Assembly,
    normals: Floats,
    axis: Axis | None,
    labels: Ints,
    *,
    hole: Flags,
    closed: Flags,
    thickness: float,
) -> list[Cycle]:
    lip = np.ones(table.n_faces, dtype=bool)
    if axis is not None:
        height = axis.cylindrical(table.centres)[:, 2]
        lip = height > lip_height(height)
    free = free_border(table, closed)
    void = void_edges(table, labels, hole=hole, free=free, lip=lip, thickness=thickness)
    return [c for c in hole_cycles(table, normals, labels, void=void) if c.length > LEAST_LENGTH * thickness]


def _holes(reading: Reading) -> list[Hole]:
    """Holes on the outer wall, each with its partner on the inner one, longest first."""
    kinds = [_kind(c, reading) for c in reading.cycles]
    outer, inner, both = (
        [c for c, kind in zip(reading.cycles, kinds) if kind == wanted] for wanted in (OUTER, INNER, OUTER + INNER)
    )
    found = [hole for cycle in both for hole in _over_the_lip(cycle, reading)]
    for cycle in outer:
        for part, kind, problem in _parts(cycle, reading):
            if problem:
                found.append(Hole(HoleEdge(part.points[::-1], part.sherds[::-1]), None, problem, kind))
                continue
            edge, partner = _edge(part, reading, outward=1.0), _partner(part, inner, reading)
            through = partner is not None or not reading.closed.all()
            if edge is not None and (through or part.length > LEAST_KNOWN * reading.thickness):
                # a line that is to be cleaned in the wheel's chart runs over a foot ring
                found.append(Hole(edge, partner, kind=kind if edge.normals is None else HoleKind.FOOT))
    return sorted(found, key=lambda hole: -hole.length)


def _kind(cycle: Cycle, reading: Reading) -> int:
    """Which wall a line bounds; the border of open walls that runs round the mouth may lie on part of the lip."""
    if not reading.closed.any() and reading.axis is not None and winding(cycle, reading.axis):
        return OUTER
    share = float((cycle.walls == OUTER).mean())
    return OUTER if share > 0.8 else INNER if share < 0.2 else OUTER + INNER


def _over_the_lip(cycle: Cycle, reading: Reading) -> list[Hole]:
    """A line that runs over the lip bounds a hole at the rim; elsewhere such a line is a lump."""
    assert reading.axis is not None  # without it every wall is an outer one
    height = reading.axis.cylindrical(reading.table.centres)[:, 2]
    line = reading.axis.cylindrical(cycle.points)[:, 2]
    if line.max() < lip_height(height) or np.ptp(line) < LEAST_DEPTH * reading.thickness:
        return []
    edge = HoleEdge(cycle.points[::-1], cycle.sherds[::-1], cycle.normals[::-1])
    return [Hole(edge, None, kind=HoleKind.RIM, over_lip=True)]


def _parts(cycle: Cycle, reading: Reading) -> list[tuple[Cycle, HoleKind, str]]:
    """The holes that a line on the outer wall bounds, each with what surrounds it and what is wrong with it."""
    axis = reading.axis
    if cycle.gap > 0.25 * cycle.length:
        if cycle.length < LEAST_KNOWN * reading.thickness:
            return []
        return [(cycle, HoleKind.WALL, f"{cycle.gap:.3g} of its edge are missing in one stretch")]
    if axis is None:
        return [(cycle, HoleKind.WALL, "")]
    turns = winding(cycle, axis)
    if turns == 0 and reading.closed.any():
        return [(cycle, HoleKind.WALL, "")]
    if turns == 0:
        if sweep(cycle, axis) <= NEARLY_ROUND:
            return [(cycle, HoleKind.WALL, "")]
        part = between_rims(cycle, axis, reading.table.spacing)
        if part is None:
            return [(cycle, HoleKind.WALL, "it runs from the mouth to the base")]
        return [(part, HoleKind.RIM, "")]
    if turns > 0 and comes_near(cycle, axis):
        return [(cycle, HoleKind.WALL, "")]
    if reading.closed.any():
        missing = "above" if turns < 0 else "below"
        return [(cycle, HoleKind.WALL, f"it runs round the whole vessel: all that was {missing} it is missing")]
    kind = HoleKind.RIM if turns < 0 else HoleKind.FOOT
    return [(part, kind, "") for part in excursions(cycle, axis, reading.table.spacing)]


def _edge(cycle: Cycle, reading: Reading, *, outward: float) -> HoleEdge | None:
    """The line, cleaned and turned counter-clockwise seen from outside; None when it surrounds wall, or is a chip.

    outward   1 on the outer wall, -1 on the inner one, whose normals point to the vessel's inside
    """
    points, sherds, normals = cycle.points, cycle.sherds, outward * cycle.normals
    for _ in range(3):  # the chart settles with the line: what was cut off no longer tilts it
        uv = chart_points(points, normals)
        rows = clean_rows(points, uv, reading.table.spacing)
        points, sherds, normals = points[rows], sherds[rows], normals[rows]
    uv = chart_points(points, normals)
    area = signed_area(uv)
    if -outward * area < LEAST_AREA * reading.thickness**2 or len(crossings(uv)):
        return None
    turn = slice(None, None, -1 if area < 0 else 1)
    if outward > 0 and _cut_off_at_foot(cycle, points, reading):
        return HoleEdge(cycle.points[turn], cycle.sherds[turn], cycle.normals[turn])
    return HoleEdge(points[turn], sherds[turn])


def _cut_off_at_foot(cycle: Cycle, kept: Floats, reading: Reading) -> bool:
    """Whether cleaning, from above, cut off what runs down a foot ring and up again.

    kept  (k, 3) the points that were left of the line
    """
    if reading.axis is None or not reading.closed.any():
        return False
    height = reading.axis.cylindrical(reading.table.centres)[:, 2]
    low, high = np.quantile(height, [0.001, 0.999])
    cut = cKDTree(kept).query(cycle.points)[0] > 0.0
    at_foot = np.flatnonzero(cut & (reading.axis.cylindrical(cycle.points)[:, 2] < low + FOOT * (high - low)))
    reach = LEAST_CUT * reading.thickness
    i, j = cKDTree(cycle.points[at_foot]).query_pairs(reach, output_type="ndarray").T
    # the sides of a ring look away from each other; those of a hair along a crack look the same way
    against = np.einsum("ij,ij->i", cycle.normals[at_foot[i]], cycle.normals[at_foot[j]]) < AGAINST
    return len(at_foot) * reading.table.spacing > reach and len(np.unique(i[against])) > FEW_AGAINST


def _partner(outer: Cycle, inner: list[Cycle], reading: Reading) -> HoleEdge | None:
    """The edge on the inner wall that runs along the one on the outer wall."""
    tree = cKDTree(outer.points)
    best: tuple[float, HoleEdge | None] = (3.0 * reading.thickness, None)
    for cycle in inner:
        distance = float(np.median(tree.query(cycle.points)[0]))
        if distance < best[0] and 0.4 < cycle.length / outer.length < 2.5:
            edge = _edge(cycle, reading, outward=-1.0)
            best = (distance, edge) if edge is not None else best
    return best[1]

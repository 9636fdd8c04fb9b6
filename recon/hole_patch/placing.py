"""Does the piece fit between its neighbours, and from which side can it be set in?

In place a piece may cut into a sherd, or leave a gap; on its way in it may be held by its fracture. All of it is
measured on the meshes, so that one knows before printing what has to be shaved off.

    gap              overlap               on the way
    ___  ____        ____                  ___    _____    the piece moved along w in steps; what it claims
    ___||____        __|_|__                   \\ /        together with the neighbours, at the worst of them
    sherd piece        |____               _____\\_
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from threadpoolctl import threadpool_limits

from recon.geometry.arrays import frozen_floats
from recon.geometry.mesh import TriangleMesh
from recon.hole_patch.insertion import (
    CONTACT,
    OPPOSED,
    ROUGH,
    Passage,
    Way,
    best_way,
    outward_direction,
    passage_between,
    signed_distances,
)
from recon.hole_patch.settling import Settling
from recon.numerics.distance import TriangleTree
from recon.numerics.halfedges import vertex_normals
from recon.numerics.overlap import FacePoints, Solid, face_points, solid

__all__ = ["Neighbour", "Placing", "place", "scans_tolerance"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

TOLERANCE = 0.05  # mm: a fracture is rough, and no direction is perfectly free
MISFIT = 3.0  # times the median distance between settled neighbours, which 2 % of a normal law go beyond to one side
DOUBTFUL = 2.0  # tolerances: a wall read one row of faces wrong cuts in three to ten times as deep
ROUNDING = 1e-6  # mm
FEWEST = 10  # points that face a neighbour, of which a share means something
REACH = 3.0  # mm: a sherd farther away is no neighbour
SPACING, MOST_POINTS = 0.4, 20_000  # mm between points on the fracture, and how many a large piece may have
POSITIONS = 12  # on the way, at which the overlap is measured; closer together near the place


@dataclass(frozen=True)
class Neighbour:
    """How the piece lies beside one sherd.

    sherd          its number among the sherds given
    gap_mm         least distance, or, where the two cut into each other, minus the greatest depth: that of a crumb, or
                   of noise, which takes even the lost piece itself a tenth into its neighbours
    usual_gap_mm   what all but `ROUGH` of the fracture that faces the sherd keep of it, negative inside it; None where
                   no fracture faces it
    overlap_mm3    volume that both claim; None where the sherd or the piece is no closed mesh
    overlap_share  the same as a share of the piece's volume
    """

    sherd: int
    gap_mm: float
    usual_gap_mm: float | None
    overlap_mm3: float | None
    overlap_share: float | None


@dataclass(frozen=True, eq=False)
class Placing:
    """Whether a piece fits.

    neighbours         the sherds near it, in the order given
    insert_direction   (3,) unit vector along which the piece moves when it is set in; None where no fracture of a
                       neighbour faces it
    from_inside        the piece is set in from the vessel's inside
    undercut_mm        greatest depth, across that direction, by which the fracture is held on its way, its depth in
                       place included: what has to be shaved off; None without a direction
    held_share         share of the fracture that is held by more than the tolerance; None without a direction
    held_by            sherds to be set in after the piece: along that direction the others let it pass
    worst_overlap_mm3  greatest volume that piece and neighbours both claim, in place or on the way
    tolerance_mm       depth that counts as none
    collision_free     all but `ROUGH` of the fracture, and the overlap by its mean depth over it, stay within the
                       tolerance in place and on the way
    notes              sentences for the report
    """

    neighbours: tuple[Neighbour, ...]
    insert_direction: Floats | None
    from_inside: bool
    undercut_mm: float | None
    held_share: float | None
    held_by: tuple[int, ...]
    worst_overlap_mm3: float | None
    tolerance_mm: float
    collision_free: bool | None
    notes: tuple[str, ...] = field(default=())

    @property
    def usual_gap_mm(self) -> float | None:
        """The least of the neighbours' usual gaps; None where no fracture faces the piece."""
        return min((n.usual_gap_mm for n in self.neighbours if n.usual_gap_mm is not None), default=None)

    @property
    def cuts_in(self) -> bool:
        """Whether some neighbour's fracture lies deeper in the piece than roughness and scatter explain."""
        return _or_nothing(self.usual_gap_mm) < -DOUBTFUL * self.tolerance_mm

    def __post_init__(self) -> None:
        if self.insert_direction is not None:
            direction = frozen_floats(self.insert_direction, (3,), "placing: insert_direction")
            object.__setattr__(self, "insert_direction", direction)


def place(piece: TriangleMesh, sherds: Sequence[TriangleMesh], *, tolerance: float = TOLERANCE) -> Placing:
    """Measure how a closed piece lies between its neighbours, and how it can be set in.

    piece      closed, in place, in millimetres
    sherds     in pose, closed or open outer walls; those farther than `REACH` are passed over
    tolerance  millimetres of undercut that do not count as a collision
    Promises   never fails on a mesh that is not closed: what needs a volume is None then, and the notes say so. Sets
               in from outside where it can; from inside only where that halves the undercut.
    """
    # small products: threads of the linear algebra library would wait for each other
    with threadpool_limits(limits=1, user_api="blas"):
        return _placing(piece, sherds, tolerance)


def scans_tolerance(settling: Settling | None) -> float:
    """Millimetres by which two fractures of the same crack cut into each other as the sherds are scanned and placed."""
    if settling is None or not np.isfinite(settling.gap_after):
        return TOLERANCE
    return max(TOLERANCE, MISFIT * settling.gap_after)


def _placing(piece: TriangleMesh, sherds: Sequence[TriangleMesh], tolerance: float) -> Placing:
    body = solid(piece.vertices, piece.face_vertices)
    spacing = max(SPACING, float(np.sqrt(np.linalg.norm(piece.area_vectors(), axis=1).sum() / MOST_POINTS)))
    points = face_points(piece.vertices, piece.face_vertices, spacing)
    around = cKDTree(points.places)
    reachable = (_reachable(k, sherd, around, spacing) for k, sherd in enumerate(sherds))
    near = [one for one in reachable if one is not None]
    tree = TriangleTree(piece.vertices, piece.face_vertices)
    neighbours = tuple(_neighbour(one, points, body, tree) for one in near)
    notes = _notes_on_closedness(body, near)
    passage = passage_between(points, [(one.mesh, one.normals) for one in near], spacing) if near else None
    if passage is None:
        notes.append("No fracture of a sherd faces the piece: the direction to set it in is unknown.")
        unknown = _total(neighbours)
        return Placing(neighbours, None, False, None, None, (), unknown, tolerance, None, tuple(notes))
    way = best_way(passage, outward_direction(points.places, sherds), tolerance)
    worst = max((_overlap_at(body, near, way, t) for t in _positions(passage, way)), default=None, key=_or_nothing)
    allowed = tolerance * passage.area()
    held_by = tuple(near[k].sherd for k in way.held_by)
    notes += _notes_on_way(way, neighbours, held_by)
    return Placing(
        neighbours,
        -way.direction,
        way.from_inside,
        way.undercut,
        way.held,
        held_by,
        worst,
        tolerance,
        way.free and _or_nothing(worst) <= allowed,
        tuple(notes),
    )


class _Near(NamedTuple):
    """The part of a sherd within reach of the piece, and its inside as a whole."""

    sherd: int
    mesh: TriangleMesh
    normals: Floats
    points: FacePoints
    solid: Solid | None

    def distance(self, points: FacePoints) -> Floats:
        """(n,) distance of each point of the piece to the sherd's points, infinite beyond `REACH`."""
        return np.asarray(cKDTree(self.points.places).query(points.places, distance_upper_bound=REACH)[0])


def _reachable(number: int, sherd: TriangleMesh, around: cKDTree, spacing: float) -> _Near | None:
    """None where nothing of the sherd comes within `REACH` of the piece, of which `around` holds points."""
    low, high = around.mins - REACH, around.maxes + REACH
    corners = sherd.corners()
    close = np.flatnonzero(((corners.max(axis=1) > low) & (corners.min(axis=1) < high)).all(axis=1))
    middles = corners[close].mean(axis=1)
    reach = REACH + spacing + np.linalg.norm(corners[close] - middles[:, None], axis=2).max(axis=1, initial=0.0)
    close = close[around.query(middles)[0] < reach] if len(close) else close
    if len(close) == 0:
        return None
    normals = vertex_normals(sherd.vertices, sherd.face_vertices)[np.unique(sherd.face_vertices[close])]
    mesh = sherd.part(close)
    points = face_points(mesh.vertices, mesh.face_vertices, spacing)
    if len(points.places) == 0 or around.query(points.places, distance_upper_bound=REACH)[0].min() >= REACH:
        return None
    return _Near(number, mesh, normals, points, solid(sherd.vertices, sherd.face_vertices))


def _neighbour(near: _Near, points: FacePoints, body: Solid | None, piece: TriangleTree) -> Neighbour:
    tree = TriangleTree(near.mesh.vertices, near.mesh.face_vertices)
    if body is None or near.solid is None:
        return Neighbour(near.sherd, _least_gap(near, points, tree, piece), _usual_gap(near, points, tree), None, None)
    common = body.common(near.solid)
    volume = max(common.volume, 0.0)
    if volume <= 1e-9 * body.volume:
        least = _least_gap(near, points, tree, piece)
        return Neighbour(near.sherd, least, _usual_gap(near, points, tree, deepest=0.0), 0.0, 0.0)
    depth = _depth(common, tree, piece)
    return Neighbour(near.sherd, -depth, _usual_gap(near, points, tree, deepest=depth), volume, volume / body.volume)


def _usual_gap(near: _Near, points: FacePoints, sherd: TriangleTree, *, deepest: float = np.inf) -> float | None:
    """Over the piece's points that have the sherd's fracture before them, each for its share of its face's area.

    deepest  depth that no point exceeds: what seems deeper lies outside, behind a far side of the sherd
    """
    away, other = cKDTree(near.points.places).query(points.places, distance_upper_bound=CONTACT)
    close = np.flatnonzero(away < CONTACT)
    facing = close[np.einsum("ij,ij->i", points.normals[close], near.points.normals[other[close]]) < OPPOSED]
    if len(facing) < FEWEST:
        return None
    gap = signed_distances(sherd, near.mesh, near.normals, points.places[facing])
    gap = np.where(gap < -(deepest + ROUNDING), -gap, gap)
    order = np.argsort(gap)
    total = np.cumsum(points.areas[facing][order])
    return float(gap[order[np.searchsorted(total, ROUGH * total[-1])]])


def _least_gap(near: _Near, points: FacePoints, sherd: TriangleTree, piece: TriangleTree) -> float:
    """From the points of each on the other; only those that may be nearest are measured."""
    away = near.distance(points)
    back = cKDTree(points.places).query(near.points.places, distance_upper_bound=REACH)[0]
    slack = away.min() + 2.0 * SPACING
    one = sherd.closest(points.places[away <= slack]).distances.min()
    two = piece.closest(near.points.places[back <= slack]).distances.min(initial=np.inf)
    return float(min(one, two))


def _depth(common: Solid, sherd: TriangleTree, piece: TriangleTree) -> float:
    """Greatest distance across what two solids share: its points lie on one of them, and so far from the other."""
    vertices, faces = common.mesh()
    places = np.concatenate([vertices, face_points(vertices, faces, SPACING).places])
    return float(np.maximum(sherd.closest(places).distances, piece.closest(places).distances).max())


def _positions(passage: Passage, way: Way) -> Floats:
    """(POSITIONS + 1,) lengths of the way out, from place to just free of the fracture."""
    return passage.travel(way.direction) * np.linspace(0.0, 1.0, POSITIONS + 1) ** 2


def _overlap_at(body: Solid | None, near: list[_Near], way: Way, length: float) -> float | None:
    """Volume that the moved piece and the neighbours both claim; None where no volume is known."""
    solids = [one.solid for one in near if one.solid is not None]
    if body is None or not solids:
        return None
    moved = body.moved(length * way.direction)
    return sum(max(moved.common(other).volume, 0.0) for other in solids)


def _or_nothing(value: float | None) -> float:
    return 0.0 if value is None else value


def _total(neighbours: tuple[Neighbour, ...]) -> float | None:
    known = [one.overlap_mm3 for one in neighbours if one.overlap_mm3 is not None]
    return sum(known) if known else None


def _notes_on_closedness(body: Solid | None, near: list[_Near]) -> list[str]:
    if body is None:
        return ["The piece is no closed mesh: overlaps were not measured."]
    open_ones = [str(one.sherd) for one in near if one.solid is None]
    if not open_ones:
        return []
    which = f"Sherd {open_ones[0]} is" if len(open_ones) == 1 else f"Sherds {', '.join(open_ones)} are"
    return [f"{which} not closed: only the gap was measured there, not the overlap."]


def _notes_on_way(way: Way, neighbours: tuple[Neighbour, ...], held_by: tuple[int, ...]) -> list[str]:
    notes = []
    if way.from_inside:
        notes.append("The piece is set in from the vessel's inside: check that it passes through the mouth.")
    if held_by:
        in_place = max([0.0, *(-one.gap_mm for one in neighbours)])
        which = "sherd" if len(held_by) == 1 else "sherds"
        notes.append(
            f"No direction is free: on its best way the piece is held over {way.held:.0%} of its fracture, by up to"
            f" {way.undercut:.2f} mm, and in place it cuts up to {in_place:.2f} mm into its neighbours: shave that off,"
            f" or set {which} {', '.join(map(str, held_by))} in after it."
        )
    return notes

"""The way in: the direction along which a piece slides between its neighbours, and by how much it is held there.

A fracture is rough, so that no direction is perfectly free. Directions are sorted by the normals of the fracture, the
best of them are tried by moving points of the fracture, and the one that is chosen is measured on the triangles.

      w ^   __________       _________
        |             \\_   _/              the hole is narrower above than below: a point p of the piece,
        |             / p ' \\              moved along w, comes to lie inside the neighbour; its depth there,
        |   _________/_______\\________     measured across w, is the undercut that must be shaved off

w           unit vector along which the piece leaves; it is set in along -w
p, n        point of the piece's fracture and its normal there, out of the piece; n·w > 0 moves into the neighbour
q           nearest point of the neighbours' surface
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from recon.geometry.mesh import TriangleMesh
from recon.numerics.distance import TriangleTree, barycentric
from recon.numerics.overlap import FacePoints, face_points

__all__ = [
    "CONTACT",
    "OPPOSED",
    "ROUGH",
    "Passage",
    "Way",
    "best_way",
    "outward_direction",
    "passage_between",
    "signed_distances",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

REACH = 3.0  # mm: how deep a point may be in a neighbour and still be found there
CONTACT = 1.0  # mm: a sherd is misplaced by less, and a wall is thicker
OPPOSED = -0.3  # cosine between the normals of two fractures that face each other
FACING = 0.2  # of the points near a sherd; fewer look at its fracture where only its outer wall was scanned
HALF_ANGLE = np.radians(60.0)  # of the cone of directions that are tried
DIRECTIONS, KEPT = 400, 16  # on the whole sphere, and how many of the cone are swept
TURNS = np.radians([8.0, 4.0, 2.0])  # by which the best direction is improved
DRAFT = 0.02  # mm of undercut that are worth a draft from 0 to 90 degrees
UPRIGHT = 0.5  # least cosine between a foot's way and the normal there
STEEP = 0.3  # least sine between w and the normal of a wall that can be shaved across w
SEARCHED, SWEPT = 500, 4000  # points of the fracture that are moved to search a direction, and to judge it
FINEST = 60  # steps of the way, when it is short
ROUGH = 0.02  # of a fracture: crumbs and chips, which come off with the fingers
EXAMINED = 3000  # points that go deepest by the quick test, measured exactly


class Passage(NamedTuple):
    """What slides along what.

    fracture   points of the piece that see a neighbour's fracture before them
    wall       points of the neighbours' fractures that face it, and a tree of them
    mesh       the neighbours in one mesh, and (V, 3) normals of its vertices
    owner      (F,) the neighbour that each of its faces is of, by its place among them
    facing     numbers of the faces that are those fractures
    spacing    between the points, in millimetres
    """

    fracture: FacePoints
    wall: FacePoints
    wall_tree: cKDTree
    mesh: TriangleMesh
    normals: Floats
    owner: Ints
    facing: Ints
    spacing: float

    def area(self) -> float:
        """Of the fractures that face the piece."""
        return float(np.linalg.norm(self.mesh.area_vectors()[self.facing], axis=1).sum())

    def with_points(self, most: int) -> "Passage":
        """Fewer points of the fracture, evenly chosen."""
        every = -(-len(self.fracture.places) // most)
        return self._replace(fracture=self.fracture.of(np.arange(0, len(self.fracture.places), every)))

    def travel(self, direction: Floats) -> float:
        """How far the piece moves until its lowest point is above the fractures that face it."""
        return self.top(direction) - float((self.fracture.places @ direction).min())

    def top(self, direction: Floats) -> float:
        return float((self.mesh.vertices[self.mesh.face_vertices[self.facing]] @ direction).max())


def passage_between(points: FacePoints, near: Sequence[tuple[TriangleMesh, Floats]], spacing: float) -> Passage | None:
    """The fractures of a piece and its neighbours; None where hardly any point of the piece sees a fracture before it.

    points   all over the piece
    near     meshes, all within reach of the piece, each with the normals (V, 3) of its vertices
    spacing  between points, in millimetres
    """
    mesh, normals, owner = _joined(near)
    wall = face_points(mesh.vertices, mesh.face_vertices, spacing)
    away, other = cKDTree(wall.places).query(points.places, distance_upper_bound=CONTACT)
    touching = np.flatnonzero(away <= CONTACT)
    opposed = np.einsum("ij,ij->i", points.normals[touching], wall.normals[other[touching]]) < OPPOSED
    if opposed.sum() < max(FACING * len(touching), 10):
        return None
    back, mate = cKDTree(points.places).query(wall.places, distance_upper_bound=CONTACT)
    seen = np.flatnonzero(back <= CONTACT)
    seen = seen[np.einsum("ij,ij->i", wall.normals[seen], points.normals[mate[seen]]) < OPPOSED]
    facing = np.unique(wall.faces[seen])
    # without the rims of the fracture: a point below one would be nearer to the outer wall than to what holds it
    held_by = wall.of(np.isin(wall.faces, facing))
    fracture = points.of(touching[opposed])
    return Passage(fracture, held_by, cKDTree(held_by.places), mesh, normals, owner, facing, spacing)


class Way(NamedTuple):
    """A direction in which the piece leaves, and by how much it is held.

    undercut     greatest depth of the fracture in a neighbour on the way, across the direction, in millimetres
    mean, held   mean of that depth over the fracture, and the share where it exceeds the tolerance
    held_by      the neighbours, by their places, without which the way is free
    from_inside  the direction is not on the side of the vessel's outside
    """

    direction: Floats
    undercut: float
    mean: float
    held: float
    held_by: tuple[int, ...]
    from_inside: bool

    @property
    def free(self) -> bool:
        """Whether nothing is held but crumbs."""
        return self.held <= ROUGH


def best_way(passage: Passage, outward: Floats, tolerance: float) -> Way:
    """The direction on the outside that holds the piece least; one on the inside only where that halves the mean depth.

    outward    (3,) unit vector
    tolerance  undercut in millimetres that does not count
    """
    outside = _way(passage, _searched(passage, outward), tolerance)
    if outside.free:
        return outside
    inside = _way(passage, _searched(passage, -outward), tolerance)._replace(from_inside=True)
    return inside if inside.mean < 0.5 * outside.mean else outside


def outward_direction(places: Floats, sherds: Sequence[TriangleMesh]) -> Floats:
    """The direction in which the piece is thinnest, pointing away from the middle of all sherds."""
    middle = places.mean(axis=0)
    thin = np.linalg.svd((places - middle)[:: max(1, len(places) // 5000)], full_matrices=False)[2][2]
    inside = np.concatenate([sherd.vertices for sherd in sherds]).mean(axis=0)
    return np.asarray(thin if thin @ (middle - inside) >= 0.0 else -thin)


def _searched(passage: Passage, middle: Floats) -> Floats:
    """The direction near `middle` that holds the piece least: by normals first, then by sweeps, then turned a little.

    n·w <= 0 for all normals means free in the small; how deep a wall with n·w > 0 goes only the sweep can tell.
    """
    coarse = passage.with_points(SEARCHED)
    cone = _sphere(DIRECTIONS)
    cone = np.concatenate([middle[None], cone[cone @ middle > np.cos(HALF_ANGLE)]])
    held = np.maximum(coarse.fracture.normals @ cone.T, 0.0).mean(axis=0)
    tried = cone[np.argsort(held, kind="stable")[:KEPT]]
    costs = [_cost(coarse, w) for w in tried]
    best, cost = tried[int(np.argmin(costs))], min(costs)
    for angle in TURNS:
        for w in _beside(best, float(angle)):
            if (turned := _cost(coarse, w)) < cost:
                best, cost = w, turned
    return np.asarray(best)


def _sphere(n: int) -> Floats:
    """(n, 3) unit vectors spread evenly: Fibonacci's lattice."""
    k = np.arange(n) + 0.5
    height, angle = 1.0 - 2.0 * k / n, np.pi * (1.0 + np.sqrt(5.0)) * k
    across = np.sqrt(1.0 - height**2)
    return np.stack([across * np.cos(angle), across * np.sin(angle), height], axis=1)


def _beside(direction: Floats, angle: float) -> Floats:
    """(6, 3) directions turned by an angle."""
    first = np.cross(direction, np.eye(3)[np.argmin(np.abs(direction))])
    first /= np.linalg.norm(first)
    turn = np.arange(6)[:, None] * np.pi / 3
    aside = np.cos(turn) * first + np.sin(turn) * np.cross(direction, first)
    return np.cos(angle) * direction + np.sin(angle) * aside


def _cost(passage: Passage, direction: Floats) -> float:
    """Undercut in millimetres, root mean square over the fracture; among free directions the one with the most draft.

    The mean would go by the volume in the way, but stay the same when one side gains what the other loses.
    """
    draft = np.quantile(passage.fracture.normals @ direction, 0.95)
    deepest = _swept(passage, direction, 2.0 * passage.spacing).deepest()
    return float(np.sqrt(np.mean(deepest**2)) + DRAFT * draft)


class _Swept(NamedTuple):
    """Positions (m, 3) on the way, how deep each is (m,), and the number (m,) of the nearest face or -1; (k,) the first
    position of each point.
    """

    places: Floats
    depth: Floats
    faces: Ints
    first: Ints

    def deepest(self) -> Floats:
        """(k,) how deep each point comes on its way."""
        return np.asarray(np.maximum.reduceat(self.depth, self.first))


def _swept(passage: Passage, direction: Floats, step: float) -> _Swept:
    """The fracture's points on their way, and how deep they are, by the plane at q.

    Each point moves up to the highest level of the fracture that faces it. A depth counts across the direction, and
    only where q's neighbourhood lies beside the point: beyond the rim of a wall nothing holds.
    """
    level = passage.fracture.places @ direction
    count = np.maximum((passage.top(direction) - level) / step, 0.0).astype(np.int64) + 1
    row = np.repeat(np.arange(len(count)), count)
    first = np.cumsum(count) - count
    way = step * (np.arange(len(row)) - first[row])
    places = passage.fracture.places[row] + way[:, None] * direction
    away, near = passage.wall_tree.query(places, distance_upper_bound=REACH)
    found = np.flatnonzero(np.isfinite(away))
    normal = passage.wall.normals[near[found]]
    off = places[found] - passage.wall.places[near[found]]
    height = np.einsum("ij,ij->i", off, normal)
    aside = np.linalg.norm(off - height[:, None] * normal, axis=1)
    across = np.sqrt(np.maximum(1.0 - (normal @ direction) ** 2, 0.0))
    beside = (across > STEEP) & (aside < 2.0 * passage.spacing)
    depth = np.zeros(len(places))
    depth[found[beside]] = np.maximum(-height[beside] / across[beside], 0.0)
    faces = np.full(len(places), -1)
    faces[found] = passage.wall.faces[near[found]]
    return _Swept(places, depth, faces, first)


def _way(passage: Passage, direction: Floats, tolerance: float) -> Way:
    """How the fracture is held along a direction: by the quick test all over, at its deepest on the triangles."""
    travel = passage.travel(direction)
    step = float(np.clip(travel / FINEST, 0.25 * passage.spacing, passage.spacing))
    swept = _swept(passage.with_points(SWEPT), direction, step)
    deepest = swept.deepest()
    undercut = _undercut(passage, direction, swept)
    held_by = _held_by(passage, swept, tolerance)
    return Way(direction, undercut, float(deepest.mean()), float((deepest > tolerance).mean()), held_by, False)


def _held_by(passage: Passage, swept: _Swept, tolerance: float) -> tuple[int, ...]:
    """The neighbours that hold most, until the others hold no more than crumbs."""
    point = np.repeat(np.arange(len(swept.first)), np.diff(swept.first, append=len(swept.depth)))
    deep = swept.depth > tolerance
    holds = np.zeros((len(swept.first), int(passage.owner.max()) + 1), dtype=bool)
    holds[point[deep], passage.owner[swept.faces[deep]]] = True
    held_by: list[int] = []
    while holds.any(axis=1).mean() > ROUGH:
        held_by.append(int(holds.sum(axis=0).argmax()))
        holds[:, held_by[-1]] = False
    return tuple(sorted(held_by))


def _undercut(passage: Passage, direction: Floats, swept: _Swept) -> float:
    """The greatest depth on the way, in millimetres, where the quick test and the triangles agree."""
    candidates = np.argsort(-swept.depth)[:EXAMINED]
    candidates = candidates[swept.depth[candidates] > 0.0]
    if len(candidates):
        mesh = passage.mesh
        tree = TriangleTree(mesh.vertices, mesh.face_vertices)
        behind = signed_distances(tree, mesh, passage.normals, swept.places[candidates]) < 0.0
        candidates = candidates[behind]
    if len(candidates) == 0:
        return 0.0
    facing = passage.mesh.part(passage.facing)
    closest = TriangleTree(facing.vertices, facing.face_vertices).closest(swept.places[candidates])
    vectors = facing.area_vectors()[closest.faces]
    slope = vectors @ direction / np.maximum(np.linalg.norm(vectors, axis=1), 1e-300)
    measured = closest.distances / np.maximum(np.sqrt(1.0 - np.minimum(slope**2, 1.0)), STEEP)
    return float(np.minimum(measured, swept.depth[candidates]).max())


def signed_distances(tree: TriangleTree, mesh: TriangleMesh, normals: Floats, places: Floats) -> Floats:
    """(m,) distances of places near a surface, negative behind it, by the normals of its vertices at the foot point.

    tree     of the mesh, whose vertices have the normals (V, 3)
    Unlike the normal of a face they give the right side at edges too, where several faces are equally near. A foot on
    the border, where the sherd was cut off, lies sideways and says nothing: the distance is positive then.
    """
    closest = tree.closest(places)
    corners = mesh.face_vertices[closest.faces]
    weight = barycentric(closest.points, mesh.vertices[corners])
    normal = np.einsum("ij,ijk->ik", weight, normals[corners])
    height = np.einsum("ij,ij->i", places - closest.points, normal)
    behind = height < -UPRIGHT * closest.distances * np.linalg.norm(normal, axis=1)
    return np.where(behind, -closest.distances, closest.distances)


def _joined(near: Sequence[tuple[TriangleMesh, Floats]]) -> tuple[TriangleMesh, Floats, Ints]:
    """All parts in one mesh, with the normals of its vertices, and the part of each face."""
    first = np.cumsum([0] + [mesh.n_vertices for mesh, _ in near])
    faces = np.concatenate([mesh.face_vertices + k for (mesh, _), k in zip(near, first)])
    joined = TriangleMesh(np.concatenate([mesh.vertices for mesh, _ in near]), faces, "neighbours")
    owner = np.repeat(np.arange(len(near)), [mesh.n_faces for mesh, _ in near])
    return joined, np.concatenate([normals for _, normals in near]), owner

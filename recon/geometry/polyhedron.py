"""Solids with planar faces, holes in faces, inner voids and several bodies; and triangle meshes turned into them."""

from dataclasses import dataclass
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from recon.errors import BadGeometry, NotManifold
from recon.geometry.arrays import frozen_floats, frozen_ints
from recon.geometry.mesh import TriangleMesh

__all__ = ["PlanarFace", "Polyhedron", "merge_coplanar", "mesh_bodies"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
SHIFT = 5.0  # tolerances a corner may move to where its planes meet; planes that meet at a low angle would move it far


@dataclass(frozen=True)
class PlanarFace:
    """Vertex numbers of a planar face: `outer` counter-clockwise seen from outside, each hole clockwise."""

    outer: tuple[int, ...]
    holes: tuple[tuple[int, ...], ...] = ()

    @property
    def loops(self) -> tuple[tuple[int, ...], ...]:
        return (self.outer, *self.holes)


@dataclass(frozen=True, eq=False)
class Polyhedron:
    """Bodies bounded by planar faces.

    vertices  (V, 3)
    faces     planar faces, seen from outside the material
    bodies    for each body its shells as face numbers: the outer shell first, then the shells of its voids
    Raises  BadGeometry when a number is out of range, a loop is too short, or a face belongs to no shell or to two.
    """

    vertices: NDArray[np.float64]
    faces: tuple[PlanarFace, ...]
    bodies: tuple[tuple[tuple[int, ...], ...], ...]

    def __post_init__(self) -> None:
        vertices = frozen_floats(self.vertices, (None, 3), "polyhedron: vertices")
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "faces", tuple(self.faces))
        object.__setattr__(self, "bodies", tuple(tuple(tuple(shell) for shell in body) for body in self.bodies))
        corners = list(chain.from_iterable(loop for face in self.faces for loop in face.loops))
        frozen_ints(corners, (None,), "polyhedron: corners of faces")
        for i, face in enumerate(self.faces):
            for loop in face.loops:
                if len(set(loop)) < 3 or min(loop) < 0 or max(loop) >= len(vertices):
                    raise BadGeometry(
                        "polyhedron",
                        f"face {i} has a loop of fewer than three vertices, or names one that does not exist",
                    )
        used = sorted(f for body in self.bodies for shell in body for f in shell)
        if used != list(range(len(self.faces))):
            raise BadGeometry("polyhedron", "each face must belong to exactly one shell")

    def mirrored(self, axis: int, at: float) -> "Polyhedron":
        """The mirror image in the plane across a coordinate axis."""
        vertices = self.vertices.copy()
        vertices[:, axis] = 2 * at - vertices[:, axis]
        faces = tuple(PlanarFace(f.outer[::-1], tuple(hole[::-1] for hole in f.holes)) for f in self.faces)
        return Polyhedron(vertices, faces, self.bodies)


def mesh_bodies(mesh: TriangleMesh) -> list[tuple[Ints, ...]]:
    """Face numbers of every body of a closed mesh: its outer shell first, then the shells of its voids.

    Raises  NotManifold naming a place, when the mesh is open, an edge has more than two faces, two faces disagree about
            what is outside, a body is turned inside out, or bodies overlap.
    """
    from recon.numerics.closed_mesh import nested_shells, opposite_halfedges
    from recon.numerics.halfedges import connected_components

    if not mesh.n_faces:
        raise NotManifold(mesh.name, "has no faces")
    opposite_halfedges(mesh.vertices, mesh.face_vertices, mesh.name)
    shell = connected_components(mesh.face_vertices)
    return [tuple(np.flatnonzero(shell == s) for s in body) for body in nested_shells(mesh.corners(), shell, mesh.name)]


def triangle_polyhedron(mesh: TriangleMesh) -> Polyhedron:
    """A closed triangle mesh as a polyhedron with one face a triangle.

    Raises  NotManifold as `mesh_bodies` does.
    """
    faces = tuple(PlanarFace((a, b, c)) for a, b, c in mesh.face_vertices.tolist())
    bodies = tuple(tuple(tuple(shell.tolist()) for shell in body) for body in mesh_bodies(mesh))
    return Polyhedron(mesh.vertices, faces, bodies)


def merge_coplanar(mesh: TriangleMesh, tolerance: float) -> Polyhedron:
    """A closed triangle mesh as a polyhedron: coplanar triangles become one face, vertices on straight edges go.

    tolerance  length: how far vertices may lie from the plane of their face, and dropped ones from their edge
    Promises   the same bodies and voids; every remaining vertex is one of the mesh's, moved by no more than a few
               tolerances onto the planes that meet there, or not at all where it lies on them already.
    Raises     NotManifold as `mesh_bodies` does, or where the mesh is thinner than the tolerance.
    """
    from recon.numerics.closed_mesh import opposite_halfedges
    from recon.numerics.coplanar import coplanar_regions, corner_vertices, meet_planes, region_loops, region_planes

    vertices, triangles = mesh.vertices, mesh.face_vertices
    bodies = mesh_bodies(mesh)
    twin = opposite_halfedges(vertices, triangles, mesh.name)
    region = coplanar_regions(vertices, triangles, twin, tolerance)
    cycles = region_loops(twin, region)
    owner = np.array([region[cycle[0] // 3] for cycle in cycles])
    rows = [triangles.ravel()[cycle] for cycle in cycles]
    corner = corner_vertices(vertices, rows, tolerance)
    loops = [row[corner[row]] for row in rows]
    planes = region_planes(mesh.corners(), region)
    incidence = np.concatenate(loops), np.repeat(owner, [len(loop) for loop in loops])
    points = meet_planes(vertices, incidence, planes, SHIFT * tolerance)
    used, renumbered = np.unique(incidence[0], return_inverse=True)
    cuts = np.cumsum([len(loop) for loop in loops])[:-1]
    faces = _planar_faces(points[used], np.split(renumbered, cuts), (owner, planes[0]), mesh.name)
    shells = tuple(tuple(_regions_of(shell, region) for shell in body) for body in bodies)
    for shell, members in zip(chain(*shells), chain(*bodies)):
        if len(shell) < 4:  # fewer planes enclose nothing
            where = vertices[triangles[members[0], 0]].tolist()
            raise NotManifold(mesh.name, "a body or void is thinner than the tolerance", where)
    return Polyhedron(points[used], faces, shells)


def _regions_of(members: Ints, region: Ints) -> tuple[int, ...]:
    return tuple(int(r) for r in np.unique(region[members]))


def _planar_faces(points: Floats, loops: list[Ints], owners: tuple[Ints, Floats], name: str) -> tuple[PlanarFace, ...]:
    """One face a region, from its loops and its normal; loops that touch themselves come apart where they do."""
    owner, normals = owners
    simple = [(part, r) for loop, r in zip(loops, owner.tolist()) for part in _simple_loops(loop.tolist())]
    areas = _double_areas(points, [part for part, _ in simple], normals[[r for _, r in simple]])
    outer: list[tuple[int, ...] | None] = [None] * len(normals)
    holes: list[list[tuple[int, ...]]] = [[] for _ in normals]
    for (loop, r), area in zip(simple, areas.tolist()):
        if len(loop) < 3 or area == 0 or (area > 0 and outer[r] is not None):
            raise NotManifold(name, "is thinner than the tolerance, or folds over itself,", points[loop[0]].tolist())
        if area > 0:
            outer[r] = loop
        else:
            holes[r].append(loop)
    return tuple(_face(o, tuple(h), points, name) for o, h in zip(outer, holes))


def _face(outer: tuple[int, ...] | None, holes: tuple[tuple[int, ...], ...], points: Floats, name: str) -> PlanarFace:
    if outer is None:
        where = points[holes[0][0]].tolist() if holes else None
        raise NotManifold(name, "is thinner than the tolerance, or folds over itself,", where)
    return PlanarFace(outer, holes)


def _simple_loops(loop: list[int]) -> list[tuple[int, ...]]:
    """A loop cut at the vertices that it visits more than once."""
    if len(set(loop)) == len(loop):
        return [tuple(loop)]
    simple: list[tuple[int, ...]] = []
    path: list[int] = []
    for vertex in loop:
        if vertex in path:
            start = path.index(vertex)
            simple.append(tuple(path[start:]))
            del path[start:]
        path.append(vertex)
    return [*simple, tuple(path)]


def _double_areas(points: Floats, loops: list[tuple[int, ...]], normals: Floats) -> Floats:
    """(L,) twice the area of every loop seen along its normal: positive when it runs counter-clockwise."""
    size = np.array([len(loop) for loop in loops])
    start = np.cumsum(size) - size
    row = np.concatenate([np.array(loop) for loop in loops])
    following = np.arange(1, len(row) + 1)
    following[start + size - 1] = start
    arm = points[row] - np.repeat(points[row[start]], size, axis=0)
    around = np.add.reduceat(np.cross(arm, arm[following]), start, axis=0)
    return np.asarray(np.einsum("ij,ij->i", around, normals))

"""A control mesh of quadrilaterals: triangles in pairs, two by two.

    o-------o-------o          o-------o-------o       every triangle takes one neighbour, the flattest and squarest
    | \\     | \\     |          |       |       |       pairs first; those left over are paired along paths on which
    |   \\   |   \\   |   -->    |       |       |       pairs are exchanged. A closed mesh always has such a pairing:
    |     \\ |     \\ |          |       |       |       every triangle has three neighbours and no edge is a bridge.
    o-------o-------o          o-------o-------o

Pairs do not reach over creases. Where these, or a border, leave triangles over, strips are cut from one to the next
(`quad_splits`).

Paper  [petersen1891], the pairing exists; [edmonds1965], paths, trees and flowers that find it.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from recon.geometric_fit.initial_mesh import NoControlMesh
from recon.geometric_fit.quad_splits import inset, with_quads_only
from recon.geometric_fit.quad_turns import faces_wanted, turned_to_even_valences
from recon.geometric_fit.refinement import split_sides
from recon.geometry.control_mesh import ControlMesh
from recon.numerics.halfedges import free_edges, opposite_sides
from recon.subdivision.sheets import VertexKind, cut_along_creases

__all__ = ["initial_quads", "paired", "without_doublets"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

SPLITS = 4  # rounds in which triangles at creases are split
BENT = 0.5  # what a right angle between the two triangles of a pair costs, beside a corner that is right angle off


def initial_quads(
    triangles: Callable[[int], ControlMesh],
    n_vertices: int,
    *,
    evened: Callable[[ControlMesh], ControlMesh] = turned_to_even_valences,
) -> ControlMesh:
    """A quadrilateral control mesh of at most `n_vertices`, its creases marked.

    triangles  makes a triangle control mesh of at most so many vertices
    evened     makes valences, and perhaps spacing, of quadrilaterals even
    Raises     NoControlMesh.
    """
    count = n_vertices
    while count >= 4:
        mesh = with_room_at_creases(triangles(count))
        quads, left = paired(mesh)
        found = without_doublets(mesh, quads) if len(left) == 0 else _with_strips(mesh, quads, left)
        found = with_smooth_creases(evened(found))
        if found.n_vertices <= n_vertices:
            return evened(found)
        count = int(0.98 * count * n_vertices / found.n_vertices)
    raise NoControlMesh(f"no mesh of quadrilaterals with {n_vertices} control points was found; ask for more.")


def _with_strips(mesh: ControlMesh, quads: Ints, left: Ints) -> ControlMesh:
    """The mesh with triangles left over joined by strips."""
    faces = [*quads.tolist(), *mesh.faces_of(3)[left].tolist()]
    creases, marked = mesh.crease_edges, mesh.corner_vertices
    mixed = ControlMesh.from_faces(mesh.vertices, faces, crease_edges=creases, corner_vertices=marked)
    cut = with_quads_only(mixed)
    return without_doublets(cut, cut.faces_of(4))


def with_room_at_creases(mesh: ControlMesh) -> ControlMesh:
    """The triangles split so that three lie on each side of a smooth crease at every vertex, as far as that goes.

    Fewer would become a single quadrilateral there.
    """
    for _ in range(SPLITS):
        sheets, _ = cut_along_creases(mesh, 3)
        faces, flat = sheets.faces, sheets.faces.ravel()
        counts = np.bincount(flat, minlength=len(sheets.kinds))
        narrow = (sheets.kinds == VertexKind.BORDER) & (counts < 3)
        opposite = (np.arange(faces.size) // 3) * 3 + (np.arange(faces.size) % 3 + 1) % 3
        wanted = np.flatnonzero(narrow[flat] & (sheets.across.ravel()[opposite] >= 0))
        if len(wanted) == 0:
            break
        ends = np.stack([mesh.faces_of(3), np.roll(mesh.faces_of(3), -1, axis=1)], axis=2).reshape(-1, 2)
        x = mesh.vertices[ends[opposite[wanted]]]
        order = np.lexsort((-np.linalg.norm(x[:, 1] - x[:, 0], axis=1), flat[wanted]))
        _, first = np.unique(flat[wanted][order], return_index=True)
        mesh = split_sides(mesh, opposite[wanted[order[first]]])
    return mesh


def with_smooth_creases(mesh: ControlMesh) -> ControlMesh:
    """The mesh with a quadrilateral put into one at every vertex that has too few: no tangent plane would be there."""
    sheets, behind = cut_along_creases(mesh, 4)
    count = np.bincount(sheets.faces.ravel(), minlength=len(sheets.kinds))
    _, least = faces_wanted(sheets, mesh.vertices[behind])
    vertices, first = np.unique(sheets.faces, return_index=True)
    return inset(mesh, np.unique(first[count[vertices] < least[vertices]] // 4))


def paired(mesh: ControlMesh) -> tuple[Ints, Ints]:
    """(Q, 4) quadrilaterals of pairs of triangles, and (T,) the triangles left over."""
    faces = mesh.faces_of(3)
    n = mesh.n_vertices
    across = opposite_sides(faces)
    ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2), axis=2)
    creases = np.sort(mesh.crease_edges, axis=1)
    across[np.isin(ends[..., 0] * n + ends[..., 1], creases[:, 0] * n + creases[:, 1])] = -1
    mate = _greedy(faces, across, mesh.vertices, _needed(mesh))
    neighbours = np.where(across >= 0, across // 3, -1)
    _augment(neighbours, mate)
    first = np.flatnonzero(mate > np.arange(len(faces)))
    side = (neighbours[first] == mate[first, None]).argmax(axis=1)
    other = across[first, side]
    tip = faces[other // 3, (other % 3 + 2) % 3]
    corners = [faces[first, (side + k) % 3] for k in (0, 1, 2)]
    return np.stack([corners[0], tip, corners[1], corners[2]], axis=1), np.flatnonzero(mate < 0)


def _needed(mesh: ControlMesh) -> Bools:
    """(F, 3) sides that should stay: between the only two triangles that a crease or border runs smoothly past."""
    sheets, _ = cut_along_creases(mesh, 3)
    counts = np.bincount(sheets.faces.ravel(), minlength=len(sheets.kinds))
    single = (sheets.kinds == VertexKind.BORDER) & (counts == 2)
    ends = np.stack([sheets.faces, np.roll(sheets.faces, -1, axis=1)], axis=2)
    return np.asarray(single[ends].any(axis=2) & (sheets.across >= 0))


def _greedy(faces: Ints, across: Ints, vertices: Floats, needed: Bools) -> Ints:
    """(F,) the mate of each triangle, -1 without one; best pairs first, those over needed sides (F, 3) last."""
    face, side = np.nonzero(across > 3 * np.arange(len(faces))[:, None] + np.arange(3))
    other = across[face, side]
    tip = faces[other // 3, (other % 3 + 2) % 3]
    quads = np.stack([faces[face, side], tip, faces[face, (side + 1) % 3], faces[face, (side + 2) % 3]], axis=1)
    badness = _badness(vertices[quads])
    order = np.lexsort((badness, needed[face, side]))
    mate = np.full(len(faces), -1)
    for one, two in zip(face[order].tolist(), (other[order] // 3).tolist()):
        if mate[one] < 0 and mate[two] < 0:
            mate[one], mate[two] = two, one
    return mate


def _badness(corners: Floats) -> Floats:
    """(n,) how far quadrilaterals (n, 4, 3) are from flat rectangles: the worst corner's cosine, and the bend."""
    out = np.roll(corners, -1, axis=1) - corners
    out /= np.maximum(np.linalg.norm(out, axis=2, keepdims=True), 1e-300)
    back = -np.roll(out, 1, axis=1)
    normals = np.cross(out, back)
    one, two = normals[:, 1], normals[:, 3]
    bend = np.einsum("ij,ij->i", one, two) / np.maximum(np.linalg.norm(one, axis=1) * np.linalg.norm(two, axis=1), 1e-9)
    # a corner that turns the other way, seen from the sum of the normals, is worse than any
    facing = np.einsum("nkj,nj->nk", normals, normals.sum(axis=1))
    cosine = np.abs(np.einsum("nkj,nkj->nk", out, back))
    return np.where(facing > 0, cosine, 2.0).max(axis=1) + BENT * (1.0 - bend)


def _augment(neighbours: Ints, mate: Ints) -> None:
    """Edmonds' search from every face without a mate: along a path of exchanges to another one, `mate` in place."""
    around = [[face for face in row if face >= 0] for row in neighbours.tolist()]
    mates = mate.tolist()
    for root in np.flatnonzero(mate < 0).tolist():
        if mates[root] < 0:
            _Search(around, mates, root).run()
    mate[:] = mates


class _Search:
    """One search: a tree of exchanges that grows from a root; odd rings in it, the flowers, count as one face.

    parent  the face before, for faces that an exchange reaches
    base    where the flower of a face hangs on the tree
    """

    def __init__(self, around: list[list[int]], mates: list[int], root: int) -> None:
        self._around, self._mates, self._root = around, mates, root
        self._parent: dict[int, int] = {}
        self._base: dict[int, int] = {}
        self._queue, self._used = [root], {root}

    def run(self) -> None:
        """Exchange along the first path found; nothing changes where there is none."""
        end = self._end()
        while end is not None:
            before = self._parent[end]
            following = self._mates[before]
            self._mates[end], self._mates[before] = before, end
            end = following if following >= 0 else None

    def _end(self) -> int | None:
        mates, parent = self._mates, self._parent
        for face in self._queue:
            for to in self._around[face]:
                if self._based(face) == self._based(to) or mates[face] == to:
                    continue
                if to == self._root or (mates[to] >= 0 and mates[to] in parent):
                    self._close_flower(face, to)
                elif to not in parent:
                    parent[to] = face
                    if mates[to] < 0:
                        return to
                    self._reach(mates[to])
        return None

    def _based(self, face: int) -> int:
        return self._base.get(face, face)

    def _reach(self, face: int) -> None:
        if face not in self._used:
            self._used.add(face)
            self._queue.append(face)

    def _close_flower(self, one: int, two: int) -> None:
        stem = self._meeting(one, two)
        petals: set[int] = set()
        self._mark(one, stem, two, petals)
        self._mark(two, stem, one, petals)
        for face in [*self._parent, *self._used]:
            if self._based(face) in petals:
                self._base[face] = stem
                self._reach(face)

    def _meeting(self, one: int, two: int) -> int:
        """Where the paths of two faces back to the root first meet."""
        seen = set()
        while True:
            one = self._based(one)
            seen.add(one)
            if self._mates[one] < 0:
                break
            one = self._parent[self._mates[one]]
        while (two := self._based(two)) not in seen:
            two = self._parent[self._mates[two]]
        return two

    def _mark(self, face: int, stem: int, child: int, petals: set[int]) -> None:
        """Mark the bases from a face down to the stem of its flower, and let its paths run both ways."""
        while self._based(face) != stem:
            petals |= {self._based(face), self._based(self._mates[face])}
            self._parent[face] = child
            child = self._mates[face]
            face = self._parent[child]


def without_doublets(mesh: ControlMesh, quads: Ints) -> ControlMesh:
    """Two quadrilaterals around one vertex become one; then all that is left, renumbered.

    On a border two are as they should be.
    """
    held = np.union1d(np.union1d(mesh.crease_edges, mesh.corner_vertices), free_edges(quads))
    while True:
        count = np.bincount(quads.ravel(), minlength=mesh.n_vertices)
        lone = np.setdiff1d(np.flatnonzero(count == 2), held)
        touched, gone, changed = np.zeros(len(quads), dtype=bool), np.zeros(len(quads), dtype=bool), quads.copy()
        for vertex in lone.tolist():
            one, two = np.flatnonzero((quads == vertex).any(axis=1)).tolist()
            at = quads[one].tolist().index(vertex)
            far = np.setdiff1d(quads[two], quads[one])
            # with three corners in common the two lie back to back
            if touched[[one, two]].any() or len(far) != 1 or len(np.intersect1d(quads[one], quads[two])) != 3:
                continue
            changed[one, at] = far[0]
            touched[[one, two]], gone[two] = True, True
        if not gone.any():
            break
        quads = changed[~gone]
    used, renumbered = np.unique(quads, return_inverse=True)
    number = np.full(mesh.n_vertices, -1)
    number[used] = np.arange(len(used))
    return ControlMesh.from_faces(
        mesh.vertices[used],
        renumbered.reshape(-1, 4).astype(np.int64),
        crease_edges=number[mesh.crease_edges],
        corner_vertices=number[mesh.corner_vertices],
    )

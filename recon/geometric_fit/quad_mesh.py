"""A control mesh of quadrilaterals: triangles in pairs, two by two.

    o-------o-------o          o-------o-------o       every triangle takes one neighbour, the flattest and squarest
    | \\     | \\     |          |       |       |       pairs first; those left over are paired along paths on which
    |   \\   |   \\   |   -->    |       |       |       pairs are exchanged. A closed mesh always has such a pairing:
    |     \\ |     \\ |          |       |       |       every triangle has three neighbours and no edge is a bridge.
    o-------o-------o          o-------o-------o

Pairs do not reach over creases. Where these, or a border, leave triangles over, a mesh of a quarter is taken and
every face, three- or four-sided, is cut into quadrilaterals from its middle.

Paper  [petersen1891], the pairing exists; [edmonds1965], paths, trees and flowers that find it.
"""

from collections.abc import Callable

import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.geometric_fit.initial_mesh import NoControlMesh
from recon.geometry.control_mesh import ControlMesh
from recon.numerics.halfedges import opposite_sides

__all__ = ["initial_quads", "paired"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

BENT = 0.5  # what a right angle between the two triangles of a pair costs, beside a corner that is right angle off


def initial_quads(triangles: Callable[[int], ControlMesh], n_vertices: int) -> ControlMesh:
    """A quadrilateral control mesh of at most `n_vertices`, its creases marked.

    triangles  makes a triangle control mesh of at most so many vertices
    Raises     NoControlMesh.
    """
    mesh = triangles(n_vertices)
    quads, left = paired(mesh)
    if len(left) == 0:
        return _without_doublets(mesh, quads)
    count = n_vertices // 4
    while count >= 4:
        mesh = triangles(count)
        cut = _cut_from_middles(mesh, *paired(mesh))
        if cut.n_vertices <= n_vertices:
            return cut
        count = int(0.95 * count * n_vertices / cut.n_vertices)
    raise NoControlMesh(f"no mesh of quadrilaterals with {n_vertices} control points was found; ask for more.")


def paired(mesh: ControlMesh) -> tuple[Ints, Ints]:
    """(Q, 4) quadrilaterals of pairs of triangles, and (T,) the triangles left over."""
    faces = mesh.faces_of(3)
    n = mesh.n_vertices
    across = opposite_sides(faces)
    ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2), axis=2)
    creases = np.sort(mesh.crease_edges, axis=1)
    across[np.isin(ends[..., 0] * n + ends[..., 1], creases[:, 0] * n + creases[:, 1])] = -1
    mate = _greedy(faces, across, mesh.vertices)
    neighbours = np.where(across >= 0, across // 3, -1)
    _augment(neighbours, mate)
    first = np.flatnonzero(mate > np.arange(len(faces)))
    side = (neighbours[first] == mate[first, None]).argmax(axis=1)
    other = across[first, side]
    tip = faces[other // 3, (other % 3 + 2) % 3]
    corners = [faces[first, (side + k) % 3] for k in (0, 1, 2)]
    return np.stack([corners[0], tip, corners[1], corners[2]], axis=1), np.flatnonzero(mate < 0)


def _greedy(faces: Ints, across: Ints, vertices: Floats) -> Ints:
    """(F,) the mate of each triangle, -1 without one; best pairs first."""
    face, side = np.nonzero(across > 3 * np.arange(len(faces))[:, None] + np.arange(3))
    other = across[face, side]
    tip = faces[other // 3, (other % 3 + 2) % 3]
    quads = np.stack([faces[face, side], tip, faces[face, (side + 1) % 3], faces[face, (side + 2) % 3]], axis=1)
    order = np.argsort(_badness(vertices[quads]), kind="stable")
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


@njit(cache=True)
def _augment(neighbours: Ints, mate: Ints) -> None:
    """Edmonds' search from every face without a mate: along a path of exchanges to another one, `mate` in place."""
    n = len(mate)
    parent, base = np.full(n, -1), np.arange(n)
    used, blossom = np.zeros(n, dtype=np.bool_), np.zeros(n, dtype=np.bool_)
    queue, seen = np.empty(n, dtype=np.int64), np.zeros(n, dtype=np.bool_)
    for root in range(n):
        if mate[root] >= 0:
            continue
        parent[:], used[:], base[:] = -1, False, np.arange(n)
        used[root], queue[0] = True, root
        head, tail, end = 0, 1, -1
        while head < tail and end < 0:
            v = queue[head]
            head += 1
            for to in neighbours[v]:
                if to < 0 or base[v] == base[to] or mate[v] == to:
                    continue
                if to == root or (mate[to] >= 0 and parent[mate[to]] >= 0):
                    stem = _common_base(v, to, mate, base, parent, seen)
                    blossom[:] = False
                    _mark_path(v, stem, to, mate, base, parent, blossom)
                    _mark_path(to, stem, v, mate, base, parent, blossom)
                    for i in range(n):
                        if blossom[base[i]]:
                            base[i] = stem
                            if not used[i]:
                                used[i], queue[tail] = True, i
                                tail += 1
                elif parent[to] < 0:
                    parent[to] = v
                    if mate[to] < 0:
                        end = to
                        break
                    used[mate[to]], queue[tail] = True, mate[to]
                    tail += 1
        while end >= 0:
            before = parent[end]
            following = mate[before]
            mate[end], mate[before] = before, end
            end = following


@njit(cache=True)
def _common_base(a: int, b: int, mate: Ints, base: Ints, parent: Ints, seen: NDArray[np.bool_]) -> int:
    """Where the paths of two faces back to the root first meet."""
    seen[:] = False
    while True:
        a = base[a]
        seen[a] = True
        if mate[a] < 0:
            break
        a = parent[mate[a]]
    while True:
        b = base[b]
        if seen[b]:
            return b
        b = parent[mate[b]]


@njit(cache=True)
def _mark_path(v: int, stem: int, child: int, mate: Ints, base: Ints, parent: Ints, blossom: NDArray[np.bool_]) -> None:
    """Mark the bases from v down to the stem of a flower, and let its paths run both ways."""
    while base[v] != stem:
        blossom[base[v]] = blossom[base[mate[v]]] = True
        parent[v] = child
        child = mate[v]
        v = parent[mate[v]]


def _without_doublets(mesh: ControlMesh, quads: Ints) -> ControlMesh:
    """Two quadrilaterals around one vertex become one; then all that is left, renumbered."""
    held = np.union1d(mesh.crease_edges, mesh.corner_vertices)
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


def _cut_from_middles(mesh: ControlMesh, quads: Ints, left: Ints) -> ControlMesh:
    """Every face cut into one quadrilateral a corner, by its middle and those of its sides."""
    faces = [quads, mesh.faces_of(3)[left]]
    n = mesh.n_vertices
    ends = np.concatenate([np.stack([f, np.roll(f, -1, axis=1)], axis=2).reshape(-1, 2) for f in faces])
    edges, number = np.unique(np.sort(ends, axis=1), axis=0, return_inverse=True)
    number = number.ravel()
    middles, cut, first = [mesh.vertices, mesh.vertices[edges].mean(axis=1)], [], 0
    centre = n + len(edges)
    for f in faces:
        k = f.shape[1]
        side = n + number[first : first + f.size].reshape(f.shape)
        first += f.size
        middle = np.repeat(centre + np.arange(len(f))[:, None], k, axis=1)
        centre += len(f)
        cut.append(np.stack([f, side, middle, np.roll(side, 1, axis=1)], axis=2).reshape(-1, 4))
        middles.append(mesh.vertices[f].mean(axis=1))
    creases = np.sort(mesh.crease_edges, axis=1)
    known = np.flatnonzero(np.isin(edges[:, 0] * n + edges[:, 1], creases[:, 0] * n + creases[:, 1]))
    halves = np.concatenate([np.stack([edges[known, i], n + known], axis=1) for i in (0, 1)])
    return ControlMesh.from_faces(
        np.concatenate(middles), np.concatenate(cut), crease_edges=halves, corner_vertices=mesh.corner_vertices
    )

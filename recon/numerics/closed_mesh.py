"""Closed triangle meshes: which half-edge lies opposite which, and which shell is a void in which body.

             b                 half-edge h = 3 f + k runs from face_vertices[f, k] to face_vertices[f, (k + 1) % 3]
           / ^ \\
         /  h|  \\              twin[h] is the same edge on the other face, the other way round
       c     |t   d
         \\   |  /              shell   faces joined over edges
           \\ v /               void    a shell turned inside out, within the material of another
             a
"""

import numpy as np
from numpy.typing import NDArray

from recon.errors import NotManifold

__all__ = ["opposite_halfedges", "shell_volumes", "nested_shells", "winding_number"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def opposite_halfedges(vertices: Floats, face_vertices: Ints, what: str = "mesh") -> Ints:
    """(3 F,) the half-edge that runs the other way along the same edge.

    Raises  NotManifold naming a place, when an edge belongs to one face, to more than two, or to two that disagree
            about which side is out.
    """
    start, end = face_vertices.ravel(), np.roll(face_vertices, -1, axis=1).ravel()
    key = np.minimum(start, end) * len(vertices) + np.maximum(start, end)
    order = np.argsort(key, kind="stable")
    first = np.flatnonzero(np.diff(key[order], prepend=-1))
    uses = np.diff(np.append(first, len(key)))
    if (uses != 2).any():
        edge = int(np.argmax(uses != 2))
        _refuse_edge(vertices[[start[order[first[edge]]], end[order[first[edge]]]]], int(uses[edge]), what)
    left, right = order[first], order[first + 1]
    same_way = start[left] == start[right]
    if same_way.any():
        h = left[np.argmax(same_way)]
        raise NotManifold(
            what,
            f"at {int(same_way.sum())} edges both faces run in the same direction, so that inside and outside cannot "
            "be told apart; the first is",
            vertices[[start[h], end[h]]].mean(axis=0),
        )
    twin = np.empty(len(key), dtype=np.int64)
    twin[left], twin[right] = right, left
    return twin


def _refuse_edge(ends: Floats, uses: int, what: str) -> None:
    if uses == 1:
        raise NotManifold(what, "is open: an edge belongs to one face only; close the hole", ends.mean(axis=0))
    raise NotManifold(what, f"an edge belongs to {uses} faces where two are allowed", ends.mean(axis=0))


def shell_volumes(corners: Floats, shell: Ints) -> Floats:
    """(S,) signed volume of every shell from the (F, 3, 3) corner points of its faces; negative for a void."""
    a, b, c = (corners - corners.reshape(-1, 3).mean(axis=0)).transpose(1, 0, 2)
    return np.bincount(shell, weights=np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0).astype(np.float64)


def nested_shells(corners: Floats, shell: Ints, what: str = "mesh") -> list[tuple[int, ...]]:
    """Shells grouped to bodies: the number of each outer shell, followed by those of its voids.

    corners  (F, 3, 3) corner points of the faces of closed shells
    Raises   NotManifold naming a place, when a shell is inside out without lying in a body, or two bodies overlap.
    """
    volume = shell_volumes(corners, shell)
    order = np.argsort(shell, kind="stable")
    faces = np.split(order, np.flatnonzero(np.diff(shell[order])) + 1)
    boxes = np.array([(corners[f].min(axis=(0, 1)), corners[f].max(axis=(0, 1))) for f in faces])
    around = [_shells_around(s, corners, faces, boxes) for s in range(len(volume))]
    bodies: dict[int, list[int]] = {s: [s] for s in np.flatnonzero(volume > 0).tolist()}
    for s, outside in enumerate(around):
        inside = sum(1 if volume[o] > 0 else -1 for o in outside)
        if inside != (volume[s] <= 0):
            problem = "a body is turned inside out" if volume[s] <= 0 else "a body lies in the material of another"
            raise NotManifold(what, problem, corners[faces[s][0], 0])
        if volume[s] <= 0:
            bodies[min((o for o in outside if volume[o] > 0), key=lambda o: float(volume[o]))].append(s)
    return [tuple(body) for body in bodies.values()]


def _shells_around(s: int, corners: Floats, faces: list[Ints], boxes: Floats) -> list[int]:
    """Shells that contain shell `s`, whichever way they are turned; boxes (S, 2, 3) are the shells' extents."""
    mine = corners[faces[s]]
    probe = mine[np.argmax(_double_areas(mine))].mean(axis=0)  # of the largest face: hardly on another shell
    near = ((boxes[:, 0] <= probe) & (probe <= boxes[:, 1])).all(axis=1)
    near[s] = False
    return [o for o in np.flatnonzero(near).tolist() if abs(winding_number(probe, corners[faces[o]])) > 0.5]


def _double_areas(corners: Floats) -> Floats:
    return np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)


def winding_number(point: Floats, corners: Floats) -> float:
    """How often closed faces, (F, 3, 3) corner points, wind around a (3,) point: 1 inside, 0 outside.

    Paper  [vanoosterom1983], the solid angle of a triangle.
    """
    a, b, c = (corners - point).transpose(1, 0, 2)
    la, lb, lc = (np.linalg.norm(x, axis=1) for x in (a, b, c))
    ab, bc, ca = (np.einsum("ij,ij->i", x, y) for x, y in ((a, b), (b, c), (c, a)))
    numerator = np.einsum("ij,ij->i", a, np.cross(b, c))
    denominator = la * lb * lc + ab * lc + bc * la + ca * lb
    return float(np.arctan2(numerator, denominator).sum() / (2.0 * np.pi))

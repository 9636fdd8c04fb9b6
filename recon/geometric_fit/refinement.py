"""Where the control mesh gets its points: edges split where the error is, edges flipped toward even valences.

    split: an edge of a bad face, both its faces with it         flip: R = sum (d - d_opt)^2 goes down

          c                 c                                          c              c
        /   \\             / | \\                                      /   \\          / | \\
       a-----b    -->    a--m--b                                    a-----b  -->   a  |  b
        \\   /             \\ | /                                      \\   /          \\ | /
          d                 d                                          d              d

d_opt is 6 inside and 4 on the border. Between sharp edges, where even valences make slivers, edges flip toward the
Delaunay triangulation instead. Neighbours stay whole, so the mesh conforms after every step. Creases are never
flipped, and stay creases when split.

sharp   (F, 3) whether a side is a crease;     fixed   sides that no flip may touch: creases and borders

Paper  [maekawa2009], refinement and flips.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.geometric_fit.side_walks import cosine, join, next_side, previous_side, share_a_face
from recon.geometry.control_mesh import ControlMesh
from recon.numerics.halfedges import opposite_sides

__all__ = ["flip_to_delaunay", "flip_to_even_valences", "split_faces", "split_sides"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

MOST_TURN = np.cos(np.radians(40.0))  # between the faces before and after a flip: a crease of the shape stays
WORST_CORNER = np.sin(np.radians(8.0))  # of a face that a flip may make


class _Sides(NamedTuple):
    """A triangle list ready for edits; flat arrays over its 3 F sides."""

    faces: Ints
    across: Ints
    sharp: Bools


def _sides(mesh: ControlMesh) -> _Sides:
    faces = mesh.faces_of(3)
    n = mesh.n_vertices
    ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2), axis=2)
    creases = np.sort(mesh.crease_edges, axis=1)
    sharp = np.isin(ends[..., 0] * n + ends[..., 1], creases[:, 0] * n + creases[:, 1])
    return _Sides(faces.ravel().copy(), opposite_sides(faces).ravel(), sharp.ravel())


def _mesh(vertices: Floats, sides: _Sides, corners: Ints) -> ControlMesh:
    faces = sides.faces.reshape(-1, 3)
    ends = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)
    creases = np.unique(np.sort(ends[sides.sharp], axis=1), axis=0)
    return ControlMesh.from_faces(vertices, faces, crease_edges=creases, corner_vertices=corners)


def flip_to_even_valences(mesh: ControlMesh, *, passes: int = 6) -> ControlMesh:
    """Flip edges while that evens the valences out and neither bends the mesh nor makes slivers."""
    sides = _sides(mesh)
    _flip_all(sides.faces, sides.across, sides.sharp, mesh.vertices, passes, MOST_TURN, WORST_CORNER)
    return _mesh(mesh.vertices, sides, mesh.corner_vertices)


def flip_to_delaunay(mesh: ControlMesh, *, passes: int = 12) -> ControlMesh:
    """Flip edges that see angles of more than two right angles together, where that does not bend the mesh."""
    sides = _sides(mesh)
    _flip_to_delaunay(sides.faces, sides.across, sides.sharp, mesh.vertices, passes, MOST_TURN)
    return _mesh(mesh.vertices, sides, mesh.corner_vertices)


def split_faces(mesh: ControlMesh, worst_first: Ints, n_new: int) -> ControlMesh:
    """Split the longest edge of the given faces, at most `n_new` of them, each face once.

    worst_first  (m,) faces; one whose edge a neighbour has split already is passed over
    Promises     the old vertices keep their numbers; the new ones follow, on the edge masks of Loop's scheme.
    """
    sides = _sides(mesh)
    more, room = 6 * n_new, mesh.n_vertices + n_new
    faces, across = (np.concatenate([part, np.full(more, -1)]) for part in (sides.faces, sides.across))
    sharp = np.concatenate([sides.sharp, np.zeros(more, dtype=np.bool_)])
    vertices = np.concatenate([mesh.vertices, np.empty((n_new, 3))])
    touched = np.zeros(len(faces) // 3, dtype=np.bool_)
    counts = _split_all(faces, across, sharp, vertices, worst_first, touched, (mesh.n_faces, mesh.n_vertices, room))
    n_faces, n_vertices = counts
    grown = _Sides(faces[: 3 * n_faces], across[: 3 * n_faces], sharp[: 3 * n_faces])
    return _mesh(vertices[:n_vertices], grown, mesh.corner_vertices)


def split_sides(mesh: ControlMesh, chosen: Ints) -> ControlMesh:
    """Split the given sides, numbers 3 face + side, in this order; one of a face that was split already is passed over.

    Promises  as of `split_faces`.
    """
    sides = _sides(mesh)
    faces, across = (np.concatenate([part, np.full(6 * len(chosen), -1)]) for part in (sides.faces, sides.across))
    sharp = np.concatenate([sides.sharp, np.zeros(6 * len(chosen), dtype=np.bool_)])
    vertices = np.concatenate([mesh.vertices, np.empty((len(chosen), 3))])
    touched = np.arange(len(faces) // 3) >= mesh.n_faces
    n_faces, n_vertices = mesh.n_faces, mesh.n_vertices
    for side in chosen.tolist():
        pair = [face // 3 for face in (side, int(across[side])) if face >= 0]
        if not touched[pair].any():
            touched[pair] = True
            n_faces = _split(faces, across, sharp, vertices, side, n_faces, n_vertices)
            n_vertices += 1
    grown = _Sides(faces[: 3 * n_faces], across[: 3 * n_faces], sharp[: 3 * n_faces])
    return _mesh(vertices[:n_vertices], grown, mesh.corner_vertices)


@njit(cache=True)
def _area_vector(p: Floats, q: Floats, r: Floats) -> tuple[float, float, float]:
    ax, ay, az = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    bx, by, bz = r[0] - p[0], r[1] - p[1], r[2] - p[2]
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@njit(cache=True)
def _narrowest(p: Floats, q: Floats, r: Floats) -> float:
    """Sine of the smallest corner of a triangle."""
    x, y, z = _area_vector(p, q, r)
    area = np.sqrt(x * x + y * y + z * z)
    longest, middle = 0.0, 0.0
    for s, t in ((p, q), (q, r), (r, p)):
        length = np.sqrt((s[0] - t[0]) ** 2 + (s[1] - t[1]) ** 2 + (s[2] - t[2]) ** 2)
        if length > longest:
            longest, middle = length, longest
        elif length > middle:
            middle = length
    return area / max(longest * middle, 1e-300)


@njit(cache=True)
def _keeps_shape(x: Floats, corners: tuple[int, int, int, int], most_turn: float, worst: float) -> bool:
    """Whether faces a d c and d b c lie like a b c and b a d did, and are no slivers."""
    a, b, c, d = x[corners[0]], x[corners[1]], x[corners[2]], x[corners[3]]
    old_one, old_two = _area_vector(a, b, c), _area_vector(b, a, d)
    new_one, new_two = _area_vector(a, d, c), _area_vector(d, b, c)
    for new in (new_one, new_two):
        if cosine(new, old_one) < most_turn or cosine(new, old_two) < most_turn:
            return False
    narrow = min(_narrowest(a, b, c), _narrowest(b, a, d))
    return min(_narrowest(a, d, c), _narrowest(d, b, c)) >= min(worst, narrow)


@njit(cache=True)
def _ends_and_tips(faces: Ints, side: int, other: int) -> tuple[int, int, int, int]:
    """The ends a, b of an edge, which is a side of two faces, and the tips c, d of these."""
    return faces[side], faces[next_side(side, 3)], faces[previous_side(side, 3)], faces[previous_side(other, 3)]


@njit(cache=True)
def _flip_all(faces: Ints, across: Ints, sharp: Bools, x: Floats, passes: int, most_turn: float, worst: float) -> None:
    """Flip in place, pass after pass, until no edge is left that gains."""
    surplus = np.full(len(x), -6)
    for side in range(len(faces)):
        surplus[faces[side]] += 1
        if across[side] < 0:
            # a border vertex has one edge more than faces, and wants four
            surplus[faces[side]] += 3
    for _ in range(passes):
        flipped = False
        for side in range(len(faces)):
            other = across[side]
            if other < side or sharp[side]:
                continue
            a, b, c, d = _ends_and_tips(faces, side, other)
            # sum of squares: each end goes down by one, each tip up by one
            gain = surplus[a] + surplus[b] - surplus[c] - surplus[d] - 2
            if gain <= 0 or surplus[a] <= -3 or surplus[b] <= -3 or c == d:
                continue
            if share_a_face(faces, across, previous_side(side, 3), d, 3):
                continue
            if not _keeps_shape(x, (a, b, c, d), most_turn, worst):
                continue
            _flip(faces, across, sharp, side)
            surplus[a] -= 1
            surplus[b] -= 1
            surplus[c] += 1
            surplus[d] += 1
            flipped = True
        if not flipped:
            return


@njit(cache=True)
def _cotangent(p: Floats, q: Floats, r: Floats) -> float:
    """Of the angle at r."""
    x, y, z = _area_vector(r, p, q)
    dot = 0.0
    for axis in range(3):
        dot += (p[axis] - r[axis]) * (q[axis] - r[axis])
    return dot / max(np.sqrt(x * x + y * y + z * z), 1e-300)


@njit(cache=True)
def _flip_to_delaunay(faces: Ints, across: Ints, sharp: Bools, x: Floats, passes: int, most_turn: float) -> None:
    """Flip in place, pass after pass, until no edge is left that gains."""
    for _ in range(passes):
        flipped = False
        for side in range(len(faces)):
            other = across[side]
            if other < side or sharp[side]:
                continue
            a, b, c, d = _ends_and_tips(faces, side, other)
            # the angles at both tips make more than two right angles where their cotangents have a negative sum
            if c == d or _cotangent(x[a], x[b], x[c]) + _cotangent(x[a], x[b], x[d]) > -1e-9:
                continue
            if share_a_face(faces, across, previous_side(side, 3), d, 3):
                continue
            if not _keeps_shape(x, (a, b, c, d), most_turn, 0.0):
                continue
            _flip(faces, across, sharp, side)
            flipped = True
        if not flipped:
            return


@njit(cache=True)
def _flip(faces: Ints, across: Ints, sharp: Bools, side: int) -> None:
    """Faces a b c and b a d become a d c and b c d, in the same two places."""
    other = across[side]
    bc, ca, ad, db = next_side(side, 3), previous_side(side, 3), next_side(other, 3), previous_side(other, 3)
    a, b, c, d = faces[side], faces[bc], faces[ca], faces[db]
    beyond = (across[ad], across[ca], across[bc], across[db])
    edged = (sharp[ad], sharp[ca], sharp[bc], sharp[db])
    f, g = side - side % 3, other - other % 3
    faces[f], faces[f + 1], faces[f + 2] = a, d, c
    faces[g], faces[g + 1], faces[g + 2] = b, c, d
    join(across, f, beyond[0])
    join(across, f + 2, beyond[1])
    join(across, g, beyond[2])
    join(across, g + 2, beyond[3])
    across[f + 1], across[g + 1] = g + 1, f + 1
    sharp[f], sharp[f + 2], sharp[g], sharp[g + 2] = edged
    sharp[f + 1] = sharp[g + 1] = False


@njit(cache=True)
def _longest_side(faces: Ints, x: Floats, face: int) -> int:
    best, side = -1.0, 0
    for i in range(3 * face, 3 * face + 3):
        p, q = x[faces[i]], x[faces[next_side(i, 3)]]
        length = (p[0] - q[0]) ** 2 + (p[1] - q[1]) ** 2 + (p[2] - q[2]) ** 2
        if length > best:
            best, side = length, i
    return side


@njit(cache=True)
def _split_all(
    faces: Ints,
    across: Ints,
    sharp: Bools,
    x: Floats,
    worst_first: Ints,
    touched: Bools,
    counts: tuple[int, int, int],
) -> tuple[int, int]:
    """Split in place, in arrays with room; counts are faces, vertices, and the most vertices there may be."""
    n_faces, n_vertices, room = counts
    for face in worst_first:
        if n_vertices == room:
            break
        if touched[face]:
            continue
        side = _longest_side(faces, x, face)
        other = across[side]
        if other >= 0 and touched[other // 3]:
            continue
        touched[face] = True
        if other >= 0:
            touched[other // 3] = True
        n_faces = _split(faces, across, sharp, x, side, n_faces, n_vertices)
        n_vertices += 1
    return n_faces, n_vertices


@njit(cache=True)
def _split(faces: Ints, across: Ints, sharp: Bools, x: Floats, side: int, n_faces: int, m: int) -> int:
    """Put vertex m on an edge; faces a m c, b m d keep their places, m b c and m a d come last; the new face count."""
    other = across[side]
    f = side - side % 3
    bc, ca = next_side(side, 3), previous_side(side, 3)
    a, b, c = faces[side], faces[bc], faces[ca]
    edge_sharp, bc_sharp, ca_sharp = sharp[side], sharp[bc], sharp[ca]
    bc_across, ca_across = across[bc], across[ca]
    new = 3 * n_faces
    x[m] = 0.5 * (x[a] + x[b])
    faces[f], faces[f + 1], faces[f + 2] = a, m, c
    faces[new], faces[new + 1], faces[new + 2] = m, b, c
    join(across, f + 2, ca_across)
    join(across, new + 1, bc_across)
    across[f + 1], across[new + 2] = new + 2, f + 1
    across[f], across[new] = -1, -1
    sharp[f], sharp[f + 1], sharp[f + 2] = edge_sharp, False, ca_sharp
    sharp[new], sharp[new + 1], sharp[new + 2] = edge_sharp, bc_sharp, False
    if other < 0:
        return n_faces + 1
    g = other - other % 3
    ad, db = next_side(other, 3), previous_side(other, 3)
    d = faces[db]
    ad_across, db_across, ad_sharp, db_sharp = across[ad], across[db], sharp[ad], sharp[db]
    last = new + 3
    if not edge_sharp:
        x[m] = 0.375 * (x[a] + x[b]) + 0.125 * (x[c] + x[d])
    faces[g], faces[g + 1], faces[g + 2] = b, m, d
    faces[last], faces[last + 1], faces[last + 2] = m, a, d
    join(across, g + 2, db_across)
    join(across, last + 1, ad_across)
    across[g + 1], across[last + 2] = last + 2, g + 1
    join(across, f, last)
    join(across, new, g)
    sharp[g], sharp[g + 1], sharp[g + 2] = edge_sharp, False, db_sharp
    sharp[last], sharp[last + 1], sharp[last + 2] = edge_sharp, ad_sharp, False
    return n_faces + 2

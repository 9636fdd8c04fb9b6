"""Edges of quadrilaterals turned toward even valences, as flips do for triangles.

    c---b---f          c---b---f          c---b---f       an edge of two quadrilaterals may join any two opposite
    |   |   |          |     / |          | \\     |       corners of the six around both: its ends lose an edge,
    |   |   |   -->    |   /   |    or    |   \\   |       the corners that it joins afterwards get one
    d---a---e          d / a---e          d---a \\ e

R = sum (d - d_opt)^2 over the vertices goes down, d counted in faces. d_opt is 4 inside, 2 on a crease or border that
runs smoothly through, and as many right angles as there are at a corner. On each side of a crease the faces count for
themselves. A smooth crease with a single face on one side has no tangent plane there, so that costs most.

Paper  [bommes2013], valences and singularities of quadrilateral meshes; [maekawa2009], R for triangles.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.geometric_fit.side_walks import cosine, join, next_side, share_a_face
from recon.geometry.control_mesh import ControlMesh
from recon.subdivision.sheets import Sheets, VertexKind, cut_along_creases

__all__ = ["WIDEST", "corner_angles", "faces_wanted", "turned_to_even_valences"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

PASSES = 8
MOST_TURN = np.cos(np.radians(40.0))  # between the two old faces and the new ones: a crease of the shape stays
SHARPEST_CORNER = np.cos(np.radians(25.0))  # of a face that a turn may make, unless an old one was worse
WIDEST = np.radians(150.0)  # corner of a quadrilateral: beyond, the surface hardly has a tangent plane there
TOO_FEW = 50  # what a face too few costs, in the units of R


def turned_to_even_valences(mesh: ControlMesh) -> ControlMesh:
    """Turn edges while that evens the valences out and neither bends the mesh nor makes slivers."""
    sheets, behind = cut_along_creases(mesh, 4)
    wanted, least = faces_wanted(sheets, mesh.vertices[behind])
    faces, across = sheets.faces.ravel().copy(), sheets.across.ravel().copy()
    inside = sheets.kinds == VertexKind.SMOOTH
    _turn_all(faces, across, mesh.vertices[behind], wanted, least, inside)
    return ControlMesh.from_faces(
        mesh.vertices,
        behind[faces.reshape(-1, 4)],
        crease_edges=mesh.crease_edges,
        corner_vertices=mesh.corner_vertices,
    )


def faces_wanted(sheets: Sheets, x: Floats) -> tuple[Ints, Ints]:
    """(W,) the best number of faces around each vertex of the sheets, at x (W, 3), and (W,) the least that will do."""
    faces, kinds = sheets.faces, sheets.kinds
    corners = x[faces]
    out, back = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    angle = np.bincount(faces.ravel(), corner_angles(out, back).ravel(), len(kinds))
    square = np.maximum(np.round(angle / (np.pi / 2.0)), 1).astype(np.int64)
    wanted = np.select([kinds == VertexKind.BORDER, kinds == VertexKind.CORNER], [2, square], 4)
    enough = np.maximum(np.ceil(angle / WIDEST), 1).astype(np.int64)
    least = np.select([kinds == VertexKind.BORDER, kinds == VertexKind.CORNER], [2, enough], 3)
    return wanted, least


def corner_angles(out: Floats, back: Floats) -> Floats:
    """(F, 4) angles between the ways (F, 4, 3) from the corners of faces to the next corners and to those before."""
    lengths = np.linalg.norm(out, axis=2) * np.linalg.norm(back, axis=2)
    cosine = np.einsum("fki,fki->fk", out, back) / np.maximum(lengths, 1e-300)
    return np.asarray(np.arccos(np.clip(cosine, -1.0, 1.0)))


@njit(cache=True)
def _cost(count: int, wanted: int, least: int) -> int:
    return (count - wanted) ** 2 + TOO_FEW * max(least - count, 0)


@njit(cache=True)
def _gain(ends: tuple[int, int, int, int], counts: Ints, wanted: Ints, least: Ints) -> int:
    """What R goes down by when an edge from ends 0 to 1 is turned to run from 2 to 3."""
    gain = 0
    for i in range(4):
        v, change = ends[i], -1 if i < 2 else 1
        gain += _cost(counts[v], wanted[v], least[v]) - _cost(counts[v] + change, wanted[v], least[v])
    return gain


@njit(cache=True)
def _corner_normals(x: Floats, quad: tuple[int, int, int, int], out: Floats) -> float:
    """Normals at the four corners into out (5, 3), their sum last; the largest cosine of a corner."""
    sharpest = 0.0
    out[4] = 0.0
    for i in range(4):
        p, q, r = x[quad[i]], x[quad[(i + 1) % 4]], x[quad[(i + 3) % 4]]
        ax, ay, az = q[0] - p[0], q[1] - p[1], q[2] - p[2]
        bx, by, bz = r[0] - p[0], r[1] - p[1], r[2] - p[2]
        out[i, 0], out[i, 1], out[i, 2] = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        out[4] += out[i]
        lengths = np.sqrt((ax * ax + ay * ay + az * az) * (bx * bx + by * by + bz * bz))
        sharpest = max(sharpest, abs(ax * bx + ay * by + az * bz) / max(lengths, 1e-300))
    for i in range(4):
        if out[i, 0] * out[4, 0] + out[i, 1] * out[4, 1] + out[i, 2] * out[4, 2] <= 0.0:
            return 2.0  # it turns the other way in this corner
    return sharpest


@njit(cache=True)
def _keeps_shape(x: Floats, six: tuple[int, int, int, int, int, int], way: int) -> bool:
    """Whether the two new faces lie like the old ones and have no corner that is sharper than these had."""
    a, b, c, d, e, f = six
    old, new = np.empty((5, 3)), np.empty((5, 3))
    worst = max(_corner_normals(x, (a, b, c, d), old), _corner_normals(x, (b, a, e, f), new))
    mean = old[4] + new[4]
    one, two = ((c, d, a, e), (e, f, b, c)) if way == 0 else ((d, a, e, f), (f, b, c, d))
    for quad in (one, two):
        sharpest = _corner_normals(x, quad, new)
        if sharpest > max(SHARPEST_CORNER, worst) or cosine(new[4], mean) < MOST_TURN:
            return False
    return True


@njit(cache=True)
def _turn(faces: Ints, across: Ints, side: int, way: int) -> None:
    """Faces a b c d and b a e f become c d a e and e f b c, or d a e f and f b c d, in the same two places."""
    other = across[side]
    f0, g0 = side - side % 4, other - other % 4
    ring = np.empty(6, dtype=np.int64)  # sides bc cd da ae ef fb, one after the other around both faces
    at = side
    for i in range(3):
        at = next_side(at, 4)
        ring[i] = at
    at = other
    for i in range(3):
        at = next_side(at, 4)
        ring[3 + i] = at
    starts, beyond = faces[ring].copy(), across[ring].copy()
    for i in range(3):
        one, two = (1 + way + i) % 6, (4 + way + i) % 6
        faces[f0 + i], faces[g0 + i] = starts[one], starts[two]
        join(across, f0 + i, beyond[one])
        join(across, g0 + i, beyond[two])
    faces[f0 + 3], faces[g0 + 3] = starts[(4 + way) % 6], starts[(1 + way) % 6]
    across[f0 + 3], across[g0 + 3] = g0 + 3, f0 + 3


@njit(cache=True)
def _turn_all(faces: Ints, across: Ints, x: Floats, wanted: Ints, least: Ints, inside: Bools) -> None:
    """Turn in place, pass after pass, until no edge is left that gains."""
    counts = np.zeros(len(x), dtype=np.int64)
    for corner in faces:
        counts[corner] += 1
    for _ in range(PASSES):
        turned = False
        for side in range(len(faces)):
            other = across[side]
            if other < side:
                continue
            s1, o1 = next_side(side, 4), next_side(other, 4)
            s2, o2 = next_side(s1, 4), next_side(o1, 4)
            s3, o3 = next_side(s2, 4), next_side(o2, 4)
            a, b, c, d, e, f = faces[side], faces[s1], faces[s2], faces[s3], faces[o2], faces[o3]
            face, beside = side // 4, other // 4
            if beside in (across[s1] // 4, across[s2] // 4, across[s3] // 4) or face == beside:
                continue
            best, way = 0, -1
            for choice in range(2):
                p, q = (c, e) if choice == 0 else (d, f)
                if not (inside[p] or inside[q]) or share_a_face(faces, across, s2 if choice == 0 else s3, q, 4):
                    continue
                gain = _gain((a, b, p, q), counts, wanted, least)
                if gain > best and _keeps_shape(x, (a, b, c, d, e, f), choice):
                    best, way = gain, choice
            if way < 0:
                continue
            p, q = (c, e) if way == 0 else (d, f)
            _turn(faces, across, side, way)
            counts[a] -= 1
            counts[b] -= 1
            counts[p] += 1
            counts[q] += 1
            turned = True
        if not turned:
            return

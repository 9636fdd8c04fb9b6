"""Quadrilaterals ready to become faces of a solid: irregular vertices apart.

    o---o---o---o---o        R   regular: all four corners have the faces of a regular mesh, the limit is bicubic
    | R | R | R | R |        x   a vertex that has not; its quads become caps
    o---o---o---o---o
    | R | c | c | R |        where two such vertices share a quad the mesh is refined once: after it a quad has one at
    o---o---x---o---o        most, and it is put first
    | R | c | c | R |

Paper  [catmull1978]; [peters2000], patches over regular parts and caps between them.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from recon.geometry.control_mesh import ControlMesh
from recon.numerics.halfedges import opposite_sides
from recon.subdivision.catmull_clark import REGULAR_FACES, refine, split_faces
from recon.subdivision.sheets import Sheets, cut_along_creases, fan_corners

__all__ = ["Layout", "irregular_corners", "isolated", "turned_faces"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


class Layout(NamedTuple):
    """A mesh of quads that have one irregular corner at most.

    sheets    cut along creases; an irregular corner is corner 0
    faces     (F, 4) the same quads over vertices that creases do not cut, and `across` (F, 4) their sides across
    points    (W, V) sparse, control points -> points of the sheets' vertices
    regular   (F,) whether no corner is irregular, so that the quad is polynomial
    """

    sheets: Sheets
    faces: Ints
    across: Ints
    points: sparse.csr_array
    regular: Bools


def isolated(mesh: ControlMesh, steps: int = 0) -> Layout:
    """The mesh, refined once where a quad would have two irregular corners, and then so often.

    Raises  BadGeometry when a face is no quadrilateral; NotManifold.
    """
    sheets, behind = cut_along_creases(mesh, 4)
    points = sparse.csr_array(
        (np.ones(len(behind)), behind, np.arange(len(behind) + 1)), shape=(len(behind), mesh.n_vertices)
    )
    beside = opposite_sides(mesh.faces_of(4))
    # two parts that touch in a vertex alone part there
    faces = fan_corners(beside).reshape(beside.shape)
    whole = Sheets(faces, beside, np.zeros(int(faces.max()) + 1, dtype=np.int64))
    irregular = irregular_corners(sheets, REGULAR_FACES)
    while (near := bool((irregular.sum(axis=1) > 1).any())) or steps > 0:
        step, whole = refine(sheets), split_faces(whole)
        sheets, points, steps = step.sheets, sparse.csr_array(step.matrix @ points), steps - (not near)
        irregular = irregular_corners(sheets, REGULAR_FACES)
    turns = irregular.argmax(axis=1)
    turned, across = turned_faces(sheets.faces, sheets.across, turns)
    whole_faces, whole_across = turned_faces(whole.faces, whole.across, turns)
    regular = np.logical_not(irregular.any(axis=1))
    return Layout(Sheets(turned, across, sheets.kinds), whole_faces, whole_across, points, np.asarray(regular))


def irregular_corners(sheets: Sheets, regular_faces: tuple[int, ...]) -> Bools:
    """(F, k) whether the corner has not the faces around it that its kind has in a regular mesh."""
    wanted = np.array(regular_faces)[sheets.kinds]
    irregular = np.bincount(sheets.faces.ravel(), minlength=len(sheets.kinds)) != wanted
    return np.asarray(irregular[sheets.faces])


def turned_faces(faces: Ints, across: Ints, turns: Ints) -> tuple[Ints, Ints]:
    """Faces begun at another corner; the sides across with them."""
    k = faces.shape[1]
    places = (np.arange(k) + turns[:, None]) % k
    other = np.take_along_axis(across, places, axis=1)
    moved = k * (other // k) + (other % k - turns[other // k]) % k
    return np.take_along_axis(faces, places, axis=1), np.where(other < 0, -1, moved)

"""Creases that divide concave corners of sheets, without which Doo-Sabin's surface folds there.

    .-------.-------.          .---.---.---.---.      at a corner c the surface lies in one patch between two sharp
    |       |       |          |   |   |   |   |      edges, whatever the angle: over two right angles it folds. So the
    |       c=======.   -->    .---.---.---.---.      faces around are cut, and short creases # lead from c to the
    |       H                  |   |   #   |   |      middles of edges, which are regular vertices. For the same reason
    .-------.                  .---.###c=======.      creases that end inside a sheet are made to end in such a middle.
                               |   |   H
                               .---.---.

Paper  [doo1978]; [biermann2000], concave corners.
"""

import numpy as np
from numpy.typing import NDArray

from recon.geometric_fit.quad_splits import cut_around
from recon.geometric_fit.quad_turns import WIDEST, corner_angles
from recon.geometry.control_mesh import ControlMesh
from recon.subdivision.limit_surface import Scheme
from recon.subdivision.sheets import Sheets, VertexKind, cut_along_creases

__all__ = ["slit_for", "with_slits"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


def slit_for(mesh: ControlMesh, scheme: Scheme) -> ControlMesh:
    """The mesh as a scheme needs it at concave corners."""
    return with_slits(mesh) if scheme is Scheme.DOO_SABIN else mesh


def with_slits(mesh: ControlMesh) -> ControlMesh:
    """The mesh of quadrilaterals with its concave corners divided, finer around these and around irregular ends of
    creases."""
    sheets, behind = cut_along_creases(mesh, 4)
    concave = behind[_are_wide(sheets, mesh.vertices[behind])]
    n_faces = np.bincount(sheets.faces.ravel(), minlength=len(behind))
    ends = behind[(sheets.kinds == VertexKind.DART) & (n_faces != 4)]
    chosen = np.union1d(concave, ends)
    if len(chosen) == 0:
        return mesh
    fine = cut_around(mesh, chosen)
    is_end = np.zeros(fine.n_vertices, dtype=np.bool_)
    is_end[ends] = fine is not mesh
    creases = fine.crease_edges[~is_end[fine.crease_edges].any(axis=1)]
    slits = np.concatenate([creases, _dividing(fine)])
    return ControlMesh(fine.vertices, fine.face_corners, fine.face_starts, slits, fine.corner_vertices)


def _total_angles(sheets: Sheets, x: Floats) -> Floats:
    """(W,) the angles of all faces around each vertex together; x (W, 3)."""
    corners = x[sheets.faces]
    out, back = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    total = np.zeros(len(sheets.kinds))
    np.add.at(total, sheets.faces, corner_angles(out, back))
    return total


def _are_wide(sheets: Sheets, x: Floats) -> Bools:
    """(W,) which vertices are corners of several faces with more than WIDEST between their sharp edges; x (W, 3)."""
    several = np.bincount(sheets.faces.ravel(), minlength=len(sheets.kinds)) > 1
    return np.asarray((sheets.kinds == VertexKind.CORNER) & several & (_total_angles(sheets, x) > WIDEST))


def _dividing(mesh: ControlMesh) -> Ints:
    """(m, 2) the edges between the faces of wide corners."""
    sheets, behind = cut_along_creases(mesh, 4)
    wide = _are_wide(sheets, mesh.vertices[behind])
    starts, ends = sheets.faces, np.roll(sheets.faces, -1, axis=1)
    inner = (sheets.across >= 0) & wide[starts] & (sheets.kinds[ends] == VertexKind.SMOOTH)
    return np.stack([behind[starts[inner]], behind[ends[inner]]], axis=1)

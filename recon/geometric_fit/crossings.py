"""Surface that cuts itself, drawn smooth bit by bit until it does so no more.

Where the scan has an edge sharper than the control mesh can follow, control points crowd and pass through each other
in loops so small that no angle between triangles shows them. What counts for a solid is that no two triangles of the
surface cut each other; so these are looked for, and the control points that carry them go toward their neighbours'
mean, later with their neighbours.
"""

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from recon.geometric_fit.folding import smoothed_out
from recon.geometric_fit.foot_points import Feet
from recon.geometric_fit.guards import neighbour_means
from recon.geometric_fit.tangent_distance import basis_rows
from recon.geometry.control_mesh import ControlMesh
from recon.geometry.mesh import TriangleMesh
from recon.numerics.halfedges import edge_table
from recon.numerics.near_boxes import near_boxes
from recon.numerics.rows import unit_vectors
from recon.numerics.self_intersection import crossing_triangles
from recon.subdivision.limit_surface import LimitPatches, tessellation_places

__all__ = ["without_crossings"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

HALVINGS, MORE_HALVINGS = 1, 3  # of each patch, into the triangles that are looked at; more where it is bent
BENT = np.cos(np.radians(40.0))  # between two triangles of a patch that is bent
HELD = 0.05  # weight in a crossing triangle from which on a control point is one of those that carry it


def without_crossings(mesh: ControlMesh, patches: LimitPatches) -> ControlMesh:
    """The mesh with its surface freed from cuts through itself; where that fails, with as few as were found."""
    means = neighbour_means(mesh)
    coarse = _Crossings(mesh, patches, HALVINGS, np.ones(len(patches.sheets.faces), dtype=np.bool_))
    points, _ = smoothed_out(mesh.vertices, coarse, means)
    fine = _Crossings(mesh, patches, MORE_HALVINGS, coarse.bent(points))
    points, _ = smoothed_out(points, fine, means)
    return mesh.with_vertices(points)


class _Crossings:
    """Tells as a guard against folds does which control points carry triangles that cut each other.

    halvings  of each patch, into triangles
    chosen    (P,) the patches that are looked at
    """

    def __init__(self, mesh: ControlMesh, patches: LimitPatches, halvings: int, chosen: Bools) -> None:
        patch, v, w, triangles = tessellation_places(patches.sheets, halvings)
        kept = triangles.reshape(len(chosen), -1, 3)[chosen].reshape(-1, 3)
        used, corners = np.unique(kept, return_inverse=True)
        self._triangles, self._n_patches = corners.reshape(-1, 3).astype(np.int64), int(chosen.sum())
        nowhere = np.empty((len(used), 3))
        feet = Feet(patch[used], v[used], w[used], nowhere, nowhere)
        self._rows = basis_rows(patches, feet).matrix(mesh.n_vertices)
        ones, n = np.ones(len(mesh.face_corners)), mesh.n_vertices
        incidence = sparse.csr_array((ones, mesh.face_corners, mesh.face_starts), shape=(mesh.n_faces, n))
        self._around = sparse.csr_array(incidence.T @ incidence)
        self._last: Floats | None = None  # the surface's points at the last look
        self._crossing = np.zeros(len(self._triangles), dtype=np.bool_)  # the triangles that cut others then

    def bent(self, control_points: Floats) -> Bools:
        """(P,) the patches with two neighbouring triangles over BENT apart, where all patches are looked at."""
        drawn = TriangleMesh(self._rows @ control_points, self._triangles)
        normals = unit_vectors(drawn.area_vectors())
        _, one, two = edge_table(self._triangles).face_pairs()
        turned = np.einsum("ij,ij->i", normals[one], normals[two]) < BENT
        found = np.zeros(self._n_patches, dtype=np.bool_)
        found[np.concatenate([one[turned], two[turned]]) // (len(self._triangles) // self._n_patches)] = True
        return found

    def folded(self, control_points: Floats) -> Bools:
        """(V,) the control points that carry triangles which cut each other."""
        drawn = self._rows @ control_points
        looked_at = self._since_last(drawn)
        pairs, _ = crossing_triangles(drawn, self._triangles[looked_at])
        crossing = looked_at[pairs.ravel()]
        self._last, self._crossing = drawn, np.isin(np.arange(len(self._triangles)), crossing)
        carrying = np.zeros(len(control_points), dtype=np.bool_)
        rows = self._rows[np.unique(self._triangles[crossing])]
        carrying[rows.indices[rows.data > HELD]] = True
        return carrying

    def _since_last(self, drawn: Floats) -> Ints:
        """The triangles that may cut others: at first all, then those that moved or did so before, and those near."""
        if self._last is None:
            return np.arange(len(self._triangles))
        moved = (drawn != self._last).any(axis=1)[self._triangles].any(axis=1)
        return np.flatnonzero(near_boxes(drawn[self._triangles], moved | self._crossing))

    def widened(self, control_points: Bools) -> Bools:
        """(V,) these control points and all that share a face with one."""
        return np.asarray(control_points | (self._around @ control_points.astype(np.float64) > 0.0))

"""A control mesh with more points where the error is, its valences even, and no more folds than need be.

Paper  [maekawa2009], step 5; the rest is ours.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.geometric_fit.exact_distances import Seen
from recon.geometric_fit.folding import unfolded
from recon.geometric_fit.quad_splits import refine_quads
from recon.geometric_fit.quad_turns import turned_to_even_valences
from recon.geometric_fit.refinement import flip_to_delaunay, flip_to_even_valences, split_faces
from recon.geometric_fit.scan_data import ScanData
from recon.geometric_fit.settling import Ground, ground_of
from recon.geometric_fit.slits import slit_for
from recon.geometry.control_mesh import ControlMesh
from recon.subdivision.limit_surface import Scheme

__all__ = ["FinerMesh"]

Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

PEAK_SHARE = 0.3  # of the new points go to the largest errors, the others to the largest sums of squares


@dataclass(frozen=True)
class FinerMesh:
    """How the control meshes of a fit to a scan grow, by a scheme."""

    scheme: Scheme
    scan: ScanData

    def grown(self, mesh: ControlMesh, found: Seen, n_new: int) -> Ground:
        """The mesh with so many more control points where the error is, and even valences again.

        Where new points fold the surface for good, faces around are left as they are.
        """
        worst = self._worst_faces(mesh, found, n_new)
        ground = self._with_fewer_folds(*self._split(mesh, worst, n_new))
        folded = _folded_for_good(ground)
        if not folded.any():
            return ground
        corners = mesh.faces_of(int(mesh.face_starts[1]))[worst]
        apart = worst[~np.isin(corners, np.flatnonzero(folded)).any(axis=1)]
        again = self._with_fewer_folds(*self._split(mesh, apart, n_new))
        return again if _folded_for_good(again).sum() < folded.sum() else ground

    def _with_fewer_folds(self, split: ControlMesh, evened: ControlMesh) -> Ground:
        """The second of these meshes, unless the surface folds more there.

        Flips even the valences out, but may fold a surface that was smooth before. Catmull-Clark's surfaces come out of
        such folds in the rounds, and are nearer for even valences.
        """
        flipped = ground_of(evened, self.scheme, self.scan)
        n_folded = flipped.n_folded()
        if n_folded == 0 or self.scheme is Scheme.CATMULL_CLARK:
            return flipped
        del flipped
        plain = ground_of(split, self.scheme, self.scan)
        if n_folded > plain.n_folded():
            return plain
        del plain
        return ground_of(evened, self.scheme, self.scan)

    def _split(self, mesh: ControlMesh, worst: Ints, n_new: int) -> tuple[ControlMesh, ControlMesh]:
        """The worst faces split, by as many points as there are left when corners have become concave; and the same
        with even valences."""
        if self.scheme is Scheme.LOOP:
            split = split_faces(mesh, worst, n_new)
            return split, _flipped(split)
        most = mesh.n_vertices + n_new
        while True:
            split = refine_quads(mesh, worst, n_new)
            evened = turned_to_even_valences(split)
            slit, slit_evened = slit_for(split, self.scheme), slit_for(evened, self.scheme)
            excess = max(slit.n_vertices, slit_evened.n_vertices) - most
            if excess <= 0:
                return slit, slit_evened
            if excess >= n_new:
                return split, evened
            n_new -= excess

    def _worst_faces(self, mesh: ControlMesh, found: Seen, n_new: int) -> Ints:
        n = self.scan.n_measured
        distance, face = found.distances[:n], np.minimum(found.places.patch[:n] // 4, mesh.n_faces - 1)
        largest, squares = np.zeros(mesh.n_faces), np.bincount(face, distance**2, mesh.n_faces)
        np.maximum.at(largest, face, distance)
        n_peaks = int(PEAK_SHARE * n_new)
        order = np.concatenate([np.argsort(-largest, kind="stable")[:n_peaks], np.argsort(-squares, kind="stable")])
        _, first = np.unique(order, return_index=True)
        return order[np.sort(first)]


def _flipped(mesh: ControlMesh) -> ControlMesh:
    """Even valences; between sharp edges no slivers, which fold sooner than uneven valences do harm."""
    return flip_to_delaunay(mesh) if len(mesh.crease_edges) else flip_to_even_valences(mesh)


def _folded_for_good(ground: Ground) -> Bools:
    """(V,) the control points around folds that are left when these have been smoothed out as far as that goes."""
    return ground.guards.folded(unfolded(ground.mesh, ground.guards)[0].vertices)

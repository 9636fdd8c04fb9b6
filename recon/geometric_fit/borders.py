"""What holds the surface to the borders of the scan, and its sharp edges where the scan has them.

The tangent distance lets points slide along the surface. At a border, and on either side of a sharp edge, a residual
along the surface is an error too: the border is too far in, or too far out.

        scan  . . . . .  p             p's foot is on the border: it pulls along the conormal m too, as a
        ______________ /               second data point at the same place with m for its normal
        surface       S --> m
                                       samples of the surface's border want to come to the border of the scan
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from recon.geometric_fit.foot_points import Feet
from recon.geometric_fit.scan_data import ScanData
from recon.geometric_fit.tangent_distance import basis_rows
from recon.geometry.control_mesh import ControlMesh
from recon.subdivision.evaluation import points_at
from recon.subdivision.limit_surface import LimitPatches

__all__ = ["BorderPull", "Borders", "sideways"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

ON_SIDE = 1e-12  # how far inside a place on a side may seem
SHARES = (0.25, 0.75)  # of a border side, where it is sampled


class BorderPull(NamedTuple):
    """Samples of the border of the surface.

    feet     where they are; `normals` point to the border of the scan
    targets  (m, 3) the nearest points of the border of the scan
    """

    feet: Feet
    targets: Floats


class Borders:
    """The border of one control mesh; empty where it, or the scan, is closed."""

    def __init__(self, mesh: ControlMesh, patches: LimitPatches, scan: ScanData) -> None:
        self._scan = scan
        patch, side = _free_sides(patches) if scan.is_open else (np.empty(0, dtype=np.int64),) * 2
        patch, side = (np.repeat(x, len(SHARES)) for x in (patch, side))
        v, w = _on_sides(patches, side, np.resize(np.array(SHARES), len(side)))
        nowhere = np.empty((len(patch), 3))
        self._places = Feet(patch, v, w, nowhere, nowhere)
        self._to_places: sparse.csr_array = basis_rows(patches, self._places).matrix(mesh.n_vertices)

    def pull(self, control_points: Floats) -> BorderPull:
        """Where the samples are, and where they should come to."""
        places = self._to_places @ control_points
        if len(places) == 0:
            return BorderPull(self._places, places)
        found = self._scan.border_tree.closest(places)
        away = found.points - places
        normals = away / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-300)
        return BorderPull(self._places._replace(positions=places, normals=normals), found.points)


def _free_sides(patches: LimitPatches) -> tuple[Ints, Ints]:
    """(m,) patches and (m,) their sides on the border; both sides of a crease, which weigh points alike, are none."""
    patch, side = np.nonzero(patches.arrays.across < 0)
    v, w = _on_sides(patches, side, np.full(len(side), 0.5))
    nowhere = np.empty((len(patch), 3))
    rows = basis_rows(patches, Feet(patch, v, w, nowhere, nowhere)).matrix(patches.points.shape[1])
    mark = np.round(rows @ np.random.default_rng(0).random(rows.shape[1]), 10)
    _, number, count = np.unique(mark, return_inverse=True, return_counts=True)
    lone = count[number] == 1
    return patch[lone], side[lone]


def _corners(patches: LimitPatches) -> Floats:
    """(k, 2) v and w at the corners of a patch."""
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    return square if patches.arrays.across.shape[1] == 4 else square[[0, 1, 3]]


def _on_sides(patches: LimitPatches, side: Ints, share: Floats) -> tuple[Floats, Floats]:
    """v and w of places that are so far along the sides."""
    corners = _corners(patches)
    place = (1.0 - share)[:, None] * corners[side] + share[:, None] * np.roll(corners, -1, axis=0)[side]
    return place[:, 0].copy(), place[:, 1].copy()


def sideways(patches: LimitPatches, points: Floats, feet: Feet) -> tuple[Ints, Floats]:
    """Which feet are on a border or a crease, and (m, 3) the unit vectors there that lead out of the patch.

    points  (R, 3) the points the patches depend on
    """
    v, w = feet.v, feet.w
    inside = [w, 1.0 - v - w, v] if patches.arrays.across.shape[1] == 3 else [w, 1.0 - v, 1.0 - w, v]
    on = (np.stack(inside, axis=1) <= ON_SIDE) & (patches.arrays.across[feet.patch] < 0)
    which = np.flatnonzero(on.any(axis=1))
    corners = _corners(patches)
    along = (np.roll(corners, -1, axis=0) - corners)[on[which].argmax(axis=1)]
    slopes = points_at(patches.arrays, points, feet.patch[which], v[which], w[which], 3)
    tangent = np.einsum("mi,mik->mk", along, slopes[:, 1:3])
    out = np.cross(tangent, np.cross(slopes[:, 1], slopes[:, 2]))
    return which, out / np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-300)

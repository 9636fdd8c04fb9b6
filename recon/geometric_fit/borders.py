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

ON_SIDE = 1e-12  # barycentric coordinate
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
        patch, side = np.nonzero(_free_sides(patches)) if scan.is_open else (np.empty(0, dtype=np.int64),) * 2
        bary = np.zeros((len(patch), len(SHARES), 3))
        row, share = np.arange(len(patch))[:, None], np.array(SHARES)
        bary[row, np.arange(len(SHARES)), side[:, None]] = 1.0 - share
        bary[row, np.arange(len(SHARES)), (side[:, None] + 1) % 3] = share
        patch = np.repeat(patch, len(SHARES))
        v, w = bary.reshape(-1, 3)[:, 1].copy(), bary.reshape(-1, 3)[:, 2].copy()
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


def _free_sides(patches: LimitPatches) -> NDArray[np.bool_]:
    """(C, 3) the sides of patches on the border; both sides of a crease, which share control points, are none."""
    faces, across, kinds = patches.sheets
    mark = np.round(patches.refined @ np.random.default_rng(0).random(patches.refined.shape[1]), 10)
    same = np.unique(mark, return_inverse=True)[1]
    ends = np.sort(np.stack([same[faces], same[np.roll(faces, -1, axis=1)]], axis=2), axis=2)
    key = ends[..., 0] * len(kinds) + ends[..., 1]
    _, number, count = np.unique(key, return_inverse=True, return_counts=True)
    return (across < 0) & (count[number].reshape(key.shape) == 1)


def sideways(patches: LimitPatches, points: Floats, feet: Feet) -> tuple[Ints, Floats]:
    """Which feet are on a border or a crease, and (m, 3) the unit vectors there that lead out of the patch.

    points  (R, 3) the points the patches depend on
    """
    bary = np.stack([1.0 - feet.v - feet.w, feet.v, feet.w], axis=1)
    # corner o is opposite the side from o + 1 to o + 2
    on = (bary <= ON_SIDE) & (np.roll(patches.arrays.across[feet.patch], -1, axis=1) < 0)
    which = np.flatnonzero(on.any(axis=1))
    start = (on[which].argmax(axis=1) + 1) % 3
    end = (start + 1) % 3
    slopes = points_at(patches.arrays, points, feet.patch[which], feet.v[which], feet.w[which], 3)
    along = [(end == k).astype(np.float64) - (start == k) for k in (1, 2)]
    tangent = along[0][:, None] * slopes[:, 1] + along[1][:, None] * slopes[:, 2]
    out = np.cross(tangent, np.cross(slopes[:, 1], slopes[:, 2]))
    return which, out / np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-300)

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

from recon.geometric_fit.foot_points import ROUGH, Feet, walk_feet
from recon.geometric_fit.scan_data import ScanData
from recon.geometric_fit.tangent_distance import basis_rows
from recon.geometry.control_mesh import ControlMesh
from recon.numerics.distance import TriangleTree
from recon.subdivision.evaluation import points_at
from recon.subdivision.limit_surface import LimitPatches

__all__ = ["BorderPull", "Borders", "sideways"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

ON_SIDE = 1e-12  # how far inside a place on a side may seem
OFF = 0.15  # of a crease's edge off the sharp edges of the scan: it is none of these
SHARES = (0.25, 0.75)  # of a border side, where it is sampled


class BorderPull(NamedTuple):
    """Samples of the border of the surface and of its creases.

    feet     where they are; `normals` point to the border, or to the sharp edges, of the scan
    targets  (m, 3) the nearest points of these
    """

    feet: Feet
    targets: Floats


class Borders:
    """The border and the creases of one control mesh; empty where it, or the scan, has none.

    has_slits  whether some creases are no sharp edges of the scan, but divide concave corners
    """

    def __init__(self, mesh: ControlMesh, patches: LimitPatches, scan: ScanData, *, has_slits: bool = False) -> None:
        self._patches = patches
        self._twins = _twins(patches)
        patch, side = np.nonzero((patches.arrays.across < 0) & (self._twins < _key(patches)))
        is_border = self._twins[patch, side] < 0
        self._trees = [scan.border_tree if scan.is_open else None, scan.sharp_tree if len(scan.sharp_edges) else None]
        wanted = np.where(is_border, self._trees[0] is not None, self._trees[1] is not None)
        patch, side = np.repeat(patch[wanted], len(SHARES)), np.repeat(side[wanted], len(SHARES))
        is_border = np.repeat(is_border[wanted], len(SHARES))
        v, w = _on_sides(patches, side, np.resize(np.array(SHARES), len(side)))
        nowhere = np.empty((len(patch), 3))
        self._places, self._groups = Feet(patch, v, w, nowhere, nowhere), (is_border, ~is_border)
        self._to_places: sparse.csr_array = basis_rows(patches, self._places).matrix(mesh.n_vertices)
        if has_slits and len(scan.sharp_edges) and len(mesh.crease_edges):
            self._leave_out_slits(mesh, scan.sharp_tree)

    def _leave_out_slits(self, mesh: ControlMesh, tree: TriangleTree) -> None:
        """Samples of creases that are far from the sharp edges of the scan, as those that divide a corner are."""
        is_border, on_crease = self._groups
        ends = mesh.vertices[mesh.crease_edges]
        edge = float(np.median(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)))
        places = self._to_places @ mesh.vertices
        kept = is_border | (tree.closest(places).distances < OFF * edge)
        self._places, self._to_places = self._places.chosen(np.flatnonzero(kept)), self._to_places[kept]
        self._groups = (is_border[kept], on_crease[kept])

    def pull(self, control_points: Floats) -> BorderPull:
        """Where the samples are, and where they should come to."""
        places = self._to_places @ control_points
        targets = places.copy()
        for tree, group in zip(self._trees, self._groups):
            if tree is not None and group.any():
                targets[group] = tree.closest(places[group]).points
        away = targets - places
        normals = away / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-300)
        return BorderPull(self._places._replace(positions=places, normals=normals), targets)

    def hopped(self, points: Floats, data: Floats, feet: Feet, *, step: float = ROUGH) -> Feet:
        """The feet, those on a crease moved to its other side where a nearer point is found from there.

        A walk cannot leave the piece of surface between creases in which it began.
        points  (R, 3) the points the patches depend on, data (N, 3)
        step    as of `walk_feet`
        """
        patches, k = self._patches, self._twins.shape[1]
        which, side = _on_free_side(patches, feet)
        twin = self._twins[feet.patch[which], side]
        which, side, twin = which[twin >= 0], side[twin >= 0], twin[twin >= 0]
        if len(which) == 0:
            return feet
        along = _along(patches, side, feet.v[which], feet.w[which])
        v, w = _on_sides(patches, twin % k, 1.0 - along)
        at = feet.chosen(which)
        there = walk_feet(patches, points, data[which], at._replace(patch=twin // k, v=v, w=w), step=step)
        off = [np.linalg.norm(each.positions - data[which], axis=1) for each in (at, there)]
        nearer = off[1] < off[0]
        return feet.replaced(which[nearer], there.chosen(np.flatnonzero(nearer)))


def _key(patches: LimitPatches) -> Ints:
    """(P, k) the number of every side."""
    return np.arange(patches.arrays.across.size).reshape(patches.arrays.across.shape)


def _twins(patches: LimitPatches) -> Ints:
    """(P, k) the side on the other side of a crease, as k times its patch plus its number there; -1 elsewhere.

    The two sides of a crease are known by their weights, which are alike.
    """
    patch, side = np.nonzero(patches.arrays.across < 0)
    v, w = _on_sides(patches, side, np.full(len(side), 0.5))
    nowhere = np.empty((len(patch), 3))
    rows = basis_rows(patches, Feet(patch, v, w, nowhere, nowhere)).matrix(patches.points.shape[1])
    mark = np.round(rows @ np.random.default_rng(0).random(rows.shape[1]), 10)
    order = np.argsort(mark, kind="stable")
    pair = np.flatnonzero(mark[order[1:]] == mark[order[:-1]])
    twins = np.full(patches.arrays.across.shape, -1)
    one, two = order[pair], order[pair + 1]
    key = _key(patches)[patch, side]
    twins[patch[one], side[one]], twins[patch[two], side[two]] = key[two], key[one]
    return twins


def _corners(patches: LimitPatches) -> Floats:
    """(k, 2) v and w at the corners of a patch."""
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    return square if patches.arrays.across.shape[1] == 4 else square[[0, 1, 3]]


def _on_sides(patches: LimitPatches, side: Ints, share: Floats) -> tuple[Floats, Floats]:
    """v and w of places that are so far along the sides."""
    corners = _corners(patches)
    place = (1.0 - share)[:, None] * corners[side] + share[:, None] * np.roll(corners, -1, axis=0)[side]
    return place[:, 0].copy(), place[:, 1].copy()


def _along(patches: LimitPatches, side: Ints, v: Floats, w: Floats) -> Floats:
    """How far along their sides places on them are."""
    corners = _corners(patches)
    start, way = corners[side], (np.roll(corners, -1, axis=0) - corners)[side]
    return np.einsum("mi,mi->m", np.stack([v, w], axis=1) - start, way) / np.einsum("mi,mi->m", way, way)


def _on_free_side(patches: LimitPatches, feet: Feet) -> tuple[Ints, Ints]:
    """Which feet are on a border or a crease, and on which side of their patch."""
    free = patches.arrays.across < 0
    has_free: Bools = np.asarray(free.any(axis=1))
    which = np.flatnonzero(has_free[feet.patch])
    v, w = feet.v[which], feet.w[which]
    inside = [w, 1.0 - v - w, v] if free.shape[1] == 3 else [w, 1.0 - v, 1.0 - w, v]
    on = (np.stack(inside, axis=1) <= ON_SIDE) & free[feet.patch[which]]
    on, which = on[on.any(axis=1)], which[on.any(axis=1)]
    return which, on.argmax(axis=1)


def sideways(patches: LimitPatches, points: Floats, feet: Feet) -> tuple[Ints, Floats]:
    """Which feet are on a border or a crease, and (m, 3) the unit vectors there that lead out of the patch.

    points  (R, 3) the points the patches depend on
    """
    which, side = _on_free_side(patches, feet)
    corners = _corners(patches)
    along = (np.roll(corners, -1, axis=0) - corners)[side]
    slopes = points_at(patches.arrays, points, feet.patch[which], feet.v[which], feet.w[which], 3)
    tangent = np.einsum("mi,mik->mk", along, slopes[:, 1:3])
    out = np.cross(tangent, np.cross(slopes[:, 1], slopes[:, 2]))
    return which, out / np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-300)

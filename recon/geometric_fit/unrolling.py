"""A scan unrolled: a place in a rectangle for every vertex, no triangle turned over.

Vertices are joined by springs and rest where each is the weighted mean of its neighbours; weights are positive, so no
triangle turns over (disc: its border on a convex curve; cylinder: its borders on two sides; torus: nothing is held).
A disc that can be seen whole from one side keeps its outline from there, which need not be convex: it is checked.
Springs are then made softer where the rectangle is too small for the scan, as long as that helps.

     disc                    cylinder                        torus
    .--------.              +----------+  v = 1             +----------+
    |( scan )|              >   scan   >  u and u + 1       >   scan   >  both ways around
    '--------'              +----------+  are one           +----^-----+

jumps   (F, 3) over a seam a neighbour is seen a period further on: x_end + jump as seen from the start of each side
w_ij    weight of a spring; stretch of a triangle: length of the scan over length of the rectangle

Paper  [floater1997] the disc, [gortler2006] cylinder and torus, [yoshizawa2004] springs by stretch.
"""

from contextlib import suppress
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu

from recon.errors import NoSurface
from recon.geometric_fit.hole_filling import cotangents
from recon.geometric_fit.one_sided_view import OVERLAP, measured_areas, overlap, seen_from_one_side
from recon.geometric_fit.rim_places import cross, rim_places, shares
from recon.geometric_fit.scan_kind import ScanKind, SheetScan, sheet_scans
from recon.geometric_fit.seams import jumps_around, jumps_between
from recon.geometry.mesh import TriangleMesh
from recon.numerics.halfedges import opposite_sides

__all__ = ["Unrolled", "unrolled", "unrolled_sheet"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

MOST_ROUNDS = 8  # in which springs are made softer
USUAL = 4.0  # times the median, up to which the speed of a face counts for the sides of the rectangle
WORST = 30.0  # stretch that counts: a triangle squeezed to nothing at the rim is not all there is
SOFTENING = 0.75  # power of the stretch by which they are
MARGIN = 0.02  # of the rectangle around the rim of a disc, where the surface goes on beyond the scan
STRETCHED = 1.2  # stretch from where on what may be a cylinder is tried as a disc
LARGE = 200_000  # vertices from where on springs are made softer a few times only
FEW_ROUNDS = 3


class Unrolled(NamedTuple):
    """A scan and the places of its vertices.

    sheet    the scan as what it was unrolled as
    places   (V, 2) in the unit square; in a periodic direction from 0 to below 1
    sides    (2,) what the square's sides are in the scan's unit, in the mean
    jumps    (F, 3, 2) periods between the start and the end of each side of each face
    stretch  root mean square over the scan: 1 where all lengths are kept
    """

    sheet: SheetScan
    places: Floats
    sides: Floats
    jumps: Ints
    stretch: float

    def face_corners(self) -> Floats:
        """(F, 3, 2) corners of every face, one beside the other even across a seam."""
        return _corners(self.places, self.sheet.mesh.face_vertices, self.jumps)


def unrolled(scan: TriangleMesh) -> Unrolled:
    """Unroll a scan as what it is, and where it may be two things as the one with less stretch.

    Raises  NoSurface where it is none, or cannot be unrolled.
    """
    *others, last = sheet_scans(scan)
    found = []
    for sheet in others:
        with suppress(NoSurface):
            found.append(unrolled_sheet(sheet))
    if not found or found[0].stretch > STRETCHED:
        found.append(unrolled_sheet(last))
    return min(found, key=lambda flat: flat.stretch)


def unrolled_sheet(sheet: SheetScan) -> Unrolled:
    """Unroll a scan of one kind.

    A disc that can be seen whole from one side begins as it is seen from there, others on a superellipse.
    Promises  every triangle runs counter-clockwise in the square, those of positive area on the scan that is.
    Raises    NoSurface where rounding leaves a triangle turned over.
    """
    mesh = sheet.mesh
    across = opposite_sides(mesh.face_vertices)
    jumps = np.zeros((mesh.n_faces, 3, 2), dtype=np.int64)
    if sheet.kind is ScanKind.CYLINDER:
        jumps[..., 0] = jumps_between(mesh.face_vertices, across, sheet.rims)
    elif sheet.kind is ScanKind.TORUS:
        jumps = jumps_around(mesh.face_vertices, across, mesh.n_vertices)
    seen = seen_from_one_side(sheet) if sheet.kind is ScanKind.DISC else None
    if seen is not None:
        relaxed = _relaxed(sheet, jumps, (sheet.rims[0], seen[sheet.rims[0]]), seen)
        if relaxed is not None:
            return _finished(sheet, *relaxed)
    relaxed = _relaxed(sheet, jumps, _held(sheet, jumps), None)
    if relaxed is None:
        raise NoSurface(
            f"{mesh.name} cannot be unrolled into a rectangle without triangles that turn over; cut it into flatter "
            "parts, or fit it with --surface loop."
        )
    return _finished(sheet, *relaxed)


def _relaxed(
    sheet: SheetScan, jumps: Ints, rim: tuple[Ints, Floats], seen: Floats | None
) -> tuple[Floats, Floats, Ints, float] | None:
    """Places, sides of the rectangle and jumps of the sound round with the least stretch; None where none is sound."""
    mesh = sheet.mesh
    held, where = rim
    springs = _Springs(mesh, jumps, held)
    area = measured_areas(sheet)
    best, least = None, np.inf
    for number in range(MOST_ROUNDS if mesh.n_vertices < LARGE else FEW_ROUNDS):
        places = seen if seen is not None and number == 0 else springs.rest(where)
        straight, periods = _straightened(sheet, places, jumps)
        corners = _corners(straight, mesh.face_vertices, periods)
        sides, stretch = _stretch(mesh, corners, area)
        total = float(
            np.sqrt(np.average(np.minimum(stretch, WORST) ** 2, weights=area) * _larger(corners, sides, area))
        )
        if total < least and _is_sound(sheet, straight, periods):
            best, least = (straight, sides, periods, total), total
        springs.soften(stretch, area)
    return best


def _is_sound(sheet: SheetScan, places: Floats, jumps: Ints) -> bool:
    """Whether no triangle of the scan is turned over, and no border overlaps itself.

    Where none over a hole is turned over either, only the rim can.
    """
    corners = _corners(places, sheet.mesh.face_vertices, jumps)
    if n_turned(corners, measured_areas(sheet)):
        return False
    if not n_turned(corners[sheet.n_faces :], np.ones(len(corners) - sheet.n_faces)):
        return sheet.kind is not ScanKind.DISC or overlap(places, sheet.rims) < OVERLAP
    return sheet.kind is ScanKind.DISC and overlap(places, (*sheet.rims, *sheet.holes)) < OVERLAP


def _finished(sheet: SheetScan, places: Floats, sides: Floats, jumps: Ints, stretch: float) -> Unrolled:
    mesh = sheet.mesh
    low = places.min(axis=0)
    size = np.ones(2)
    if sheet.kind is ScanKind.DISC:
        size = np.ptp(places, axis=0)
        low, size = low - MARGIN * size, (1.0 + 2.0 * MARGIN) * size
    elif sheet.kind is ScanKind.CYLINDER:
        low = np.zeros(2)
    places = (places - low) / size
    periodic = jumps.any(axis=(0, 1))
    around = np.floor(places).astype(np.int64) * periodic
    # who moves by a period is seen from all neighbours a period nearer
    seen = around[np.roll(mesh.face_vertices, -1, axis=1)] - around[mesh.face_vertices]
    return Unrolled(sheet, places - around, sides * size, jumps + seen, stretch)


def _corners(places: Floats, faces: Ints, jumps: Ints) -> Floats:
    a, b, c = places[faces].transpose(1, 0, 2)
    return np.stack([a, b + jumps[:, 0], c - jumps[:, 2]], axis=1)


def n_turned(corners: Floats, area: Floats) -> int:
    a, b, c = corners.transpose(1, 0, 2)
    one, two = b - a, c - a
    return int((one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0] <= 0.0)[area > 0.0].sum())


class _Springs:
    """Springs along the edges of a mesh, in which some vertices are held."""

    def __init__(self, mesh: TriangleMesh, jumps: Ints, held: Ints) -> None:
        self._faces, self._n, self._jumps = mesh.face_vertices, mesh.n_vertices, jumps
        start, end = self._faces, np.roll(self._faces, -1, axis=1)
        weights = cotangents(mesh.vertices, self._faces)
        # both sides of an edge share its spring; on a border there is one side only
        uses = sparse.coo_array((np.ones(start.size), (start.ravel(), end.ravel())), shape=weights.shape).tocsr()
        uses = uses + uses.T
        self._start, self._end = start.ravel(), end.ravel()
        self._weights = np.asarray(weights[self._start, self._end] / uses[self._start, self._end]).ravel()
        self._softness = np.ones(mesh.n_vertices)
        self._held = held
        self._free = np.setdiff1d(np.arange(mesh.n_vertices), held)

    def rest(self, where: Floats) -> Floats:
        """(V, 2) places at rest; held vertices are at `where` (H, 2)."""
        weight = self._weights / np.sqrt(self._softness[self._start] * self._softness[self._end])
        shape = (self._n, self._n)
        matrix = sparse.coo_array((weight, (self._start, self._end)), shape=shape).tocsr()
        matrix = matrix + matrix.T
        laplacian = sparse.diags_array(np.asarray(matrix.sum(axis=1)).ravel()) - matrix
        pull = weight[:, None] * self._jumps.reshape(-1, 2)
        right = np.stack(
            [np.bincount(self._start, p, self._n) - np.bincount(self._end, p, self._n) for p in pull.T], axis=1
        )
        places = np.zeros((self._n, 2))
        places[self._held] = where
        laplacian = sparse.csr_array(laplacian)[self._free]
        system = sparse.csc_array(laplacian[:, self._free])
        right = right[self._free] - laplacian[:, self._held] @ where
        factors = splu(system, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        places[self._free] = factors.solve(right)
        return places

    def soften(self, stretch: Floats, area: Floats) -> None:
        """Make springs softer around vertices whose faces are stretched, stiffer around others."""
        of_face = np.repeat(area, 3)
        total = np.bincount(self._faces.ravel(), of_face, self._n)
        squares = np.bincount(self._faces.ravel(), of_face * np.repeat(stretch**2, 3), self._n)
        mean = np.where(total > 0.0, squares / np.maximum(total, 1e-300), 1.0) ** SOFTENING
        self._softness *= np.clip(mean, 1.0 / WORST, WORST)


def _stretch(mesh: TriangleMesh, corners: Floats, area: Floats) -> tuple[Floats, Floats]:
    """(2,) mean lengths of the scan along u and v, and (F,) stretch from the rectangle with such sides to the scan."""
    speed = _speeds(mesh, corners)
    # where a face is a point in the rectangle its speed says nothing about the others
    usual = (speed < USUAL * np.median(speed, axis=0)).all(axis=1)
    sides = np.sqrt((area[usual, None] * speed[usual] ** 2).sum(axis=0) / max(float(area[usual].sum()), 1e-300))
    return sides, np.sqrt(0.5 * ((speed / sides) ** 2).sum(axis=1))


def _larger(corners: Floats, sides: Floats, area: Floats) -> float:
    """How many times larger than the scan its image in a rectangle with such sides is."""
    one, two = _two_sides(corners[area > 0.0])
    return float(0.5 * np.abs(cross(one, two)).sum() * sides.prod() / area.sum())


def _speeds(mesh: TriangleMesh, corners: Floats) -> Floats:
    """(F, 2) lengths of the derivatives of the scan by u and v."""
    a, b, c = mesh.corners().transpose(1, 0, 2)
    one, two = b - a, c - a
    (u1, v1), (u2, v2) = (corners[:, 1] - corners[:, 0]).T, (corners[:, 2] - corners[:, 0]).T
    double = np.maximum(u1 * v2 - v1 * u2, 1e-30)[:, None]
    by_u = (v2[:, None] * one - v1[:, None] * two) / double
    by_v = (u1[:, None] * two - u2[:, None] * one) / double
    return np.stack([np.linalg.norm(by_u, axis=1), np.linalg.norm(by_v, axis=1)], axis=1)


def _held(sheet: SheetScan, jumps: Ints) -> tuple[Ints, Floats]:
    """Vertices that are held, and their places."""
    if sheet.kind is ScanKind.DISC:
        return sheet.rims[0], rim_places(sheet.mesh.vertices[sheet.rims[0]])
    if sheet.kind is ScanKind.TORUS:
        return np.zeros(1, dtype=np.int64), np.zeros((1, 2))
    rows = [_from_seam(sheet.mesh, jumps[..., 0], rim) for rim in sheet.rims]
    share = [shares(sheet.mesh.vertices[row]) for row in rows]
    first = np.stack([share[0], np.zeros(len(share[0]))], axis=1)
    # the surface lies to the left of both rims, so the second one runs back
    second = np.stack([1.0 - share[1], np.ones(len(share[1]))], axis=1)
    return np.concatenate(rows), np.concatenate([first, second])


def _from_seam(mesh: TriangleMesh, jumps: Ints, rim: Ints) -> Ints:
    """The rim from the vertex behind the seam on."""
    after = dict(zip(rim.tolist(), np.roll(rim, -1).tolist()))
    for face, side in np.argwhere(jumps != 0).tolist():
        start, end = mesh.face_vertices[face, [side, (side + 1) % 3]].tolist()
        if after.get(start) == end:
            return np.roll(rim, -int(np.flatnonzero(rim == end)[0]))
    return rim


def _straightened(sheet: SheetScan, places: Floats, jumps: Ints) -> tuple[Floats, Ints]:
    """The second rim of a cylinder turned, or the periods of a torus combined, so that u and v are least askew."""
    if sheet.kind is ScanKind.DISC:
        return places, jumps
    u, v = places.T
    energy = _energies(sheet.mesh, _corners(places, sheet.mesh.face_vertices, jumps))
    if sheet.kind is ScanKind.CYLINDER:
        return np.stack([u - energy[0, 1] / energy[1, 1] * v, v], axis=1), jumps
    turn = np.eye(2, dtype=np.int64)
    for _ in range(64):
        now = turn @ energy @ turn.T
        longer = int(now[1, 1] > now[0, 0])
        other = 1 - longer
        times = round(float(now[0, 1] / now[other, other]))
        if times == 0:
            break
        turn[longer] -= times * turn[other]
    places, jumps = places @ turn.T, jumps @ turn.T
    if cross(*_two_sides(_corners(places, sheet.mesh.face_vertices, jumps))).sum() < 0.0:
        places, jumps = places[:, ::-1], jumps[..., ::-1]
    return places, jumps


def _two_sides(corners: Floats) -> tuple[Floats, Floats]:
    return corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]


def _energies(mesh: TriangleMesh, corners: Floats) -> Floats:
    """(2, 2) integrals over the scan of the products of the gradients of u and v."""
    a, b, c = mesh.corners().transpose(1, 0, 2)
    one, two = b - a, c - a
    aa, ab, bb = (np.einsum("ij,ij->i", x, y) for x, y in ((one, one), (one, two), (two, two)))
    double = np.sqrt(np.maximum(aa * bb - ab * ab, 1e-300))
    d1, d2 = _two_sides(corners)
    inverse = np.stack([bb, -ab, -ab, aa], axis=1).reshape(-1, 2, 2) / double[:, None, None]
    d = np.stack([d1, d2], axis=1)
    return 0.5 * np.einsum("fki,fkl,flj->ij", d, inverse, d)

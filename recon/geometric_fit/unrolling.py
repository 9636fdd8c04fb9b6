"""A scan unrolled: a place in a rectangle for every vertex, no triangle turned over.

Vertices are joined by springs and rest where each is the weighted mean of its neighbours; weights are positive, so no
triangle turns over (disc: its border on a convex curve; cylinder: its borders on two sides; torus: nothing is held).
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
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.optimize import OptimizeResult, linprog, minimize
from scipy.sparse import csgraph
from scipy.sparse.linalg import splu
from scipy.spatial import ConvexHull
from shapely import Polygon, make_valid

from recon.errors import NoSurface
from recon.geometric_fit.hole_filling import cotangents
from recon.geometric_fit.scan_kind import ScanKind, SheetScan, sheet_scans
from recon.geometry.mesh import TriangleMesh
from recon.numerics.halfedges import edge_table, opposite_sides

__all__ = ["Unrolled", "unrolled", "unrolled_sheet"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

MOST_ROUNDS = 8  # in which springs are made softer
USUAL = 4.0  # times the median, up to which the speed of a face counts for the sides of the rectangle
WORST = 30.0  # stretch that counts: a triangle squeezed to nothing at the rim is not all there is
OVERLAP = 1e-6  # share of the rectangle that a border may cover twice, for rounding
LOOKS, FLATTEST = 30, 1e-3  # attempts to find a side from which all is seen, and the least cosine there
SOFTENING = 0.75  # power of the stretch by which they are
ROUNDNESS = 6.0  # of the rim of a disc, a superellipse: 2 an ellipse, infinite a rectangle with corners that pinch
MARGIN = 0.02  # of the rectangle around the rim of a disc, where the surface goes on beyond the scan
STRETCHED = 1.2  # stretch from where on what may be a cylinder is tried as a disc
LARGE = 200_000  # vertices from where on springs are made softer a few times only
FEW_ROUNDS = 3


class Unrolled(NamedTuple):
    """A scan and the places of its vertices.

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
        jumps[..., 0] = _jumps_between(mesh.face_vertices, across, sheet.rims)
    elif sheet.kind is ScanKind.TORUS:
        jumps = _jumps_around(mesh.face_vertices, across, mesh.n_vertices)
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
        sides, stretch = _stretch(mesh, _corners(straight, mesh.face_vertices, periods), area)
        total = float((area * np.minimum(stretch, WORST) ** 2).sum())
        if total < least and _is_sound(sheet, straight, periods):
            best, least = (straight, sides, periods, float(np.sqrt(total / area.sum()))), total
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
        return sheet.kind is not ScanKind.DISC or _overlap(places, sheet.rims) < OVERLAP
    return sheet.kind is ScanKind.DISC and _overlap(places, (*sheet.rims, *sheet.holes)) < OVERLAP


def measured_areas(sheet: SheetScan) -> Floats:
    """(F,) twice the area of every face of the scan, zero of those laid over holes."""
    area = np.linalg.norm(sheet.mesh.area_vectors(), axis=1)
    area[sheet.n_faces :] = 0.0
    return area


def seen_from_one_side(sheet: SheetScan) -> Floats | None:
    """(V, 2) the scan seen from where all its triangles show their front and no border overlaps itself.

    None where no such side is found: from the one that is steepest on all triangles the search goes on to where less
    is hidden, as the side from which a scanner saw it is one.
    """
    mesh, length = sheet.mesh, measured_areas(sheet)
    normals = 2.0 * mesh.area_vectors()[length > 0.0] / length[length > 0.0, None]
    steepest = _steepest_side(normals)
    if steepest is None:
        return None
    aside, loops = _axes_across(steepest), (*sheet.rims, *sheet.holes)

    def hidden(turn: Floats) -> float:
        toward = steepest + turn @ aside
        return _overlap(mesh.vertices @ _axes_across(toward).T, loops) if (normals @ toward).min() > 0.0 else 1.0

    def stop(intermediate_result: OptimizeResult) -> None:
        if intermediate_result.fun < OVERLAP:
            raise StopIteration

    first = np.array([[0.0, 0.0], [0.1, 0.0], [0.0, 0.1]])
    search = {"initial_simplex": first, "maxfev": 4 * LOOKS}
    found = minimize(hidden, first[0], method="Nelder-Mead", callback=stop, options=search)
    if found.fun >= OVERLAP:
        return None
    flat = mesh.vertices @ _axes_across(steepest + found.x @ aside).T
    return np.asarray(flat @ _least_box(flat[sheet.rims[0]])[1])


def _axes_across(toward: Floats) -> Floats:
    """(2, 3) unit vectors across a direction that make a right-handed frame with it."""
    axes = np.linalg.svd(toward[None])[2][1:]
    return axes if np.linalg.det([*axes, toward]) > 0.0 else axes[::-1]


def _steepest_side(normals: Floats) -> Floats | None:
    """(3,) unit direction whose least cosine with normals (n, 3) is largest, by a linear program; None without any."""
    toward = normals.mean(axis=0)
    chosen = np.empty(0, dtype=np.int64)
    for _ in range(LOOKS):
        chosen = np.union1d(chosen, np.argsort(normals @ toward)[:200])
        rows = np.column_stack([-normals[chosen], np.ones(len(chosen))])
        best = linprog([0.0, 0.0, 0.0, -1.0], A_ub=rows, b_ub=np.zeros(len(rows)), bounds=[(-1.0, 1.0)] * 3 + [(0, 1)])
        if best.x is None or best.x[3] < FLATTEST:
            return None
        toward = best.x[:3]
        if (normals @ toward).min() > 0.5 * best.x[3]:
            return np.asarray(toward / np.linalg.norm(toward))
    return None


def _overlap(places: Floats, loops: tuple[Ints, ...]) -> float:
    """Area that closed rows of places cover not once, as a share of what the first covers; they may touch."""
    rows = [places[loop] for loop in loops]
    covered = [0.5 * abs(float(_cross(row, np.roll(row, -1, axis=0)).sum())) for row in rows]
    off = sum(abs(make_valid(Polygon(row)).area - area) for row, area in zip(rows, covered))
    return off / max(covered[0], 1e-300)


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
        return sheet.rims[0], _rim_places(sheet.mesh.vertices[sheet.rims[0]])
    if sheet.kind is ScanKind.TORUS:
        return np.zeros(1, dtype=np.int64), np.zeros((1, 2))
    rows = [_from_seam(sheet.mesh, jumps[..., 0], rim) for rim in sheet.rims]
    share = [_shares(sheet.mesh.vertices[row]) for row in rows]
    first = np.stack([share[0], np.zeros(len(share[0]))], axis=1)
    # the surface lies to the left of both rims, so the second one runs back
    second = np.stack([1.0 - share[1], np.ones(len(share[1]))], axis=1)
    return np.concatenate(rows), np.concatenate([first, second])


def _shares(row: Floats) -> Floats:
    """(n,) share of its length around a closed row before each of its points."""
    steps = np.linalg.norm(np.roll(row, -1, axis=0) - row, axis=1)
    return (np.cumsum(steps) - steps) / steps.sum()


def _from_seam(mesh: TriangleMesh, jumps: Ints, rim: Ints) -> Ints:
    """The rim from the vertex behind the seam on."""
    after = dict(zip(rim.tolist(), np.roll(rim, -1).tolist()))
    for face, side in np.argwhere(jumps != 0).tolist():
        start, end = mesh.face_vertices[face, [side, (side + 1) % 3]].tolist()
        if after.get(start) == end:
            return np.roll(rim, -int(np.flatnonzero(rim == end)[0]))
    return rim


def _rim_places(row: Floats) -> Floats:
    """(n, 2) places of the rim of a disc on a superellipse as long and wide as the rim seems from its best side."""
    middle = row - row.mean(axis=0)
    axes = np.linalg.svd(middle, full_matrices=False)[2]
    flat = middle @ axes[:2].T
    if 0.5 * _cross(flat, np.roll(flat, -1, axis=0)).sum() < 0.0:
        flat = flat * [1.0, -1.0]
    box, turn = _least_box(flat)
    flat = flat @ turn
    centre = 0.5 * (flat.max(axis=0) + flat.min(axis=0))
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) * 0.5 * box
    at = _corner_numbers(flat - centre, corners)
    share = _shares(row)
    number = np.argsort(at)
    known = np.append(share[at[number]], share[at[number[0]]] + 1.0)
    quarter = np.interp(share + (share < known[0]), known, np.arange(5)) + number[0]
    return _superellipse(quarter) * 0.5 * box


def _corner_numbers(flat: Floats, corners: Floats) -> Ints:
    """(4,) points of the rim nearest to the corners of its box, in the order of the rim; else its quarters."""
    at = np.array([int(np.argmax(flat @ corner)) for corner in corners])
    turns = np.diff(np.append(at, at[0])) % len(flat)
    if (turns > 0).all() and turns.sum() == len(flat):
        return at
    share = _shares(flat)
    first = share[at[0]]
    return np.array([int(np.argmin(np.abs((share - first - k / 4.0 + 0.5) % 1.0 - 0.5))) for k in range(4)])


def _superellipse(quarter: Floats) -> Floats:
    """(n, 2) points |x|^m + |y|^m = 1; quarter 0 at the corner (-, -), 1 at (+, -) and so on, even along the sides."""
    along = 2.0 * (quarter % 1.0) - 1.0
    side = np.stack([along, -np.ones(len(along))], axis=1)
    turn = np.floor(quarter).astype(np.int64) % 4
    cos, sin = np.array([1, 0, -1, 0])[turn], np.array([0, 1, 0, -1])[turn]
    square = np.stack([cos * side[:, 0] - sin * side[:, 1], sin * side[:, 0] + cos * side[:, 1]], axis=1)
    size = (np.abs(square) ** ROUNDNESS).sum(axis=1) ** (1.0 / ROUNDNESS)
    return square / size[:, None]


def _least_box(flat: Floats) -> tuple[Floats, Floats]:
    """(2,) sides of the smallest rectangle around points (n, 2), and (2, 2) the turn that lays it along the axes."""
    hull = flat[ConvexHull(flat).vertices]
    edges = np.roll(hull, -1, axis=0) - hull
    angles = np.arctan2(edges[:, 1], edges[:, 0])
    turns = np.stack([np.cos(angles), -np.sin(angles), np.sin(angles), np.cos(angles)], axis=1).reshape(-1, 2, 2)
    boxes = np.ptp(np.einsum("ni,kij->knj", hull, turns), axis=1)
    least = int(np.argmin(boxes.prod(axis=1)))
    return boxes[least], turns[least]


def _cross(a: Floats, b: Floats) -> Floats:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


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
    if _cross(*_two_sides(_corners(places, sheet.mesh.face_vertices, jumps))).sum() < 0.0:
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


def _jumps_between(faces: Ints, across: Ints, rims: tuple[Ints, ...]) -> Ints:
    """(F, 3) jumps over a seam: the sides crossed on the shortest way over faces from one rim to the other."""
    side_of = {}
    for face, side in np.argwhere(across < 0).tolist():
        side_of[int(faces[face, side])] = (face, side)
    first, last = ([side_of[int(v)] for v in rim if int(v) in side_of] for rim in rims)
    graph = _face_graph(across)
    starts = np.unique([face for face, _ in first])
    _, before, _ = csgraph.dijkstra(graph, unweighted=True, indices=starts, min_only=True, return_predecessors=True)
    distance = csgraph.dijkstra(graph, unweighted=True, indices=starts, min_only=True)
    end, end_side = min(last, key=lambda pair: distance[pair[0]])
    row = [end]
    while before[row[-1]] >= 0:
        row.append(int(before[row[-1]]))
    row.reverse()
    jumps = np.zeros(faces.shape, dtype=np.int64)
    _cross_row(jumps, across, row)
    jumps[row[0], next(side for face, side in first if face == row[0])] += 1
    jumps[end, end_side] -= 1
    return jumps


def _cross_row(jumps: Ints, across: Ints, row: list[int]) -> None:
    """Mark the sides between faces that follow each other: to their right the far side is a period back."""
    for one, two in pairwise(row):
        side = next(s for s in range(3) if across[one, s] // 3 == two and across[one, s] >= 0)
        jumps[one, side] -= 1
        jumps.reshape(-1)[across[one, side]] += 1


def _face_graph(across: Ints) -> sparse.csr_array:
    face, side = np.nonzero(across >= 0)
    other = across[face, side] // 3
    return sparse.coo_array((np.ones(len(face)), (face, other)), shape=(len(across), len(across))).tocsr()


def _jumps_around(faces: Ints, across: Ints, n_vertices: int) -> Ints:
    """(F, 3, 2) jumps over two seams that cut a torus open.

    A tree of edges through all vertices, a tree of faces over other edges: two edges are in neither [eppstein2003].
    """
    table = edge_table(faces)
    a, b = table.edges.T
    graph = sparse.coo_array((np.ones(len(a)), (a, b)), shape=(n_vertices, n_vertices)).tocsr()
    tree = csgraph.breadth_first_tree(graph, 0, directed=False).tocoo()
    in_tree = np.isin(a * n_vertices + b, np.minimum(tree.row, tree.col) * n_vertices + np.maximum(tree.row, tree.col))
    face, side = np.nonzero(across >= 0)
    open_sides = ~in_tree[table.face_edges[face, side]]
    face, side = face[open_sides], side[open_sides]
    shape = (len(faces), len(faces))
    dual = sparse.coo_array((np.ones(len(face)), (face, across[face, side] // 3)), shape=shape).tocsr()
    before = csgraph.breadth_first_order(dual, 0, directed=False)[1]
    joined = before[face] == across[face, side] // 3
    joined |= before[across[face, side] // 3] == face
    left = np.flatnonzero(~joined)
    jumps = np.zeros((*faces.shape, 2), dtype=np.int64)
    edges = table.face_edges[face[left], side[left]]
    for k, edge in enumerate(np.unique(edges).tolist()):
        i = left[int(np.flatnonzero(edges == edge)[0])]
        start, end = int(face[i]), int(across[face[i], side[i]] // 3)
        to_start, to_end = _way_up(before, start), _way_up(before, end)
        shared = set(to_start)
        meet = next(f for f in to_end if f in shared)
        row = to_end[: to_end.index(meet)] + to_start[: to_start.index(meet) + 1][::-1]
        layer = np.zeros(faces.shape, dtype=np.int64)
        _cross_row(layer, across, row)
        layer[start, side[i]] -= 1
        layer.reshape(-1)[across[start, side[i]]] += 1
        jumps[..., k] = layer
    return jumps


def _way_up(before: Ints, face: int) -> list[int]:
    row = [face]
    while before[row[-1]] >= 0:
        row.append(int(before[row[-1]]))
    return row

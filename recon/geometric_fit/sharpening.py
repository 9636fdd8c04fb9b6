"""Sharp edges that a scan has cut off, put back where the surfaces on both sides meet.

A scanner, or marching cubes, samples without regard to edges: triangles between the last points on one side and the
first on the other cut every edge off. The sides are told by their smooth vertices, and meet on their tangent planes:

          A                     A
           \\                     \\               A, B   smooth faces, and the vertices beside them
            \\                     \\              x      where the tangent planes at both ends of an edge from side
             .                     .\\                    to side meet, nearest to its middle; three at a corner
               `  .                   x
                 `--.---- B          --.---- B

    smooth vertices -> sides -> vertices on no side, and those next to an edge, moved onto it -> edges split at x

That is done where the shape is one with edges: most of what is sharp hangs together in long chains, whose vertices lie
between sides. On other scans what looks sharp is noise, a fold of a small radius or a sliver: they stay as they are.

Paper  [attene2005], recovering sharp edges in meshes of feature-insensitive sampling; [kobbelt2001], the corner as the
       point nearest to the planes around it.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from recon.geometric_fit.chains import chain_lengths
from recon.geometry.mesh import TriangleMesh
from recon.numerics.face_loops import agreeing_corners, all_around, bent_sides, corner_sums
from recon.numerics.halfedges import numbered_edges, paired_sides, vertex_normals
from recon.numerics.rows import added_at, unit_vectors

__all__ = ["SharpScan", "sharpened"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
SmallInts = NDArray[np.int32]

SMOOTH = np.cos(np.radians(12.0))  # between the normals around a smooth vertex and their mean
AGREE = np.cos(np.radians(25.0))  # between the smooth faces around a vertex and their mean, on one side
SLIVER = 0.02  # of the median area: the normal of such a face is noise
GROWTH = 2  # rounds in which faces join the side that they continue
OFF = 0.1  # mean edges off the plane of its side that a vertex may be
NEAREST, FARTHEST = 0.3, 1.5  # lengths of a split edge between its ends and the point put back
LONGEST_MOVE = 0.7  # of a vertex, in mean edges around it
SINGULAR = 0.02  # of the largest eigenvalue: planes that say nothing in a direction
LONG, MOST = (
    0.5,
    0.5,
)  # of the diagonal, a long chain; of all that is sharp, what lies in long ones on a shape with edges
PIECE = 1 << 16  # edges looked at together
ROUNDED = 0.75  # of the angle asked for: along an edge that is put back it varies


class SharpScan(NamedTuple):
    """A scan with the edges that it had cut off.

    mesh   the vertices of the scan, some of them moved, then new ones
    edges  (m, 2) its sharp edges; none where the shape has no long ones, and mesh is the scan itself
    """

    mesh: TriangleMesh
    edges: Ints


class _Sides(NamedTuple):
    """Every vertex with the side it lies on.

    normals  (V, 3) unit normal of its tangent plane, as the smooth faces around it have it
    through  (V, 3) a point of that plane
    known    (V,) whether there are any, and they agree: a vertex on an edge lies on both sides
    """

    normals: Floats
    through: Floats
    known: Bools


class _Crossings(NamedTuple):
    """Edges from one side to another.

    edges   (m,) their numbers;  points (m, 3) where the tangent planes at their ends meet
    shares  (m, 2) how far that is from each end, in lengths of the edge
    """

    edges: Ints
    points: Floats
    shares: Floats


class _Edges(NamedTuple):
    """The edges of the scan: ends (E, 2), and face_edges (F, 3) the edge along each side."""

    ends: SmallInts
    face_edges: SmallInts


def sharpened(scan: TriangleMesh, angle: float) -> SharpScan:
    """The scan with its cut-off edges put back, if it is one of a shape with edges.

    angle  radians between both sides from which on an edge is one
    """
    table = _Edges(*numbered_edges(scan.face_vertices))
    on_edges = _on_edges(scan.vertices, table, _sides(scan, table), angle)
    vertices, faces = on_edges.vertices, scan.face_vertices
    crossings = _crossings(vertices, table, on_edges.sides, angle)
    if len(crossings.edges):
        vertices, faces = _split((vertices, faces), table, crossings, on_edges.sides)
    edges = _bent_edges(vertices, faces, ROUNDED * angle)
    between_sides = np.ones(len(vertices), dtype=np.bool_)
    between_sides[: scan.n_vertices] = ~on_edges.sides.known
    if _are_lines(edges, vertices) and between_sides[np.unique(edges)].mean() > MOST:
        return SharpScan(TriangleMesh(vertices, faces, scan.name), edges)
    return SharpScan(scan, np.empty((0, 2), dtype=np.int64))


def _are_lines(edges: Ints, vertices: Floats) -> bool:
    """Whether most of the edges are in long chains, and most of their vertices have two of them, as along a line."""
    if len(edges) == 0:
        return False
    length = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
    long = chain_lengths(edges, vertices) >= LONG * np.linalg.norm(np.ptp(vertices, axis=0))
    count = np.bincount(edges.ravel())
    return bool(length[long].sum() > MOST * length.sum() and (count == 2).sum() > MOST * (count > 0).sum())


def _sides(scan: TriangleMesh, table: _Edges) -> _Sides:
    """Smooth vertices are on one side, and so is what lies beside them, and what continues that."""
    mean = vertex_normals(scan.vertices, scan.face_vertices)
    smooth, sides = _by_faces(scan, mean)
    return _extrapolated(scan, table, sides, (smooth, mean))


def _by_faces(scan: TriangleMesh, mean: Floats) -> tuple[Bools, _Sides]:
    """(V,) the smooth vertices, and the sides as the faces around every vertex tell them.

    mean  (V, 3) normals of the faces around each vertex
    """
    faces, n = scan.face_vertices, scan.n_vertices
    area_vectors = scan.area_vectors()
    area = np.linalg.norm(area_vectors, axis=1)
    sliver = area < SLIVER * np.median(area)
    smooth = all_around(agreeing_corners(area_vectors, mean, faces, SMOOTH) | sliver[:, None], faces, n)
    flat = smooth[faces].any(axis=1) & ~sliver
    for _ in range(GROWTH):
        side = unit_vectors(corner_sums(area_vectors, flat, faces, n))
        flat |= agreeing_corners(area_vectors, side, faces, SMOOTH).any(axis=1) & ~sliver
    side = unit_vectors(corner_sums(area_vectors, flat, faces, n))
    agree = agreeing_corners(area_vectors, side, faces, AGREE)
    known = all_around(~flat[:, None] | agree, faces, n) & side.any(axis=1)
    return smooth, _Sides(side, scan.vertices, known)


def _extrapolated(scan: TriangleMesh, table: _Edges, sides: _Sides, at_vertices: tuple[Bools, Floats]) -> _Sides:
    """The planes beside smooth vertices taken from these; a vertex that is off its plane was measured across an edge.

    at_vertices  (V,) which are smooth, and (V, 3) normals of the faces around, which hold there
    """
    (smooth, normals), x, n = at_vertices, scan.vertices, scan.n_vertices
    at, beside = _beside(table.ends, ~smooth, smooth)
    agree = np.einsum("ki,ki->k", sides.normals[at], normals[beside]) > AGREE
    at, beside = at[agree], beside[agree]
    count = np.bincount(at, minlength=n)
    mean = np.where((count > 0)[:, None], unit_vectors(added_at(normals[beside], at, n)), sides.normals)
    way = x[beside] - x[at]
    height = np.bincount(at, np.einsum("ki,ki->k", mean[at], way), n) / np.maximum(count, 1)
    size = np.bincount(at, np.linalg.norm(way, axis=1), n) / np.maximum(count, 1)
    off = np.abs(height) > OFF * size
    return _Sides(mean, x + height[:, None] * mean, sides.known & ~off)


def _beside(edges: SmallInts, here: Bools, there: Bools) -> tuple[SmallInts, SmallInts]:
    """Vertices (m,) that are `here`, and (m,) those joined to them that are `there`."""
    ways = [edges[here[edges[:, i]] & there[edges[:, 1 - i]]] for i in (0, 1)]
    return np.concatenate([ways[0][:, 0], ways[1][:, 1]]), np.concatenate([ways[0][:, 1], ways[1][:, 0]])


class _OnEdges(NamedTuple):
    """The vertices, some of them moved onto edges, and the sides with these on none."""

    vertices: Floats
    sides: _Sides


def _on_edges(vertices: Floats, table: _Edges, sides: _Sides, angle: float) -> _OnEdges:
    """Vertices on no side, and those that an edge passes close by, go where the planes around them meet.

    A point close to an edge would leave slivers there, and a point that was measured across one lies on neither side.
    """
    crossings = _crossings(vertices, table, sides, angle)
    known = sides.known.copy()
    known[table.ends[crossings.edges][crossings.shares < NEAREST]] = False
    at, beside = _beside(table.ends, ~known, known)
    chosen, move = _toward_planes(vertices, at, beside, sides, angle)
    moved = vertices.copy()
    moved[chosen] += move
    return _OnEdges(moved, sides._replace(known=known))


def _toward_planes(x: Floats, at: SmallInts, beside: SmallInts, sides: _Sides, angle: float) -> tuple[Ints, Floats]:
    """(m,) vertices among `at` (k,) with two sides around them, and (m, 3) their way to all planes of `beside`."""
    normals, way = sides.normals[beside], x[beside] - x[at]
    height = np.einsum("ki,ki->k", normals, sides.through[beside] - x[at])
    places, row = np.unique(at, return_inverse=True)
    n = len(places)
    quadric = added_at(np.einsum("ki,kj->kij", normals, normals).reshape(-1, 9), row, n).reshape(-1, 3, 3)
    pull = added_at(normals * height[:, None], row, n)
    count = np.bincount(row, minlength=n)
    size = np.bincount(row, np.linalg.norm(way, axis=1), n) / np.maximum(count, 1)
    chosen = np.flatnonzero(count > 1)
    values, vectors = np.linalg.eigh(quadric[chosen])
    # two sides of equal weight at this angle have eigenvalues in the ratio of its half's squared tangent
    two_sided = values[:, 1] > (np.tan(angle / 2.0) / 2.0) ** 2 * values[:, 2]
    chosen, values, vectors = chosen[two_sided], values[two_sided], vectors[two_sided]
    inverse = np.where(values > SINGULAR * values[:, 2:], 1.0 / np.maximum(values, 1e-300), 0.0)
    move = np.einsum("mik,mk,mjk,mj->mi", vectors, inverse, vectors, pull[chosen])
    short = np.linalg.norm(move, axis=1) < LONGEST_MOVE * size[chosen]
    return places[chosen[short]], move[short]


def _crossings(vertices: Floats, table: _Edges, sides: _Sides, angle: float) -> _Crossings:
    ends, normals = table.ends, sides.normals
    edges = np.flatnonzero(sides.known[ends].all(axis=1))
    apart = [
        np.einsum("ei,ei->e", normals[ends[part, 0]], normals[ends[part, 1]]) < np.cos(angle)
        for part in np.array_split(edges, len(edges) // PIECE + 1)
    ]
    edges = edges[np.concatenate(apart)]
    through = vertices[ends[edges]]
    points = _nearest_on_planes(through.mean(axis=1), sides.through[ends[edges]], normals[ends[edges]])
    length = np.linalg.norm(through[:, 1] - through[:, 0], axis=1)
    shares = np.linalg.norm(points[:, None] - through, axis=2) / np.maximum(length, 1e-300)[:, None]
    near = shares.max(axis=1) <= FARTHEST
    return _Crossings(edges[near], points[near], shares[near])


def _nearest_on_planes(near: Floats, through: Floats, normals: Floats) -> Floats:
    """(m, 3) the points nearest to `near` (m, 3) on all planes `through` (m, k, 3) with `normals` (m, k, 3)."""
    off = np.einsum("mki,mki->mk", through - near[:, None], normals)
    return near + np.einsum("mik,mk->mi", np.linalg.pinv(normals, rcond=1e-2), off)


def _split(surface: tuple[Floats, Ints], table: _Edges, crossings: _Crossings, sides: _Sides) -> tuple[Floats, Ints]:
    """Every face cut at the points on its edges: one cuts it in two, two in three, three in six around a corner.

    surface  (V, 3) vertices and (F, 3) faces
    """
    vertices, all_faces = surface
    n_vertices = len(vertices)
    at = np.full(len(table.ends), -1, dtype=np.int32)
    at[crossings.edges] = n_vertices + np.arange(len(crossings.edges))
    is_cut = (at[table.face_edges] >= 0).any(axis=1)
    faces, on_side = all_faces[is_cut], at[table.face_edges[is_cut]].astype(np.int64)
    count = (on_side >= 0).sum(axis=1)
    a, b, c, p, _, _ = _turned(faces[count == 1], on_side[count == 1], on_side[count == 1] >= 0)
    halves = [[a, p, c], [p, b, c]]
    a, b, c, _, q, r = _turned(faces[count == 2], on_side[count == 2], on_side[count == 2] < 0)
    thirds = [[q, c, r], [a, b, q], [a, q, r]]
    cut = count == 3
    x = vertices[faces[cut]]
    middle = crossings.points[on_side[cut] - n_vertices].mean(axis=1)
    corner = _nearest_on_planes(middle, sides.through[faces[cut]], sides.normals[faces[cut]])
    size = np.linalg.norm(x - np.roll(x, 1, axis=1), axis=2).max(axis=1)
    corner = np.where((np.linalg.norm(corner - middle, axis=1) <= size)[:, None], corner, middle)
    m = n_vertices + len(crossings.edges) + np.arange(len(corner))
    (a, b, c), (p, q, r) = faces[cut].T, on_side[cut].T
    sixths = [[a, p, m], [p, b, m], [b, q, m], [q, c, m], [c, r, m], [r, a, m]]
    pieces = [np.stack(piece, axis=1) for piece in (*halves, *thirds, *sixths)]
    return np.concatenate([vertices, crossings.points, corner]), np.concatenate([all_faces[~is_cut], *pieces])


def _turned(faces: Ints, on_side: Ints, first: Bools) -> tuple[Ints, ...]:
    """Corners a, b, c and what is on the sides ab, bc, ca, turned so that the side marked `first` (m, 3) is ab."""
    turn = (np.argmax(first, axis=1)[:, None] + np.arange(3)) % 3
    return (*np.take_along_axis(faces, turn, axis=1).T, *np.take_along_axis(on_side, turn, axis=1).T)


def _bent_edges(vertices: Floats, faces: Ints, angle: float) -> Ints:
    """(m, 2) the edges whose two faces stand at this angle to each other, or a larger one."""
    face, side = np.nonzero(bent_sides(vertices, faces, paired_sides(faces), float(np.cos(angle))))
    return np.sort(np.stack([faces[face, side], faces[face, (side + 1) % 3]], axis=1), axis=1)

"""The wall around a hole turned into one half plane through the axis, and its samples put in order along the profile.

The samples of a wall form a band about its profile. Its cells, linked to those beside them that face alike, make a
graph; lengths through it say roughly how far along the profile every sample lies.

    one wall                     over a lip                      x   the highest cell: the lip's top
      z ^   .::  s = 31            .-x-.   0                     n   the wall's normal, out of the band
        |  .::   s = 28          ::     ::                       s   length, from the base up, or from the top: negative
        |  ::    s = 25       -3 ::     :: 3                         on the outer wall, positive on the inner one
        +----> r              -6 ::     :: 6
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import cKDTree

from recon.errors import NoSurface
from recon.geometry.mesh import TriangleMesh
from recon.hole_patch.surroundings import Axis, Wall

__all__ = [
    "SectionSamples",
    "edge_length",
    "lengths_along_mesh",
    "lengths_from_lip",
    "mirrored",
    "rough_lengths",
    "section_normals",
    "section_samples",
    "vertex_areas_and_normals",
    "wrapped",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

CELL = 1.0  # mm: half of what a profile's knots lie apart
LINKED = 2.5  # mm; neighbouring sherds leave gaps of about a millimetre
LONGEST = 2.0  # of the usual link between cells
LEAST_PART = 0.01  # of all weight, of a part of the mesh that a profile may run over
SECTORS, SELDOM = 72, 0.15  # of the turn; and of the sectors in which a cell usually has samples: fracture has fewer
FEW = 0.1  # of the edges that usually link two cells: fewer do not come from all round the vessel


@dataclass(frozen=True, eq=False)
class SectionSamples:
    """Wall vertices turned into one half plane: (m, 2) places in (radius, height), (m, 2) normals, (m,) weights, (m,)
    angles from which they were turned, and (m,) numbers of the vertices.
    """

    place: Floats
    normal: Floats
    weight: Floats
    angle: Floats
    vertex: Ints

    def of(self, which: Bools) -> "SectionSamples":
        """The chosen samples."""
        return SectionSamples(
            self.place[which], self.normal[which], self.weight[which], self.angle[which], self.vertex[which]
        )


@dataclass(frozen=True, eq=False)
class _Cells:
    """Samples taken together: (n, 2) mean places and normals, (n,) weights, and (n,) whether they come from all round
    the vessel.
    """

    place: Floats
    normal: Floats
    weight: Floats
    recurring: Bools


def section_samples(wall: Wall, axis: Axis, *, middle: float, nearness: float) -> SectionSamples:
    """The vertices of a wall as scanned.

    middle, nearness  radians; vertices count by exp(-θ²/2 nearness²) of their angle from the middle
    """
    areas, normals = vertex_areas_and_normals(wall.measured)
    turned = axis.cylindrical(wall.measured.vertices)
    normal = section_normals(wall.measured.vertices, normals, axis)
    # a wall that faces along θ is a handle or a mislabelled fracture: the square of what is left grades it down
    weight = areas * (normal**2).sum(axis=1)
    weight *= np.exp(-0.5 * (wrapped(turned[:, 0] - middle) / nearness) ** 2)
    samples = SectionSamples(turned[:, 1:], normal, weight, turned[:, 0], np.arange(len(weight)))
    return samples.of(weight > 1e-4 * weight.max())


def section_normals(points: Floats, normals: Floats, axis: Axis) -> Floats:
    """(m, 2) parts of normals (m, 3) at points (m, 3) away from the axis and along it; shorter where they face θ."""
    ahead = axis.cylindrical(axis.point + normals)  # normals as points: their angle, size across, size along the axis
    outward = ahead[:, 1] * np.cos(ahead[:, 0] - axis.cylindrical(points)[:, 0])
    return np.stack([outward, ahead[:, 2]], axis=1)


def vertex_areas_and_normals(mesh: TriangleMesh) -> tuple[Floats, Floats]:
    """(V,) a third of the area around every vertex and (V, 3) its unit normal, zero where no face is."""
    vectors = mesh.area_vectors()
    areas, normals = np.zeros(mesh.n_vertices), np.zeros((mesh.n_vertices, 3))
    for corner in mesh.face_vertices.T:
        areas += np.bincount(corner, np.linalg.norm(vectors, axis=1) / 3.0, mesh.n_vertices)
        normals += np.stack([np.bincount(corner, column, mesh.n_vertices) for column in vectors.T], axis=1)
    return areas, normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)


def wrapped(angle: Floats) -> Floats:
    """Angles in [-π, π)."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


def mirrored(samples: SectionSamples, s: Floats) -> tuple[SectionSamples, Floats]:
    """The samples and their mirror images beyond the axis, as far from each other as their radii say."""
    first = np.argsort(s)[: max(1, len(s) // 100)]
    s = s - s[first].mean() + samples.place[first, 0].mean()
    both = SectionSamples(
        np.concatenate([samples.place, samples.place * [-1, 1]]),
        np.concatenate([samples.normal, samples.normal * [-1, 1]]),
        np.tile(samples.weight, 2),
        np.concatenate([samples.angle, samples.angle + np.pi]),
        np.tile(samples.vertex, 2),
    )
    return both, np.concatenate([s, -s])


def edge_length(mesh: TriangleMesh) -> float:
    """Length of the longest sides of the mesh's faces, in the mean."""
    corners = mesh.corners()
    return float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1).mean())


def rough_lengths(samples: SectionSamples, edge: Floats, *, side: float) -> Floats:
    """(m,) rough length along the profile of every sample, NaN for samples that do not hang together with the hole.

    edge  (n, 2) the hole's edge; side: length of the mesh's edges
    The shortest way through cells of half a span, from the end of the profile that is nearer to the base.
    """
    link = max(LINKED, 2.0 * side)
    cell, cells = _cells(samples)
    heavy = cells.weight > 0.02 * np.median(cells.weight)
    graph = _linked_by_nearness(cells, heavy, link)
    return _lengths_from_base(graph, cells, heavy, edge=edge, link=link)[cell]


def lengths_along_mesh(samples: SectionSamples, edge: Floats, *, wall: TriangleMesh) -> Floats:
    """(m,) the same by ways that follow the mesh, so that they run down a foot ring and up again, and not across it.

    edge  (n, 2) the hole's edge; wall: the mesh that the samples stem from
    Only from one part of the mesh to another, as across a crack all round the vessel, they go to what lies near.
    """
    link = max(LINKED, 2.0 * edge_length(wall))
    cell, cells = _cells(samples)
    graph = _linked_by_mesh(samples, cell, cells, wall)
    part = connected_components(graph, directed=False)[1]
    share = np.bincount(part, cells.weight) / cells.weight.sum()
    heavy = share[part] > LEAST_PART
    near = _linked_by_nearness(cells, heavy, link).tocoo()
    a, b = near.coords
    across = part[a] != part[b]
    joins = sparse.csr_array((near.data[across], (a[across], b[across])), shape=graph.shape)
    return _lengths_from_base(graph + joins, cells, heavy, edge=edge, link=link)[cell]


def _linked_by_nearness(cells: _Cells, heavy: Bools, link: float) -> "sparse.csr_array":
    """(n, n) distances between cells no farther apart than a length that face alike."""
    near = cKDTree(cells.place).query_pairs(link, output_type="ndarray")
    alike = np.einsum("ij,ij->i", cells.normal[near[:, 0]], cells.normal[near[:, 1]]) > 0.3
    a, b = near[alike & heavy[near].all(axis=1)].T
    n = len(cells.place)
    return sparse.csr_array((np.linalg.norm(cells.place[a] - cells.place[b], axis=1) + 1e-9, (a, b)), shape=(n, n))


def _lengths_from_base(graph: "sparse.csr_array", cells: _Cells, heavy: Bools, *, edge: Floats, link: float) -> Floats:
    """(n,) lengths through the graph from the end of the profile nearer to the base; NaN off the hole's part."""
    part = connected_components(graph, directed=False)[1]
    at_hole = np.unique(cKDTree(cells.place[heavy]).query(edge)[1])
    end = int(np.flatnonzero(part == np.bincount(part[heavy][at_hole]).argmax())[0])
    for _ in range(2):  # the farthest from anywhere is an end, the farthest from there the other
        length = dijkstra(graph, directed=False, indices=end)
        end = int(np.argmax(np.where(np.isfinite(length), length, -1.0)))
    known = np.isfinite(length)
    _check_known(cells.place[known], edge, link)
    length[~known] = np.nan
    return _from_base_up(length, cells)


def lengths_from_lip(samples: SectionSamples, edge: Floats, *, wall: TriangleMesh) -> Floats:
    """(m,) rough length from the lip's top to every sample, negative on the outer wall; NaN for samples that do not
    hang together with it.

    edge  (n, 2) the hole's edge; wall: the mesh that the samples stem from
    The shortest way through cells that leaves the top to one side, or to the other, whichever is shorter: so the walls
    are told apart although each may turn back and forth, as where the lip is rolled.
    """
    cell, cells = _cells(samples)
    graph = _linked_by_mesh(samples, cell, cells, wall)
    heavy = graph.sum(axis=1) + graph.sum(axis=0) > 0.0
    if not heavy.any():
        raise NoSurface("The walls around the hole hang together nowhere: give more of the sherds beside it.")
    top = int(np.argmax(np.where(heavy, cells.place[:, 1], -np.inf)))
    ahead = (cells.place - cells.place[top]) @ np.array([-cells.normal[top, 1], cells.normal[top, 0]])
    # as wide as the longest link, so that none leads past it, and wide enough for a cell on either side
    from_top = dijkstra(graph, directed=False, indices=top)
    sides = [from_top[(side > 0.0) & (from_top > 0.0)] for side in (ahead, -ahead)]
    beside = from_top <= max(float(graph.max()), *(float(side.min(initial=np.inf)) for side in sides))
    outer, inner = (
        _lengths_past(graph, from_top, seeds=beside & side, barred=beside & ~side)
        for side in (ahead <= 0.0, ahead > 0.0)
    )
    s = np.where(inner < outer, inner, -outer)
    if not np.isfinite(s[s > 0]).any() or not np.isfinite(s[s < 0]).any():
        raise NoSurface("The walls around the hole meet in no lip: give more of the sherds beside it.")
    s[~np.isfinite(s)] = np.nan
    _check_known(cells.place[np.isfinite(s)], edge, LINKED)
    return np.asarray(s[cell])


def _lengths_past(graph: "sparse.csr_array", from_top: Floats, *, seeds: Bools, barred: Bools) -> Floats:
    """(n,) lengths of ways from the top that begin over the seeds and never touch what is barred."""
    if not seeds.any():
        return np.full(len(seeds), np.inf)
    free = sparse.diags_array((~barred).astype(np.float64))
    ways = dijkstra(
        (free @ graph @ free).tocsr(),
        directed=False,
        indices=np.flatnonzero(seeds),
        return_predecessors=True,
        min_only=True,
    )
    length, source = ways[0], ways[2]
    return np.asarray(length + np.where(source >= 0, from_top[np.maximum(source, 0)], 0.0))


def _linked_by_mesh(samples: SectionSamples, cell: Ints, cells: _Cells, wall: TriangleMesh) -> "sparse.csr_array":
    """(n, n) distances between cells that many edges of the mesh lead from and to, all round the vessel.

    Two walls may be nearer to each other than cells are wide, but no edge leads from one to the other; but for a few,
    where fracture was taken for wall, over cells that come from there alone.
    """
    number, weight = np.full(wall.n_vertices, -1), np.zeros(wall.n_vertices)
    number[samples.vertex], weight[samples.vertex] = cell, samples.weight
    ends = np.concatenate([wall.face_vertices[:, [k, (k + 1) % 3]] for k in range(3)])
    a, b = np.sort(number[ends], axis=1).T
    leads = (a >= 0) & (a != b)
    n = len(cells.place)
    count = sparse.coo_array((weight[ends[leads]].min(axis=1), (a[leads], b[leads])), shape=(n, n)).tocsr().tocoo()
    a, b = count.coords
    most = np.zeros(n)
    np.maximum.at(most, np.concatenate([a, b]), np.tile(count.data, 2))
    many = (count.data > FEW * np.median(most[most > 0.0])) & cells.recurring[a] & cells.recurring[b]
    a, b = a[many], b[many]
    length = np.linalg.norm(cells.place[a] - cells.place[b], axis=1) + 1e-9
    short = length <= LONGEST * np.median(length) if len(length) else many[:0]
    return sparse.csr_array((length[short], (a[short], b[short])), shape=(n, n))


def _check_known(place: Floats, edge: Floats, link: float) -> None:
    if np.quantile(cKDTree(place).query(edge)[0], 0.95) > 4 * link:
        raise NoSurface("The wall around the hole gives no single profile: give more of the sherds beside it.")


def _cells(samples: SectionSamples) -> tuple[Ints, _Cells]:
    """(m,) cell of every sample, and the cells' means; both sides of a foot fall into cells of their own."""
    quarter = np.floor(np.arctan2(samples.normal[:, 1], samples.normal[:, 0]) / (np.pi / 2))
    keys = np.column_stack([np.floor(samples.place / CELL), quarter]).astype(np.int64)
    cell = np.unique(keys, axis=0, return_inverse=True)[1].ravel()
    total = np.bincount(cell, samples.weight).astype(np.float64)
    place, normal = (
        np.stack([np.bincount(cell, samples.weight * x) / total for x in rows.T], axis=1)
        for rows in (samples.place, samples.normal)
    )
    sector = np.floor(wrapped(samples.angle) * (SECTORS / (2 * np.pi))).astype(np.int64)
    seen = np.unique(np.stack([cell, sector]), axis=1)[0]
    sectors = np.bincount(seen, minlength=len(total))
    return cell, _Cells(place, normal, total, sectors > SELDOM * np.median(sectors[cell]))


def _from_base_up(length: Floats, cells: _Cells) -> Floats:
    """Lengths counted from the other end where the tangent turned clockwise would point against the wall's normals."""
    order = np.argsort(length)[: np.isfinite(length).sum()]
    tangent = np.stack([-cells.normal[:, 1], cells.normal[:, 0]], axis=1)[order]
    # from cell to cell the place is noise; a few cells on it is a direction
    lag = max(1, len(order) // 20)
    steps = cells.place[order][lag:] - cells.place[order][:-lag]
    agreement = np.einsum("ij,ij->", steps, 0.5 * (tangent[lag:] + tangent[:-lag]))
    return length if agreement > 0 else np.nanmax(length) - length

"""What is known of the scan: its points, more points on its large triangles, and how near it is from anywhere.

A scan says nothing between its points but what its triangles say. Where they are large against the control mesh, as
over holes that were filled, a surface through the points alone may stray; so large triangles are sampled:

       .                       .
      / \\                     /.\\        measured points first, each with weight 1;
     /   \\        -->        /. .\\       then samples inside, which together weigh
    /     \\                 /. . .\\      SAMPLE_WEIGHT of a measured point each
   .-------.               .-------.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from recon.errors import NotManifold
from recon.geometric_fit.sharpening import SharpScan
from recon.geometry.mesh import TriangleMesh
from recon.numerics.distance import TriangleTree, nearest_on_triangles
from recon.numerics.face_loops import bent_sides, longest_sides
from recon.numerics.halfedges import FREE, TANGLED, edge_table, paired_sides, vertex_normals
from recon.numerics.rows import unit_vectors

__all__ = ["ScanData", "fold_places", "refuse_tangles", "scan_data"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
SmallInts = NDArray[np.int32]

SAMPLE_WEIGHT = 0.05
MOST_PIECES = 64  # into which the side of a triangle is cut
FOLD = 0.0  # cosine of the angle between neighbouring normals from which on an edge is a fold: 90 degrees


@dataclass(frozen=True, eq=False)
class ScanData:
    """Points to fit, and the scan they come from.

    mesh        the scan, with its cut-off edges put back where it has some
    as_measured the scan without these
    points      (N, 3) the scan's vertices that faces use, then vertices that fill its holes, then samples on large
                triangles
    weights     (N,) how much each counts
    normals     (N, 3) unit normals of the scan there, in single precision
    sampled_faces  the triangle of every sample
    measured    (M, 3) where the first M points were measured; some were moved onto sharp edges
    diagonal    of the box around the scan
    sharp_edges (E, 2) the edges of the mesh that are sharp
    """

    mesh: TriangleMesh
    as_measured: TriangleMesh
    points: Floats
    weights: Floats
    normals: NDArray[np.float32]
    sampled_faces: Ints
    measured: Floats
    diagonal: float
    sharp_edges: Ints

    @property
    def n_measured(self) -> int:
        """How many of the points were measured."""
        return len(self.measured)

    @property
    def counts(self) -> Floats:
        """(N,) one for each point that was measured, zero for the others."""
        return (np.arange(len(self.points)) < self.n_measured).astype(np.float64)

    @cached_property
    def tree(self) -> cKDTree:
        """Search tree over the points."""
        return cKDTree(self.points, leafsize=32, balanced_tree=False, compact_nodes=False)

    @cached_property
    def _vertex_numbers(self) -> SmallInts:
        """The vertex of the mesh that each point is, as far as the points are vertices."""
        return np.flatnonzero(_is_used(self.mesh)).astype(np.int32)

    def _faces_at(self, points: Ints) -> tuple[Ints, Ints]:
        """Where the triangles around each of some points (n,), each named once, begin, (n + 1,), and all of these."""
        n_vertices = len(self._vertex_numbers)
        place = np.full(self.mesh.n_vertices, -1, dtype=np.int32)
        is_vertex = points < n_vertices
        place[self._vertex_numbers[points[is_vertex]]] = np.flatnonzero(is_vertex)
        of_samples = np.full(len(points), -1)
        of_samples[~is_vertex] = self.sampled_faces[points[~is_vertex] - n_vertices]
        return _faces_around(self.mesh.face_vertices, place, of_samples)

    def nearest_on_triangles_at(self, places: Floats, at: Ints) -> tuple[Floats, Ints]:
        """(n, 3) the nearest point of the triangles around scan point at[i] to place i, and (n,) its triangle."""
        points, at = np.unique(at, return_inverse=True)
        starts, faces = self._faces_at(points)
        count = starts[at + 1] - starts[at]
        query = np.repeat(np.arange(len(at)), count)
        first = np.cumsum(count) - count
        face = faces[np.repeat(starts[at] - first, count) + np.arange(len(query))]
        foot, squared = nearest_on_triangles(places[query], self.mesh.vertices[self.mesh.face_vertices[face]])
        order = np.lexsort((squared, query))
        best = order[first]
        return foot[best], face[best]

    @cached_property
    def is_open(self) -> bool:
        """Whether the scan has a border."""
        return len(self.border) > 0

    @cached_property
    def border(self) -> Ints:
        """(B, 2) the edges of the scan with one face only."""
        face, side = np.nonzero(paired_sides(self.mesh.face_vertices) == FREE)
        faces = self.mesh.face_vertices[face]
        return np.stack([faces[np.arange(len(face)), side], faces[np.arange(len(face)), (side + 1) % 3]], axis=1)

    @cached_property
    def border_tree(self) -> TriangleTree:
        """Search tree over the border, whose edges are triangles without area."""
        return TriangleTree(self.mesh.vertices, self.border[:, [0, 1, 1]])

    @cached_property
    def sharp_tree(self) -> TriangleTree:
        """Search tree over the sharp edges, as triangles without area."""
        return TriangleTree(self.mesh.vertices, self.sharp_edges[:, [0, 1, 1]])

    @cached_property
    def fold_tree(self) -> cKDTree:
        """Search tree over the folds."""
        return cKDTree(self.folds)

    @cached_property
    def folds(self) -> Floats:
        """(m, 3) middles of the edges at which the scan itself folds, beside those that were put back."""
        return fold_places(self.as_measured.vertices, self.as_measured.face_vertices)


def scan_data(
    mesh: TriangleMesh,
    n_control: int,
    *,
    sharp: SharpScan | None = None,
    n_measured: int = -1,
    n_sampled: int = -1,
    fill_weight: float = SAMPLE_WEIGHT,
) -> ScanData:
    """The points to fit with about `n_control` control points; triangles as large as a control face are sampled.

    mesh         the scan; vertices that no face uses are left out
    sharp        the same with its edges put back; None: it has none
    n_measured   vertices from here on fill holes, and weigh `fill_weight`, as do those put back; -1: none do
    n_sampled    faces from here on fill holes, and are not sampled, however large; -1: none do
    """
    as_measured = mesh
    mesh, sharp_edges = sharp or SharpScan(mesh, np.empty((0, 2), dtype=np.int64))
    used = np.flatnonzero(_is_used(mesh))
    normals = vertex_normals(mesh.vertices, mesh.face_vertices).astype(np.float32)[used]
    vertices = _chosen(mesh.vertices, used)
    samples, face = _samples_on_large(mesh, n_control, mesh.n_faces if n_sampled < 0 else n_sampled)
    measured = used < (as_measured.n_vertices if n_measured < 0 else n_measured)
    weights = np.where(measured, 1.0, fill_weight)
    if len(samples):
        a, b, c = mesh.vertices[mesh.face_vertices[face]].transpose(1, 0, 2)
        vertices = np.concatenate([vertices, samples])
        normals = np.concatenate([normals, unit_vectors(np.cross(b - a, c - a)).astype(np.float32)])
        weights = np.concatenate([weights, np.full(len(samples), SAMPLE_WEIGHT)])
    measured_at = _chosen(as_measured.vertices, used[measured])
    # as they are in the mesh, edges put back: what a share of the diagonal is does not depend on them
    diagonal = float(np.linalg.norm(np.ptp(vertices[: len(used)][measured], axis=0)))
    return ScanData(mesh, as_measured, vertices, weights, normals, face, measured_at, diagonal, sharp_edges)


def _is_used(mesh: TriangleMesh) -> NDArray[np.bool_]:
    """(V,) whether any face has the vertex."""
    used = np.zeros(mesh.n_vertices, dtype=np.bool_)
    used[mesh.face_vertices.ravel()] = True
    return used


def _chosen(rows: Floats, which: Ints) -> Floats:
    """Those rows; no copy where they are all."""
    return rows if len(which) == len(rows) else rows[which]


def _samples_on_large(mesh: TriangleMesh, n_control: int, n_sampled: int) -> tuple[Floats, Ints]:
    """(m, 3) points half a control edge apart inside those of the first triangles with a side above one, and (m,)
    their faces."""
    longest, area = longest_sides(mesh.vertices, mesh.face_vertices)
    # a control face of an even mesh: twice as many faces as points
    control_edge = np.sqrt(area / (2.0 * n_control) * 4.0 / np.sqrt(3.0))
    pieces = np.clip(np.ceil(2.0 * longest / control_edge), 1, MOST_PIECES).astype(np.int64)
    pieces[longest <= control_edge] = 1
    pieces[n_sampled:] = 1
    points, faces = [np.empty((0, 3))], [np.empty(0, dtype=np.int64)]
    for n in np.unique(pieces[pieces > 1]).tolist():
        chosen = np.flatnonzero(pieces == n)
        i, j = np.indices((n, n)).reshape(2, -1)
        inside = i + j < n
        v, w = (i[inside] + 1 / 3) / n, (j[inside] + 1 / 3) / n
        bary = np.stack([1.0 - v - w, v, w], axis=1)
        points.append(np.einsum("mk,fkx->fmx", bary, mesh.vertices[mesh.face_vertices[chosen]]).reshape(-1, 3))
        faces.append(np.repeat(chosen, len(v)))
    return np.concatenate(points), np.concatenate(faces)


@njit(cache=True)
def _faces_around(faces: Ints, place: SmallInts, alone: Ints) -> tuple[Ints, Ints]:  # pragma: no cover - compiled
    """The faces with a corner at each of n places, as starts (n + 1,) and their numbers.

    place  (V,) which place a vertex is, -1 for none
    alone  (n,) the one face of a place that is no vertex, -1 for the others
    """
    starts = np.zeros(len(alone) + 2, dtype=np.int64)
    starts[2:] = (alone >= 0).astype(np.int64)
    for face in range(len(faces)):
        for corner in range(3):
            starts[place[faces[face, corner]] + 2] += place[faces[face, corner]] >= 0
    starts = np.cumsum(starts)
    found = np.empty(starts[-1], dtype=np.int64)
    for at in np.flatnonzero(alone >= 0):
        found[starts[at + 1]] = alone[at]
        starts[at + 1] += 1
    for face in range(len(faces)):
        for corner in range(3):
            at = place[faces[face, corner]]
            if at >= 0:
                found[starts[at + 1]] = face
                starts[at + 1] += 1
    return starts[:-1], found


def fold_places(vertices: Floats, faces: Ints) -> Floats:
    """(m, 3) middles of the edges whose two faces have normals over 90 degrees apart."""
    face, side = np.nonzero(bent_sides(vertices, faces, paired_sides(faces), FOLD))
    return 0.5 * (vertices[faces[face, side]] + vertices[faces[face, (side + 1) % 3]])


def refuse_tangles(scan: TriangleMesh) -> None:
    """Raise NotManifold for a scan with an edge that no surface has."""
    if not (paired_sides(scan.face_vertices) == TANGLED).any():
        return
    table = edge_table(scan.face_vertices)
    for edges, problem in (
        (table.overused(), "edges with more than two faces"),
        (table.misoriented(), "edges whose two faces disagree about what is outside"),
    ):
        if len(edges):
            where = scan.vertices[edges[0]].mean(axis=0).tolist()
            raise NotManifold(scan.name, f"{len(edges)} {problem}, where no surface can be fitted", where)

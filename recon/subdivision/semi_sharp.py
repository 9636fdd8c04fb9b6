"""Semi-sharp creases and corners: sharp for as many steps of refinement as their sharpness says, then smooth.

A step lowers every sharpness by one. An edge of sharpness s >= 1, or on the border, is halved; one of 0 < s < 1 goes
the share s of the way there from its smooth place. A vertex follows the rule that its sharp edges ask for:

    none or one   the scheme's own             two   3/4 of itself, 1/8 of the ends of both (a curve of its own)
    three up, or the vertex itself sharp       it stays

Where the rule after the step is another one, for sharpnesses of at most one end with it, the vertex goes the mean m of
these: m of the way to the place that the old rule asks for, 1 - m to that of the new one.

When no finite sharpness is left the mesh has smooth and sharp edges alone, and the limit surface is the one it had.

Paper  [derose1998], sharpness as a number and the blend of the rules; where the sharp edges of a vertex differ the mean
       is over those that end, as in OpenSubdiv, not over all.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from recon.errors import BadGeometry, NotManifold
from recon.geometry.control_mesh import ControlMesh

__all__ = [
    "MeshEdges",
    "Sharpness",
    "firm",
    "firm_points",
    "halved_creases",
    "mesh_edges",
    "refuse_cones",
    "semi_sharp_vertices",
    "sharpness_of",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


class MeshEdges(NamedTuple):
    """The edges of a control mesh, each once.

    ends    (E, 2) vertices, the lower first
    number  (H,) the edge from every corner to the next
    uses    (E,) faces on each
    """

    ends: Ints
    number: Ints
    uses: Ints


class Sharpness(NamedTuple):
    """(E,) sharpness of every edge, infinite on borders, and (V,) of every vertex; 0 where smooth."""

    edges: Floats
    vertices: Floats

    def after_a_step(self) -> "Sharpness":
        return Sharpness(np.maximum(self.edges - 1.0, 0.0), np.maximum(self.vertices - 1.0, 0.0))


def mesh_edges(mesh: ControlMesh) -> MeshEdges:
    """The edges; raises NotManifold when one has more than two faces."""
    n, corner = mesh.n_vertices, mesh.face_corners
    ahead = corner[mesh.next_corners()]
    keys, number, uses = np.unique(
        np.minimum(corner, ahead) * n + np.maximum(corner, ahead), return_inverse=True, return_counts=True
    )
    ends = np.stack([keys // n, keys % n], axis=1)
    if (uses > 2).any():
        place = mesh.vertices[ends[np.argmax(uses > 2)]].mean(axis=0)
        raise NotManifold("control mesh", "an edge has more than two faces", place.tolist())
    return MeshEdges(ends, number, uses)


def sharpness_of(mesh: ControlMesh, edges: MeshEdges) -> Sharpness:
    """Of all edges and vertices of the mesh.

    Creases that are no edge of a face say nothing, nor does a corner that stays sharp where no edge does.
    """
    of_edges, of_vertices = np.where(edges.uses == 1, np.inf, 0.0), np.zeros(mesh.n_vertices)
    place, found = _crease_places(mesh, edges)
    np.maximum.at(of_edges, place[found], mesh.crease_sharpness[found])
    np.maximum.at(of_vertices, mesh.corner_vertices, mesh.corner_sharpness)
    of_vertices[_cones(edges, of_edges, of_vertices)] = 0.0
    return Sharpness(of_edges, of_vertices)


def _cones(edges: MeshEdges, of_edges: Floats, of_vertices: Floats) -> Ints:
    """Vertices that stay sharp where no edge does."""
    held = np.zeros(len(of_vertices), dtype=bool)
    held[edges.ends[np.isinf(of_edges)]] = True
    return np.flatnonzero(np.isinf(of_vertices) & ~held)


def _crease_places(mesh: ControlMesh, edges: MeshEdges) -> tuple[Ints, Bools]:
    """(C,) the edge that is each crease, and whether there is one."""
    keys, creases = edges.ends @ [mesh.n_vertices, 1], np.sort(mesh.crease_edges, axis=1) @ [mesh.n_vertices, 1]
    place = np.minimum(np.searchsorted(keys, creases), len(keys) - 1)
    return place, keys[place] == creases


def firm_points(
    mesh: ControlMesh, edges: MeshEdges, sharpness: Sharpness, smooth: tuple[Floats, Floats]
) -> tuple[Floats, Floats]:
    """(V, 3) vertices and (E, 3) edge points after a step, from those of the smooth scheme."""
    vertices, edge_points = smooth
    share = np.minimum(sharpness.edges, 1.0)[:, None]
    middles = mesh.vertices[edges.ends].mean(axis=1)
    edge_points = share * middles + (1.0 - share) * edge_points
    after = sharpness.after_a_step()
    before_rule, before = _by_rule(mesh, edges, sharpness, vertices)
    after_rule, behind = _by_rule(mesh, edges, after, vertices)
    mean = np.where(before_rule == after_rule, 1.0, _ending(edges, sharpness))[:, None]
    return mean * before + (1.0 - mean) * behind, edge_points


def _by_rule(mesh: ControlMesh, edges: MeshEdges, sharpness: Sharpness, smooth: Floats) -> tuple[Ints, Floats]:
    """(V,) rule, 0 smooth, 1 curve, 2 still; (V, 3) where it takes every vertex."""
    sharp = edges.ends[sharpness.edges > 0.0]
    count = np.bincount(sharp.ravel(), minlength=mesh.n_vertices)
    rule = np.select([(count > 2) | (sharpness.vertices > 0.0), count == 2], [2, 1], 0)
    sums = np.zeros_like(mesh.vertices)
    np.add.at(sums, sharp[:, 0], mesh.vertices[sharp[:, 1]])
    np.add.at(sums, sharp[:, 1], mesh.vertices[sharp[:, 0]])
    curve = 0.75 * mesh.vertices + 0.125 * sums
    return rule, np.where((rule == 2)[:, None], mesh.vertices, np.where((rule == 1)[:, None], curve, smooth))


def _ending(edges: MeshEdges, sharpness: Sharpness) -> Floats:
    """(V,) mean of the sharpnesses at a vertex that end with this step; 0 where there is none."""
    last = (sharpness.edges > 0.0) & (sharpness.edges <= 1.0)
    ends, n = edges.ends[last].ravel(), len(sharpness.vertices)
    own = np.where(sharpness.vertices <= 1.0, sharpness.vertices, 0.0)
    total = np.bincount(ends, np.repeat(sharpness.edges[last], 2), n) + own
    return np.asarray(total / np.maximum(np.bincount(ends, minlength=n) + (own > 0.0), 1))


def halved_creases(mesh: ControlMesh, edges: MeshEdges, first: int) -> dict[str, NDArray[np.generic]]:
    """Creases and corners after a step; edge e has its point at vertex first + e."""
    place, found = _crease_places(mesh, edges)
    left = mesh.crease_sharpness - 1.0
    kept = found & (left > 0.0)
    middle = first + place[kept]
    still = mesh.corner_sharpness > 1.0
    return {
        "crease_edges": np.concatenate([np.stack([mesh.crease_edges[kept, i], middle], axis=1) for i in range(2)]),
        "crease_sharpness": np.tile(left[kept], 2),
        "corner_vertices": mesh.corner_vertices[still],
        "corner_sharpness": mesh.corner_sharpness[still] - 1.0,
    }


def firm(mesh: ControlMesh) -> ControlMesh:
    """The mesh with those of its creases and corners that stay sharp."""
    return ControlMesh(
        mesh.vertices,
        mesh.face_corners,
        mesh.face_starts,
        mesh.crease_edges[np.isinf(mesh.crease_sharpness)],
        mesh.corner_vertices[np.isinf(mesh.corner_sharpness)],
    )


def semi_sharp_vertices(mesh: ControlMesh) -> Bools:
    """(V,) whether a semi-sharp crease ends or passes there, or the vertex is a semi-sharp corner."""
    met = np.zeros(mesh.n_vertices, dtype=bool)
    met[mesh.crease_edges[np.isfinite(mesh.crease_sharpness)]] = True
    met[mesh.corner_vertices[np.isfinite(mesh.corner_sharpness)]] = True
    return met


def refuse_cones(mesh: ControlMesh) -> None:
    """Raise BadGeometry when a corner stays sharp where no edge does: the surface would have a cone there."""
    edges = mesh_edges(mesh)
    of_vertices = np.zeros(mesh.n_vertices)
    np.maximum.at(of_vertices, mesh.corner_vertices, mesh.corner_sharpness)
    cones = _cones(edges, sharpness_of(mesh, edges).edges, of_vertices)
    if len(cones):
        x, y, z = mesh.vertices[cones[0]]
        problem = f"corner near ({x:.4g}, {y:.4g}, {z:.4g}) has no sharp edge; a cone has no tangent plane"
        raise BadGeometry("control mesh", f"{problem}. Give it a sharpness below 10, or make edges there sharp")

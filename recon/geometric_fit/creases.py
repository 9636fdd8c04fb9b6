"""Sharp edges of a scan, found on its control mesh: where two faces stand at an angle that the scan has nearby too.

A control edge is bent because the shape is sharp there, or because the control mesh is coarse. The scan tells which:
normals are compared on both sides of the edge, near to it. A sharp edge keeps its angle there, a round one loses it.

       sharp  ______            round   ___---___        a, b   where the scan is asked: up to a third of an edge
             a   b  \\                   /  a  b  \\               to the left and to the right of its middle
                     \\                 |        |

    bent edges  ->  confirmed by the scan  ->  chains that are `LONG`  ->  corners where a chain turns sharply

Paper  [hoppe1994], sharp edges, darts and corners of a subdivision surface.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from recon.geometric_fit.chains import chain_lengths, chains_of
from recon.geometric_fit.sharpening import SharpScan
from recon.geometry.control_mesh import ControlMesh
from recon.geometry.mesh import TriangleMesh
from recon.numerics.distance import TriangleTree
from recon.numerics.halfedges import boundary_loops, edge_table
from recon.numerics.rows import unit_vectors

__all__ = ["n_loose_ends", "with_creases"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

REACH = 0.35  # of a control edge: how far from it the scan is asked
CONFIRMED = 0.75  # of the angle asked for is found in the scan, whose edges are a little rounded
EDGED = 0.1  # of all edges in long chains: the shape is one with sharp edges, and shorter chains count too
SHORTEST = 4  # edges in a chain of such a shape: fewer are a bump
WEAK, ALONG = 0.5, 0.15  # of the angle, and of its length off a sharp edge that was put back: enough for an edge there
LONG = 0.5  # of the diagonal, all edges of a chain together: what is shorter, as a hoof or an ear, is fitted smoothly
NEAREST = 24  # faces of the scan that are asked at each edge at least, as far as they are within reach
SHARP_TURN = np.cos(np.radians(50.0))  # between two edges of a chain that meet in a corner


def with_creases(mesh: ControlMesh, scan: SharpScan, angle: float) -> ControlMesh:
    """The control mesh with its sharp edges marked, and the corners of these and of its border.

    angle  radians between the normals of two faces from which on the edge is sharp
    """
    table = edge_table(mesh.faces_of(3))
    edge, one, two = table.face_pairs()
    normals = unit_vectors(mesh.triangle_mesh().area_vectors())
    turn = np.arccos(np.clip(np.einsum("ij,ij->i", normals[one], normals[two]), -1.0, 1.0))
    bent = turn > (angle if len(scan.edges) == 0 else WEAK * angle)
    edges, outward = table.edges[edge[bent]], (normals[one] + normals[two])[bent]
    if len(scan.edges):
        creases = _once_along_slivers(mesh, edges[_along(mesh.vertices[edges], scan)])
    else:
        found = _angle_in_scan(mesh, scan.mesh, edges, outward) > CONFIRMED * angle
        creases = _chains(edges[found], mesh.vertices, len(table.edges))
    border = table.edges[table.uses == 1]
    corners = _corners(mesh.vertices, np.concatenate([creases, border]))
    on_border_alone = np.isin(corners, border) & ~np.isin(corners, creases)
    if on_border_alone.any():
        asked = corners[on_border_alone]
        corners = np.union1d(corners[~on_border_alone], asked[_turn_in_scan(mesh.vertices, border, asked, scan.mesh)])
    return ControlMesh(mesh.vertices, mesh.face_corners, mesh.face_starts, creases, corners)


def _along(ends: Floats, scan: SharpScan) -> Bools:
    """(m,) whether control edges, given by their ends (m, 2, 3), lie along sharp edges of the scan."""
    tree = TriangleTree(scan.mesh.vertices, scan.edges[:, [0, 1, 1]])
    places = np.stack([ends[:, 0], ends.mean(axis=1), ends[:, 1]], axis=1)
    off = np.linalg.norm(tree.closest(places.reshape(-1, 3)).points.reshape(places.shape) - places, axis=2)
    return np.asarray(off.max(axis=1) < ALONG * np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1))


def _once_along_slivers(mesh: ControlMesh, edges: Ints) -> Ints:
    """The edges without the longest side of every face that has all three: a sliver that lies along a sharp edge."""
    faces, n = mesh.faces_of(3), mesh.n_vertices
    sides = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2), axis=2)
    keys, own = sides[..., 0] * n + sides[..., 1], np.sort(edges, axis=1)
    slivers = np.isin(keys, own[:, 0] * n + own[:, 1]).all(axis=1)
    lengths = np.linalg.norm(mesh.vertices[sides[slivers, :, 0]] - mesh.vertices[sides[slivers, :, 1]], axis=2)
    longest = keys[slivers, lengths.argmax(axis=1)]
    return edges[~np.isin(own[:, 0] * n + own[:, 1], longest)]


def n_loose_ends(mesh: ControlMesh) -> int:
    """How many vertices one crease alone leads to: many where the creases are ragged."""
    return int((np.bincount(mesh.crease_edges.ravel()) == 1).sum())


def _angle_in_scan(mesh: ControlMesh, scan: TriangleMesh, edges: Ints, outward: Floats) -> Floats:
    """(m,) the angle between the mean normals of the scan on both sides of each edge, near its middle."""
    if len(edges) == 0:
        return np.empty(0)
    centres = scan.vertices[scan.face_vertices[:, 0]]
    for corner in (1, 2):
        centres += scan.vertices[scan.face_vertices[:, corner]]
    centres /= 3.0
    start, end = mesh.vertices[edges[:, 0]], mesh.vertices[edges[:, 1]]
    middle, length = (start + end) / 2.0, np.linalg.norm(end - start, axis=1)
    across = unit_vectors(np.cross(outward, end - start))
    distance, near = cKDTree(centres, leafsize=32, balanced_tree=False, compact_nodes=False).query(
        middle, k=min(NEAREST, len(centres))
    )
    distance, near = distance.reshape(len(edges), -1), near.reshape(len(edges), -1)
    # the edge may lie a little off the scan: what is within reach is counted from the nearest face
    within = distance <= distance[:, :1] + REACH * length[:, None]
    side = np.einsum("mki,mi->mk", centres[near] - centres[near[:, :1]], across)
    side -= np.median(side, axis=1, keepdims=True)
    a, b, c = scan.vertices[scan.face_vertices[near]].transpose(2, 0, 1, 3)
    normals = np.cross(b - a, c - a)
    left, right = (unit_vectors(np.einsum("mk,mki->mi", within & chosen, normals)) for chosen in (side > 0, side < 0))
    return np.arccos(np.clip(np.einsum("mi,mi->m", left, right), -1.0, 1.0))


def _chains(edges: Ints, vertices: Floats, n_edges: int) -> Ints:
    """The edges that hang together with enough others: over LONG of the diagonal, or some few where all is sharp."""
    if len(edges) == 0:
        return edges
    chain = chains_of(edges, len(vertices))
    long = chain_lengths(edges, vertices) >= LONG * np.linalg.norm(np.ptp(vertices, axis=0))
    return edges[np.bincount(chain)[chain] >= SHORTEST if long.sum() > EDGED * n_edges else long]


def _turn_in_scan(vertices: Floats, border: Ints, corners: Ints, scan: TriangleMesh) -> Bools:
    """(m,) whether the border of the scan turns sharply near these corners (m,) of the control mesh's border (B, 2).

    The control mesh turns in a round hole, too, if it has few edges there.
    """
    ends = vertices[border]
    length = np.full(len(vertices), np.inf)
    np.minimum.at(length, border, np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)[:, None])
    loops = boundary_loops(scan.face_vertices)
    tree = cKDTree(scan.vertices[np.concatenate(loops)])
    _, nearest = tree.query(vertices[corners])
    loop_of = np.repeat(np.arange(len(loops)), [len(loop) for loop in loops])
    first = np.cumsum([0] + [len(loop) for loop in loops])
    found = np.zeros(len(corners), dtype=np.bool_)
    for number in np.unique(loop_of[nearest]).tolist():
        asked = np.flatnonzero(loop_of[nearest] == number)
        row = scan.vertices[loops[number]]
        steps = np.linalg.norm(np.roll(row, -1, axis=0) - row, axis=1)
        along = np.concatenate([[0.0], np.cumsum(steps)])
        here = along[nearest[asked] - first[number]]
        reach = REACH * length[corners[asked]]
        before, at, after = (_places(row, along, here + k * reach) for k in (-1.0, 0.0, 1.0))
        found[asked] = np.einsum("mi,mi->m", unit_vectors(at - before), unit_vectors(after - at)) < SHARP_TURN
    return found


def _places(row: Floats, along: Floats, wanted: Floats) -> Floats:
    """(m, 3) places so far along a closed row of points (n, 3); along (n + 1,) how far each is, and the first again."""
    closed = np.concatenate([row, row[:1]])
    return np.stack([np.interp(wanted % along[-1], along, closed[:, k]) for k in range(3)], axis=1)


def _corners(vertices: Floats, sharp: Ints) -> Ints:
    """(K,) vertices in which two sharp edges, creases or borders, meet at a sharp turn.

    The turn is seen from two edges away, where the chain leads that far: short edges zigzag on a noisy scan.
    """
    ends = np.concatenate([sharp, sharp[:, ::-1]])
    ends = ends[np.argsort(ends[:, 0], kind="stable")]
    count = np.bincount(ends[:, 0], minlength=len(vertices))
    first = np.cumsum(count) - count
    vertex = np.flatnonzero(count == 2)

    def ahead(nearest: Ints) -> Floats:
        pair = ends[first[nearest][:, None] + np.array([0, 1]) * (count[nearest] == 2)[:, None], 1]
        beyond = np.where(pair[:, 0] == vertex, pair[:, 1], pair[:, 0])
        reached = np.where(count[nearest] == 2, beyond, nearest)
        return unit_vectors(vertices[reached] - vertices[vertex])

    one, two = ahead(ends[first[vertex], 1]), ahead(ends[first[vertex] + 1, 1])
    return vertex[np.einsum("ij,ij->i", one, two) > -SHARP_TURN]

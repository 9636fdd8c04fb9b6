"""The outer walls of all sherds as one mesh with one hole in it: what programs that fill holes ask for.

Sherds have cracks between them, and neighbours that overlap by a tenth of a millimetre. Here the points of all walls
around the hole, and those of the hole's edge, are joined by one Delaunay triangulation in a chart over the hole, which
bridges the cracks and leaves out the hole. The points stay where they were measured.

     sherd A  |  sherd B          .--+--+--+--.        chart: rays from a point behind the hole,
       - - - -.- - - -            | \\|/ | \\/ |               then stereographic
             /  \\        ->       +--+.---.+--+
       - - -( ?  )- - -           |/ (     ) \\|        edge: the one line where triangles end inside
             \\__/                 +--+'---'+--+
"""

from dataclasses import dataclass

import numpy as np
from matplotlib.path import Path as Outline
from numpy.typing import NDArray
from scipy.spatial import Delaunay, cKDTree

from recon.geometry.mesh import TriangleMesh
from recon.hole_patch.smoothing import taubin_smooth
from recon.hole_patch.surroundings import Wall
from recon.numerics.halfedges import boundary_loops, connected_components, vertex_normals

__all__ = ["Chart", "StitchedWall", "stitched_wall", "without_relief"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

RELIEF_REACH = 2.5  # millimetres beside a border where the filter is held back by the vertices that do not move
WIDTH = 0.6  # of the wall kept around the hole, in radii of the hole
SLANT = 0.2  # cosine between ray and normal: beyond, the wall folds over itself in the chart


@dataclass(frozen=True, eq=False)
class Chart:
    """Plane coordinates of points about a hole: rays from `eye`, stereographic about the direction `up`."""

    eye: Floats
    frame: Floats  # (3, 3) two directions across, and up

    def __call__(self, points: Floats) -> Floats:
        ray = points - self.eye
        x, y, z = self.frame @ (ray / np.linalg.norm(ray, axis=1, keepdims=True)).T
        return np.stack([x, y], axis=1) / (1.0 + np.maximum(z, -0.99))[:, None]


@dataclass(frozen=True, eq=False)
class StitchedWall:
    """The wall around a hole as one mesh.

    mesh   manifold; open along the hole and along its far border
    hole   (n,) vertices of the hole's boundary, in order
    edge   (m, 3) the hole's edge as it was scanned
    chart  in which the triangles do not overlap
    """

    mesh: TriangleMesh
    hole: Ints
    edge: Floats
    chart: Chart

    def in_hole(self, mesh: TriangleMesh) -> TriangleMesh:
        """The faces of a filled mesh that lie in the hole: hung together at it, within its outline, not of the wall."""
        own = cKDTree(self.mesh.corners().mean(axis=1))
        new = _welded(mesh.part(own.query(mesh.corners().mean(axis=1))[0] > 1e-3 * _spacing(self.mesh)))
        part = connected_components(new.face_vertices)
        parts = [new.part(part == k) for k in range(int(part.max(initial=-1)) + 1)]
        if not parts:
            return new
        rim = self.mesh.vertices[self.hole]
        filling = min(parts, key=lambda piece: float(cKDTree(piece.vertices).query(rim)[0].mean()))
        outline = Outline(self.chart(self.edge))
        return filling.part(outline.contains_points(self.chart(filling.corners().mean(axis=1))))


def stitched_wall(wall: Wall) -> StitchedWall:
    """One mesh of the wall as scanned, six tenths of the hole's radius wide."""
    spacing = _spacing(wall.measured)
    middle = wall.edge.points.mean(axis=0)
    reach = float(np.linalg.norm(wall.edge.points - middle, axis=1).max())
    chart = _chart(wall, middle, reach)
    edge = _even(wall.edge.points, spacing)
    normals = vertex_normals(wall.measured.vertices, wall.measured.face_vertices)
    near = cKDTree(edge).query(wall.measured.vertices)[0] < WIDTH * reach
    ray = wall.measured.vertices - chart.eye
    near &= (normals * ray).sum(axis=1) > SLANT * np.linalg.norm(ray, axis=1)
    own = _without_overlap(wall.measured.vertices[near], wall.sherds[near], 0.5 * spacing)
    clear = cKDTree(edge).query(own)[0] > 0.5 * spacing
    clear &= ~Outline(chart(wall.edge.points)).contains_points(chart(own))
    points = np.concatenate([edge, own[clear]])
    mesh = _manifold(points, _triangles(points, len(edge), chart, spacing))
    return StitchedWall(mesh, _hole_of(mesh, edge), wall.edge.points, chart)


def without_relief(wall: StitchedWall) -> StitchedWall:
    """The same with its relief filtered off as one sheet, and the hole grown by what the filter could not reach.

    Where the hole would grow into the far border of the wall, it grows less.
    """
    smooth = taubin_smooth(wall.mesh)
    spacing = _spacing(smooth)
    away = cKDTree(wall.edge).query(smooth.vertices)[0]
    reach = max(RELIEF_REACH, 3.0 * spacing)
    while reach > spacing:
        faces = smooth.face_vertices[(away[smooth.face_vertices] >= reach).all(axis=1)]
        mesh = _manifold(smooth.vertices, faces)
        hole = _hole_of(mesh, wall.edge)
        if cKDTree(wall.edge).query(mesh.vertices[hole])[0].max() < reach + 3.0 * spacing:
            return StitchedWall(mesh, hole, wall.edge, wall.chart)
        reach *= 0.8
    return StitchedWall(smooth, wall.hole, wall.edge, wall.chart)


def _hole_of(mesh: TriangleMesh, edge: Floats) -> Ints:
    """The border of the mesh that lies nearest to the edge."""
    tree = cKDTree(edge)
    loops = boundary_loops(mesh.face_vertices)
    return min(loops, key=lambda loop: float(tree.query(mesh.vertices[loop])[0].mean()))


def _chart(wall: Wall, middle: Floats, reach: float) -> Chart:
    normals = vertex_normals(wall.measured.vertices, wall.measured.face_vertices)
    _, beside = cKDTree(wall.measured.vertices).query(wall.edge.points)
    up = normals[beside].mean(axis=0)
    up /= np.linalg.norm(up)
    across = np.cross(np.eye(3)[np.argmin(np.abs(up))], up)
    across /= np.linalg.norm(across)
    return Chart(middle - reach * up, np.stack([across, np.cross(up, across), up]))


def _welded(mesh: TriangleMesh) -> TriangleMesh:
    """The mesh with vertices in one place made one; faces that collapse are left out."""
    steps = np.round(mesh.vertices / (1e-5 * _spacing(mesh))) if mesh.n_faces else mesh.vertices
    _, first, number = np.unique(steps, axis=0, return_index=True, return_inverse=True)
    faces = number.ravel()[mesh.face_vertices]
    whole = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    return TriangleMesh(mesh.vertices[first], faces[whole])


def _spacing(mesh: TriangleMesh) -> float:
    a, b, _ = mesh.corners().transpose(1, 0, 2)
    return float(np.median(np.linalg.norm(b - a, axis=1)))


def _even(line: Floats, step: float) -> Floats:
    """A closed line with its points at even steps."""
    closed = np.concatenate([line, line[:1]])
    run = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    at = np.linspace(0.0, run[-1], max(8, round(run[-1] / step)), endpoint=False)
    return np.stack([np.interp(at, run, closed[:, k]) for k in range(3)], axis=1)


def _without_overlap(points: Floats, sherds: Ints, reach: float) -> Floats:
    """Of two points of different sherds nearer than `reach` the first."""
    i, j = cKDTree(points).query_pairs(reach, output_type="ndarray").T
    kept = np.ones(len(points), dtype=bool)
    kept[np.maximum(i, j)[sherds[i] != sherds[j]]] = False
    return points[kept]


def _triangles(points: Floats, n_edge: int, chart: Chart, spacing: float) -> Ints:
    flat = chart(points)
    faces = Delaunay(flat).simplices.astype(np.int64)
    a, b, c = flat[faces].transpose(1, 0, 2)
    turned = (b - a)[:, 0] * (c - a)[:, 1] < (b - a)[:, 1] * (c - a)[:, 0]
    faces[turned] = faces[turned][:, ::-1]
    corners = points[faces]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    outside = ~Outline(flat[:n_edge]).contains_points(flat[faces].mean(axis=1))
    return faces[outside & (longest < 5.0 * spacing)]


def _manifold(points: Floats, faces: Ints) -> TriangleMesh:
    """The largest part, less the faces at vertices where its border touches itself."""
    while True:
        part = connected_components(faces)
        faces = faces[part == np.bincount(part).argmax()]
        border = np.concatenate(boundary_loops(faces))
        touching = np.flatnonzero(np.bincount(border, minlength=len(points)) > 1)
        if not len(touching):
            return TriangleMesh(points, faces, "wall").part(np.s_[:])
        faces = faces[~np.isin(faces, touching).any(axis=1)]

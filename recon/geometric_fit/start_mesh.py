"""The control mesh that a fit starts from: the scan simplified, its sharp edges marked, valences evened out.

Quadrilaterals come from the control mesh of a Loop surface, which has put its points in their places.

Paper  [maekawa2009], step 1; the rest is ours.
"""

from collections.abc import Callable

import numpy as np

from recon.geometric_fit.creases import n_loose_ends, with_creases
from recon.geometric_fit.growth import Growth
from recon.geometric_fit.initial_mesh import NoControlMesh, initial_mesh
from recon.geometric_fit.options import FitOptions
from recon.geometric_fit.quad_mesh import initial_quads
from recon.geometric_fit.quad_turns import turned_to_even_valences
from recon.geometric_fit.refinement import flip_to_even_valences
from recon.geometric_fit.relaxation import relaxed
from recon.geometric_fit.sharpening import SharpScan
from recon.geometry.control_mesh import ControlMesh
from recon.subdivision.limit_surface import Scheme, limit_points

__all__ = ["first_count", "start_mesh"]

FIRST_SHARE = 0.8  # of the control points are there from the start, the others come where the error is
RAGGED, COARSER = 0.1, 0.7  # loose ends a crease from where on it starts with so much fewer control points
FEWEST = 100  # control points at which no fewer are tried
COARSEST = 0.5  # of them, or so many: a scan that is ragged still is rough, and has no edges worth fewer points
FIRST_QUADS = 0.97  # of quadrilaterals: those are taken from a fit of triangles, which has put them in their places
FIRST_SHARP_QUADS = 0.85  # of them where edges were put back: small faces that come later fold less


def first_count(options: FitOptions, growth: Growth, n_measured: int, *, has_edges: bool) -> int:
    """How many control points a fit starts with.

    n_measured  points of the scan
    has_edges   whether sharp edges were put back that the scan had cut off
    """
    if options.plain:
        return growth.limit
    if growth.toward_tolerance:
        return max(min(n_measured // 100, growth.limit), 100)
    share = FIRST_SHARE
    if options.scheme is not Scheme.LOOP:
        share = FIRST_SHARP_QUADS if has_edges else FIRST_QUADS
    return max(int(share * growth.limit), 4)


def start_mesh(
    sharp: SharpScan, options: FitOptions, count: int, by_loop: Callable[[FitOptions], ControlMesh], *, is_open: bool
) -> ControlMesh:
    """The control mesh that a fit starts from: triangles for Loop's scheme, else quadrilaterals.

    sharp    the scan, with its sharp edges
    count    control points of it
    by_loop  the control mesh of a fit to the same scan by Loop's scheme
    is_open  whether the scan has borders
    Raises   NoControlMesh.
    """

    def triangles(count: int) -> ControlMesh:
        return _triangles(sharp, options, count)

    def fitted_triangles(count: int) -> ControlMesh:
        """Of a Loop surface: points are where the error was, valences even."""
        loop = FitOptions(control_points=count, crease_angle=options.crease_angle, robust=options.robust)
        mesh = by_loop(loop)
        folds_at_edges = options.scheme is Scheme.DOO_SABIN and len(mesh.crease_edges) > 0
        return _on_its_surface(mesh) if folds_at_edges or is_open else mesh

    def evened(quads: ControlMesh) -> ControlMesh:
        """Even valences, and even spacing between sharp edges."""
        return relaxed(quads, sharp.mesh) if len(quads.crease_edges) else turned_to_even_valences(quads)

    if options.scheme is Scheme.LOOP:
        return triangles(count)
    return initial_quads(triangles if options.plain else fitted_triangles, count, evened=evened)


def _triangles(sharp: SharpScan, options: FitOptions, count: int) -> ControlMesh:
    """The scan simplified, its sharp edges marked, valences evened out."""
    mesh = _with_edges(sharp, options, count)
    if mesh is not None and len(mesh.crease_edges):
        return relaxed(mesh, sharp.mesh)
    return flip_to_even_valences(mesh or initial_mesh(sharp.mesh, count))


def _with_edges(sharp: SharpScan, options: FitOptions, count: int) -> ControlMesh | None:
    """The scan simplified, its edges marked, coarser while these are ragged; None where none of them is left then."""
    mesh = with_creases(initial_mesh(sharp.mesh, count), sharp, options.crease_angle)
    if options.plain or count <= FEWEST or not _is_ragged(mesh):
        return mesh
    return _less_ragged(sharp, count, options.crease_angle)


def _less_ragged(sharp: SharpScan, count: int, angle: float) -> ControlMesh | None:
    """A coarser mesh whose sharp edges are chains, if there are any in the end.

    The simplifier keeps what is ragged at the edges of a sharp scan, if it may; points come later.
    """
    least = max(FEWEST, int(COARSEST * count))
    while count > least:
        count = int(COARSER * count)
        try:
            mesh = with_creases(initial_mesh(sharp.mesh, count), sharp, angle)
        except NoControlMesh:
            return None
        if not _is_ragged(mesh):
            return mesh if len(mesh.crease_edges) else None
    return None


def _on_its_surface(triangles: ControlMesh) -> ControlMesh:
    """The mesh with every point on the Loop surface; where that bends, its control points lie beside it."""
    faces = triangles.faces_of(3)
    vertices, corner = np.unique(faces, return_index=True)
    v, w = (np.where(corner % 3 == i, 1.0, 0.0) for i in (1, 2))
    points = triangles.vertices.copy()
    points[vertices] = limit_points(triangles, (corner // 3, v, w))[:, 0]
    return triangles.with_vertices(points)


def _is_ragged(mesh: ControlMesh) -> bool:
    """Whether many creases lead nowhere."""
    return n_loose_ends(mesh) > RAGGED * len(mesh.crease_edges)

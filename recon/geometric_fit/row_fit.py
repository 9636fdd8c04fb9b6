"""The fit that makes the best solid: quadrilaterals in rows, few of their vertices irregular.

    coarse rows of quads  ->  wrapped over the scan  ->  each in four, wrapped again  ->  fit  ->  rows halved  ->  fit

A solid has a few faces for every irregular vertex, and its other faces may be as large as the rows run. A coarse mesh
has few irregular vertices, and neither cutting every quad in four nor cutting whole rows makes more. So the control
points come that way, the last of them where the error is.

Paper  [jakob2015], the rows; [maekawa2009], the fit.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from recon.geometric_fit.foot_points import ROUGH, nearest_feet
from recon.geometric_fit.hole_filling import close_holes
from recon.geometric_fit.initial_mesh import NoControlMesh
from recon.geometric_fit.options import FitOptions, FittedSurface
from recon.geometric_fit.pipeline import fit_surface
from recon.geometric_fit.quad_remesh import remeshed_quads
from recon.geometric_fit.quad_splits import split_rows
from recon.geometric_fit.wrapping import wrapped
from recon.geometry.control_mesh import ControlMesh
from recon.geometry.mesh import TriangleMesh
from recon.subdivision.limit_surface import Scheme, limit_patches
from recon.subdivision.polygons import split_polygons

__all__ = ["fit_rows"]

SHARE, MOST = 3, 16_000  # control points where nobody asks: a third of the scan's, but no more
COARSE, MOST_COARSE = 20, 1_800  # quads to begin with: a twentieth of the scan's points, but no more
FEWEST = 50  # quads; a mesh for fewer control points than four times that begins with all of them
PASSES = (20, 10)  # of wrapping, before the quads are cut in four and after
DOUBLINGS, DENSER = 4, 1.3  # attempts, and times more quads where a coarse mesh comes out torn


def fit_rows(
    scan: TriangleMesh, options: FitOptions, *, doing: Callable[[str], None] = lambda step: None
) -> FittedSurface:
    """The Catmull-Clark surface of a control mesh in rows; twice as many control points where the tolerance asks.

    Raises  as `fit_surface`; NoControlMesh.
    """
    whole, _ = close_holes(scan) if options.close else (scan, 0)
    count = options.control_points or min(max(scan.n_vertices // SHARE, 200), MOST)
    for _ in range(DOUBLINGS):
        fitted = _fit(scan, whole, replace(options, control_points=count), doing)
        reached = options.tolerance is None or float(fitted.distances.max()) <= options.tolerance
        if reached or options.control_points is not None or 2 * count > scan.n_vertices:
            break
        count *= 2
    return fitted


def _fit(scan: TriangleMesh, whole: TriangleMesh, options: FitOptions, doing: Callable[[str], None]) -> FittedSurface:
    count = options.control_points or 0
    mesh = _laid_over(whole, count, doing)
    first = fit_surface(scan, _from(options, mesh), doing=doing)
    grown = split_rows(first.mesh, _squares(whole, first.mesh), count - first.mesh.n_vertices)
    if grown.n_vertices == first.mesh.n_vertices:
        return first
    second = fit_surface(scan, _from(options, grown), doing=doing)
    rounds = (*first.rounds, *(r._replace(number=r.number + len(first.rounds)) for r in second.rounds))
    return replace(second, rounds=rounds)


def _from(options: FitOptions, mesh: ControlMesh) -> FitOptions:
    return replace(options, start=mesh, plain=True, control_points=mesh.n_vertices)


def _laid_over(scan: TriangleMesh, count: int, doing: Callable[[str], None]) -> ControlMesh:
    """At most `count` control points in rows over the scan, a fourth of them to begin with.

    Raises  NoControlMesh when the rows come out torn, however many there are.
    """
    cut = count >= 4 * FEWEST
    n_quads = min(count // 4, max(scan.n_vertices // COARSE, FEWEST), MOST_COARSE) if cut else count
    for last in (False,) * DOUBLINGS + (True,):
        doing(f"laying about {n_quads} quadrilaterals over the scan")
        try:
            mesh = remeshed_quads(scan, n_quads)
        except NoControlMesh:
            if last:
                raise
            n_quads = int(DENSER * n_quads)
            continue
        n_points = mesh.n_vertices + 3 * mesh.n_faces if cut else mesh.n_vertices
        if n_points <= count:
            break
        n_quads = int(0.95 * n_quads * count / n_points)
    mesh = wrapped(mesh, scan, PASSES[0])
    return wrapped(split_polygons(mesh), scan, PASSES[1]) if cut else mesh


def _squares(scan: TriangleMesh, mesh: ControlMesh) -> NDArray[np.float64]:
    """(F,) the squared distances of the scan's points from the surface, summed over those nearest to each face."""
    patches = limit_patches(mesh, Scheme.CATMULL_CLARK)
    feet = nearest_feet(patches, patches.points @ mesh.vertices, scan.vertices, step=ROUGH)
    off = feet.positions - scan.vertices
    return np.bincount(feet.patch // 4, np.einsum("ni,ni->n", off, off), mesh.n_faces).astype(np.float64)

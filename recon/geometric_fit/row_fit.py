"""The fit that makes the best solid: quadrilaterals in rows, few of their vertices irregular.

    coarse rows of quads  ->  wrapped over the scan, tips and all  ->  each in four  ->  fit  ->  rows halved  ->  fit

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
from recon.geometric_fit.tips import covered_tips
from recon.geometric_fit.wrapping import wrapped
from recon.geometry.control_mesh import ControlMesh
from recon.geometry.mesh import TriangleMesh
from recon.subdivision.limit_surface import Scheme, limit_patches
from recon.subdivision.polygons import split_polygons

__all__ = ["fit_rows"]

SHARE, MOST = 3, 30_000  # control points where nobody asks: a third of the scan's, more where it is rich in detail
COARSE, MOST_COARSE = 20, 6_500  # quads to begin with: a twentieth of the scan's points, but no more
FIRST_COARSE = 1_800  # quads of the first attempt at the most
FINEST = 6  # points of the scan a quad, at the least
NEAR = 0.015  # per cent of the diagonal: how near in the mean square a fit is to come where nobody asks for a number
DENSIFYING, FASTER = 1.5, (1.3, 4.0)  # quads grow with that power of what it is too far off, so much at a time
WORTH = 0.7  # of the error before: what more quads have to come to
SPARE = 1.15  # times the control points of the coarse mesh cut in four, of which the last go where the error is
FEWEST = 50  # quads; a mesh for fewer control points than four times that begins with all of them
PASSES = (20, 10)  # of wrapping, before the quads are cut in four and after
ATTEMPTS, DENSER = 5, 1.3  # at a coarse mesh, and times more quads where it comes out torn
TRIMMINGS = 4  # of the number of quads, where they are more than asked for


def fit_rows(
    scan: TriangleMesh, options: FitOptions, *, doing: Callable[[str], None] = lambda step: None
) -> FittedSurface:
    """The Catmull-Clark surface of a control mesh in rows; twice as many control points where the tolerance asks.

    Raises  as `fit_surface`; NoControlMesh.
    """
    whole, _ = close_holes(scan) if options.close else (scan, 0)
    if options.control_points is not None:
        return _fit(scan, whole, _laid_over(whole, options.control_points, doing), options, doing)
    fitted = _detailed(scan, whole, options, doing)
    count = max(fitted.mesh.n_vertices, scan.n_vertices // SHARE)
    while not _is_near(fitted, options) and 2 * count <= scan.n_vertices:
        count *= 2
        asked = replace(options, control_points=count)
        fitted = _fit(scan, whole, _laid_over(whole, count, doing), asked, doing)
    return fitted


def _is_near(fitted: FittedSurface, options: FitOptions) -> bool:
    return options.tolerance is None or float(fitted.distances.max()) <= options.tolerance


def _fit(
    scan: TriangleMesh, whole: TriangleMesh, mesh: ControlMesh, options: FitOptions, doing: Callable[[str], None]
) -> FittedSurface:
    first = fit_surface(scan, _from(options, mesh), doing=doing)
    grown = split_rows(first.mesh, _squares(whole, first.mesh), (options.control_points or 0) - first.mesh.n_vertices)
    if grown.n_vertices == first.mesh.n_vertices:
        return first
    second = fit_surface(scan, _from(options, grown), doing=doing)
    rounds = (*first.rounds, *(r._replace(number=r.number + len(first.rounds)) for r in second.rounds))
    return replace(second, rounds=rounds)


def _from(options: FitOptions, mesh: ControlMesh) -> FitOptions:
    return replace(options, start=mesh, plain=True, control_points=mesh.n_vertices)


def _detailed(
    scan: TriangleMesh, whole: TriangleMesh, options: FitOptions, doing: Callable[[str], None]
) -> FittedSurface:
    """The fit with as many quads as the scan's detail asks for: more where it does not come near, if they help."""
    most = min(max(scan.n_vertices // FINEST, FEWEST), MOST_COARSE)
    n_quads = min(max(scan.n_vertices // COARSE, FEWEST), FIRST_COARSE, most)
    best: FittedSurface | None = None
    while True:
        mesh = wrapped(split_polygons(_over_tips(_rows(whole, n_quads, doing), whole)), whole, PASSES[1])
        count = min(max(scan.n_vertices // SHARE, round(SPARE * mesh.n_vertices)), MOST)
        fitted = _fit(scan, whole, mesh, replace(options, control_points=count), doing)
        if best is not None and fitted.errors.rms > WORTH * best.errors.rms:
            return best
        best, off = fitted, fitted.errors.rms / NEAR
        if off <= 1.0 or n_quads >= most:
            return best
        n_quads = min(int(n_quads * np.clip(off**DENSIFYING, *FASTER)), most)


def _laid_over(scan: TriangleMesh, count: int, doing: Callable[[str], None]) -> ControlMesh:
    """At most `count` control points in rows over the scan, a fourth of them to begin with.

    Raises  NoControlMesh when the rows come out torn, however many there are.
    """
    cut = count >= 4 * FEWEST
    n_quads = min(count // 4, max(scan.n_vertices // COARSE, FEWEST), MOST_COARSE) if cut else count
    for _ in range(TRIMMINGS):
        mesh = _rows(scan, n_quads, doing)
        n_points = mesh.n_vertices + 3 * mesh.n_faces if cut else mesh.n_vertices
        if n_points <= count:
            break
        n_quads = int(0.95 * n_quads * count / n_points)
    mesh = _over_tips(mesh, scan) if cut else wrapped(mesh, scan, PASSES[0])
    return wrapped(split_polygons(mesh), scan, PASSES[1]) if cut else mesh


def _over_tips(mesh: ControlMesh, scan: TriangleMesh) -> ControlMesh:
    return covered_tips(wrapped(mesh, scan, PASSES[0]), scan)


def _rows(scan: TriangleMesh, n_quads: int, doing: Callable[[str], None]) -> ControlMesh:
    """About so many quads, or more where they come out torn; raises as `remeshed_quads`."""
    for _ in range(ATTEMPTS - 1):
        doing(f"laying about {n_quads} quadrilaterals over the scan")
        try:
            return remeshed_quads(scan, n_quads)
        except NoControlMesh:
            n_quads = int(DENSER * n_quads)
    return remeshed_quads(scan, n_quads)


def _squares(scan: TriangleMesh, mesh: ControlMesh) -> NDArray[np.float64]:
    """(F,) the squared distances of the scan's points from the surface, summed over those nearest to each face."""
    patches = limit_patches(mesh, Scheme.CATMULL_CLARK)
    feet = nearest_feet(patches, patches.points @ mesh.vertices, scan.vertices, step=ROUGH)
    off = feet.positions - scan.vertices
    return np.bincount(feet.patch // 4, np.einsum("ni,ni->n", off, off), mesh.n_faces).astype(np.float64)

"""Measurements as cadquery shapes: one function a method, paths or arrays in, `cq.Solid` and its like out.

    from brep_export.app.extension import register, voxels

    bracket = voxels("bracket.npz", analytic=True)      a cq.Solid like any other
    register()                                          now workplanes know the methods, too
    part = cq.Workplane().reconVoxels("bracket.npz").faces(">Z").workplane().hole(5)

Every shape has passed the gate. Importing this module changes nothing in cadquery, and loads no method before its
function is called; `register` can be called as often as an editor reloads.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cadquery as cq
import numpy as np
from numpy.typing import ArrayLike, NDArray

from brep_export.check import ShapeKind, check
from recon.errors import BadOption
from recon.geometry.contour_map import ContourMap, HeightGrid
from recon.geometry.mesh import TriangleMesh
from recon.geometry.views import ThreeViews
from recon.geometry.voxel_grid import VoxelGrid
from recon.tolerance import Tolerance

if TYPE_CHECKING:
    from OCP.TopoDS import TopoDS_Shape

    from recon.geometric_fit.curve_fit import CurveOptions
    from recon.geometric_fit.options import FitOptions
    from recon.hole_patch.pipeline import PatchOptions
    from recon.terrain.pipeline import TerrainOptions
    from recon.three_view.pipeline import ViewsOptions
    from recon.voxel_mesh.pipeline import VoxelOptions

__all__ = ["curve", "fit", "patch", "register", "terrain", "views", "voxels"]

File = str | Path
Mesh = File | TriangleMesh | tuple[ArrayLike, ArrayLike]


def patch(sherds: Sequence[Mesh], options: "PatchOptions | None" = None) -> cq.Shape:
    """The missing piece of a vessel: a solid where the scans show or are told its wall, else the outer face.

    sherds  scans in pose, in millimetres: files, meshes, or pairs of vertices (V, 3) and triangles (F, 3)
    Raises  ReconError where no piece can be found, GateFailed where it is no sound shape.
    """
    from brep_export.app.patch_job import built
    from recon.hole_patch.pipeline import patch_readings

    found = built(patch_readings([_mesh(sherd) for sherd in sherds], options), _bench())
    found.report.require()
    return cq.Shape.cast(found.shape)


def fit(scan: Mesh, options: "FitOptions | None" = None, *, angle_deg: float = 0.1) -> cq.Shape:
    """The smooth surface of a scan: a solid of a closed one, a shell of an open one.

    options    with a scheme of their own; without any, quadrilaterals in rows for Catmull-Clark's
    angle_deg  degrees by which tangent planes may differ along smooth edges
    Raises     ReconError, GateFailed.
    """
    from brep_export.app.limit_shape import limit_shape
    from recon.geometric_fit.options import FitOptions
    from recon.geometric_fit.pipeline import fit_surface
    from recon.geometric_fit.row_fit import fit_rows
    from recon.subdivision.limit_surface import Scheme

    mesh = _mesh(scan)
    if options is None:
        fitted = fit_rows(mesh, FitOptions(scheme=Scheme.CATMULL_CLARK), doing=_silent)
    else:
        fitted = fit_surface(mesh, options)
    made = limit_shape(fitted.mesh, fitted.scheme, angle_deg, _bench())
    return _proved(made.shape, made.tolerance, made.kind)


def curve(points: File | ArrayLike, options: "CurveOptions | None" = None) -> cq.Shape:
    """The smooth curve of a row of points, as an edge.

    points  a file, or (n, 2) or (n, 3) in order; a row whose last point is its first is closed
    Raises  ReconError, GateFailed.
    """
    from brep_export.wires import curve_edge
    from recon.geometric_fit.curve_fit import CurveOptions, fit_curve
    from recon.readers.point_rows import read_point_row

    row = read_point_row(points) if isinstance(points, str | Path) else np.asarray(points, dtype=np.float64)
    closed = len(row) > 3 and bool((row[0] == row[-1]).all())
    fitted = fit_curve(row, options or CurveOptions(closed=closed))
    return _proved(curve_edge(fitted.curve), Tolerance(fit=max(1e-6 * fitted.diagonal, 1e-6)), ShapeKind.EDGE)


def terrain(
    contours: File | ContourMap | HeightGrid,
    options: "TerrainOptions | None" = None,
    *,
    base_depth: float | None = None,
    interval: float | None = None,
) -> cq.Shape:
    """The ground of contour lines: a solid where a base is asked for, else an open shell. One unit is a metre.

    contours    a file of contours or of a grid, or either in memory
    base_depth  metres from the lowest ground to the base
    interval    metres at which a grid is contoured
    Raises      ReconError, GateFailed; BadOption for a grid without an interval.
    """
    from brep_export.app.terrain_job import TOLERANCE, lowest_place
    from brep_export.blocks import block_solid
    from brep_export.shells import network_shell
    from recon.terrain.network import terrain_network
    from recon.terrain.pipeline import terrain_surface

    network = terrain_network(terrain_surface(_contours(contours, interval), options))
    if base_depth is None:
        return _proved(network_shell(network, TOLERANCE), TOLERANCE, ShapeKind.SHELL)
    solid = block_solid(network, lowest_place(network) - base_depth, TOLERANCE)
    return _proved(solid, TOLERANCE, ShapeKind.SOLID)


def voxels(
    volume: File | VoxelGrid | NDArray[Any],
    options: "VoxelOptions | None" = None,
    *,
    smooth: bool = False,
    analytic: bool = False,
    snap: float | None = None,
    spacing: ArrayLike = 1.0,
) -> cq.Shape:
    """The boundary of the solid voxels as a solid.

    volume    a file of a binary volume, a grid, or an array (X, Y, Z) whose voxels are solid where it is not zero
    smooth    triangles without terraces, edges sharp
    analytic  planes, cylinders, cones, spheres and rounded edges as true faces, where the part has them
    snap      with analytic: take the roundest multiples of this length that the voxels leave open
    spacing   of the voxels of an array: one length, or three
    Raises    ReconError, GateFailed.
    """
    from brep_export.app.voxel_bodies import analytic_body, faceted_body, smooth_body
    from brep_export.app.voxel_proof import FIT, FLAT
    from recon.voxel_mesh.pipeline import VoxelOptions

    grid, chosen = _grid(volume, spacing), options or VoxelOptions()
    if analytic:
        body = analytic_body(grid, chosen, snap=snap, bench=_bench())
    elif smooth:
        body = smooth_body(grid, chosen, bench=_bench())
    else:
        body = faceted_body(grid, chosen, bench=_bench())
    return _proved(body.shape, Tolerance(merge=FLAT * grid.voxel, fit=FIT * grid.voxel), ShapeKind.SOLID)


def views(drawing: File | ThreeViews, options: "ViewsOptions | None" = None, *, solution: int = 1) -> cq.Shape:
    """A solid that a three-view drawing can mean.

    solution  its number, 1 the most plausible
    Raises    ReconError where no solid is drawn like this, BadOption where there are not so many, GateFailed.
    """
    from brep_export.app.views_job import SLACK, as_meant
    from brep_export.solids import polyhedron_solid
    from recon.readers.view_sheet import ViewSheet
    from recon.readers.views import read_views
    from recon.three_view.pipeline import interpret

    sheet = ViewSheet(drawing) if isinstance(drawing, ThreeViews) else read_views(drawing)
    found = interpret(sheet.drawing, options)
    shape = polyhedron_solid(as_meant(sheet, found.polyhedron(solution - 1)))
    return _proved(shape, Tolerance(merge=found.snap, fit=SLACK * found.snap), ShapeKind.SOLID)


def register() -> None:
    """Give every workplane the methods reconPatch, reconFit, reconCurve, reconTerrain, reconVoxels and reconViews.

    Each takes what its function takes, and stacks the shape, placed in the workplane. Called again, for example after a
    reload of this module, it puts the functions of now in place of those of then.
    """
    for make in (patch, fit, curve, terrain, voxels, views):
        setattr(cq.Workplane, f"recon{make.__name__.capitalize()}", _method(make))


def _method(make: Callable[..., cq.Shape]) -> Callable[..., cq.Workplane]:
    def method(self: cq.Workplane, *arguments: Any, **options: Any) -> cq.Workplane:
        return self.newObject([make(*arguments, **options).moved(self.plane.location)])

    method.__doc__ = f"{make.__doc__}\n    Stacks it, placed in the workplane."
    return method


def _proved(shape: "TopoDS_Shape", tolerance: Tolerance, kind: ShapeKind) -> cq.Shape:
    check(shape, tolerance, expect=kind).require()
    return cq.Shape.cast(shape)


def _mesh(given: Mesh) -> TriangleMesh:
    if isinstance(given, TriangleMesh):
        return given
    if isinstance(given, tuple):
        vertices, triangles = given
        return TriangleMesh(np.asarray(vertices, dtype=np.float64), np.asarray(triangles, dtype=np.int64))
    from recon.readers.meshes import read_mesh

    return read_mesh(given).mesh


def _contours(given: File | ContourMap | HeightGrid, interval: float | None) -> ContourMap:
    from recon.readers.contours import read_contours
    from recon.readers.height_grids import GRID_ENDINGS, read_height_grid
    from recon.terrain.contouring import contour_grid

    if isinstance(given, ContourMap):
        return given
    if not isinstance(given, HeightGrid):
        if not str(given).lower().endswith(GRID_ENDINGS):
            return read_contours(given)
        given = read_height_grid(given)
    if interval is None:
        raise BadOption("interval", "say at which interval in metres to contour the grid")
    return contour_grid(given, interval)


def _grid(given: File | VoxelGrid | NDArray[Any], spacing: ArrayLike) -> VoxelGrid:
    from recon.geometry.voxel_grid import binary_grid
    from recon.readers.volumes import read_volume

    if isinstance(given, VoxelGrid):
        return given
    if isinstance(given, np.ndarray):
        lengths = np.broadcast_to(np.asarray(spacing, dtype=np.float64), (3,))
        return VoxelGrid(spacing=lengths, name="array", solid=given != 0)
    return binary_grid(read_volume(given))


def _bench() -> Any:
    """A place of work where nobody listens."""
    from brep_export.app.workshop import Bench

    return Bench(_silent)


def _silent(told: Any) -> None:
    del told

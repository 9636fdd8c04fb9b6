"""Measurements to geometry: published methods, no CAD kernel below this line.

    patch_hole(sherds)        the missing piece of a broken vessel
    fit_surface(scan)         a subdivision surface of a scan; limit_faces makes its faces
    fit_sheet(scan)           one B-spline surface of a scan that is a disc, a tube or a torus
    fit_curve(points)         a B-spline curve of a row of points
    terrain_surface(contours) a ground of patches that meet in common tangent planes
    voxel_boundary(grid)      the clean boundary of a binary grid; analytic_part its planes, cylinders and cones
    all_polyhedra(drawing)    every solid that three views can mean

Functions and types are loaded on first use, so that `import recon` costs nothing. What they give becomes solids and
files in `brep_export`.
"""

# ruff: noqa: I001  (sorted by storey, and the names of a module together)
from importlib import import_module
from typing import TYPE_CHECKING, Any

from recon.version import __version__

if TYPE_CHECKING:  # a name as itself says that it is exported
    from recon.errors import ReconError as ReconError, InputError as InputError, Refusal as Refusal
    from recon.tolerance import Tolerance as Tolerance
    from recon.geometry.mesh import PointSet as PointSet, TriangleMesh as TriangleMesh
    from recon.geometry.control_mesh import ControlMesh as ControlMesh
    from recon.geometry.bspline import BSplineCurve as BSplineCurve, BSplineSurface as BSplineSurface
    from recon.geometry.trimmed import LipPiece as LipPiece, ThickPiece as ThickPiece, TrimmedSurface as TrimmedSurface
    from recon.geometry.patches import PatchNetwork as PatchNetwork
    from recon.geometry.polyhedron import Polyhedron as Polyhedron
    from recon.geometry.contour_map import ContourMap as ContourMap, HeightGrid as HeightGrid
    from recon.geometry.voxel_grid import Volume as Volume, VoxelGrid as VoxelGrid, binary_grid as binary_grid
    from recon.geometry.views import DrawnView as DrawnView, ThreeViews as ThreeViews
    from recon.readers.meshes import read_mesh as read_mesh
    from recon.readers.control_meshes import read_control_mesh as read_control_mesh
    from recon.readers.point_rows import read_point_row as read_point_row
    from recon.readers.contours import read_contours as read_contours
    from recon.readers.height_grids import read_height_grid as read_height_grid
    from recon.readers.volumes import read_volume as read_volume
    from recon.readers.views import read_views as read_views
    from recon.subdivision.limit_surface import Scheme as Scheme
    from recon.subdivision.limit_faces import limit_faces as limit_faces
    from recon.hole_patch.pipeline import (
        MissingPiece as MissingPiece,
        PatchOptions as PatchOptions,
        list_holes as list_holes,
        patch_hole as patch_hole,
        patch_holes as patch_holes,
        patch_readings as patch_readings,
    )
    from recon.geometric_fit.pipeline import fit_surface as fit_surface
    from recon.geometric_fit.options import FitOptions as FitOptions, FittedSurface as FittedSurface
    from recon.geometric_fit.spline_fit import fit_sheet as fit_sheet
    from recon.geometric_fit.spline_options import FittedSheet as FittedSheet, SplineOptions as SplineOptions
    from recon.geometric_fit.curve_fit import (
        CurveOptions as CurveOptions,
        FittedCurve as FittedCurve,
        fit_curve as fit_curve,
    )
    from recon.terrain.pipeline import (
        Terrain as Terrain,
        TerrainOptions as TerrainOptions,
        terrain_surface as terrain_surface,
    )
    from recon.terrain.contouring import contour_grid as contour_grid
    from recon.terrain.evaluation import elevations as elevations
    from recon.terrain.network import terrain_network as terrain_network
    from recon.terrain.sections import contours_at as contours_at
    from recon.voxel_mesh.pipeline import (
        VoxelBoundary as VoxelBoundary,
        VoxelOptions as VoxelOptions,
        voxel_boundary as voxel_boundary,
    )
    from recon.voxel_mesh.analytic_part import AnalyticPart as AnalyticPart, analytic_part as analytic_part
    from recon.three_view.pipeline import (
        Interpretation as Interpretation,
        ViewsOptions as ViewsOptions,
        all_polyhedra as all_polyhedra,
        diagnose as diagnose,
        interpret as interpret,
    )

# the same names as above, for the interpreter: a module and what is loaded from it
_HOMES = {
    "recon.errors": "ReconError InputError Refusal",
    "recon.tolerance": "Tolerance",
    "recon.geometry.mesh": "PointSet TriangleMesh",
    "recon.geometry.control_mesh": "ControlMesh",
    "recon.geometry.bspline": "BSplineCurve BSplineSurface",
    "recon.geometry.trimmed": "LipPiece ThickPiece TrimmedSurface",
    "recon.geometry.patches": "PatchNetwork",
    "recon.geometry.polyhedron": "Polyhedron",
    "recon.geometry.contour_map": "ContourMap HeightGrid",
    "recon.geometry.voxel_grid": "Volume VoxelGrid binary_grid",
    "recon.geometry.views": "DrawnView ThreeViews",
    "recon.readers.meshes": "read_mesh",
    "recon.readers.control_meshes": "read_control_mesh",
    "recon.readers.point_rows": "read_point_row",
    "recon.readers.contours": "read_contours",
    "recon.readers.height_grids": "read_height_grid",
    "recon.readers.volumes": "read_volume",
    "recon.readers.views": "read_views",
    "recon.subdivision.limit_surface": "Scheme",
    "recon.subdivision.limit_faces": "limit_faces",
    "recon.hole_patch.pipeline": "MissingPiece PatchOptions list_holes patch_hole patch_holes patch_readings",
    "recon.geometric_fit.pipeline": "fit_surface",
    "recon.geometric_fit.options": "FitOptions FittedSurface",
    "recon.geometric_fit.spline_fit": "fit_sheet",
    "recon.geometric_fit.spline_options": "FittedSheet SplineOptions",
    "recon.geometric_fit.curve_fit": "CurveOptions FittedCurve fit_curve",
    "recon.terrain.pipeline": "Terrain TerrainOptions terrain_surface",
    "recon.terrain.contouring": "contour_grid",
    "recon.terrain.evaluation": "elevations",
    "recon.terrain.network": "terrain_network",
    "recon.terrain.sections": "contours_at",
    "recon.voxel_mesh.pipeline": "VoxelBoundary VoxelOptions voxel_boundary",
    "recon.voxel_mesh.analytic_part": "AnalyticPart analytic_part",
    "recon.three_view.pipeline": "Interpretation ViewsOptions all_polyhedra diagnose interpret",
}
_MODULE_OF = {name: module for module, names in _HOMES.items() for name in names.split()}

__all__ = ["__version__", *_MODULE_OF]


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'recon' has no attribute '{name}'")
    return getattr(import_module(_MODULE_OF[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_MODULE_OF})

"""Geometry to OpenCascade solids that are proved before they are written.

    thick_solid, lip_solid, trimmed_face   the missing piece of a vessel
    mosaic_shape, trimmed_shell            the faces of a subdivision surface; one B-spline face
    network_shell, block_solid             a ground, and the block under it
    polyhedron_solid, triangle_solid       planar faces
    analytic_solid                         planes, cylinders, cones, spheres and rounded edges
    write_outputs                          STEP, IGES, BREP, STL, 3MF and GLB: read back, and all or none

The gate is `brep_export.check.check`, repairs on request are `brep_export.repair.repair`; both have the names of their
modules, and are imported from there. Everything else is loaded on first use.
"""

# ruff: noqa: I001  (sorted by storey, and the names of a module together)
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # a name as itself says that it is exported
    from brep_export.analytic import analytic_solid as analytic_solid
    from brep_export.blocks import block_solid as block_solid
    from brep_export.check import CheckReport as CheckReport, ShapeKind as ShapeKind
    from brep_export.faces import trimmed_face as trimmed_face
    from brep_export.file_header import FileHeader as FileHeader, LengthUnit as LengthUnit
    from brep_export.measures import ShapeMeasures as ShapeMeasures, measure as measure
    from brep_export.mesh_files import write_mesh as write_mesh
    from brep_export.mosaics import mosaic_shape as mosaic_shape
    from brep_export.outputs import write_outputs as write_outputs
    from brep_export.read_back import ReadBack as ReadBack, read_cad as read_cad
    from brep_export.sheets import trimmed_shell as trimmed_shell
    from brep_export.shells import network_shell as network_shell
    from brep_export.solids import (
        lip_solid as lip_solid,
        mesh_solid as mesh_solid,
        network_solid as network_solid,
        polyhedron_solid as polyhedron_solid,
        thick_solid as thick_solid,
        triangle_solid as triangle_solid,
    )
    from brep_export.step import StepSchema as StepSchema, write_step as write_step
    from brep_export.triangulation import triangulate as triangulate
    from brep_export.wires import curve_edge as curve_edge

# the same names as above, for the interpreter: a module and what is loaded from it
_HOMES = {
    "brep_export.analytic": "analytic_solid",
    "brep_export.blocks": "block_solid",
    "brep_export.check": "CheckReport ShapeKind",
    "brep_export.faces": "trimmed_face",
    "brep_export.file_header": "FileHeader LengthUnit",
    "brep_export.measures": "ShapeMeasures measure",
    "brep_export.mesh_files": "write_mesh",
    "brep_export.mosaics": "mosaic_shape",
    "brep_export.outputs": "write_outputs",
    "brep_export.read_back": "ReadBack read_cad",
    "brep_export.sheets": "trimmed_shell",
    "brep_export.shells": "network_shell",
    "brep_export.solids": "lip_solid mesh_solid network_solid polyhedron_solid thick_solid triangle_solid",
    "brep_export.step": "StepSchema write_step",
    "brep_export.triangulation": "triangulate",
    "brep_export.wires": "curve_edge",
}
_MODULE_OF = {name: module for module, names in _HOMES.items() for name in names.split()}

__all__ = [*_MODULE_OF]


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'brep_export' has no attribute '{name}'")
    return getattr(import_module(_MODULE_OF[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_MODULE_OF})

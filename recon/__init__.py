"""Measurements to geometry: five published methods, no CAD kernel below this line.

The entry functions and the neutral types are loaded on first use, so that `import recon` costs nothing:

    patch_hole(sherds)      the missing piece of a broken vessel
    all_polyhedra(drawing)  every solid that three views can mean
"""

from importlib import import_module
from typing import Any

from recon.version import __version__

_HOMES = {
    "patch_hole": "recon.hole_patch.pipeline",
    "PatchOptions": "recon.hole_patch.pipeline",
    "all_polyhedra": "recon.three_view.pipeline",
    "interpret": "recon.three_view.pipeline",
    "ViewsOptions": "recon.three_view.pipeline",
    "read_views": "recon.readers.views",
    "DrawnView": "recon.geometry.views",
    "ThreeViews": "recon.geometry.views",
    "read_mesh": "recon.readers.meshes",
    "BSplineCurve": "recon.geometry.bspline",
    "BSplineSurface": "recon.geometry.bspline",
    "LipPiece": "recon.geometry.trimmed",
    "PatchNetwork": "recon.geometry.patches",
    "PointSet": "recon.geometry.mesh",
    "Polyhedron": "recon.geometry.polyhedron",
    "ThickPiece": "recon.geometry.trimmed",
    "Tolerance": "recon.tolerance",
    "TriangleMesh": "recon.geometry.mesh",
    "TrimmedSurface": "recon.geometry.trimmed",
}

__all__ = ["__version__", *_HOMES]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'recon' has no attribute '{name}'")
    return getattr(import_module(_HOMES[name]), name)

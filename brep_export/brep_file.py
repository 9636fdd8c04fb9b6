"""The kernel's own BREP text, the one form that keeps every tolerance and flag; it knows neither unit nor name."""

from pathlib import Path

from OCP.BRepTools import BRepTools
from OCP.TopoDS import TopoDS_Shape
from OCP.TopTools import TopTools_FormatVersion

from brep_export.measures import ShapeMeasures, measure
from brep_export.read_back import ReadBack, compare, read_cad
from recon.errors import NotWritten

__all__ = ["write_brep"]


def write_brep(shape: TopoDS_Shape, path: str | Path, *, measures: ShapeMeasures | None = None) -> ReadBack:
    """Write a shape, without triangles, to exactly this path, read it again, and say whether it is the same.

    Raises NotWritten when the kernel cannot write the file.
    """
    version = TopTools_FormatVersion.TopTools_FormatVersion_VERSION_1
    try:
        written = BRepTools.Write_s(shape, str(path), False, False, version)
    except RuntimeError:  # on a full disk the kernel fails over its own error message
        written = False
    if not written:
        raise NotWritten(str(path), "the kernel could not write the file")
    return compare(measures or measure(shape), measure(read_cad(path)))

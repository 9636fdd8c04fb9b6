"""IGES files in the B-rep form, entity 186, which keeps solids.

IGES has no closed faces without a seam vertex and no shared compounds, and its numbers of faces and edges may differ
after reading where the kernel splits closed surfaces; what differs is listed, as for every file.
"""

from pathlib import Path

from OCP.IGESControl import IGESControl_Writer
from OCP.TCollection import TCollection_HAsciiString
from OCP.TopoDS import TopoDS_Shape

from brep_export.file_header import ORIGIN, FileHeader
from brep_export.kernel_settings import KERNEL_FAILURES, exchange_settings
from brep_export.measures import ShapeMeasures, measure
from brep_export.read_back import ReadBack, compare, read_cad
from recon.errors import NotWritten

__all__ = ["write_iges"]

_BREP_MODE = 1  # mode 0 writes trimmed surfaces side by side and loses the solid


def write_iges(
    shape: TopoDS_Shape,
    path: str | Path,
    *,
    header: FileHeader = FileHeader(),  # noqa: B008  (frozen)
    measures: ShapeMeasures | None = None,
) -> ReadBack:
    """Write a shape to exactly this path, read it again, and say whether it is the same.

    measures  of the shape, when they are known already
    Raises    NotWritten when the kernel cannot write the shape or the file.
    """
    measures = measures or measure(shape)
    try:
        with exchange_settings({"xstep.cascade.unit": str(header.unit), "write.precision.mode": 1}):
            done = _write(shape, Path(path), header)
    except KERNEL_FAILURES as failure:
        raise NotWritten(str(path), f"the kernel gave up writing it ({type(failure).__name__})") from failure
    if not done:
        raise NotWritten(str(path), "the kernel could not write the file")
    return compare(measures, measure(read_cad(path, unit=str(header.unit))))


def _write(shape: TopoDS_Shape, path: Path, header: FileHeader) -> bool:
    writer = IGESControl_Writer(str(header.unit), _BREP_MODE)
    section = writer.Model().GlobalSection()
    # coordinates mean the header's unit; the kernel takes them for millimetres whatever its setting says
    section.SetCascadeUnit(1e3 * header.unit.in_metres)
    texts = (
        (section.SetSystemId, ORIGIN),
        (section.SetSendName, header.name),
        (section.SetFileName, f"{header.name}{path.suffix}"),
        # left alone, the kernel writes the name of whoever runs it
        (section.SetAuthorName, header.author or "unknown"),
        (section.SetCompanyName, header.organisation),
    )
    for set_text, text in texts:
        set_text(TCollection_HAsciiString(text))
    writer.Model().SetGlobalSection(section)
    if not writer.AddShape(shape):
        return False
    writer.ComputeModel()
    return bool(writer.Write(str(path), False))

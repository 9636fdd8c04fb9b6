"""STEP files (ISO 10303-21) with name, unit, origin and the validation properties volume, area and centroid.

Curves on faces are a quarter to a third of a file of spline surfaces and carry nothing where a face ends on its own
borders, so they are written only when some spline face is trimmed inside them; there a reader would have to find them
again, and would find others.
"""

from enum import StrEnum
from pathlib import Path

from OCP.APIHeaderSection import APIHeaderSection_MakeHeader
from OCP.BRep import BRep_Tool
from OCP.BRepAdaptor import BRepAdaptor_Curve2d, BRepAdaptor_Surface
from OCP.BRepBuilderAPI import BRepBuilderAPI_Transform
from OCP.GeomAbs import GeomAbs_CurveType, GeomAbs_SurfaceType
from OCP.gp import gp_Pnt
from OCP.IFSelect import IFSelect_ReturnStatus
from OCP.STEPCAFControl import STEPCAFControl_Writer
from OCP.STEPControl import STEPControl_StepModelType
from OCP.TCollection import TCollection_ExtendedString, TCollection_HAsciiString
from OCP.TDataStd import TDataStd_Name
from OCP.TDocStd import TDocStd_Document
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopLoc import TopLoc_Location
from OCP.TopoDS import TopoDS, TopoDS_Face, TopoDS_Shape
from OCP.XCAFDoc import XCAFDoc_Area, XCAFDoc_Centroid, XCAFDoc_DocumentTool, XCAFDoc_Volume

from brep_export.advance_copy import AdvanceCopy
from brep_export.check_topology import sub_shapes
from brep_export.file_header import ORIGIN, FileHeader
from brep_export.kernel_settings import KERNEL_FAILURES, exchange_settings
from brep_export.measures import ShapeMeasures, measure
from brep_export.read_back import ReadBack, compare, read_cad
from brep_export.spline_step import write_spline_text
from brep_export.survey import Survey
from recon.errors import NotWritten

__all__ = ["StepSchema", "write_step", "needs_pcurves"]


class StepSchema(StrEnum):
    """The application protocols that can be written; the values are the kernel's words for them."""

    AP214 = "AP214IS"
    AP242 = "AP242DIS"


def write_step(
    shape: TopoDS_Shape,
    path: str | Path,
    *,
    header: FileHeader = FileHeader(),  # noqa: B008  (frozen)
    schema: StepSchema = StepSchema.AP214,
    measures: ShapeMeasures | None = None,
    seen: Survey | None = None,
    copy: AdvanceCopy | None = None,
) -> ReadBack:
    """Write a shape to exactly this path, read it again, and say whether it is the same.

    measures, seen  of the shape, when they are known already
    copy      of the shape, as AP214 with this header, where one was written ahead: it is moved here
    Returns   the comparison; the file stays whatever it says
    Raises    NotWritten when the kernel cannot write the shape or the file.
    """
    path, measures = Path(path), measures or measure(shape, seen=seen)
    if copy is not None and copy.path.exists() and (schema, header) == (StepSchema.AP214, copy.header):
        found = copy.move_to(path)
        return compare(measures, found or measure(read_cad(path, unit=str(header.unit))))
    try:
        plain = schema is StepSchema.AP214 and write_spline_text(shape, path, header, measures, seen)
        if not plain:
            _write_by_kernel(shape, path, header, schema, measures)
    except KERNEL_FAILURES as failure:
        raise NotWritten(str(path), f"the kernel gave up writing it ({type(failure).__name__})") from failure
    return compare(measures, measure(read_cad(path, unit=str(header.unit))))


def _write_by_kernel(
    shape: TopoDS_Shape, path: Path, header: FileHeader, schema: StepSchema, measures: ShapeMeasures
) -> None:
    settings: dict[str, str | int | float] = {
        "write.step.schema": str(schema),
        "write.step.unit": str(header.unit),
        "xstep.cascade.unit": str(header.unit),
        "write.step.product.name": header.name,
        "write.surfacecurve.mode": 1 if needs_pcurves(shape) else 0,
        "write.precision.mode": 1,
    }
    with exchange_settings(settings):
        done = _write(_document(shape, header, measures), path, header)
    if not done:
        raise NotWritten(str(path), "the kernel could not write the file")


def _document(shape: TopoDS_Shape, header: FileHeader, measures: ShapeMeasures) -> TDocStd_Document:
    document = TDocStd_Document(TCollection_ExtendedString("BinXCAF"))
    XCAFDoc_DocumentTool.SetLengthUnit_s(document, header.unit.in_metres)
    label = XCAFDoc_DocumentTool.ShapeTool_s(document.Main()).AddShape(_in_place(shape), False)
    TDataStd_Name.Set_s(label, TCollection_ExtendedString(header.name, True))
    XCAFDoc_Area.Set_s(label, measures.area)
    if measures.volume is not None:
        XCAFDoc_Volume.Set_s(label, measures.volume)
    XCAFDoc_Centroid.Set_s(label, gp_Pnt(*measures.centroid))
    return document


def _in_place(shape: TopoDS_Shape) -> TopoDS_Shape:
    """The shape without a location of its own: the kernel writes a located one as an assembly, without properties."""
    if shape.Location().IsIdentity():
        return shape
    move = shape.Location().Transformation()
    return BRepBuilderAPI_Transform(shape.Located(TopLoc_Location()), move, True).Shape()


def _write(document: TDocStd_Document, path: Path, header: FileHeader) -> bool:
    writer = STEPCAFControl_Writer()
    writer.SetPropsMode(True)
    writer.SetNameMode(True)
    if not writer.Transfer(document, STEPControl_StepModelType.STEPControl_AsIs):
        return False
    _sign(writer, header)
    return bool(writer.Write(str(path)) == IFSelect_ReturnStatus.IFSelect_RetDone)


def _sign(writer: STEPCAFControl_Writer, header: FileHeader) -> None:
    section = APIHeaderSection_MakeHeader(writer.ChangeWriter().Model())
    section.SetName(TCollection_HAsciiString(header.name))
    section.SetAuthorValue(1, TCollection_HAsciiString(header.author))
    section.SetOrganizationValue(1, TCollection_HAsciiString(header.organisation))
    section.SetOriginatingSystem(TCollection_HAsciiString(ORIGIN))
    section.SetAuthorisation(TCollection_HAsciiString(""))


def needs_pcurves(shape: TopoDS_Shape) -> bool:
    """Whether some face on a curved surface of no simple form ends elsewhere than on lines of constant parameter."""
    return any(_is_trimmed(TopoDS.Face_s(face)) for face in sub_shapes(shape, TopAbs_ShapeEnum.TopAbs_FACE))


_SIMPLE = (
    GeomAbs_SurfaceType.GeomAbs_Plane,
    GeomAbs_SurfaceType.GeomAbs_Cylinder,
    GeomAbs_SurfaceType.GeomAbs_Cone,
    GeomAbs_SurfaceType.GeomAbs_Sphere,
    GeomAbs_SurfaceType.GeomAbs_Torus,
)


def _is_trimmed(face: TopoDS_Face) -> bool:
    if BRepAdaptor_Surface(face, False).GetType() in _SIMPLE:
        return False
    edges = (TopoDS.Edge_s(edge) for edge in sub_shapes(face, TopAbs_ShapeEnum.TopAbs_EDGE))
    return any(
        BRep_Tool.CurveOnSurface_s(edge, face, 0.0, 0.0) is not None
        and not _is_iso_line(BRepAdaptor_Curve2d(edge, face))
        for edge in edges
    )


def _is_iso_line(curve: BRepAdaptor_Curve2d) -> bool:
    """A straight line along one of the two parameters."""
    if curve.GetType() == GeomAbs_CurveType.GeomAbs_Line:
        direction = curve.Line().Direction()
        return min(abs(direction.X()), abs(direction.Y())) < 1e-12
    first, last = curve.FirstParameter(), curve.LastParameter()
    points = [curve.Value(first + i * (last - first) / 8) for i in range(9)]
    spread = [max(p) - min(p) for p in ([q.X() for q in points], [q.Y() for q in points])]
    return min(spread) <= 1e-9 * max(spread)

"""Reading CAD files, and telling whether what was read is what was written: line 7 of the gate.

The kernel heals in silence while it reads, so a file can hold something else than the shape that went in; and it
answers a truncated file with nothing, or with a part.  Both are found here.
"""

from dataclasses import dataclass
from mmap import ACCESS_READ, mmap
from pathlib import Path
from re import findall, fullmatch

from OCP.BRep import BRep_Builder
from OCP.BRepTools import BRepTools
from OCP.IFSelect import IFSelect_ReturnStatus
from OCP.IGESControl import IGESControl_Reader
from OCP.Resource import Resource_DataMapOfAsciiStringAsciiString
from OCP.ShapeFix import ShapeFix_ShapeTolerance
from OCP.STEPControl import STEPControl_Reader
from OCP.TCollection import TCollection_AsciiString
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopoDS import TopoDS_Shape

from brep_export.check_topology import ShapeKind
from brep_export.kernel_settings import KERNEL_FAILURES, exchange_settings
from brep_export.measures import ShapeMeasures, measure
from brep_export.occ_arrays import texts_from_kernel
from recon.errors import UnreadableFile, UnsupportedFormat
from recon.geometry.promises import Defect

__all__ = ["ReadBack", "READABLE", "read_cad", "same_after_reading", "compare"]

STEP_ENDINGS, IGES_ENDINGS, BREP_ENDINGS = (".step", ".stp"), (".iges", ".igs"), (".brep",)
READABLE = STEP_ENDINGS + IGES_ENDINGS + BREP_ENDINGS


@dataclass(frozen=True)
class ReadBack:
    """What came back from a file beside what went in; `volume_change` is relative, None without a volume."""

    same: bool
    volume_change: float | None
    defects: tuple[Defect, ...] = ()

    def as_json(self) -> dict[str, object]:
        return {"same": self.same, "volume_change": self.volume_change}


def read_cad(path: str | Path, *, unit: str = "MM", healed: bool = True) -> TopoDS_Shape:
    """The shape in a STEP, IGES or BREP file, in the given unit (MM, M or INCH; BREP files know no unit).

    healed  whether the kernel mends a STEP file while it reads, as every program that is made with it does; left out,
            the shape is what the file says, which is enough for planar faces, and comes in a quarter of the time
    Raises UnsupportedFormat for another ending; UnreadableFile when the file is missing, empty, truncated, of other
    content than its ending says, or holds no shape.
    """
    path = Path(path)
    ending = path.suffix.lower()
    if ending not in READABLE:
        raise UnsupportedFormat(str(path), READABLE)
    _look_at(path, ending)
    try:
        with exchange_settings({"xstep.cascade.unit": unit}):
            shape = _read_step(path, healed=healed) if ending in STEP_ENDINGS else _READERS[ending](path)
    except KERNEL_FAILURES as failure:
        raise UnreadableFile(str(path), f"the kernel gave up reading it ({type(failure).__name__})") from failure
    if shape is None or shape.IsNull():
        raise UnreadableFile(str(path), "it holds no shape", "Write it again, with its solids or faces selected")
    return shape


def _look_at(path: Path, ending: str) -> None:
    """Refuse what is no file of its kind before the kernel sees it."""
    if path.is_dir():
        raise UnreadableFile(str(path), "it is a directory")
    try:
        with path.open("rb") as file:
            head = file.read(4096)
            file.seek(max(path.stat().st_size - 4096, 0))
            tail = file.read()
    except FileNotFoundError as failure:
        raise UnreadableFile(str(path), "there is no such file") from failure
    except OSError as failure:
        raise UnreadableFile(str(path), f"it cannot be opened ({failure.strerror})") from failure
    if not head.strip():
        raise UnreadableFile(str(path), "it is empty")
    if not _begins_right(head, ending):
        raise UnreadableFile(str(path), f"its content is not that of a {ending} file")
    if not _ends_right(tail, ending):
        raise UnreadableFile(str(path), "it ends before its end, cut short while it was written or copied")


def _begins_right(head: bytes, ending: str) -> bool:
    if ending in STEP_ENDINGS:
        return b"ISO-10303-21" in head
    if ending in IGES_ENDINGS:
        line = head.splitlines()[0]
        return len(line) >= 73 and line[72:73] in b"SCB"  # column 73 names the section: start, or a packed form
    return b"CASCADE Topology" in head or head.lstrip().startswith(b"DBRep_DrawableShape")


def _ends_right(tail: bytes, ending: str) -> bool:
    if ending in STEP_ENDINGS:
        return b"END-ISO-10303-21" in tail
    lines = tail.rstrip().splitlines()
    if ending in IGES_ENDINGS:
        return bool(lines) and lines[-1][72:73] == b"T"
    # the last line of a BREP text is its root shape: an orientation and two numbers, without the star of a list
    return any(fullmatch(rb"\s*[-+ie]\d+ \d+\s*", line) for line in lines[-2:])


def _read_step(path: Path, *, healed: bool) -> TopoDS_Shape | None:
    reader = STEPControl_Reader()
    shape = _transferred(reader, path, healed=healed)
    with path.open("rb") as file, mmap(file.fileno(), 0, access=ACCESS_READ) as content:
        accuracies = [float(figure) for figure in findall(_STEP_ACCURACY, content)]
    units = texts_from_kernel(reader.FileUnits, 3)[0]
    if shape is not None and accuracies and units and units[0].lower() in _IN_MILLIMETRES:
        in_file = max(accuracies) * _IN_MILLIMETRES[units[0].lower()]
        _set_stated_accuracy(shape, in_file / reader.SystemLengthUnit())
    return shape


def _read_iges(path: Path) -> TopoDS_Shape | None:
    reader = IGESControl_Reader()
    shape = _transferred(reader, path)
    if shape is not None:
        section = reader.IGESModel().GlobalSection()
        _set_stated_accuracy(shape, section.Resolution() * section.UnitValue() / section.CascadeUnit())
    return shape


def _no_healing() -> Resource_DataMapOfAsciiStringAsciiString:
    """Every kind of mending that the kernel's reader knows, switched off."""
    modes = Resource_DataMapOfAsciiStringAsciiString()
    for kind in _MENDED:
        modes.Bind(TCollection_AsciiString(f"FixShape.Fix{kind}Mode"), TCollection_AsciiString("0"))
    return modes


_MENDED = (
    *("Solid", "Shell", "ShellOrientation", "Face", "Wire", "FreeShell", "FreeFace", "FreeWire"),
    *("SameParameter", "VertexPosition", "VertexTolerance"),
)
_STEP_ACCURACY = rb"UNCERTAINTY_MEASURE_WITH_UNIT\s*\(\s*LENGTH_MEASURE\s*\(\s*([0-9.+\-Ee]+)\s*\)"
_IN_MILLIMETRES = {"millimetre": 1.0, "metre": 1e3, "centimetre": 10.0, "inch": 25.4, "foot": 304.8, "micrometre": 1e-3}


def _set_stated_accuracy(shape: TopoDS_Shape, accuracy: float) -> None:
    """Give every edge and vertex at least the accuracy that the file states for what it joins.

    STEP and IGES keep no tolerance an edge, only this one figure; the kernel passes over it and takes what it measures
    itself, at 23 points of an edge, which on long spline edges is too low.
    """
    limit = ShapeFix_ShapeTolerance()
    for kind in (TopAbs_ShapeEnum.TopAbs_EDGE, TopAbs_ShapeEnum.TopAbs_VERTEX):
        limit.LimitTolerance(shape, accuracy, 0.0, kind)


def _transferred(
    reader: STEPControl_Reader | IGESControl_Reader, path: Path, *, healed: bool = True
) -> TopoDS_Shape | None:
    if reader.ReadFile(str(path)) != IFSelect_ReturnStatus.IFSelect_RetDone:
        raise UnreadableFile(str(path), "the kernel cannot make sense of its content")
    if not healed:
        reader.SetShapeFixParameters(_no_healing())  # which reading a file would set back
    reader.TransferRoots()
    return reader.OneShape() if reader.NbShapes() else None


def _read_brep(path: Path) -> TopoDS_Shape | None:
    shape = TopoDS_Shape()
    return shape if BRepTools.Read_s(shape, str(path), BRep_Builder()) else None


_READERS = dict.fromkeys(IGES_ENDINGS, _read_iges) | dict.fromkeys(BREP_ENDINGS, _read_brep)


def same_after_reading(before: TopoDS_Shape, after: TopoDS_Shape, *, relative: float = 1e-4) -> ReadBack:
    """Whether two shapes agree in kind, counts, volume, area and bounding box.

    relative  allowed change of volume and area, and of the box in parts of its diagonal
    """
    return compare(measure(before), measure(after), relative=relative)


def compare(before: ShapeMeasures, after: ShapeMeasures, *, relative: float = 1e-4) -> ReadBack:
    """The same from measures that are known already; the defects have codes `read-back-...`."""
    defects = [*_different_parts(before, after), *_different_figures(before, after, relative)]
    change = None
    if before.volume is not None and after.volume is not None:
        change = _relative(before.volume, after.volume)
    return ReadBack(not defects, change, tuple(defects))


def _different_parts(before: ShapeMeasures, after: ShapeMeasures) -> list[Defect]:
    defects = []
    if _kind(before) != _kind(after):
        defects.append(Defect("read-back-kind", f"a {before.kind} was written and a {after.kind} read"))
    for part in ("solids", "faces", "edges"):
        n, m = getattr(before, part), getattr(after, part)
        if n != m:
            defects.append(Defect("read-back-count", f"the number of {part} is another after reading", None, m, n))
    return defects


def _kind(measures: ShapeMeasures) -> ShapeKind:
    """Files keep a face alone as a shell of one face."""
    alone = measures.kind is ShapeKind.SHELL and measures.faces == 1
    return ShapeKind.FACE if alone else measures.kind


def _different_figures(before: ShapeMeasures, after: ShapeMeasures, relative: float) -> list[Defect]:
    defects = []
    for what in ("volume", "area"):
        old, new = getattr(before, what), getattr(after, what)
        if old is not None and new is not None and _relative(old, new) > relative:
            defects.append(Defect(f"read-back-{what}", f"the {what} is another after reading", None, new, old))
    diagonal = sum((b - a) ** 2 for a, b in zip(*before.bounding_box)) ** 0.5
    corners = zip([*before.bounding_box[0], *before.bounding_box[1]], [*after.bounding_box[0], *after.bounding_box[1]])
    moved = max(abs(a - b) for a, b in corners)
    if moved > relative * diagonal:
        sentence = "the bounding box is another after reading"
        defects.append(Defect("read-back-box", sentence, before.bounding_box[0], moved, relative * diagonal))
    return defects


def _relative(old: float, new: float) -> float:
    return abs(new - old) / max(abs(old), 1e-300)

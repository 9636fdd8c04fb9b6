"""From a kernel shape to files on disk and the JSON object: gate, writers, picture, all or nothing."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from shutil import copyfile
from typing import Any

import numpy as np
from numpy.typing import NDArray
from OCP.TopoDS import TopoDS_Shape

from brep_export.advance_copy import AdvanceCopy, advance_copy
from brep_export.app.exhibits import SCENE, length_unit, picture_name
from brep_export.app.outputs import MESH_ENDINGS
from brep_export.app.scene import Measured, ScenePart, shape_parts, write_scene
from brep_export.app.workshop import Bench
from brep_export.check import CheckReport, ShapeKind, check
from brep_export.file_header import FileHeader, LengthUnit
from brep_export.outputs import Consignment, write_together
from brep_export.read_back import STEP_ENDINGS, ReadBack
from brep_export.step import StepSchema
from recon.errors import GateFailed
from recon.tolerance import Tolerance

__all__ = ["Delivery", "Parcel", "copied_ahead", "exhibit", "gate", "print_formats", "write_files", "write_parcels"]

Delivery = tuple[CheckReport, list[str]]
Painter = Callable[[Path], None]


def gate(
    shape: TopoDS_Shape, tolerance: Tolerance, expect: ShapeKind, bench: Bench, copy: AdvanceCopy | None = None
) -> CheckReport:
    """Draw the gate's lines on the shape; the report says what came out."""
    with bench.phase("check", "proving the shape"):
        return check(shape, tolerance, expect=expect, copy=copy)


@contextmanager
def copied_ahead(shape: TopoDS_Shape, request: Mapping[str, Any], bench: Bench) -> Iterator[AdvanceCopy | None]:
    """The first STEP file that is asked for, written ahead for those shapes where that saves time; for `gate`."""
    paths = [path for path in request["outputs"] if Path(path).suffix.lower() in STEP_ENDINGS]
    if not paths or request.get("schema", "AP214") != "AP214":
        yield None
        return
    with ExitStack() as block:
        with bench.phase("write", "writing ahead"):
            copy = block.enter_context(advance_copy(shape, paths[0], _header(request), announce=bench.staged))
        yield copy


@dataclass(frozen=True, eq=False)
class Parcel:
    """One shape on its way to files: what the gate said of it, where it goes, and what draws its picture.

    outputs, picture  paths; picture is None where none was asked for
    paint             draws the picture into a file
    beside            further files of the same result, each with what writes it
    colours           (V, 4) of the vertices of the report's triangles, for the formats that hold them
    measured          what the shape was made from, for the page's view; made only where a page is asked for
    title             what the view calls the shape
    sheets            further pictures for the page
    """

    shape: TopoDS_Shape
    report: CheckReport
    outputs: Sequence[str]
    picture: str | None
    paint: Painter
    beside: Mapping[str, Painter] = field(default_factory=dict)
    colours: NDArray[np.uint8] | None = None
    measured: Callable[[], Measured] = Measured
    title: str = "result"
    sheets: Sequence[Painter] = ()

    @property
    def others(self) -> dict[str, Painter]:
        return dict(self.beside) | ({} if self.picture is None else {self.picture: self.paint})

    def scene(self) -> list[ScenePart]:
        """What the page's view shows of it: what was measured, the shape, its edges."""
        from brep_export.app.pictures import MADE

        measured = self.measured()
        return [*measured.parts, *shape_parts(self.title, self.shape, self.report, measured, colour=MADE)]

    def painter(self) -> Painter:
        """Draws its picture: a copy where that was drawn before."""
        if self.picture is None or not Path(self.picture).is_file():
            return self.paint
        return partial(copyfile, self.picture)


def write_files(
    shape: TopoDS_Shape,
    report: CheckReport,
    request: Mapping[str, Any],
    bench: Bench,
    *,
    paint: Painter,
    beside: Mapping[str, Painter] | None = None,
    colours: NDArray[np.uint8] | None = None,
    measured: Callable[[], Measured] = Measured,
    sheets: Sequence[Painter] = (),
) -> Delivery:
    """Write every output that was asked for, and the picture; nothing when the gate refused and nobody forced it.

    paint    draws the picture into a file
    beside   further files of the same result, each with what writes it
    colours  (V, 4) of the vertices of the report's triangles, for the formats that hold them
    measured  what the shape was made from, for the page's view
    sheets   further pictures for the page
    Returns  the report with the read-back line added, and the paths written
    Raises   NotWritten.
    """
    picture = request.get("picture")
    parcel = Parcel(shape, report, request["outputs"], picture, paint, beside or {}, colours, measured, sheets=sheets)
    return write_parcels([parcel], request, bench)[0]


def write_parcels(parcels: Sequence[Parcel], request: Mapping[str, Any], bench: Bench) -> list[Delivery]:
    """The same for several shapes: the files of all of them, or none when the gate refused one and nobody forced it.

    What a page shows is made in any case: what was refused is worth a look.
    """
    accepted = all(parcel.report.passed for parcel in parcels) or request.get("force")
    delivered = _written(parcels, request, bench) if accepted else [(parcel.report, []) for parcel in parcels]
    painters = [paint for parcel in parcels for paint in (parcel.painter(), *parcel.sheets)]
    exhibit(request, bench, lambda: [part for parcel in parcels for part in parcel.scene()], painters)
    return delivered


def exhibit(
    request: Mapping[str, Any], bench: Bench, parts: Callable[[], Sequence[ScenePart]], painters: Sequence[Painter]
) -> None:
    """Leave a scene and pictures in the folder of the page; nothing where no page is asked for."""
    if request.get("page") is None:
        return
    folder = Path(request["page"])
    with bench.phase("write", "drawing the page"):
        write_scene(folder / SCENE, parts(), unit=length_unit(request))
        for number, paint in enumerate(painters):
            with suppress(GateFailed):  # of a shape without triangles there is no picture
                paint(folder / picture_name(number))


def _written(parcels: Sequence[Parcel], request: Mapping[str, Any], bench: Bench) -> list[Delivery]:
    header = _header(request)
    with bench.phase("write", "writing and reading back"):
        read_back = write_together(
            [
                Consignment(
                    p.shape,
                    p.report.triangulation,
                    p.outputs,
                    header,
                    p.others,
                    p.colours,
                    p.report.measures,
                    p.report.seen,
                    p.report.copy,
                )
                for p in parcels
            ],
            schema=StepSchema[request.get("schema", "AP214")],
            allow_change=bool(request.get("force")),
            announce=bench.staged,
        )
    return [(_with_worst(p.report, back), [*p.outputs, *p.others]) for p, back in zip(parcels, read_back)]


def _header(request: Mapping[str, Any]) -> FileHeader:
    return FileHeader(name=request.get("name") or "missing piece", unit=LengthUnit(request.get("header_unit", "MM")))


def _with_worst(report: CheckReport, read_back: tuple[ReadBack, ...]) -> CheckReport:
    """Line 7 for the file that changed most."""
    if not read_back:
        return report
    return report.with_read_back(max(read_back, key=lambda r: (not r.same, abs(r.volume_change or 0.0))))


def print_formats(request: Mapping[str, Any]) -> list[str]:
    """The outputs that are meant for printing and need a closed body."""
    return [path for path in request["outputs"] if Path(path).suffix.lower() in MESH_ENDINGS[:2]]

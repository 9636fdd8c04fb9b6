"""Several files of one shape, or of several, all or none, each in the format of its ending."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from OCP.TopoDS import TopoDS_Shape

from brep_export.advance_copy import AdvanceCopy
from brep_export.brep_file import write_brep
from brep_export.file_header import FileHeader
from brep_export.iges import write_iges
from brep_export.measures import ShapeMeasures, measure
from brep_export.mesh_files import MESH_ENDINGS, write_mesh
from brep_export.read_back import BREP_ENDINGS, IGES_ENDINGS, STEP_ENDINGS, ReadBack
from brep_export.staging import staged
from brep_export.step import StepSchema, write_step
from brep_export.survey import Survey
from recon.errors import NotWritten, ReconError, UnsupportedFormat
from recon.geometry.mesh import TriangleMesh

__all__ = ["WRITABLE", "Consignment", "require_writable", "write_outputs", "write_together"]

WRITABLE = STEP_ENDINGS + IGES_ENDINGS + BREP_ENDINGS + MESH_ENDINGS


def require_writable(paths: Sequence[str | Path]) -> None:
    """Before any work: raises UnsupportedFormat for the first path whose ending names no format."""
    for path in paths:
        if Path(path).suffix.lower() not in WRITABLE:
            raise UnsupportedFormat(str(path), WRITABLE)


@dataclass(frozen=True, eq=False)
class Consignment:
    """One shape and the files it goes to.

    mesh      triangles of the shape, for the mesh formats; None for one without faces
    beside    further files that belong to the same result, each with the function that writes it
    colours   (V, 4) of the mesh's vertices, for the formats that hold them
    measures, seen, copy  of the shape, where they are known already, and a STEP file that was written ahead
    """

    shape: TopoDS_Shape
    mesh: TriangleMesh | None
    paths: Sequence[str | Path]
    header: FileHeader = FileHeader()  # noqa: RUF009  (frozen)
    beside: Mapping[str, Callable[[Path], None]] = field(default_factory=dict)
    colours: NDArray[np.uint8] | None = None
    measures: ShapeMeasures | None = None
    seen: Survey | None = None
    copy: AdvanceCopy | None = None


def write_outputs(
    shape: TopoDS_Shape,
    mesh: TriangleMesh,
    paths: Sequence[str | Path],
    *,
    header: FileHeader = FileHeader(),  # noqa: B008  (frozen)
    schema: StepSchema = StepSchema.AP214,
    allow_change: bool = False,
    colours: NDArray[np.uint8] | None = None,
    beside: Mapping[str, Callable[[Path], None]] | None = None,
    announce: Callable[[Path], None] = lambda path: None,
) -> tuple[ReadBack, ...]:
    """Write one shape to every path, read each file again, and put them in place together.

    mesh          triangles of the shape, for the mesh formats
    allow_change  put files in place even when they read back as something else; what changed is in the result
    colours       (V, 4) of the mesh's vertices, for the formats that hold them
    beside        further files that belong to the same result, each with the function that writes it
    announce      called with the path of every temporary file before it is made
    Promises      when anything fails no path has changed.
    Raises        UnsupportedFormat; NotWritten naming the path and what changed.
    """
    only = Consignment(shape, mesh, paths, header, beside or {}, colours)
    return write_together([only], schema=schema, allow_change=allow_change, announce=announce)[0]


def write_together(
    consignments: Sequence[Consignment],
    *,
    schema: StepSchema = StepSchema.AP214,
    allow_change: bool = False,
    announce: Callable[[Path], None] = lambda path: None,
) -> tuple[tuple[ReadBack, ...], ...]:
    """The same with several shapes, each to files of its own: all files are put in place together, or none is."""
    for one in consignments:
        require_writable(one.paths)
    places = [path for one in consignments for path in (*one.paths, *one.beside)]
    with staged(*places, announce=announce) as temporary:
        left = iter(temporary)
        return tuple(_written(one, left, schema=schema, allow_change=allow_change) for one in consignments)


def _written(
    one: Consignment, temporary: Iterator[Path], *, schema: StepSchema, allow_change: bool
) -> tuple[ReadBack, ...]:
    measures = one.measures or measure(one.shape)
    results = []
    for path, written in zip(one.paths, temporary):
        result = _write_one(one, (Path(path), written), schema=schema, measures=measures)
        if result.defects and not allow_change:
            raise NotWritten(str(path), "; ".join(str(defect) for defect in result.defects))
        results.append(result)
    for write, written in zip(one.beside.values(), temporary):
        write(written)
    return tuple(results)


def _write_one(one: Consignment, place: tuple[Path, Path], *, schema: StepSchema, measures: ShapeMeasures) -> ReadBack:
    path, written = place
    ending = path.suffix.lower()
    try:
        if ending in STEP_ENDINGS:
            known: dict[str, Any] = {"measures": measures, "seen": one.seen, "copy": one.copy}
            return write_step(one.shape, written, header=one.header, schema=schema, **known)
        if ending in IGES_ENDINGS:
            return write_iges(one.shape, written, header=one.header, measures=measures)
        if ending in BREP_ENDINGS:
            return write_brep(one.shape, written, measures=measures)
        if one.mesh is None:
            raise NotWritten(str(path), "the shape has no faces to be drawn with triangles")
        return write_mesh(one.mesh, written, header=one.header, colours=one.colours)
    except NotWritten as failure:
        raise NotWritten(str(path), failure.problem) from failure
    except ReconError as failure:
        raise NotWritten(str(path), f"it cannot be read back ({failure})") from failure

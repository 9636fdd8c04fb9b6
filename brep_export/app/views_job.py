"""The job behind `recon views`: a three-view drawing to the solids it can mean, through the gate, to files."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from brep_export.app.deliver import exhibit, write_files
from brep_export.app.exhibits import GALLERY
from brep_export.app.polyhedron_files import POLYHEDRON_ENDINGS, polyhedron_writer
from brep_export.app.result import result
from brep_export.app.views_picture import draw_solids
from brep_export.app.views_report import gallery, n_shown, scene_parts
from brep_export.app.workshop import Bench, Exit
from brep_export.check import CheckReport, ShapeKind, check
from brep_export.solids import polyhedron_solid
from brep_export.staging import staged
from recon.errors import NoSolid, NotWritten
from recon.geometry.polyhedron import Polyhedron
from recon.readers.view_sheet import ViewSheet
from recon.readers.views import read_views
from recon.three_view.labeling import FreeChoice
from recon.three_view.pipeline import Interpretation, ViewsOptions, diagnose, interpret
from recon.three_view.repairs import repaired
from recon.tolerance import Tolerance

__all__ = ["SLACK", "as_meant", "views"]

Answer = tuple[Exit, dict[str, Any], tuple[str, ...]]
LISTED = 1000  # options of a choice that are compared to tell which is the most plausible
SLACK = 5.0  # snaps by which a corner may miss the planes that meet there


@dataclass(frozen=True, eq=False)
class Proved:
    """One solid, drawn again and built, with what the gate says of it and the files it goes to."""

    solid: Polyhedron
    shape: Any
    report: CheckReport
    outputs: tuple[str, ...]


def views(request: Mapping[str, Any], bench: Bench) -> Answer:
    """Read the drawing, find its solids, prove the one that was asked for, or all, and write all files or none."""
    most = max(request["solution"], request["limit"] if request["all_solutions"] else 1, LISTED)
    options = ViewsOptions(snap=request["snap"], line_types=not request["no_hidden"], limit=most)
    with bench.phase("read", "reading the drawing"):
        sheet = read_views(request["inputs"][0])
    for note in sheet.notes:
        bench.note(note, name="reading")
    with bench.phase("reconstruct", "finding the solids"):
        sheet, found, mended = _interpreted(sheet, options, request, bench)
    _tell_count(found, request, bench)
    wanted = list(_wanted(request, found))
    proved = [_proved(sheet, found, k, wanted, bench) for k in range(len(wanted))]
    reasons = tuple(dict.fromkeys(str(defect) for one in proved for defect in one.report.defects))
    written = [] if reasons and not request["force"] else _write(proved, found, request, bench)
    if request.get("page") is not None:
        _exhibit(proved, (sheet, found), request, bench)
    answer = result(
        "views",
        inputs=request["inputs"],
        outputs=written,
        reasons=list(reasons),
        kernel=proved[0].report.as_json(),
        seconds=bench.seconds | {"total": bench.elapsed()},
        room=_figures(found, request) | mended,
        notes=bench.notes,
    )
    return (Exit.REFUSED if reasons else Exit.WRITTEN), answer, reasons


def _tell_count(found: Interpretation, request: Mapping[str, Any], bench: Bench) -> None:
    if found.count > 1:
        more = "" if found.exact else "at least "
        which = "each has a number" if found.complete else f"{found.labelings.listed} of them are numbered"
        shown = "" if request["all_solutions"] else f"; this is number {request['solution']}"
        bench.note(f"the drawing can mean {more}{found.count} solids, {which}{shown}", name="several-solids")
    if request["all_solutions"] and found.count > request["limit"]:
        bench.note(f"the first {request['limit']} are written; --limit allows more", name="limit")


def _interpreted(
    sheet: ViewSheet, options: ViewsOptions, request: Mapping[str, Any], bench: Bench
) -> tuple[ViewSheet, Interpretation, dict[str, Any]]:
    """The solids of the drawing, or of the drawing with its most likely error mended, where that is asked for; and what
    contradicted each other in it, and was mended.

    Raises  NoSolid with the lines that contradict each other and the changes that would mend them.
    """
    try:
        return sheet, interpret(sheet.drawing, options, doing=bench.doing), {"conflicts": []}
    except NoSolid as refusal:
        bench.doing("looking for the contradiction")
        diagnosis = diagnose(sheet.drawing, options)
        lines = [line.described(sheet.drawing) for line in diagnosis.conflict]
        mends = [repair.described(sheet.drawing) for repair in diagnosis.repairs]
        if not (request["repair"] and mends):
            spans = "".join(f"; {span}" for span in diagnosis.spans)
            conflict = "; these contradict each other: " + "; ".join(lines) if lines else ""
            advice = "; it would have a solid if " + "; or if ".join(mends) if mends else ""
            raise NoSolid(f"no solid is drawn like this{spans}{conflict}{advice}", lines, mends) from refusal
        bench.note(f"repaired: {mends[0]}", name="repaired")
        mended = replace(sheet, drawing=repaired(sheet.drawing, diagnosis.repairs[0]))
        said = {"conflicts": lines, "repaired": mends[0]}
        return mended, interpret(mended.drawing, options, doing=bench.doing), said


def _wanted(request: Mapping[str, Any], found: Interpretation) -> Iterator[tuple[int, list[str]]]:
    """Numbers of the solids to write, from 0, each with its files; of several, the names are numbered."""
    if not request["all_solutions"]:
        yield request["solution"] - 1, list(request["outputs"])
        return
    for number in range(min(found.labelings.listed, request["limit"])):
        paths = [Path(path) for path in request["outputs"]]
        yield number, [str(path.with_name(f"{path.stem}_{number + 1}{path.suffix}")) for path in paths]


def _proved(
    sheet: ViewSheet, found: Interpretation, turn: int, wanted: Sequence[tuple[int, list[str]]], bench: Bench
) -> Proved:
    """One solid drawn again, built and judged."""
    number, outputs = wanted[turn]
    with bench.phase("reconstruct", f"proving solids ({turn + 1} of {len(wanted)})"):
        polyhedron = found.polyhedron(number)
        differences = found.differences(polyhedron)
    if differences:
        raise NoSolid(f"solid {number + 1} does not draw as given; {differences[0]}", differences)
    solid = as_meant(sheet, polyhedron)
    with bench.phase("brep", f"proving solids ({turn + 1} of {len(wanted)})"):
        shape = polyhedron_solid(solid)
    tolerance = Tolerance(merge=found.snap, fit=SLACK * found.snap)
    with bench.phase("check", f"proving solids ({turn + 1} of {len(wanted)})"):
        report = check(shape, tolerance, expect=ShapeKind.SOLID)
    return Proved(solid, shape, report, tuple(outputs))


def as_meant(sheet: ViewSheet, solid: Polyhedron) -> Polyhedron:
    """The part itself, where the sheet was read as that of its mirror image."""
    return solid.mirrored(0, sheet.drawing.front.segments[:, :, 0].max() / 2) if sheet.mirrored else solid


def _write(proved: list[Proved], found: Interpretation, request: Mapping[str, Any], bench: Bench) -> list[str]:
    """Every file of every solid, and the picture: first under hidden names, put in place when all of them are good."""
    paths = [path for one in proved for path in one.outputs]
    extra = [path for path in (request["picture"],) if path is not None]
    with staged(*paths, *extra, announce=bench.staged) as hidden:
        places = dict(zip((*paths, *extra), map(str, hidden)))
        proved[:] = [_written(one, places, request, bench) for one in proved]
        with bench.phase("write", "drawing the solids"):
            if request["picture"] is not None:
                _paint(proved, found, Path(places[request["picture"]]))
    return [*paths, *extra]


def _paint(proved: Sequence[Proved], found: Interpretation, path: Path) -> None:
    draw_solids(path, found.drawing, [(one.solid, one.report.triangles()) for one in proved])


def _exhibit(
    proved: Sequence[Proved], read: tuple[ViewSheet, Interpretation], request: Mapping[str, Any], bench: Bench
) -> None:
    """The gallery of the page, and the solids in its view, of which the chosen one is seen first."""
    sheet, found = read
    chosen = request["solution"] - 1
    numbers = sorted({*range(n_shown(found)), chosen})
    solids = {number: as_meant(sheet, found.polyhedron(number)) for number in numbers}
    (Path(request["page"]) / GALLERY).write_text(gallery(found, solids), encoding="utf-8")
    parts = partial(scene_parts, found.drawing, solids, chosen, mirrored=sheet.mirrored)
    exhibit(request, bench, parts, [partial(_paint, proved, found)])


def _written(one: Proved, places: Mapping[str, str], request: Mapping[str, Any], bench: Bench) -> Proved:
    """The files of one solid, under their hidden names; the report with what came back when they were read."""
    kernel_files = [places[path] for path in one.outputs if Path(path).suffix.lower() not in POLYHEDRON_ENDINGS]
    plain_files = [places[path] for path in one.outputs if places[path] not in kernel_files]
    name = request["name"] or Path(request["inputs"][0]).stem
    try:
        report, _ = write_files(
            one.shape,
            one.report,
            {**request, "outputs": kernel_files, "name": name, "picture": None},
            bench,
            paint=lambda path: None,
            beside={path: polyhedron_writer(path, one.solid, one.report.triangles()) for path in plain_files},
        )
    except NotWritten as failure:
        path = next((path for path, place in places.items() if place == failure.path), failure.path)
        raise NotWritten(path, failure.problem) from failure
    return replace(one, report=report)


def _figures(found: Interpretation, request: Mapping[str, Any]) -> dict[str, Any]:
    arranged = found.arrangement
    return {
        "solutions": found.count,
        "complete": found.exact,
        "numbered": found.labelings.listed,
        "free_choices": [_choice(found, choice) for choice in found.labelings.choices],
        "chosen": None if request["all_solutions"] else request["solution"],
        "vertices": len(arranged.fragments.wire.vertices),
        "edges": len(arranged.fragments.wire.edges),
        "fragments": len(arranged.fragments.plane),
        "cells": arranged.cells.n_cells,
        "snap": found.snap,
    }


def _choice(found: Interpretation, choice: FreeChoice) -> dict[str, Any]:
    """Size of a free choice, and the box around the cells that it decides."""
    made, cells = found.arrangement.fragments, found.arrangement.cells
    walls = np.asarray(np.isin(cells.of_side, choice.cells).any(axis=1))
    edges = cells.edge[np.flatnonzero(walls[cells.fragment])]
    corners = made.wire.vertices[made.wire.edges[edges]].reshape(-1, 3)
    return {
        "options": choice.count,
        "complete": choice.exact,
        "box": [corners.min(axis=0).tolist(), corners.max(axis=0).tolist()],
    }

"""The job behind `recon views`: a three-view drawing to the solids it can mean, through the gate, to files."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from brep_export.app.deliver import gate, write_files
from brep_export.app.polyhedron_files import POLYHEDRON_ENDINGS, polyhedron_writer
from brep_export.app.result import result
from brep_export.app.workshop import Bench, Exit
from brep_export.check import CheckReport, ShapeKind
from brep_export.solids import polyhedron_solid
from recon.errors import NoSolid
from recon.readers.view_sheet import ViewSheet
from recon.readers.views import read_views
from recon.three_view.conflicts import repaired
from recon.three_view.labeling import FreeChoice
from recon.three_view.pipeline import Interpretation, ViewsOptions, diagnose, interpret
from recon.tolerance import Tolerance

__all__ = ["views"]

Answer = tuple[Exit, dict[str, Any], tuple[str, ...]]
SLACK = 5.0  # snaps by which a corner may miss the planes that meet there


def views(request: Mapping[str, Any], bench: Bench) -> Answer:
    """Read the drawing, find its solids, prove and write the one that was asked for, or all."""
    options = ViewsOptions(snap=request["snap"], line_types=not request["no_hidden"])
    with bench.phase("read", "reading the drawing"):
        sheet = read_views(request["inputs"][0])
    for note in sheet.notes:
        bench.note(note)
    with bench.phase("reconstruct", "finding the solids"):
        sheet, found = _interpreted(sheet, options, request, bench)
    if found.count > 1:
        more = "" if found.complete else "at least "
        bench.note(f"the drawing can mean {more}{found.count} solids; this is number {request['solution']}")
    reports: list[CheckReport] = []
    written: list[str] = []
    reasons: list[str] = []
    for number, outputs in _wanted(request, found):
        report, paths, problems = _deliver(sheet, found, number, {**request, "outputs": outputs}, bench)
        reports.append(report)
        written += paths
        reasons += problems
    answer = result(
        "views",
        inputs=request["inputs"],
        outputs=written,
        reasons=reasons,
        kernel=reports[0].as_json(),
        seconds=bench.seconds | {"total": bench.elapsed()},
        room=_figures(found, request),
        notes=bench.notes,
    )
    return (Exit.REFUSED if reasons else Exit.WRITTEN), answer, tuple(reasons)


def _interpreted(
    sheet: ViewSheet, options: ViewsOptions, request: Mapping[str, Any], bench: Bench
) -> tuple[ViewSheet, Interpretation]:
    """The solids of the drawing, or of the drawing with its most likely error mended, where that is asked for.

    Raises  NoSolid with the lines that contradict each other and the changes that would mend them.
    """
    try:
        return sheet, interpret(sheet.drawing, options, doing=bench.doing)
    except NoSolid as refusal:
        bench.doing("looking for the contradiction")
        diagnosis = diagnose(sheet.drawing, options)
        lines = [line.described(sheet.drawing) for line in diagnosis.conflict]
        mends = [repair.described(sheet.drawing) for repair in diagnosis.repairs]
        if not (request["repair"] and mends):
            conflict = "; these contradict each other: " + "; ".join(lines) if lines else ""
            advice = "; it would have a solid if " + "; or if ".join(mends) if mends else ""
            raise NoSolid(f"no solid is drawn like this{conflict}{advice}", lines) from refusal
        bench.note(f"repaired: {mends[0]}")
        mended = replace(sheet, drawing=repaired(sheet.drawing, diagnosis.repairs[0]))
        return mended, interpret(mended.drawing, options, doing=bench.doing)


def _wanted(request: Mapping[str, Any], found: Interpretation) -> Iterator[tuple[int, list[str]]]:
    """Numbers of the solids to write, from 0, each with its files; of several, the names are numbered."""
    if not request["all_solutions"]:
        yield request["solution"] - 1, list(request["outputs"])
        return
    for number in range(min(found.count, request["limit"])):
        paths = [Path(path) for path in request["outputs"]]
        yield number, [str(path.with_name(f"{path.stem}_{number + 1}{path.suffix}")) for path in paths]


def _deliver(
    sheet: ViewSheet, found: Interpretation, number: int, request: Mapping[str, Any], bench: Bench
) -> tuple[CheckReport, list[str], list[str]]:
    """One solid drawn again, built, proved and written."""
    with bench.phase("reconstruct", "drawing the solid again"):
        polyhedron = found.polyhedron(number)
        differences = found.differences(polyhedron)
    if differences:
        raise NoSolid(f"solid {number + 1} does not draw as given; {differences[0]}", differences)
    solid = polyhedron.mirrored(0, sheet.drawing.front.segments[:, :, 0].max() / 2) if sheet.mirrored else polyhedron
    with bench.phase("brep", "building the solid"):
        shape = polyhedron_solid(solid)
    tolerance = Tolerance(merge=found.snap, fit=SLACK * found.snap)
    report = gate(shape, tolerance, ShapeKind.SOLID, bench)
    kernel_files = [path for path in request["outputs"] if Path(path).suffix.lower() not in POLYHEDRON_ENDINGS]
    plain_files = [path for path in request["outputs"] if path not in kernel_files]
    report, written = write_files(
        shape,
        report,
        {
            **request,
            "outputs": kernel_files,
            "name": request["name"] or Path(request["inputs"][0]).stem,
            "picture": None if request["all_solutions"] and number else request["picture"],
        },
        bench,
        paint=partial(_paint, report),
        beside={path: polyhedron_writer(path, solid, report.triangles()) for path in plain_files},
    )
    return report, written, [str(defect) for defect in report.defects]


def _figures(found: Interpretation, request: Mapping[str, Any]) -> dict[str, Any]:
    arranged = found.arrangement
    return {
        "solutions": found.count,
        "complete": found.complete,
        "free_choices": [_choice(found, choice) for choice in found.labelings.choices],
        "chosen": None if request["all_solutions"] else request["solution"],
        "vertices": len(arranged.fragments.wire.vertices),
        "edges": len(arranged.fragments.wire.edges),
        "fragments": len(arranged.fragments.plane),
        "cells": arranged.cells.n_cells,
        "snap": found.snap,
        "conflicts": [],
    }


def _choice(found: Interpretation, choice: FreeChoice) -> dict[str, Any]:
    """Size of a free choice, and the box around the cells that it decides."""
    made, cells = found.arrangement.fragments, found.arrangement.cells
    walls = np.asarray(np.isin(cells.of_side, choice.cells).any(axis=1))
    edges = cells.edge[np.flatnonzero(walls[cells.fragment])]
    corners = made.wire.vertices[made.wire.edges[edges]].reshape(-1, 3)
    return {
        "options": len(choice.options),
        "complete": choice.complete,
        "box": [corners.min(axis=0).tolist(), corners.max(axis=0).tolist()],
    }


def _paint(report: CheckReport, path: Path) -> None:
    from brep_export.app.pictures import draw, views_around

    draw(path, views_around(report.triangles(), [np.array(line) for line in report.free_edges]))

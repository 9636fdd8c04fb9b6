"""Three-view drawings as DXF: line types and layers tell visible edges from hidden ones and from everything else.

entity                                            what becomes of it
LINE, LWPOLYLINE, POLYLINE, blocks of them        an edge, drawn through or dashed
dash-dot lines, or layers of centre lines         set aside, and counted
dimensions, leaders, text, hatches, points        set aside, and counted
whatever is invisible, its layer off or frozen    set aside, and counted
ARC, CIRCLE, ELLIPSE, SPLINE, bulges              refused, with their places
"""

import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from recon.errors import CurvedDrawing, UnreadableFile
from recon.readers.content import require_plain_file
from recon.readers.dxf_documents import MOST_ENTITIES, damaged_dxf_refused, dxf_document
from recon.readers.view_sheet import Strokes, ViewSheet, separate_views

__all__ = ["read_dxf_views"]

MILLIMETRES = {1: 25.4, 2: 304.8, 4: 1.0, 5: 10.0, 6: 1000.0, 8: 25.4e-6, 9: 0.0254, 10: 914.4, 13: 1e-3, 14: 100.0}
CURVES = {"ARC", "CIRCLE", "ELLIPSE", "SPLINE", "HELIX"}
NOTES = re.compile(r"DIM|BEMASS|TEXT|NOTE|ANNO|HATCH|SCHRAFF|DEFPOINTS|TITLE|SCHRIFT|FRAME|BORDER|RAHMEN|VIEWPORT")
CENTRES = re.compile(
    r"CENT[ER]{2}|CHAIN|DASHDOT|DASHDDOT|DIVIDE|PHANTOM|BORDER|AXIS|AXES|MITTEL|STRICHPUNKT|ISO(0[45689]|1\d)"
)
DASHES = re.compile(r"HIDDEN|DASH|VERDECKT|GESTRICHELT|UNSICHTBAR|INVISIBLE|DOT|ISO0[237]")
DRAWN_THROUGH = re.compile(r"CONTINUOUS|SOLID|ISO01")


def read_dxf_views(path: str | Path) -> ViewSheet:
    """A drawing from a DXF file, in millimetres where the file names its unit, damaged files included.

    Raises  UnreadableFile when the file is no DXF or holds no three views; CurvedDrawing with the place of every arc.
    """
    name = str(require_plain_file(path))
    with damaged_dxf_refused(name):
        return _sheet(dxf_document(name), name)


def _sheet(document: Any, name: str) -> ViewSheet:
    segments, hidden, aside, curves = [], [], Counter[str](), []
    for number, entity in enumerate(_entities(_drawn_space(document), document)):
        if number > MOST_ENTITIES:
            raise UnreadableFile(name, f"its blocks unfold to more than {MOST_ENTITIES} entities")
        kind = _kind(entity, document)
        if kind in ("visible", "hidden"):
            curve = _curve_place(entity)
            if curve is not None:
                curves.append(curve)
                continue
            for pair in _straight(entity):
                segments.append(pair)
                hidden.append(kind == "hidden")
        else:
            aside[kind] += 1
    if curves:
        raise CurvedDrawing(name, curves)
    scale = MILLIMETRES.get(int(document.header.get("$INSUNITS", 0)), 1.0)
    rows = np.array(segments, dtype=np.float64).reshape(-1, 2, 2) * scale
    usable = np.isfinite(rows).all(axis=(1, 2)) & (np.abs(rows) < 1e12).all(axis=(1, 2))
    sheet = separate_views(Strokes(rows[usable], np.array(hidden, dtype=bool)[usable]), name)
    return sheet.with_notes(aside)


def _drawn_space(document: Any) -> Any:
    """The model space, or the first sheet with lines where that is empty."""
    model = document.modelspace()
    sheets = [document.layouts.get(name) for name in document.layouts.names_in_taborder()]
    return next((space for space in (model, *sheets) if len(space.query("LINE LWPOLYLINE POLYLINE INSERT"))), model)


def _entities(space: Any, document: Any) -> Iterator[Any]:
    """Entities of a layout, blocks resolved but for the drawing of dimensions."""
    for entity in space:
        yield from _resolved(entity, document, depth=0)


def _resolved(entity: Any, document: Any, depth: int) -> Iterator[Any]:
    if entity.dxftype() != "INSERT" or depth > 16 or _unseen(entity, document):
        yield entity
        return
    for insert in entity.multi_insert() if entity.mcount > 1 else [entity]:
        for part in insert.virtual_entities():
            if part.dxf.layer == "0":
                part.dxf.layer = entity.dxf.layer
            if part.dxf.linetype.upper() == "BYBLOCK":
                part.dxf.linetype = entity.dxf.linetype
            yield from _resolved(part, document, depth + 1)


def _unseen(entity: Any, document: Any) -> bool:
    """Whether an entity is not shown; of a block whose layer is merely off the parts on other layers are."""
    name = entity.dxf.layer
    layer = document.layers.get(name) if name in document.layers else None
    off = layer is not None and (layer.is_frozen() or (layer.is_off() and entity.dxftype() != "INSERT"))
    return bool(off or entity.dxf.get("invisible", 0))


def _kind(entity: Any, document: Any) -> str:
    """visible, hidden, or what else an entity is, in the plural."""
    if _unseen(entity, document):
        return "entities that are not shown"
    form = entity.dxftype()
    if form not in CURVES | {"LINE", "LWPOLYLINE", "POLYLINE"}:
        return {"DIMENSION": "dimensions", "HATCH": "hatches", "TEXT": "texts", "MTEXT": "texts"}.get(
            form, form.lower() + " entities"
        )
    layer = entity.dxf.layer.upper()
    if NOTES.search(layer):
        return f"lines on layer {entity.dxf.layer}"
    line_type = entity.dxf.linetype
    if line_type.upper() in ("BYLAYER", "BYBLOCK"):
        line_type = document.layers.get(entity.dxf.layer).dxf.linetype if entity.dxf.layer in document.layers else ""
    if not line_type or DRAWN_THROUGH.search(line_type.upper()):
        line_type = layer
    return _line_kind(line_type.upper(), document)


def _line_kind(line_type: str, document: Any) -> str:
    if CENTRES.search(line_type):
        return "centre lines"
    if DASHES.search(line_type):
        return "hidden"
    if line_type in document.linetypes:
        pattern = document.linetypes.get(line_type).simplified_line_pattern()
        if len(pattern) > 2:
            return "centre lines"
        if len(pattern) == 2:
            return "hidden"
    return "visible"


def _curve_place(entity: Any) -> str | None:
    """Kind and place of a curve; None for what is straight."""
    form = entity.dxftype()
    if form in ("ARC", "CIRCLE"):
        centre = entity.dxf.center
        return f"{form.lower()} at ({centre.x:.6g}, {centre.y:.6g}) of radius {entity.dxf.radius:.6g}"
    if form == "ELLIPSE":
        return f"ellipse at ({entity.dxf.center.x:.6g}, {entity.dxf.center.y:.6g})"
    if form in CURVES:
        start = next(iter(entity.flattening(1.0)), None)
        return f"{form.lower()}" + ("" if start is None else f" from ({start.x:.6g}, {start.y:.6g})")
    if form in ("LWPOLYLINE", "POLYLINE") and entity.has_arc:
        bent = next((part for part in entity.virtual_entities() if part.dxftype() == "ARC"), None)
        return None if bent is None else f"arc of a polyline, {_curve_place(bent)}"
    return None


def _straight(entity: Any) -> Iterator[list[list[float]]]:
    if entity.dxftype() == "LINE":
        yield [[entity.dxf.start.x, entity.dxf.start.y], [entity.dxf.end.x, entity.dxf.end.y]]
        return
    for part in entity.virtual_entities():
        if part.dxftype() == "LINE":
            yield [[part.dxf.start.x, part.dxf.start.y], [part.dxf.end.x, part.dxf.end.y]]

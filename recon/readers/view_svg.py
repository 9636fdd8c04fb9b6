"""Three-view drawings as SVG: dash arrays tell hidden lines from the others.

element                                  what becomes of it
line, polyline, polygon, rect, path      edges, drawn through or dashed; y turned upward, transforms applied
style sheets                             rules of classes, names and elements say how lines are drawn
a dash array of more than one dash       set aside as a centre line, and counted
text, image, filled shapes, markers      set aside, and counted
circle, ellipse, curves of a path        refused, with their places
"""

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.errors import CurvedDrawing, UnreadableFile
from recon.readers.content import file_bytes
from recon.readers.view_sheet import Strokes, ViewSheet, separate_views

__all__ = ["read_svg_views"]

Floats = NDArray[np.float64]

NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
ARC = re.compile(r"[\s,]*".join(f"({part})" for part in [*[NUMBER.pattern] * 3, "[01]", "[01]", *[NUMBER.pattern] * 2]))
COMMAND = re.compile(r"([MmLlHhVvZzCcSsQqTtAa])([^MmLlHhVvZzCcSsQqTtAa]*)")
RULE = re.compile(r"([^{}]+)\{([^{}]*)\}")
REMARK = re.compile(r"/\*.*?\*/", re.DOTALL)
TRANSFORM = re.compile(r"(matrix|translate|scale|rotate|skewX|skewY)\s*\(([^)]*)\)")
MILLIMETRES = {"mm": 1.0, "cm": 10.0, "in": 25.4, "pt": 25.4 / 72, "pc": 25.4 / 6, "px": 25.4 / 96}
ARGUMENTS = {"M": 2, "L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4, "T": 2, "A": 7, "Z": 0}
UNSEEN = {"defs", "metadata", "title", "desc", "style", "clipPath", "mask", "marker", "pattern", "symbol"}
DEEPEST = 60
MOST_ELEMENTS = 50_000  # elements that use others unfold to any number out of a small file


class _TooMany(Exception):
    """More elements than a drawing has."""


@dataclass(frozen=True)
class _Pen:
    """What an element hands down to those inside it: where it stands, how it is drawn."""

    place: Floats = field(default_factory=lambda: np.eye(3))
    dashes: str = "none"
    stroke: str = "none"
    fill: str = "black"


@dataclass
class _Sheet:
    """What has been read so far."""

    segments: list[Floats] = field(default_factory=list)
    hidden: list[bool] = field(default_factory=list)
    curves: list[str] = field(default_factory=list)
    aside: Counter[str] = field(default_factory=Counter)
    n_elements: int = 0
    named: dict[str, Any] = field(default_factory=dict)
    rules: dict[str, dict[str, str]] = field(default_factory=dict)


def read_svg_views(path: str | Path) -> ViewSheet:
    """A drawing from an SVG file, in millimetres where the file names its size.

    Raises  UnreadableFile when the file is no SVG or holds no three views; CurvedDrawing with the place of every curve.
    """
    name = str(path)
    root = _root(file_bytes(path), name)
    # of two elements with one name the first counts
    elements = [element for element in root.iter() if isinstance(element.tag, str)]
    sheet = _Sheet(named={e.get("id", ""): e for e in reversed(elements)}, rules=_rules(elements))
    scale = _millimetres(root)
    try:
        _read(root, _Pen(place=np.diag([scale, -scale, 1.0])), sheet, 0)
    except _TooMany:
        raise UnreadableFile(name, f"unfolds to more than {MOST_ELEMENTS} elements") from None
    if sheet.curves:
        raise CurvedDrawing(name, sheet.curves)
    rows = np.array(sheet.segments, dtype=np.float64).reshape(-1, 2, 2)
    usable = np.isfinite(rows).all(axis=(1, 2)) & (np.abs(rows) < 1e12).all(axis=(1, 2))
    views = separate_views(Strokes(rows[usable], np.array(sheet.hidden, dtype=bool)[usable]), name)
    return views.with_notes(sheet.aside)


def _root(content: bytes, name: str) -> Any:
    from lxml import etree

    parser = etree.XMLParser(resolve_entities=False, no_network=True, huge_tree=False)
    try:
        root = etree.fromstring(content, parser)
    except (etree.XMLSyntaxError, ValueError) as problem:
        raise UnreadableFile(name, "is no SVG file, or damaged") from problem
    if root is None or _tag(root) != "svg":
        raise UnreadableFile(name, "is no SVG file")
    return root


def _tag(element: Any) -> str:
    return element.tag.rpartition("}")[2] if isinstance(element.tag, str) else ""


def _numbers(text: str | None) -> list[float]:
    return [float(match) for match in NUMBER.findall(text or "")]


def _millimetres(root: Any) -> float:
    """Millimetres of one unit of the drawing; 1 when the file does not tell."""
    box = _numbers(root.get("viewBox"))
    width = root.get("width", "")
    unit = MILLIMETRES.get(width.strip().lstrip("+-.0123456789eE").strip())
    size = _numbers(width)
    if unit is None or not size or size[0] <= 0:
        return 1.0
    return unit * size[0] / box[2] if len(box) == 4 and box[2] > 0 else unit


def _rules(elements: Sequence[Any]) -> dict[str, dict[str, str]]:
    """What style sheets say of each simple selector: an element's kind, .class or #name."""
    found: dict[str, dict[str, str]] = {}
    for text in ("".join(element.itertext()) for element in elements if _tag(element) == "style"):
        for selectors, body in RULE.findall(REMARK.sub("", text)):
            for selector in selectors.split(","):
                found.setdefault(selector.strip(), {}).update(_declarations(body))
    return found


def _declarations(text: str) -> dict[str, str]:
    pairs = (item.split(":", 1) for item in text.split(";") if ":" in item)
    return {key.strip(): value.strip() for key, value in pairs}


def _style(element: Any, rules: Mapping[str, dict[str, str]]) -> dict[str, str]:
    """Attributes, over them the rules that name the element, over them its own style."""
    classes = element.get("class", "").split()
    selectors = (_tag(element), *(f".{name}" for name in classes), f"#{element.get('id')}")
    style = dict(element.attrib)
    for selector in selectors:
        style |= rules.get(selector, {})
    return style | _declarations(element.get("style", ""))


def _read(element: Any, pen: _Pen, sheet: _Sheet, depth: int) -> None:
    kind = _tag(element)
    if kind in UNSEEN or not kind or depth > DEEPEST:
        return
    sheet.n_elements += 1
    if sheet.n_elements > MOST_ELEMENTS:
        raise _TooMany
    style = _style(element, sheet.rules)
    if style.get("display") == "none" or style.get("visibility") == "hidden":
        return
    pen = replace(
        pen,
        place=pen.place @ _matrix(style.get("transform", "")),
        dashes=style.get("stroke-dasharray", pen.dashes),
        stroke=style.get("stroke", pen.stroke),
        fill=style.get("fill", pen.fill),
    )
    if kind in ("svg", "g", "a", "switch"):
        for child in element:
            _read(child, pen, sheet, depth + 1)
    elif kind == "use":
        _read_use(element, pen, sheet, depth)
    else:
        _draw(element, kind, pen, sheet)


def _read_use(element: Any, pen: _Pen, sheet: _Sheet, depth: int) -> None:
    wanted = element.get("href") or element.get("{http://www.w3.org/1999/xlink}href") or ""
    found = sheet.named.get(wanted[1:]) if wanted.startswith("#") and len(wanted) > 1 else None
    if found is not None:
        shift = np.eye(3)
        shift[:2, 2] = [next(iter(_numbers(element.get(key))), 0.0) for key in ("x", "y")]
        for part in found if _tag(found) == "symbol" else [found]:
            _read(part, replace(pen, place=pen.place @ shift), sheet, depth + 1)


def _matrix(text: str) -> Floats:
    """The transform of a list like translate(1 2) rotate(90)."""
    made = np.eye(3)
    for name, arguments in TRANSFORM.findall(text):
        v = _numbers(arguments)
        step = np.eye(3)
        if name == "matrix" and len(v) == 6:
            step[:2] = np.array(v).reshape(3, 2).T
        elif name == "translate" and v:
            step[:2, 2] = v[0], v[1] if len(v) > 1 else 0.0
        elif name == "scale" and v:
            step[0, 0], step[1, 1] = v[0], v[1] if len(v) > 1 else v[0]
        elif name == "rotate" and v:
            c, s = np.cos(np.radians(v[0])), np.sin(np.radians(v[0]))
            step[:2, :2] = [[c, -s], [s, c]]
            if len(v) == 3:
                centre = np.array(v[1:])
                step[:2, 2] = centre - step[:2, :2] @ centre
        elif name in ("skewX", "skewY") and v:
            step[(0, 1) if name == "skewX" else (1, 0)] = np.tan(np.radians(v[0]))
        made = made @ step
    return made


def _draw(element: Any, kind: str, pen: _Pen, sheet: _Sheet) -> None:
    if kind not in ("line", "polyline", "polygon", "rect", "path", "circle", "ellipse"):
        sheet.aside[{"text": "texts", "image": "images"}.get(kind, kind + " elements")] += 1
        return
    if pen.stroke == "none":
        sheet.aside["filled shapes without an outline"] += 1
        return
    dashes = [] if pen.dashes == "none" else _numbers(pen.dashes)
    dashes = dashes * 2 if len(dashes) % 2 else dashes  # as SVG reads a list of odd length
    if len(set(dashes[::2])) > 1:
        sheet.aside["centre lines"] += 1
        return
    lines, curves = _outline(element, kind)
    where = [pen.place @ [*place, 1.0] for _, place in curves]
    # y runs downward in the file, and there the user looks for them
    sheet.curves += [f"{name} at ({x:.6g}, {-y:.6g})" for (name, _), (x, y, _) in zip(curves, where)]
    for a, b in lines:
        if a != b:
            ends = np.column_stack([np.array([a, b]), [1.0, 1.0]]) @ pen.place.T
            sheet.segments.append(ends[:, :2])
            sheet.hidden.append(sum(dashes[1::2]) > 0)


Point = tuple[float, float]
Lines = list[tuple[Point, Point]]
Curves = list[tuple[str, Point]]


def _outline(element: Any, kind: str) -> tuple[Lines, Curves]:
    """Straight lines of an element, and its curves with a point of each."""

    def length(key: str) -> float:
        return next(iter(_numbers(element.get(key))), 0.0)

    if kind in ("circle", "ellipse"):
        return [], [(kind, (length("cx"), length("cy")))]
    if kind == "line":
        return [((length("x1"), length("y1")), (length("x2"), length("y2")))], []
    if kind == "rect":
        x, y, w, h = length("x"), length("y"), length("width"), length("height")
        corners = [(x, y), (x + w, y), (x + w, y + h), (x, y + h)]
        rounded = [("rounded corner", (x, y))] if length("rx") or length("ry") else []
        return list(zip(corners, corners[1:] + corners[:1])), rounded
    if kind == "path":
        return _path(element.get("d", ""))
    v = _numbers(element.get("points"))
    points = list(zip(v[::2], v[1::2]))
    closing = [(points[-1], points[0])] if kind == "polygon" and points else []
    return [*pairwise(points), *closing], []


def _path(text: str) -> tuple[Lines, Curves]:
    lines, curves = Lines(), Curves()
    start = at = (0.0, 0.0)
    for command, arguments in COMMAND.findall(text):
        for form, v in _steps(command, arguments):
            relative = command.islower()
            base = at if relative else (0.0, 0.0)
            to = _target(form, v, at, base, start)
            if form == "M":
                start = to
            elif form in "LHVZ":
                lines.append((at, to))
            else:
                curves.append(("arc" if form == "A" else "curve", to))
            at = to
    return lines, curves


def _steps(command: str, text: str) -> Iterator[tuple[str, list[float]]]:
    """A command once for every set of its arguments; further ones of a move are lines.

    A curve that breaks off has none; the two flags of an arc may stand before the next number without a space.
    """
    form = command.upper()
    size = ARGUMENTS[form]
    values = [float(x) for found in ARC.findall(text) for x in found] if form == "A" else _numbers(text)
    if not size:
        yield form, []
    for k in range(0, len(values) - size + 1 if size else 0, size or 1):
        yield ("L" if form == "M" and k else form), values[k : k + size]
    if form in "CSQTA" and (not values or len(values) % size):
        yield form, []


def _target(form: str, v: list[float], at: Point, base: Point, start: Point) -> Point:
    if form == "Z":
        return start
    if not v:
        return at
    if form == "H":
        return base[0] + v[0], at[1]
    if form == "V":
        return at[0], base[1] + v[0]
    return base[0] + v[-2], base[1] + v[-1]

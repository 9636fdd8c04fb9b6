"""One page that says what came out: verdict and answers first, a view to turn, the gate, figures, pictures.

The page is self-contained: style, script, scene and pictures are in it, and it forbids the browser to fetch anything.
Light on purpose: the front desk imports it.
"""

from base64 import b64encode
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

from brep_export.app.page_style import STYLE
from brep_export.app.report_figures import answers, figure, flat
from brep_export.app.versions import versions
from recon.errors import NotWritten

__all__ = ["Exhibits", "report_page", "write_report"]

ASSETS = Path(__file__).parent / "assets"
LONG = 30  # rows from which on a table is folded
NOTHING_FETCHED = (
    "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'; base-uri 'none'"
)


@dataclass(frozen=True)
class Exhibits:
    """What a page shows beside figures.

    pictures  PNG each
    scene     of the view that turns, as scene.write_scene writes it, or None for no view
    gallery   a section of the page as HTML, or nothing
    unit      of lengths of the shape
    """

    pictures: Sequence[bytes] = ()
    scene: str | None = None
    gallery: str = ""
    unit: str = "mm"


def write_report(path: Path, result: Mapping[str, Any], exhibits: Exhibits) -> None:
    """Write the page of a result, whole or not at all; raises NotWritten."""
    beside = path.with_name(f".{path.name}.part")
    try:
        beside.write_text(report_page(result, exhibits), encoding="utf-8")
        beside.replace(path)
    except OSError as problem:
        beside.unlink(missing_ok=True)
        raise NotWritten(str(path), f"the page could not be put in place ({problem.strerror})") from problem


def report_page(result: Mapping[str, Any], exhibits: Exhibits = Exhibits()) -> str:
    """The page as HTML text.

    result  the JSON object of a command
    """
    unit = exhibits.unit
    parts = [
        _head_line(result),
        _answers(result, unit),
        _listed("Reasons", result["reasons"], kind="reasons"),
        "" if exhibits.scene is None else _view(exhibits.scene),
        exhibits.gallery,
        '<div class="columns">',
        _column(
            _gate(result["kernel"].get("gate", ())),
            _table("Error", result["error"] or {}, str((result["error"] or {}).get("unit", unit))),
            _table("The shape", {k: v for k, v in result["kernel"].items() if k != "gate"}, unit),
        ),
        _column(
            _table("Method", result["room"], unit),
            _table("Time", {f"{phase}_s": seconds for phase, seconds in result["seconds"].items()}, unit),
        ),
        "</div>",
        _listed("Notes", result["notes"]),
        _listed("Read", result["inputs"]),
        _listed("Written", result["outputs"]),
        _pictures(exhibits.pictures),
        f"<footer>{escape(', '.join(f'{name} {number}' for name, number in versions().items()))}</footer>",
    ]
    title = escape(f"recon {result['command']}: {result['verdict']}")
    policy = f'<meta http-equiv="Content-Security-Policy" content="{NOTHING_FETCHED}">'
    wide = '<meta name="viewport" content="width=device-width, initial-scale=1">'
    head = f'<head><meta charset="utf-8">{policy}{wide}<title>{title}</title><style>{STYLE}</style></head>'
    body = "".join(parts) + ("" if exhibits.scene is None else _scripts())
    return f'<!DOCTYPE html>\n<html lang="en">{head}<body>{body}</body></html>\n'


def _head_line(result: Mapping[str, Any]) -> str:
    kind, said = "refused", "refused"
    if result["verdict"] == "pass":
        kind, said = ("pass", "passes the gate") if result["kernel"] else ("none", "no shape was made")
    verdict = f'<p class="verdict {kind}">{said}</p>'
    names = ", ".join(Path(name).name for name in result["inputs"][:3]) + ("" if len(result["inputs"]) < 4 else " ...")
    return f"<header><h1>recon {escape(result['command'])} {escape(names)}</h1>{verdict}</header>"


def _answers(result: Mapping[str, Any], unit: str) -> str:
    cards = "".join(
        f'<div class="{kind}"><dt>{escape(question)}</dt><dd>{escape(text)}</dd></div>'
        for question, text, kind in answers(result, unit)
    )
    return f'<dl class="answers">{cards}</dl>' if cards else ""


def _view(scene: str) -> str:
    """The frame of the view, and its scene: JSON of base64 and names, in which no tag may begin."""
    safe = scene.replace("<", "\\u003c")
    return (
        '<div id="view"><div class="stage"></div><div class="panel"></div></div>'
        f'<script type="application/json" id="scene">{safe}</script>'
    )


def _scripts() -> str:
    files = (ASSETS / "three" / "three.min.js", ASSETS / "view.js")
    return "".join(f"<script>{path.read_text(encoding='utf-8')}</script>" for path in files)


def _column(*tables: str) -> str:
    return f"<div>{''.join(tables)}</div>" if any(tables) else ""


def _gate(lines: Any) -> str:
    marks = {True: "passed", False: "broken", None: "not drawn"}
    rows = "".join(
        f'<tr class="{marks[entry["passed"]].split()[0]}"><td>{n}</td><td>{escape(entry["line"])}</td>'
        f"<td>{marks[entry['passed']]}</td></tr>"
        for n, entry in enumerate(lines, 1)
    )
    return f"<h2>The gate</h2><table>{rows}</table>" if rows else ""


def _table(title: str, figures: Mapping[str, Any], unit: str) -> str:
    rows = [f"<tr><td>{escape(name)}</td><td>{escape(text)}</td></tr>" for name, text in _texts(figures, unit)]
    if not rows:
        return ""
    table = f"<table>{''.join(rows)}</table>"
    folded = f"<details><summary>{len(rows)} figures</summary>{table}</details>" if len(rows) > LONG else table
    return f"<h2>{title}</h2>{folded}"


def _texts(figures: Mapping[str, Any], unit: str) -> Iterator[tuple[str, str]]:
    for name, value, its_unit in flat(figures, unit):
        yield name, f"{figure(value)} {its_unit}".rstrip()


def _listed(title: str, lines: Any, *, kind: str = "") -> str:
    rows = "".join(f"<li>{escape(str(line))}</li>" for line in lines)
    return f'<h2>{title}</h2><ul class="{kind}">{rows}</ul>' if rows else ""


def _pictures(pictures: Sequence[bytes]) -> str:
    images = "".join(
        f'<img alt="picture {n} of the result" src="data:image/png;base64,{b64encode(png).decode()}">'
        for n, png in enumerate(pictures, 1)
    )
    return f'<div class="pictures"><h2>Pictures</h2>{images}</div>' if images else ""

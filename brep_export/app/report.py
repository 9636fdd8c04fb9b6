"""One page that says what came out: verdict first, then the gate line by line, figures, and the picture.

The page is self-contained: style and picture are in it. Light on purpose: the front desk imports it.
"""

import platform
from base64 import b64encode
from collections.abc import Iterator, Mapping
from html import escape
from pathlib import Path
from typing import Any

from brep_export.app.page_style import STYLE
from recon.errors import NotWritten
from recon.version import __version__

__all__ = ["report_page", "write_report"]


def write_report(path: Path, result: Mapping[str, Any], picture: bytes | None) -> None:
    """Write the page of a result, whole or not at all; raises NotWritten."""
    beside = path.with_name(f".{path.name}.part")
    try:
        beside.write_text(report_page(result, picture), encoding="utf-8")
        beside.replace(path)
    except OSError as problem:
        beside.unlink(missing_ok=True)
        raise NotWritten(str(path), f"the page could not be put in place ({problem.strerror})") from problem


def report_page(result: Mapping[str, Any], picture: bytes | None) -> str:
    """The page as HTML text.

    result   the JSON object of a command
    picture  PNG, or None
    """
    parts = [
        f"<h1>recon {escape(result['command'])}</h1>",
        _verdict(result),
        _answers(result),
        "" if picture is None else f'<img alt="" src="data:image/png;base64,{b64encode(picture).decode()}">',
        _listed("Reasons", result["reasons"]),
        _gate(result["kernel"].get("gate", ())),
        _table("The shape", {k: v for k, v in result["kernel"].items() if k != "gate"}),
        _table("Error", result["error"] or {}),
        _table("Method", result["room"]),
        _listed("Notes", result["notes"]),
        _listed("Read", result["inputs"]),
        _listed("Written", result["outputs"]),
        _table("Seconds", result["seconds"]),
        f"<footer>recon-brep {__version__}, Python {platform.python_version()} on {escape(platform.system())}</footer>",
    ]
    title = escape(f"recon {result['command']}: {result['verdict']}")
    head = f'<head><meta charset="utf-8"><title>{title}</title><style>{STYLE}</style></head>'
    return f'<!DOCTYPE html>\n<html lang="en">{head}<body>{"".join(parts)}</body></html>\n'


def _verdict(result: Mapping[str, Any]) -> str:
    passed = result["verdict"] == "pass"
    return f'<p class="verdict {"pass" if passed else "refused"}">{"passes the gate" if passed else "refused"}</p>'


def _answers(result: Mapping[str, Any]) -> str:
    """What a user asks first: is it closed, how far off is it, can it be printed?"""
    kernel, error = result["kernel"], result["error"]
    answers = []
    if kernel:
        closed = kernel["closed"] and kernel["type"] == "solid"
        answers.append(("Closed?", "yes" if closed else f"no: {kernel['free_edges']} free edges"))
        answers.append(("Printable?", "yes" if closed and result["verdict"] == "pass" else "no"))
    if error:
        far = f"{_figure(error['mean'])} on average, {_figure(error['max'])} at most ({error['unit']})"
        answers.append(("How far off?", f"{far}, against {error['against']}"))
    rows = "".join(f"<dt>{escape(q)}</dt><dd>{escape(a)}</dd>" for q, a in answers)
    return f"<dl>{rows}</dl>" if rows else ""


def _gate(lines: Any) -> str:
    marks = {True: "passed", False: "broken", None: "not drawn"}
    rows = "".join(
        f'<tr class="{marks[entry["passed"]].split()[0]}"><td>{n}</td><td>{escape(entry["line"])}</td>'
        f"<td>{marks[entry['passed']]}</td></tr>"
        for n, entry in enumerate(lines, 1)
    )
    return f"<h2>The gate</h2><table>{rows}</table>" if rows else ""


def _table(title: str, figures: Mapping[str, Any]) -> str:
    rows = "".join(f"<tr><td>{escape(key)}</td><td>{escape(text)}</td></tr>" for key, text in _flat(figures))
    return f"<h2>{title}</h2><table>{rows}</table>" if rows else ""


def _flat(figures: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, str]]:
    """Rows of a nested object, keys joined by dots; lists of objects are numbered."""
    for key, value in figures.items():
        name = f"{above}{key}".replace("_", " ")
        if isinstance(value, Mapping):
            yield from _flat(value, f"{name}. ")
        elif isinstance(value, list) and value and isinstance(value[0], Mapping):
            yield from _flat({str(i): entry for i, entry in enumerate(value)}, f"{name} ")
        elif value is not None:
            yield name, _figure(value)


def _figure(value: Any) -> str:
    if isinstance(value, list | tuple):
        return ", ".join(_figure(entry) for entry in value)
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _listed(title: str, lines: Any) -> str:
    rows = "".join(f"<li>{escape(str(line))}</li>" for line in lines)
    return f"<h2>{title}</h2><ul>{rows}</ul>" if rows else ""

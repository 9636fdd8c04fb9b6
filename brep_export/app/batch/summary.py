"""The table of a run: a row a job, as CSV and as a page."""

import csv
import io
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any
from urllib.parse import quote

from brep_export.app.page_style import STYLE
from brep_export.staging import staged

__all__ = ["write_summary"]

Record = Mapping[str, Any]
COLUMNS = (
    *("job", "command", "status", "cause", "reason", "attempts", "seconds", "memory_mb", "solids", "faces", "volume"),
    *("error_max", "outputs"),
)


def write_summary(directory: Path, records: Sequence[Record]) -> list[str]:
    """Write summary.csv and summary.html, both or neither; their paths. Raises NotWritten."""
    rows = [_row(record) for record in records]
    places = [directory / "summary.csv", directory / "summary.html"]
    with staged(*places) as (table, page):
        table.write_text(_csv(rows), encoding="utf-8")
        page.write_text(_page(rows), encoding="utf-8")
    return [str(place) for place in places]


def _row(record: Record) -> dict[str, Any]:
    answer = record.get("answer") or {}
    kernel, error = answer.get("kernel") or {}, answer.get("error") or {}
    return {
        "job": record["name"],
        "command": record["command"],
        "status": record["status"],
        "cause": record["cause"],
        "reason": " ".join(record["reasons"]),
        "attempts": record["attempts"],
        "seconds": record["seconds"],
        "memory_mb": record["peak_memory_mb"],
        "solids": kernel.get("solids"),
        "faces": kernel.get("faces"),
        "volume": kernel.get("volume"),
        "error_max": error.get("max"),
        "outputs": "; ".join(record["outputs"]),
    }


def _csv(rows: Sequence[Mapping[str, Any]]) -> str:
    text = io.StringIO()
    table = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    table.writeheader()
    table.writerows(rows)
    return text.getvalue()


def _page(rows: Sequence[Mapping[str, Any]]) -> str:
    failed = [row for row in rows if row["status"] != "done"]
    verdict = f"{len(failed)} of {len(rows)} failed" if failed else f"all {len(rows)} done"
    head = "".join(f"<th>{escape(column.replace('_', ' '))}</th>" for column in COLUMNS)
    body = "\n".join(_line(row) for row in [*failed, *(row for row in rows if row["status"] == "done")])
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>recon batch: {verdict}</title>
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; style-src 'unsafe-inline'">
<style>{STYLE}
body {{ max-width: none; }} th {{ text-align: left; padding-right: 1.2rem; }} tr.broken td {{ font-weight: 400; }}
</style></head><body>
<header><h1>recon batch</h1><p class="verdict {"refused" if failed else "pass"}">{verdict}</p></header>
<table><thead><tr>{head}</tr></thead><tbody>
{body}
</tbody></table></body></html>
"""


def _line(row: Mapping[str, Any]) -> str:
    cells = {column: _cell(row[column]) for column in COLUMNS}
    folder = quote(str(row["job"]))
    cells["job"] = f'<a href="{folder}/log.txt">{cells["job"]}</a>'
    names = [name for name in str(row["outputs"]).split("; ") if name]
    cells["outputs"] = " ".join(f'<a href="{folder}/{quote(name)}">{escape(name)}</a>' for name in names)
    kind = "passed" if row["status"] == "done" else "broken"
    return f'<tr class="{kind}">' + "".join(f"<td>{cell}</td>" for cell in cells.values()) + "</tr>"


def _cell(value: Any) -> str:
    if value is None:
        return ""
    return f"{value:.6g}" if isinstance(value, float) else escape(str(value))

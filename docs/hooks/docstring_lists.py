"""Docstrings of this project as Markdown: what stands in columns becomes a list of terms, keys of papers become links.

mesh    (V, 3) vertices in        ->   mesh
        millimetres                    :   (V, 3) vertices in millimetres
"""

import re
from pathlib import Path
from typing import Any

from griffe import Extension, Object

BIBLIOGRAPHY = Path(__file__).parents[1] / "bibliography.bib"
KEYS = "|".join(re.findall(r"@\w+\{(\w+),", BIBLIOGRAPHY.read_text(encoding="utf-8")))
COLUMNS = re.compile(r"(\S+(?: \S+)*) {2,}(\S.*)")


class DocstringLists(Extension):
    """Rewrites each docstring as it is read."""

    def on_instance(self, *, obj: Object, **told: Any) -> None:
        """Called for every module, class, function and attribute."""
        del told
        if obj.docstring is not None:
            obj.docstring.value = as_markdown(obj.docstring.value)


def as_markdown(docstring: str) -> str:
    """Paragraphs whose first line stands in columns as lists; drawings, which are indented, as they are."""
    plain = docstring.replace("](", "]\\(")  # an interval before a bracket is no link
    cited = re.sub(rf"\[({KEYS})\](?!\])", r"[[\1]](../bibliography.md#\1)", plain)
    return "\n\n".join(map(_paragraph, re.split(r"\n\s*\n", cited)))


def _paragraph(paragraph: str) -> str:
    lines = paragraph.splitlines()
    if paragraph.startswith(" ") or not any(map(_columns, lines)):
        return paragraph
    said: list[list[str]] = []
    for line in lines:
        found = _columns(line)
        if found is not None:
            said.append(list(found))
        elif said and line.startswith(" "):
            said[-1][1] += " " + line.strip()
        else:
            said.append(["", line])
    return "\n\n".join(f"`{term}`\n:   {text}" if term else text for term, text in said)


def _columns(line: str) -> tuple[str, str] | None:
    found = COLUMNS.fullmatch(line)
    return None if found is None else (found[1], found[2])

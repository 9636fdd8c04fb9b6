"""The page of the bibliography, made from `bibliography.bib` when the site is built."""

import re
from pathlib import Path
from typing import Any

BIBLIOGRAPHY = Path(__file__).parents[1] / "bibliography.bib"
MARK = "<!-- bibliography -->"


def on_page_markdown(markdown: str, **told: Any) -> str:
    """Put the entries where the page has its mark."""
    del told
    return markdown.replace(MARK, entries_as_markdown(BIBLIOGRAPHY.read_text(encoding="utf-8")))


def entries_as_markdown(source: str) -> str:
    """One paragraph an entry, by the name of its first author; its key is its anchor."""
    entries = [(key, fields_of(body)) for key, body in re.findall(r"@\w+\{(\w+),(.*?)\n\}", source, flags=re.DOTALL)]
    return "\n\n".join(_paragraph(key, fields) for key, fields in sorted(entries, key=lambda one: one[1]["author"]))


def fields_of(body: str) -> dict[str, str]:
    """Fields of an entry; braces within a value fall away."""
    value = r"\{((?:[^{}]|\{[^{}]*\})*)\}"
    return {name: re.sub(r"[{}]", "", text) for name, text in re.findall(rf"(\w+)\s*=\s*{value}", body)}


def _paragraph(key: str, fields: dict[str, str]) -> str:
    authors = "; ".join(name.strip() for name in re.split(r"\s+and\s+", fields["author"]))
    places = ("journal", "booktitle", "publisher", "school", "note", "year")
    told = [authors, f"*{fields['title']}*", *(fields[place] for place in places if place in fields)]
    return f'<a id="{key}"></a>**[{key}]** ' + ". ".join(re.sub(r"\s+", " ", part) for part in told) + "."

"""The page of the bibliography, made from `bibliography.bib` as the site is built, and links from other pages to it."""

import re
import unicodedata
from pathlib import Path
from typing import Any

BIBLIOGRAPHY = Path(__file__).parents[1] / "bibliography.bib"
KEYS = "|".join(re.findall(r"@\w+\{(\w+),", BIBLIOGRAPHY.read_text(encoding="utf-8")))
MARK = "<!-- bibliography -->"
ACCENTS = {'"': "\u0308", "'": "\u0301", "`": "\u0300", "^": "\u0302", "~": "\u0303", "c": "\u0327"}


def on_page_markdown(markdown: str, *, page: Any, **told: Any) -> str:
    """Link the keys of papers, but not in blocks of code, and put the entries where the page has its mark."""
    del told
    parts = re.split(r"(^```.*?^```)", markdown, flags=re.DOTALL | re.MULTILINE)
    up = "../" * page.file.src_uri.count("/")
    linked = "".join(part if part.startswith("```") else with_links(part, f"{up}bibliography.md") for part in parts)
    return linked.replace(MARK, entries_as_markdown(BIBLIOGRAPHY.read_text(encoding="utf-8")))


def with_links(text: str, target: str) -> str:
    """The keys of papers in a text as links to their entries."""
    return re.sub(rf"\[({KEYS})\](?![(\]])", rf"[[\1]]({target}#\1)", text)


def entries_as_markdown(source: str) -> str:
    """One paragraph an entry, by the name of its first author; its key is its anchor."""
    entries = [(key, fields_of(body)) for key, body in re.findall(r"@\w+\{(\w+),(.*?)\n\}", source, flags=re.DOTALL)]
    return "\n\n".join(_paragraph(key, fields) for key, fields in sorted(entries, key=lambda one: one[1]["author"]))


def fields_of(body: str) -> dict[str, str]:
    """Fields of an entry as plain text."""
    value = r"\{((?:[^{}]|\{(?:[^{}]|\{[^{}]*\})*\})*)\}"
    return {name: plain(text) for name, text in re.findall(rf"(\w+)\s*=\s*{value}", body)}


def plain(text: str) -> str:
    """A value without braces, its accents and signs as they are printed."""
    accented = re.sub(r"\\([\"'`^~c])\{?(\w)\}?", lambda found: found[2] + ACCENTS[found[1]], text)
    return unicodedata.normalize("NFC", re.sub(r"\s+", " ", re.sub(r"[{}]", "", accented.replace(r"\&", "&"))))


def _paragraph(key: str, fields: dict[str, str]) -> str:
    authors = "; ".join(name.strip() for name in re.split(r"\s+and\s+", fields["author"]))
    places = ("journal", "booktitle", "publisher", "school", "note", "year")
    told = [authors, f"*{fields['title']}*", *(fields[place] for place in places if place in fields)]
    return f'<a id="{key}"></a>**[{key}]** ' + ". ".join(part.removesuffix(".") for part in told) + "."

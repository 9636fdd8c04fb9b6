"""Tables of the benchmarks: Markdown, printed row by row as the rows are measured, and read again for the plots."""

import platform
import re
from collections.abc import Mapping
from importlib.metadata import version

__all__ = ["Table", "machine", "tables_in"]

WIDTH = re.compile(r"\D*(\d+)")


def machine(*packages: str) -> str:
    """One line on what the figures below were measured on: the machine, Python, and the packages beside ours."""
    others = "".join(f", {package} {version(package)}" for package in packages)
    return f"{platform.machine()}, Python {platform.python_version()}, numpy {version('numpy')}{others}"


class Table:
    """Prints its head at once, and every row when it is known.

    columns  title and format of every column, as `{"method": "22", "seconds": "8.2f"}`; a format without a type is text
    """

    def __init__(self, columns: Mapping[str, str]) -> None:
        self._formats = list(columns.values())
        self._widths = [max(len(title), _width(form)) for title, form in columns.items()]
        self._left = [form[-1].isdigit() for form in self._formats]
        self._print(list(columns))
        rules = ["-" * width if left else "-" * (width - 1) + ":" for left, width in zip(self._left, self._widths)]
        self._print(rules)

    def row(self, *values: object) -> None:
        """A row; a value of None stays empty, a text in a column of numbers stands as it is, and what is left out at
        the end is empty.
        """
        cells = [_cell(value, form) for value, form in zip(values, self._formats)]
        self._print(cells + [""] * (len(self._formats) - len(cells)))

    def _print(self, cells: list[str]) -> None:
        padded = [c.ljust(w) if left else c.rjust(w) for c, w, left in zip(cells, self._widths, self._left)]
        print(f"| {' | '.join(padded)} |", flush=True)


def _width(form: str) -> int:
    found = WIDTH.match(form)
    return 0 if found is None else int(found[1])


def _cell(value: object, form: str) -> str:
    if value is None:
        return ""
    return str(value) if isinstance(value, str) or form[-1].isdigit() else format(value, form).strip()


def tables_in(text: str) -> list[list[dict[str, str]]]:
    """The tables in a Markdown text, each as its rows by the titles of its columns."""
    found: list[list[dict[str, str]]] = []
    titles: list[str] = []
    for line in text.splitlines():
        if not line.startswith("|"):
            titles = []
            continue
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
        if not titles:
            titles = cells
            found.append([])
        elif not set("".join(cells)) <= set("-: "):
            found[-1].append(dict(zip(titles, cells)))
    return found

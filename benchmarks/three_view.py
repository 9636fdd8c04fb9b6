"""Three views to solids: how fast, and how many.

python benchmarks/three_view.py

Drawings: plates with pockets and bosses, drawn by the package's own hidden line removal, and the real ones where they
lie beside the checkout. Processor seconds, after the compiled loops were warmed up: to the first solid, and to all that
are listed, counted.
"""

import os
from collections.abc import Iterator
from pathlib import Path

from drawn_parts import plate
from recon.errors import ReconError
from recon.geometry.views import ThreeViews
from recon.readers.views import read_views
from recon.three_view.hidden_lines import draw
from recon.three_view.pipeline import ViewsOptions, interpret
from tables import Table, machine

DRAWINGS = Path(__file__).parents[2] / "shared" / "data" / "views" / "drawings"


COLUMNS = {
    "drawing": "24",
    "lines": "6,d",
    "fragments": "9,d",
    "cells": "5,d",
    "solids": "14",
    "faces": "6,d",
    "bodies": "6",
    "first, s": "8.2f",
    "all, s": "8.2f",
}


def cases() -> Iterator[tuple[str, ThreeViews]]:
    for n in (2, 4, 5, 9, 14, 25):
        solid = plate(n, n)
        yield f"plate of {len(solid.faces)} faces", draw(solid)
    for path in sorted(DRAWINGS.glob("*.dxf")):
        yield path.stem, read_views(path).drawing


def seconds() -> float:
    """Processor time so far, that of the counter's process included."""
    return sum(os.times()[:4])


def main() -> None:
    interpret(draw(plate(1, 1)))
    print(f"{machine('python-sat', 'pyganak')}; processor time\n")
    table = Table(COLUMNS)
    for name, drawing in cases():
        start = seconds()
        try:
            interpret(drawing, ViewsOptions(limit=1, seconds=0.0)).polyhedron(0)
            first = seconds()
            found = interpret(drawing)
        except ReconError as refusal:
            table.row(name, None, None, None, f"refused: {refusal}")
            continue
        solid = found.polyhedron(0)
        made = found.arrangement
        lines = sum(view.n_segments for _, view in drawing)
        count = f"{found.count:,}" if found.exact else f"over {found.count:,}"
        sizes = lines, len(made.fragments.plane), made.cells.n_cells, count, len(solid.faces), len(solid.bodies)
        table.row(name, *sizes, first - start, seconds() - first)


if __name__ == "__main__":
    main()

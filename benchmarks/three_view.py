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

DRAWINGS = Path(__file__).parents[2] / "shared" / "data" / "views" / "drawings"


def cases() -> Iterator[tuple[str, ThreeViews]]:
    for n in (2, 4, 9, 14, 25):
        solid = plate(n, n)
        yield f"plate of {len(solid.faces)} faces", draw(solid)
    for path in sorted(DRAWINGS.glob("*.dxf")):
        yield path.stem, read_views(path).drawing


def seconds() -> float:
    """Processor time so far, that of the counter's process included."""
    return sum(os.times()[:4])


def main() -> None:
    interpret(draw(plate(1, 1)))
    print(f"{'drawing':24}{'lines':>7}{'fragments':>11}{'cells':>7}{'solids':>9}{'faces':>7}{'first':>8}{'all':>8}")
    for name, drawing in cases():
        start = seconds()
        try:
            interpret(drawing, ViewsOptions(limit=1, seconds=0.0)).polyhedron(0)
            first = seconds()
            found = interpret(drawing)
        except ReconError as refusal:
            print(f"{name:24} refused: {refusal}")
            continue
        solid = found.polyhedron(0)
        made = found.arrangement
        lines = sum(view.n_segments for _, view in drawing)
        count = f"{found.count}{'' if found.exact else '+'}"
        sizes = f"{lines:7}{len(made.fragments.plane):11}{made.cells.n_cells:7}{count:>9}{len(solid.faces):7}"
        print(f"{name:24}{sizes}{first - start:8.2f}{seconds() - first:8.2f}", flush=True)


if __name__ == "__main__":
    main()

"""A page on what a drawing can mean: the drawing, and beside it each solid, drawn from a corner; choices to toggle.

The page holds all it needs. Solids are line drawings, hidden lines thin, made by the same hidden line removal that
proves them.
"""

from collections.abc import Iterable, Sequence
from html import escape
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recon.geometry.polyhedron import Polyhedron
from recon.geometry.views import DrawnView
from recon.three_view.hidden_lines import draw
from recon.three_view.pipeline import Interpretation

__all__ = ["write_report"]

Floats = NDArray[np.float64]

SHOWN = 60  # solids on a page
AROUND, OVER = np.radians(-35.0), np.radians(25.0)  # the corner from which solids are seen
PAGE = """<!doctype html><html lang="en"><meta charset="utf-8"><title>{title}</title>
<style>body{{font:15px sans-serif;margin:2em}} figure{{display:inline-block;margin:.5em;text-align:center}}
svg{{width:230px;height:230px}} path{{fill:none;stroke:#000;stroke-width:1.5;vector-effect:non-scaling-stroke}}
path.h{{stroke-width:.8;stroke-dasharray:4 3;opacity:.6}} select{{font:inherit}}</style>
<h1>{title}</h1><p>{count}</p><div>{views}</div>{choices}<div id="solids">{solids}</div>
<script>
const boxes=[...document.querySelectorAll("select")];
boxes.forEach(b=>b.onchange=()=>document.querySelectorAll("#solids figure").forEach(f=>{{
 const p=f.dataset.picks.split(" ");f.hidden=boxes.some((b,k)=>b.value!=="any"&&b.value!==p[k])}}));
</script></html>
"""


def write_report(path: Path, found: Interpretation, solids: Iterable[Polyhedron], *, name: str) -> None:
    """Write the page.

    solids  those of the drawing, the most plausible first; of many only these are shown
    """
    views = "".join(_figure(_svg(view), projection.name) for projection, view in found.drawing)
    figures = []
    for number, solid in enumerate(islice(solids, SHOWN)):
        figure = _figure(_svg(_from_corner(solid)), f"solid {number + 1}")
        picks = " ".join(str(pick + 1) for pick in found.labelings.picks(number))
        figures.append(figure.replace("<figure>", f'<figure data-picks="{picks}">'))
    more = "" if found.exact else "at least "
    count = f"The drawing can mean {more}{found.count} solids; {len(figures)} are shown."
    page = PAGE.format(title=escape(name), count=count, views=views, choices=_choices(found), solids="".join(figures))
    path.write_text(page, encoding="utf-8")


def _choices(found: Interpretation) -> str:
    """One box a free choice, to show only the solids of one of its options."""
    boxes = []
    for number, choice in enumerate(found.labelings.choices, start=1):
        options = "".join(f"<option>{k + 1}</option>" for k in range(min(len(choice.options), SHOWN)))
        boxes.append(f"choice {number} of {choice.count}: <select><option>any</option>{options}</select> ")
    return f"<p>{''.join(boxes)}</p>"


def _figure(drawing: str, caption: str) -> str:
    return f"<figure>{drawing}<figcaption>{escape(caption)}</figcaption></figure>"


def _from_corner(solid: Polyhedron) -> DrawnView:
    """The solid turned so that its front view shows it from a corner."""
    a, b = (np.array([[np.cos(t), -np.sin(t)], [np.sin(t), np.cos(t)]]) for t in (AROUND, OVER))
    turn, tilt = np.eye(3), np.eye(3)
    turn[:2, :2], tilt[1:, 1:] = a, b
    turned = solid.vertices @ turn.T @ tilt.T
    return draw(Polyhedron(turned, solid.faces, solid.bodies)).front


def _svg(view: DrawnView) -> str:
    points = view.segments.reshape(-1, 2)
    low, size = points.min(axis=0), float(np.ptp(points, axis=0).max())
    margin = 0.04 * size
    middle = (np.ptp(points, axis=0) - size) / 2
    corner = low + middle - margin
    box = f"{corner[0]:.6g} {-(corner[1] + size + 2 * margin):.6g} {size + 2 * margin:.6g} {size + 2 * margin:.6g}"
    lines = (_path(view.segments[view.hidden == hidden], hidden) for hidden in (True, False))
    return f'<svg viewBox="{box}">{"".join(lines)}</svg>'


def _path(segments: Sequence[Floats] | Floats, hidden: bool) -> str:
    steps = "".join(f"M{a:.6g} {-b:.6g}L{c:.6g} {-d:.6g}" for (a, b), (c, d) in segments)
    return f'<path class="{"h" if hidden else "v"}" d="{steps}"/>' if steps else ""

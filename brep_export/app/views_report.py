"""The section of a page on what a drawing can mean: the drawing, and each solid from a corner; choices to toggle.

Solids are line drawings, hidden lines thin, made by the same hidden line removal that proves them; a click on one shows
it in the page's view.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from html import escape

import numpy as np
from numpy.typing import NDArray

from brep_export.app.scene import ScenePart, kernel_parts, line_part
from brep_export.solids import polyhedron_solid
from recon.geometry.polyhedron import Polyhedron
from recon.geometry.views import DrawnView, ThreeViews
from recon.three_view.hidden_lines import draw_front
from recon.three_view.pipeline import Interpretation

__all__ = ["gallery", "n_shown", "scene_parts", "solid_name"]

Floats = NDArray[np.float64]

SHOWN = 60  # solids on a page, fewer
MOST_FACES = 4000  # where they have many faces, but
LEAST_SHOWN = 4
AROUND, OVER = np.radians(-35.0), np.radians(25.0)  # the corner from which solids are seen
SECTION = """<section class="gallery"><h2>What the drawing can mean</h2><p>{count}</p><div>{views}</div>{choices}
<div id="solids">{solids}</div></section>
<script>
const boxes=[...document.querySelectorAll(".gallery select")];
boxes.forEach(b=>b.onchange=()=>document.querySelectorAll("#solids figure").forEach(f=>{{
 const p=f.dataset.picks.split(" ");f.hidden=boxes.some((b,k)=>b.value!=="any"&&b.value!==p[k])}}));
</script>
"""


def n_shown(found: Interpretation) -> int:
    """How many solids a page shows."""
    fit = MOST_FACES // len(found.polyhedron(0).faces)
    return min(max(LEAST_SHOWN, min(SHOWN, fit)), found.labelings.listed)


def gallery(found: Interpretation, solids: Mapping[int, Polyhedron]) -> str:
    """The section as HTML.

    solids  those to be shown, by their numbers from 0
    """
    views = "".join(_figure(_svg(view), projection.name) for projection, view in found.drawing)
    figures = []
    for number, solid in solids.items():
        picks = " ".join(str(pick + 1) for pick in found.labelings.picks(number))
        name = solid_name(number)
        data = f' data-picks="{picks}" data-part="{name}"'
        figures.append(_figure(_svg(_from_corner(solid)), name).replace("<figure", f"<figure{data}", 1))
    more = "" if found.exact else "at least "
    count = f"The drawing can mean {more}{found.count} solids; {len(figures)} are shown. A click shows one above."
    if found.count == 1 and found.exact:
        count = "The drawing can mean one solid alone."
    return SECTION.format(count=count, views=views, choices=_choices(found, solids), solids="".join(figures))


def solid_name(number: int) -> str:
    """What the page calls a solid, by its number from 0."""
    return f"solid {number + 1}"


def scene_parts(
    drawing: ThreeViews, solids: Mapping[int, Polyhedron], chosen: int, *, mirrored: bool = False
) -> list[ScenePart]:
    """What the page's view holds: the solids, the chosen one seen first, and each view in the plane it was seen in.

    mirrored  whether the solids are mirror images of what was drawn
    """
    from brep_export.app.pictures import MADE

    parts = _drawn_views(drawing, mirrored=mirrored)
    for number, solid in solids.items():
        deflection = 1e-3 * drawing.extent()
        made = kernel_parts(solid_name(number), polyhedron_solid(solid), deflection, colour=MADE)
        parts += [replace(part, shown=number == chosen) for part in made]
    return parts


def _drawn_views(drawing: ThreeViews, *, mirrored: bool) -> list[ScenePart]:
    """Each view in space, on the side from which it is seen, an eighth of the size away."""
    (low_x, _), (high_x, high_z) = _corners(drawing.front)
    low_y, away = _corners(drawing.top)[0][1], drawing.extent() / 8
    depth = {"front": low_y - away, "top": high_z + away, "side": high_x + away}
    parts = []
    for projection, view in drawing:
        lines = np.empty((view.n_segments, 2, 3))
        lines[..., projection.axes] = view.segments
        lines[..., projection.depth] = depth[projection.name]
        if mirrored:
            lines[..., 0] = low_x + high_x - lines[..., 0]
        for hidden, colour in ((False, "#111111"), (True, "#9aa3b0")):
            name = f"{projection.name} view{', hidden lines' if hidden else ''}"
            parts.append(line_part(name, list(lines[view.hidden == hidden]), colour))
    return parts


def _corners(view: DrawnView) -> tuple[Floats, Floats]:
    points = view.segments.reshape(-1, 2)
    return points.min(axis=0), points.max(axis=0)


def _choices(found: Interpretation, shown: Iterable[int]) -> str:
    """One box a free choice, to show only the solids of one of its options."""
    boxes = []
    picks = zip(*(found.labelings.picks(number) for number in shown))
    for number, (choice, picked) in enumerate(zip(found.labelings.choices, picks), start=1):
        options = "".join(f"<option>{pick + 1}</option>" for pick in sorted(set(picked)))
        more = "" if choice.exact else "at least "
        select = f"<select><option>any</option>{options}</select>"
        boxes.append(f"choice {number}, of {more}{choice.count} options: {select} ")
    return f"<p>{''.join(boxes)}</p>" if boxes else ""


def _figure(drawing: str, caption: str) -> str:
    return f"<figure>{drawing}<figcaption>{escape(caption)}</figcaption></figure>"


def _from_corner(solid: Polyhedron) -> DrawnView:
    """The solid turned so that its front view shows it from a corner."""
    a, b = (np.array([[np.cos(t), -np.sin(t)], [np.sin(t), np.cos(t)]]) for t in (AROUND, OVER))
    turn, tilt = np.eye(3), np.eye(3)
    turn[:2, :2], tilt[1:, 1:] = a, b
    turned = solid.vertices @ turn.T @ tilt.T
    return draw_front(Polyhedron(turned, solid.faces, solid.bodies))


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

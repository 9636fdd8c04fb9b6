"""From the strokes of a sheet to three views: separated, scaled to each other, moved to one origin.

    third angle,           first angle,             first angle,             third angle,
    side from the right    side from the right      side from the left       side from the left
      +-----+                +----+ +-------+         +-------+ +----+                +-----+
      | top |                |side| | front |         | front | |side|                | top |
      +-----+                +----+ +-------+         +-------+ +----+                +-----+
      +-----+ +----+                +-------+         +-------+                +----+ +-----+
      |front| |side|                |  top  |         |  top  |                |side| |front|
      +-----+ +----+                +-------+         +-------+                +----+ +-----+

The empty quarter of the sheet tells which of the four it is. Where the side view looks from the left, the sheet is read
as that of the part's mirror image, whose side view looks from the right.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from recon.errors import UnreadableFile
from recon.geometry.views import DrawnView, ThreeViews

__all__ = ["Layout", "Strokes", "ViewSheet", "separate_views"]

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Ints = NDArray[np.int64]

TOUCH = 1e-4  # of the sheet's size: strokes that come so near belong to one figure
SLIT = 1e-3  # of the sheet's size: views stand further apart
NEAR = 1e-3  # of a view's size: what is nearer in another view is the same, once both stand at the lowest place
STANDARD = 1  # oddity of scales that draughtsmen use, whose ratios are
RATIOS = (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 10.0, 20.0, 25.0, 50.0, 100.0)
MOST_VIEWS = 6  # figures among which the three views are sought: there may be pictorial ones, details, tables
MISFIT = 0.02  # of the drawing's size: widths and heights that two views share may differ by this, once scaled


@dataclass(frozen=True)
class Layout:
    """Where the views stand: the quarter of the sheet, (right, up) as 0 or 1, of each view."""

    name: str
    front: tuple[int, int]
    top: tuple[int, int]
    side: tuple[int, int]
    mirrored: bool


LAYOUTS = (
    Layout("third angle, side view from the right", (0, 0), (0, 1), (1, 0), False),
    Layout("first angle, side view from the right", (1, 1), (1, 0), (0, 1), False),
    Layout("first angle, side view from the left", (0, 1), (0, 0), (1, 1), True),
    Layout("third angle, side view from the left", (1, 0), (1, 1), (0, 0), True),
)


@dataclass(frozen=True, eq=False)
class Strokes:
    """Straight lines of a sheet.

    segments  (n, 2, 2)
    hidden    (n,) dashed
    """

    segments: Floats
    hidden: Flags

    def chosen(self, rows: Flags | Ints) -> "Strokes":
        return Strokes(self.segments[rows], self.hidden[rows])


@dataclass(frozen=True, eq=False)
class ViewSheet:
    """A drawing as read from a sheet.

    drawing    the three views, of the part or of its mirror image
    mirrored   whether x runs to the left: the part is the mirror image of what the views show
    notes      how the views stand, their scales, and what was set aside
    """

    drawing: ThreeViews
    mirrored: bool = False
    notes: tuple[str, ...] = ()

    def with_notes(self, aside: Counter[str]) -> "ViewSheet":
        """The same, and a note on what was set aside: how many of what."""
        told = ["set aside: " + ", ".join(f"{n} {kind}" for kind, n in sorted(aside.items()))] if aside else []
        return replace(self, notes=(*self.notes, *told))


def separate_views(strokes: Strokes, name: str) -> ViewSheet:
    """The three views of a sheet.

    Promises  the views share one origin and the front view's scale.
    Raises    UnreadableFile when the strokes do not fall into three views that share their widths and heights.
    """
    if not len(strokes.segments):
        raise UnreadableFile(name, "holds no lines of a drawing", "Three views in straight lines are needed")
    strokes, notes = _without_frame(strokes)
    best = min(_all_fits(strokes), key=_merit, default=None)
    if best is None or _oddity(best) > STANDARD:
        for rest in _without_margin(strokes):
            fit = min(_all_fits(rest), key=_merit, default=None)
            if fit is not None and (best is None or _oddity(fit) < _oddity(best)):
                best = fit
        if best is not None and (left := len(strokes.segments) - sum(len(view.segments) for view in best[2])):
            notes.append(f"set aside {left} lines beside the views")
    if best is None:
        raise UnreadableFile(
            name,
            "its lines do not fall into front, top and side views",
            "The top view stands above or below the front view, the side view beside it, with gaps between them",
        )
    misfit, layout, views, scales = best
    if misfit > MISFIT:
        raise UnreadableFile(
            name,
            f"the three views do not share their widths and heights (they are off by {100 * misfit:.2g} %)",
            "Draw all three at one scale, or each at its own with its full width and height",
        )
    notes.append(layout.name)
    if any(abs(scale - 1) > 0.005 for scale in scales):
        notes.append(
            "the top view is drawn at {:.4g} and the side view at {:.4g} of the front view's scale".format(
                *(1 / scale for scale in scales)
            )
        )
    return ViewSheet(_aligned(views, scales, layout.mirrored), layout.mirrored, tuple(notes))


def _boxes(segments: Floats) -> Floats:
    return np.concatenate([segments.min(axis=1), segments.max(axis=1)], axis=1)


def _without_frame(strokes: Strokes) -> tuple[Strokes, list[str]]:
    """The strokes but for figures that surround all others."""
    notes: list[str] = []
    while True:
        figure = _figures(strokes.segments)
        count = int(figure.max()) + 1
        if count < 4:
            return strokes, notes
        boxes = np.array([_box(strokes.segments[figure == k]) for k in range(count)])
        around = int(np.argmax((boxes[:, 2:] - boxes[:, :2]).prod(axis=1)))
        others = np.arange(count) != around
        inside = (boxes[others, :2] > boxes[around, :2]).all(axis=1) & (boxes[others, 2:] < boxes[around, 2:]).all(
            axis=1
        )
        if not inside.all():
            return strokes, notes
        notes.append(f"set aside a frame of {int((figure == around).sum())} lines")
        strokes = strokes.chosen(figure != around)


def _box(segments: Floats) -> Floats:
    points = segments.reshape(-1, 2)
    return np.concatenate([points.min(axis=0), points.max(axis=0)])


def _figures(segments: Floats) -> Ints:
    """(n,) number of the figure that each stroke belongs to: strokes that touch make a figure."""
    import shapely
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    lines = shapely.linestrings(segments)
    reach = TOUCH * float(np.ptp(segments.reshape(-1, 2), axis=0).max())
    a, b = shapely.STRtree(lines).query(lines, predicate="dwithin", distance=reach)
    graph = coo_array((np.ones(len(a)), (a, b)), shape=(len(lines), len(lines)))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def _gaps(low: Floats, high: Floats) -> list[float]:
    """Middles of the gaps that no interval covers; lines that should meet in a view may leave a slit."""
    order = np.argsort(low)
    reach = np.maximum.accumulate(high[order])
    open_after = np.flatnonzero(low[order][1:] - reach[:-1] > SLIT * (reach[-1] - low.min()))
    return [float((low[order][k + 1] + reach[k]) / 2) for k in open_after]


Fit = tuple[float, Layout, tuple[Strokes, Strokes, Strokes], tuple[float, float]]


def _merit(fit: Fit) -> tuple[int, float]:
    """Less is better: views at one scale before views at several, which would fit many a wrong cut of the sheet."""
    return _oddity(fit), fit[0]


def _oddity(fit: Fit) -> int:
    """0 for views at one scale, STANDARD for scales that draughtsmen use, 2 for others, 3 where they do not fit."""
    misfit, _, _, scales = fit
    if misfit > MISFIT:
        return 3
    if scales == (1.0, 1.0):
        return 0
    ratios = np.maximum(scales, 1 / np.array(scales))
    return STANDARD if all(np.abs(ratio / np.array(RATIOS) - 1).min() < 0.005 for ratio in ratios) else 2


def _all_fits(strokes: Strokes) -> list[Fit]:
    return [fit for layout in LAYOUTS for fit in _fits(strokes, layout)]


def _without_margin(strokes: Strokes) -> Iterator[Strokes]:
    """The strokes without one figure, or without all on one side of a gap: there a title block or a table may stand; or
    three of the largest figures with all that lies within them. Those that set aside little come first.
    """
    box = _boxes(strokes.segments)
    figure = _figures(strokes.segments)
    margins = [figure == k for k in range(int(figure.max()) + 1)]
    for axis in (0, 1):
        for gap in _gaps(box[:, axis], box[:, axis + 2]):
            margins += [box[:, axis] > gap, box[:, axis] < gap]
    margins = [margin for margin in margins if margin.sum() < len(box) / 2]
    outlines = np.array([_box(strokes.segments[figure == k]) for k in range(int(figure.max()) + 1)])
    largest = outlines[np.argsort(-(outlines[:, 2:] - outlines[:, :2]).prod(axis=1))[:MOST_VIEWS]]
    reach = np.concatenate([box[:, None, :2] - largest[:, :2], largest[:, 2:] - box[:, None, 2:]], axis=2)
    inside: Flags = np.min(reach, axis=2) >= 0
    margins += [~inside[:, list(three)].any(axis=1) for three in combinations(range(len(largest)), 3)]
    for margin in sorted(margins, key=lambda rows: int(rows.sum())):
        if margin.any():
            yield strokes.chosen(~margin)


def _fits(strokes: Strokes, layout: Layout) -> list[Fit]:
    """Every way to cut the sheet into views as the layout wants it, with the misfit of the shared lengths."""
    box = _boxes(strokes.segments)
    return [_fit(layout, (strokes.chosen(f), strokes.chosen(t), strokes.chosen(s))) for f, t, s in _cuts(box, layout)]


def _cuts(box: Floats, layout: Layout) -> Iterator[tuple[Flags, Flags, Flags]]:
    """Rows of the front, top and side view: one of the two others is cut off from edge to edge, then the front view.

    A view at a scale of its own may reach over the gap between the others; its middle tells where it stands.
    """
    for along, alone in ((1, layout.top), (0, layout.side)):
        across = 1 - along
        for first in _gaps(box[:, along], box[:, along + 2]):
            together = (box[:, along] > first) == layout.front[along]
            rest = box[~together]
            middle = (rest[:, across].min() + rest[:, across + 2].max()) / 2
            for second in _gaps(box[together, across], box[together, across + 2]):
                front = together & ((box[:, across] > second) == layout.front[across])
                if (middle > second) == alone[across]:
                    yield (front, ~together, together & ~front) if along else (front, together & ~front, ~together)


def _fit(layout: Layout, views: tuple[Strokes, Strokes, Strokes]) -> Fit:
    (width, height), (top_width, depth), (side_depth, side_height) = (
        np.ptp(view.segments.reshape(-1, 2), axis=0).tolist() for view in views
    )
    if min(width, height, top_width, side_height) <= 0:
        return np.inf, layout, views, (1.0, 1.0)
    size = max(width, height, depth)
    plain = max(abs(width - top_width), abs(height - side_height), abs(depth - side_depth)) / size
    scales = width / top_width, height / side_height
    scaled = abs(depth * scales[0] - side_depth * scales[1]) / size
    return (plain, layout, views, (1.0, 1.0)) if plain <= 0.005 else (scaled, layout, views, scales)


def _aligned(views: Sequence[Strokes], scales: tuple[float, float], mirrored: bool) -> ThreeViews:
    placed = [
        (view.segments - view.segments.reshape(-1, 2).min(axis=0)) * scale for view, scale in zip(views, (1.0, *scales))
    ]
    if mirrored:
        placed = [segments * [-1, 1] + [segments[:, :, 0].max(), 0.0] for segments in placed]
    front, top, side = placed
    top = top + np.array([_off(top[:, :, 0], front[:, :, 0]), 0.0])
    side = side + np.array([_off(side[:, :, 0], top[:, :, 1]), _off(side[:, :, 1], front[:, :, 1])])
    return ThreeViews(*(DrawnView(made, view.hidden) for made, view in zip((front, top, side), views)))


def _off(values: Floats, others: Floats) -> float:
    """How far values lie below the same ones in another view: the lowest ones tell, but each may be off a little."""
    ordered = np.sort(others, axis=None)
    flat = values.ravel()
    slot = np.clip(np.searchsorted(ordered, flat), 1, len(ordered) - 1)
    below, above = ordered[slot - 1], ordered[slot]
    away = np.where(flat - below < above - flat, below, above) - flat
    near = away[np.abs(away) <= NEAR * np.ptp(ordered)]
    return float(np.median(near)) if len(near) else 0.0

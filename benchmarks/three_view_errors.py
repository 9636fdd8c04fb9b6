"""Three views with errors in them: jitter, one wrong line, and drawings damaged beyond sense.

python benchmarks/three_view_errors.py [row] [first] [last]      row: one of the kinds of parts, sheets, or damaged

jitter     every coordinate is off by up to 0.01 mm: how many drawings still mean the part they were made from; of five
           parts for each one with wrong lines
one line   deleted, shifted, moved at one end, or in the wrong line type: how often the culprit is among the first three
           repairs, of the drawings that such a change leaves without a solid
sheets     jitter again, with all three views on one sheet that is parted first
damaged    random lines, and drawings with many errors: no exception but a refusal, and no solid that is none
"""

import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from itertools import pairwise

import numpy as np

from drawn_parts import KINDS, changed, part, solid_volume
from recon.errors import ReconError
from recon.geometry.polyhedron import Polyhedron
from recon.geometry.views import DrawnView, ThreeViews
from recon.readers.view_sheet import Strokes, separate_views
from recon.three_view.hidden_lines import draw
from recon.three_view.pipeline import ViewsOptions, all_polyhedra, diagnose, interpret
from recon.three_view.repairs import Change, Repair

JITTER = 0.01  # mm
GAP = 25.0  # between views on a sheet
PARTS = 40  # of a kind
DAMAGED = 2000
FEW = ViewsOptions(limit=300, seconds=0)

Rng = np.random.Generator


def still_solved(kind: str, seed: int, spread: Callable[[ThreeViews, Rng], ThreeViews]) -> bool:
    """Whether the jittered drawing of a part means a solid of its volume that draws as given."""
    solid = part(kind, seed)
    try:
        found = interpret(spread(draw(solid), np.random.default_rng(seed)), FEW)
    except ReconError:
        return False
    volume = solid_volume(solid)
    alike = (made for made in found.polyhedra() if abs(solid_volume(made) - volume) < 1e-2 * volume)
    return any(not found.differences(made) for made in alike)


def shaken(drawing: ThreeViews, rng: Rng) -> ThreeViews:
    return changed(drawing, lambda s: s + rng.uniform(-JITTER, JITTER, s.shape))


def shaken_on_a_sheet(drawing: ThreeViews, rng: Rng) -> ThreeViews:
    """Third angle; what is read from the sheet again. Raises UnreadableFile when the views cannot be told apart."""
    front, top, side = (
        view.segments - view.segments.reshape(-1, 2).min(axis=0) for view in (drawing.front, drawing.top, drawing.side)
    )
    right, up = front.reshape(-1, 2).max(axis=0) + GAP
    lines = np.concatenate([front, top + np.array([0.0, up]), side + np.array([right, 0.0])])
    hidden = np.concatenate([view.hidden for _, view in drawing])
    return separate_views(Strokes(lines + rng.uniform(-JITTER, JITTER, lines.shape), hidden), "sheet").drawing


def deleted(segments: np.ndarray, hidden: np.ndarray, i: int, rng: Rng) -> tuple[np.ndarray, np.ndarray]:
    return np.delete(segments, i, axis=0), np.delete(hidden, i)


def shifted(segments: np.ndarray, hidden: np.ndarray, i: int, rng: Rng) -> tuple[np.ndarray, np.ndarray]:
    moved = segments.copy()
    moved[i] += _across(segments[i], rng)
    return moved, hidden


def end_moved(segments: np.ndarray, hidden: np.ndarray, i: int, rng: Rng) -> tuple[np.ndarray, np.ndarray]:
    moved = segments.copy()
    moved[i, 1] += _across(segments[i], rng)
    return moved, hidden


def retyped(segments: np.ndarray, hidden: np.ndarray, i: int, rng: Rng) -> tuple[np.ndarray, np.ndarray]:
    return segments, hidden ^ (np.arange(len(hidden)) == i)


def _across(ends: np.ndarray, rng: Rng) -> np.ndarray:
    """A step of 0.3 to 2 mm across a line."""
    way = ends[1] - ends[0]
    return np.array([-way[1], way[0]]) / np.linalg.norm(way) * rng.choice([-1, 1]) * rng.uniform(0.3, 2.0)


ERRORS: dict[str, Callable[..., tuple[np.ndarray, np.ndarray]]] = {
    "deleted": deleted,
    "shifted": shifted,
    "one end moved": end_moved,
    "wrong line type": retyped,
}


def wrong_drawings(kind: str, seed: int, error: str) -> Iterator[tuple[ThreeViews, Callable[[Repair], bool]]]:
    """Drawings with one error, left without a solid by it, and what tells the repair of just that error."""
    drawing = draw(part(kind, seed, 4))
    rng = np.random.default_rng(seed)
    for _ in range(2):
        views = [view for _, view in drawing]
        k = int(rng.integers(3))
        i = int(rng.integers(views[k].n_segments))
        right = views[k].segments[i]
        views[k] = DrawnView(*ERRORS[error](views[k].segments, views[k].hidden, i, rng))
        wrong = ThreeViews(*views)
        if not _has_solid(wrong):
            yield wrong, lambda repair, k=k, i=i, right=right: _is_culprit(repair, error, k, i, right)


def _has_solid(drawing: ThreeViews) -> bool:
    try:
        interpret(drawing, ViewsOptions(limit=1, seconds=0))
    except ReconError:
        return False
    return True


def _is_culprit(repair: Repair, error: str, view: int, line: int, right: np.ndarray) -> bool:
    if repair.view != view:
        return False
    if error == "deleted":
        return repair.change is Change.ADDED and any(
            min(np.abs(np.array(s.ends) - ends).max() for ends in (right, right[::-1])) < 0.01 for s in repair.strokes
        )
    if error == "wrong line type" and repair.change is not Change.RETYPED:
        return False
    return repair.line is not None and repair.line.segment == line


def damaged(seed: int) -> ThreeViews:
    """Random lines on a coarse grid, or the drawing of a part with many lines lost, moved and retyped."""
    rng = np.random.default_rng(seed)
    if seed % 2:
        return ThreeViews(*(_random_view(rng) for _ in range(3)))
    drawing = draw(part(sorted(KINDS)[seed % 3], seed // 2 % 40, 3))
    return ThreeViews(*(_damaged_view(view, rng) for _, view in drawing))


def _random_view(rng: Rng) -> DrawnView:
    """A square with random lines on a grid of half its width, or lines without a square."""
    box = np.array([[[0, 0], [20, 0]], [[20, 0], [20, 20]], [[20, 20], [0, 20]], [[0, 20], [0, 0]]], dtype=float)
    lines = rng.integers(0, 3, (int(rng.integers(0, 5)), 2, 2)) * 10.0
    if rng.random() < 0.2 and len(lines):
        return DrawnView(lines, rng.random(len(lines)) < 0.3)
    hidden = rng.random(len(lines)) < 0.3
    return DrawnView(np.concatenate([box, lines]), np.concatenate([np.zeros(4, dtype=bool), hidden]))


def _damaged_view(view: DrawnView, rng: Rng) -> DrawnView:
    """Ends moved, lines lost, types changed: none to many of each."""
    often = rng.choice([0.0, 0.0, 0.02, 0.1])
    step = rng.choice([1e-4, 1e-2, 1.0])
    moved = view.segments + rng.normal(0, step, view.segments.shape) * (rng.random(view.segments.shape) < often)
    keep = rng.random(len(moved)) >= often
    keep[0] = True
    return DrawnView(moved[keep], view.hidden[keep] ^ (rng.random(int(keep.sum())) < often / 2))


def is_solid(solid: Polyhedron) -> bool:
    """Whether every edge is run through once each way, and the volume is positive."""
    uses = Counter(pair for face in solid.faces for loop in face.loops for pair in pairwise((*loop, loop[0])))
    return solid_volume(solid) > 0 and all(n == 1 and uses[b, a] == 1 for (a, b), n in uses.items())


def outcome_of_damage(seed: int) -> str:
    try:
        made = next(all_polyhedra(damaged(seed), FEW), None)
    except ReconError:
        return "refused"
    if made is None:
        return "no solid drawn as given"
    return "a solid" if is_solid(made) else "WRONG SOLID"


def row_of_kind(kind: str, seeds: range) -> str:
    many = range(5 * seeds.start, 5 * seeds.stop)
    row = [(sum(still_solved(kind, seed, shaken) for seed in many), len(many))]
    for error in ERRORS:
        told = [
            any(map(culprit, diagnose(wrong).repairs))
            for seed in seeds
            for wrong, culprit in wrong_drawings(kind, seed, error)
        ]
        row.append((sum(told), len(told)))
    cells = [f"{good} of {tried}" for good, tried in row]
    return f"{kind:10}{cells[0]:>14}" + "".join(f"{cell:>20}" for cell in cells[1:])


def row_of_sheets(seeds: range) -> str:
    good = [still_solved(kind, seed, shaken_on_a_sheet) for kind in KINDS for seed in seeds]
    return f"sheets    {f'{sum(good)} of {len(good)}':>14}"


def row_of_damage(seeds: range) -> str:
    outcomes = Counter(map(outcome_of_damage, seeds))
    return f"{len(seeds)} damaged drawings: " + ", ".join(f"{n} {what}" for what, n in sorted(outcomes.items()))


ROWS: dict[str, tuple[Callable[[range], str], int]] = {
    **{kind: (partial(row_of_kind, kind), PARTS) for kind in KINDS},
    "sheets": (row_of_sheets, PARTS),
    "damaged": (row_of_damage, DAMAGED),
}


def main() -> None:
    words = sys.argv[1:]
    start = time.process_time()
    print(f"{'':10}{'jitter 0.01':>14}" + "".join(f"{name:>20}" for name in ERRORS))
    for name in words[:1] or ROWS:
        row, n = ROWS[name]
        print(row(range(*map(int, words[1:3])) if len(words) > 2 else range(n)), flush=True)
    print(f"{time.process_time() - start:.0f} s")


if __name__ == "__main__":
    main()

"""Three views with errors in them: jitter, one wrong line, and drawings damaged beyond sense.

python benchmarks/three_view_errors.py [parts a kind] [damaged drawings]

jitter     every coordinate is off by up to 0.01 mm: how many drawings still mean the part they were made from
one line   deleted, shifted, moved at one end, or in the wrong line type: how often the culprit is among the first three
           repairs, of the drawings that such a change leaves without a solid
damaged    random lines, and drawings with many errors: no exception but a refusal, and no solid that is none
"""

import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from itertools import pairwise

import numpy as np

from drawn_parts import KINDS, changed, part, solid_volume
from recon.errors import ReconError
from recon.geometry.polyhedron import Polyhedron
from recon.geometry.views import DrawnView, ThreeViews
from recon.three_view.hidden_lines import draw
from recon.three_view.pipeline import ViewsOptions, all_polyhedra, diagnose, interpret
from recon.three_view.repairs import Change, Repair

JITTER = 0.01  # mm
FEW = ViewsOptions(limit=300, seconds=0)

Rng = np.random.Generator


def still_solved(kind: str, seed: int) -> bool:
    """Whether the jittered drawing of a part means a solid of its volume that draws as given."""
    solid = part(kind, seed)
    rng = np.random.default_rng(seed)
    shaken = changed(draw(solid), lambda s: s + rng.uniform(-JITTER, JITTER, s.shape))
    try:
        found = interpret(shaken, FEW)
    except ReconError:
        return False
    volume = solid_volume(solid)
    alike = (made for made in found.polyhedra() if abs(solid_volume(made) - volume) < 1e-2 * volume)
    return any(not found.differences(made) for made in alike)


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
    n = int(rng.integers(1, 14))
    box = [[[0, 0], [30, 0]], [[30, 0], [30, 30]], [[30, 30], [0, 30]], [[0, 30], [0, 0]]]
    lines = rng.integers(0, 4, (n, 2, 2)) * 10.0
    segments = np.concatenate([np.array(box, dtype=float), lines]) if rng.random() < 0.7 else lines
    return DrawnView(segments, rng.random(len(segments)) < 0.3)


def _damaged_view(view: DrawnView, rng: Rng) -> DrawnView:
    segments = view.segments + rng.normal(0, 1, view.segments.shape) * (rng.random(view.segments.shape) < 0.1)
    keep = rng.random(len(segments)) > rng.choice([0.0, 0.1, 0.3])
    keep[0] = True
    return DrawnView(segments[keep], view.hidden[keep] ^ (rng.random(int(keep.sum())) < 0.05))


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


def main() -> None:
    words = sys.argv[1:]
    parts = int(words[0]) if words else 20
    drawings = int(words[1]) if len(words) > 1 else 2000
    start = time.process_time()
    print(f"{'':10}{'jitter 0.01':>14}" + "".join(f"{name:>20}" for name in ERRORS))
    for kind in KINDS:
        row = [(sum(still_solved(kind, seed) for seed in range(parts)), parts)]
        for error in ERRORS:
            told = [
                any(map(culprit, diagnose(wrong).repairs))
                for seed in range(parts)
                for wrong, culprit in wrong_drawings(kind, seed, error)
            ]
            row.append((sum(told), len(told)))
        cells = [f"{good} of {tried}" for good, tried in row]
        print(f"{kind:10}{cells[0]:>14}" + "".join(f"{cell:>20}" for cell in cells[1:]), flush=True)
    outcomes = Counter(map(outcome_of_damage, range(drawings)))
    print(f"{drawings} damaged drawings: " + ", ".join(f"{n} {what}" for what, n in sorted(outcomes.items())))
    print(f"{time.process_time() - start:.0f} s")


if __name__ == "__main__":
    main()

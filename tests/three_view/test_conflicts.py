"""Drawings with one error: it is found, named, and mending it gives the solid back."""

import numpy as np
import pytest
from lattice_solids import PITCH, lattice_drawing

from recon.errors import NoSolid
from recon.geometry.views import DrawnView, ThreeViews
from recon.three_view.conflicts import DrawnLine
from recon.three_view.pipeline import diagnose, interpret
from recon.three_view.repairs import Change, repaired


def stepped_block(seed):
    rng = np.random.default_rng(seed)
    cubes = np.zeros((3, 3, 3), dtype=bool)
    for i, j in np.ndindex(3, 3):
        cubes[i, j, : rng.integers(1, 4)] = True
    return lattice_drawing(cubes)


def changed(drawing, view, segments, hidden):
    views = [drawn for _, drawn in drawing]
    views[view] = DrawnView(segments, hidden)
    return ThreeViews(*views)


def has_solid(drawing):
    try:
        interpret(drawing)
    except NoSolid:
        return False
    return True


@pytest.mark.parametrize("seed", range(2))
def test_every_wrong_line_type_is_found_and_named(seed):
    drawing = stepped_block(seed)
    tried = 0
    for view, (_, drawn) in enumerate(drawing):
        for segment in range(0, drawn.n_segments, 9):
            hidden = drawn.hidden.copy()
            hidden[segment] ^= True
            wrong = changed(drawing, view, drawn.segments, hidden)
            if has_solid(wrong):
                continue
            tried += 1
            found = diagnose(wrong)
            line = DrawnLine(view, segment)
            assert line in found.conflict
            assert line in [repair.line for repair in found.repairs if repair.change is Change.RETYPED]
    assert tried > 2


def test_a_shifted_line_is_moved_back_and_every_repair_mends():
    drawing = stepped_block(2)
    segments = drawing.top.segments.copy()
    row = int(np.flatnonzero((segments[:, :, 0] == PITCH).all(axis=1))[0])
    segments[row, :, 0] += 0.4
    wrong = changed(drawing, 1, segments, drawing.top.hidden)
    found = diagnose(wrong)
    assert DrawnLine(1, row) in [repair.line for repair in found.repairs]
    assert all(has_solid(repaired(wrong, repair)) for repair in found.repairs)
    assert any("should run from" in repair.described(wrong) for repair in found.repairs)


def test_a_line_that_was_deleted_is_the_one_that_is_missing():
    drawing = stepped_block(3)
    gone = drawing.side.segments[4]
    keep = np.arange(drawing.side.n_segments) != 4
    wrong = changed(drawing, 2, drawing.side.segments[keep], drawing.side.hidden[keep])
    found = diagnose(wrong)
    added = [stroke for repair in found.repairs if repair.change is Change.ADDED for stroke in repair.strokes]
    assert any(sorted(stroke.ends) == sorted(map(tuple, gone.tolist())) for stroke in added)
    assert "is missing in the side view" in " ".join(repair.described(wrong) for repair in found.repairs)


def test_an_end_that_is_off_is_told_with_its_distance():
    drawing = stepped_block(2)
    segments = drawing.top.segments.copy()
    row = int(np.flatnonzero((segments[:, :, 0] == PITCH).all(axis=1))[0])
    segments[row, 1, 0] += 0.4
    found = diagnose(changed(drawing, 1, segments, drawing.top.hidden))
    told = [repair.described(changed(drawing, 1, segments, drawing.top.hidden)) for repair in found.repairs]
    assert any("one end is off by 0.4" in text for text in told)


def test_a_conflict_is_minimal():
    drawing = stepped_block(1)
    hidden = drawing.front.hidden.copy()
    hidden[0] ^= True
    found = diagnose(changed(drawing, 0, drawing.front.segments, hidden))
    assert found.conflict
    assert diagnose(drawing).conflict == ()


def test_views_without_a_common_origin_are_told_from_their_spans():
    drawing = stepped_block(1)
    moved = changed(drawing, 1, drawing.top.segments + np.array([0, 100]), drawing.top.hidden)
    assert diagnose(drawing).spans == ()
    assert diagnose(moved).spans == ("y runs from 100 to 130 in the top view, from 0 to 30 in the side view",)

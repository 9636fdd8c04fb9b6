"""Contours that cross, repeat or break off are named by number and place."""

import numpy as np
import pytest
from generated_mountains import mountain_contours

from recon.errors import BadGeometry
from recon.geometry.contour_map import ContourMap
from recon.terrain.faults import checked_contours


def with_line(line, height=25.0):
    contours = mountain_contours(1)
    return len(contours.lines), ContourMap([*contours.lines, line], [*contours.heights, height], contours.extent)


def test_a_sound_map_stays_as_it_is():
    contours = mountain_contours(1)
    same, notes = checked_contours(contours, 1.0, mend=False)
    assert notes == ()
    np.testing.assert_array_equal(np.concatenate(same.lines), np.concatenate(contours.lines))


def test_a_contour_across_others_is_refused_with_both_numbers():
    number, crossed = with_line(np.array([[0.0, 200.0], [600.0, 210.0]]))
    with pytest.raises(BadGeometry, match=rf"crosses or touches {number} near \(\d+\.\d, 2\d\d\.\d\)"):
        checked_contours(crossed, 1.0, mend=True)


def test_a_repeated_contour_is_refused_or_left_out_and_named():
    original = mountain_contours(1).lines[2]
    number, repeated = with_line(original[::-1])
    with pytest.raises(BadGeometry, match=f"{number} repeats 2 near .*--mend"):
        checked_contours(repeated, 1.0, mend=False)
    part, notes = checked_contours(repeated, 1.0, mend=True)
    assert len(part.lines) == number
    assert f"{number} repeats 2" in notes[0]


def test_ends_inside_the_map_are_named():
    contours = mountain_contours(1)
    longest = int(np.argmax([len(line) for line in contours.lines]))
    lines = [line if i != longest else line[: len(line) // 2] for i, line in enumerate(contours.lines)]
    _, notes = checked_contours(ContourMap(lines, contours.heights, contours.extent), 1.0, mend=False)
    assert "break off inside the map" in notes[0]
    assert f"{longest} near" in notes[0]


def test_a_contour_that_crosses_itself_is_named():
    number, looped = with_line(np.array([[595.0, 1.0], [599.0, 5.0], [599.0, 1.0], [595.0, 5.0]]))
    with pytest.raises(BadGeometry, match=f"{number} crosses itself"):
        checked_contours(looped, 1.0, mend=False)


def test_contours_in_pieces_are_joined_whichever_way_they_run_and_named():
    contours = mountain_contours(1)
    lines, heights = [], []
    for line, height in zip(contours.lines, contours.heights):
        k, m = len(line) // 3, 2 * len(line) // 3
        pieces = [line[k : m + 1][::-1], line[: k + 1], line[m:]] if len(line) > 9 else [line]
        lines += pieces
        heights += [height] * len(pieces)
    assert len(lines) > len(contours.lines)
    whole, notes = checked_contours(ContourMap(lines, heights, contours.extent), 1.0, mend=False)
    assert "come in pieces, which were joined: 0 near" in notes[0] and len(notes) == 1
    assert sorted(map(len, whole.lines)) == sorted(map(len, contours.lines))
    for line, joined in zip(contours.lines, whole.lines):
        assert {*map(tuple, line.tolist())} == {*map(tuple, joined.tolist())}
        assert (joined[0] == joined[-1]).all() == (line[0] == line[-1]).all()
        steps = [np.linalg.norm(np.diff(row, axis=0), axis=1).sum() for row in (line, joined)]
        assert steps[0] == pytest.approx(steps[1])


def test_pieces_of_other_heights_and_three_that_meet_are_not_joined():
    corner = np.array([300.0, 300.0])
    ways = [corner + 200.0 * np.array([[np.cos(a), np.sin(a)], [0.0, 0.0]]) for a in (0.3, 2.4, 4.5)]
    box = np.array([[0.0, 0.0], [600.0, 600.0]])
    for heights in ([10.0, 10.0, 10.0], [10.0, 20.0, 30.0]):
        with pytest.raises(BadGeometry, match="0 crosses or touches 1 near"):
            checked_contours(ContourMap(ways, heights, box), 1.0, mend=False)


def test_a_repeated_piece_is_no_way_back():
    line = mountain_contours(1).lines[2]
    number, repeated = with_line(line, float(mountain_contours(1).heights[2]))
    part, _ = checked_contours(repeated, 1.0, mend=True)
    assert len(part.lines) == number


def test_a_map_without_an_extent_has_room_where_contours_only_touch_its_box():
    turn = np.linspace(0.0, 2.0 * np.pi, 61)
    turn[-1] = 0.0
    ring = 100.0 * np.column_stack([np.cos(turn), np.sin(turn)])
    across = np.column_stack([np.linspace(-300.0, 300.0, 61), np.full(61, -200.0)])
    step = float(np.median(np.linalg.norm(np.diff(np.vstack([ring, across]), axis=0), axis=1)[:60]))
    alone = ContourMap([ring], [10.0])
    both = ContourMap(
        [ring, across, [[-300.0, 0.0], [-280.0, 9.0]], [[300.0, 0.0], [280.0, 9.0]]], [10.0, 0.0, 5.0, 5.0]
    )
    assert alone.extent == pytest.approx(np.array([[-1.0, -1.0], [1.0, 1.0]]) * (100.0 + step), abs=0.6)
    assert both.extent[:, 0].tolist() == [-300.0, 300.0]  # lines end there: so does the map
    assert both.extent[0, 1] < -205.0 and both.extent[1, 1] > 105.0

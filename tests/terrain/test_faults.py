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

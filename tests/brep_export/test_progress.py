"""The line of progress says how long a job has worked, and how long yet where its steps are counted."""

import pytest

from brep_export.app.progress import SHORT, Clock


class Time:
    def __init__(self):
        self.seconds = 100.0

    def __call__(self):
        return self.seconds


@pytest.fixture
def time():
    return Time()


def test_short_work_shows_no_time(time):
    clock = Clock(time)
    clock.hear("reading")
    time.seconds += SHORT / 2
    assert clock.line() == "reading"
    time.seconds += SHORT
    assert clock.line() == "reading, 3 s"


def test_steps_that_are_counted_foretell_their_end(time):
    clock = Clock(time)
    time.seconds += 60.0
    clock.hear("proving solids (1 of 4)")
    assert clock.left() is None
    time.seconds += 10.0
    clock.hear("proving solids (2 of 4)")
    assert clock.left() == 30.0
    assert clock.line() == "proving solids (2 of 4), 1 min 10 s, about 30 s left"


def test_another_count_begins_anew(time):
    clock = Clock(time)
    clock.hear("proving solids (1 of 2)")
    time.seconds += 50.0
    clock.hear("drawing (1 of 3)")
    time.seconds += 1.0
    clock.hear("drawing (2 of 3)")
    assert clock.left() == 2.0
    clock.hear("writing")
    assert clock.left() is None

"""The line of progress says how long a job has worked, and how long yet where its steps are counted."""

import pytest

from brep_export.app.earlier_runs import EarlierRun, RunKey, kind_of, recall, remember, run_key
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


def earlier(*steps, seconds=100.0, size=1000):
    return EarlierRun("", size, steps, seconds)


def test_an_earlier_run_foretells_what_follows(time):
    clock = Clock(time, earlier=earlier(("reading", 0.0), ("fitting", 10.0), ("writing", 90.0)), size=1000)
    clock.hear("reading")
    assert clock.left() == 100.0
    time.seconds += 20.0
    clock.hear("fitting")
    assert clock.left() == 180.0, "twice as slow as then"
    time.seconds += 30.0
    assert clock.line() == "fitting, 50 s, about 2 min 30 s left"


def test_larger_inputs_are_expected_to_take_longer(time):
    clock = Clock(time, earlier=earlier(("reading", 0.0), ("fitting", 1.0)), size=3000)
    clock.hear("reading")
    assert clock.left() == 300.0


def test_rounds_follow_each_other_and_more_of_them_are_no_surprise(time):
    clock = Clock(time, earlier=earlier(("round #", 10.0), ("round #", 50.0)), size=1000)
    for number, seconds in ((1, 10.0), (2, 40.0), (3, 40.0)):
        time.seconds += seconds
        clock.hear(f"round {number}")
    assert clock.left() == 50.0 * 90.0 / 50.0
    time.seconds += 91.0
    assert clock.left() is None, "nobody knows"


def test_a_step_of_which_the_earlier_run_knows_nothing(time):
    clock = Clock(time, earlier=earlier(("reading", 0.0)), size=1000)
    clock.hear("drawing")
    assert clock.left() is None


def test_rounds_are_of_one_kind():
    assert kind_of("round 3: 1,204 control points, error 1.2e-05 %") == kind_of(
        "round 11: 96 control points, error 3 %"
    )


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setattr("platformdirs.user_cache_path", lambda name: tmp_path / name)
    return tmp_path / "recon-brep"


def test_runs_are_recalled_by_their_options_first(cache):
    plain, exact = RunKey("fit", "plain", 1000), RunKey("fit", "exact", 2000)
    assert recall(plain) is None
    remember(plain, [("reading", 0.0)], 5.0)
    remember(exact, [("reading", 0.0)], 50.0)
    assert recall(plain).seconds == 5.0
    assert recall(RunKey("fit", "other", 1)).seconds == 50.0, "the last, where none is alike"
    assert recall(RunKey("patch", "plain", 1000)) is None
    remember(plain, [("reading", 0.0)], 7.0)
    assert recall(plain).seconds == 7.0
    assert len(list(cache.iterdir())) == 1


@pytest.mark.parametrize("text", ["", "{", "[1]", '[{"steps": 3}]', '{"steps": []}'])
def test_what_cannot_be_understood_is_forgotten(cache, text):
    cache.mkdir()
    (cache / "fit.json").write_text(text)
    key = RunKey("fit", "plain", 1000)
    assert recall(key) is None
    remember(key, [], 5.0)
    assert recall(key).seconds == 5.0


def test_a_folder_that_cannot_be_written_is_no_trouble(cache):
    cache.write_text("a file in its place")
    key = RunKey("fit", "plain", 1000)
    remember(key, [], 5.0)
    assert recall(key) is None


def test_runs_are_alike_by_what_was_chosen_not_by_their_files(tmp_path):
    (tmp_path / "a.ply").write_bytes(b"12345")
    request = {
        "inputs": [str(tmp_path / "a.ply"), "missing.ply"],
        "outputs": ["a.step"],
        "tolerance": 0.1,
        "smooth": None,
    }
    key = run_key("fit", request)
    assert key.size == 5
    assert (
        key.options
        == run_key("fit", {**request, "inputs": [], "outputs": ["b.step"], "page": "another folder"}).options
    )
    assert key.options != run_key("fit", {**request, "tolerance": 0.2}).options

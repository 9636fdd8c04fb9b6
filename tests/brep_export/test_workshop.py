"""However a job ends, the front desk gets a sentence, and no temporary file stays."""

import ast
from pathlib import Path

from brep_export.app import workshop
from brep_export.app.note_names import NOTES
from brep_export.app.workshop import Bench, Exit, run


def job(name):
    return f"workshop_jobs:{name}"


def test_a_good_job_answers_and_what_libraries_print_stays_away(capfd):
    steps, notes = [], []
    outcome = run(job("good"), {"word": "clay"}, doing=steps.append, note=notes.append)
    assert outcome.status is Exit.WRITTEN
    assert outcome.result == {"echo": "clay", "phases": ["read"]}
    assert (steps, notes) == (["reading"], ["a remark"])
    assert capfd.readouterr() == ("", "")


def test_bad_input_and_refusal_differ_in_status():
    assert run(job("bad_input"), {"word": "mud"}).status is Exit.BAD_INPUT
    refused = run(job("refused"), {})
    assert (refused.status, refused.reasons) == (Exit.REFUSED, ("there is no hole.",))


def test_a_fault_of_our_own_is_one_sentence_with_its_place():
    outcome = run(job("faulty"), {"zero": 0})
    assert outcome.status is Exit.REFUSED
    assert "ZeroDivisionError" in outcome.reasons[0] and "workshop_jobs.py" in outcome.reasons[0]
    assert "\n" not in outcome.reasons[0] and "Traceback" in outcome.trace


def test_want_of_memory_is_said():
    assert "memory" in run(job("hungry"), {}).reasons[0]


def test_a_crash_names_the_step_and_leaves_no_file(tmp_path):
    half = tmp_path / "half.step"
    outcome = run(job("crash"), {"file": str(half)})
    assert outcome.status is Exit.REFUSED
    assert "cutting" in outcome.reasons[0] and "SIGSEGV" in outcome.reasons[0]
    assert not half.exists()


def test_files_that_were_finished_before_a_crash_stay_and_are_told_of(tmp_path):
    first, half = tmp_path / "first.step", tmp_path / "half.step"
    (reason,) = run(job("crash_at_the_second"), {"first": str(first), "file": str(half)}).reasons
    assert f"1 file was finished before: {first}" in reason
    assert first.exists() and not half.exists()


def test_an_interrupt_tells_of_finished_files_too(tmp_path):
    def interrupt(step):
        raise KeyboardInterrupt

    first, half = tmp_path / "first.step", tmp_path / "half.step"
    outcome = run(job("crash_at_the_second"), {"first": str(first), "file": str(half)}, doing=interrupt)
    assert outcome.status is Exit.INTERRUPTED
    assert outcome.reasons == (f"interrupted; 1 file was finished before: {first}.",)
    assert not half.exists()


def test_a_job_that_never_ends_is_stopped_and_leaves_no_file(tmp_path):
    half = tmp_path / "half.step"
    outcome = run(job("endless"), {"file": str(half)}, timeout=6.0)
    assert outcome.status is Exit.REFUSED
    assert "waiting" in outcome.reasons[0] and "--timeout" in outcome.reasons[0]
    assert not half.exists()


def test_a_note_is_silenced_by_its_name_and_kept_for_the_answer():
    told = []
    bench = Bench(told.append, frozenset({"thin-wall"}))
    bench.note("the wall is thin", name="thin-wall")
    bench.note("a hole is left out", name="hole-left-out")
    assert told == [("note", "a hole is left out [hole-left-out]")]
    assert bench.notes == ["the wall is thin", "a hole is left out"]


def test_every_note_of_a_job_has_a_name_that_can_be_silenced():
    jobs = Path(workshop.__file__).parent.glob("*.py")
    calls = [
        node
        for path in jobs
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "note"
    ]
    named = [keyword.value.value for call in calls for keyword in call.keywords if keyword.arg == "name"]
    assert len(named) == len(calls) > 10
    assert set(named) == set(NOTES)
